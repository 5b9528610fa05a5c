//! The budget of a gap as one HTML page: what is left after each constant, and the table behind it.

use std::fmt::Write as _;

use super::bars;
use crate::report::html;
use crate::report::svg::{Limit, Tone, escape};
use haltere_gap::commission::budget::Budget;

/// The whole page. `logs`: names of the flights.
pub fn render(budget: &Budget, logs: &[String]) -> String {
    let mut html = html::open("Gap budget", super::OWN_STYLE);
    let tone = if budget.exit_code() == 0 { "good" } else { "bad" };
    let _ = write!(
        html,
        "<header><span class=\"verdict {tone}\">{}</span><div><h1>Gap budget</h1><p>{} against the vehicle file</p></div></header>\
         <p>{}</p>",
        escape(&budget.outcome.replace('_', " ")),
        escape(&logs.join(", ")),
        escape(&budget.words()),
    );
    section(&mut html, budget);
    html::close(html)
}

/// What differs, what each closes, what is left.
pub(super) fn section(html: &mut String, budget: &Budget) {
    let mut steps = vec![("file".to_owned(), vec![(Tone::Estimate, 1.0)])];
    steps.extend(budget.parts.iter().filter_map(|part| {
        Some((format!("+ {}", part.key), vec![(Tone::Estimate, part.left_after?)]))
    }));
    if steps.len() > 1 {
        let none = vec![Limit { name: "nothing is left".to_owned(), y: 0.0 }];
        let width_px = 160.0 * (steps.len() as f64 + 1.0);
        html.push_str(&bars("Left of the gap", "share of the gap", &steps, none, width_px));
    }
    if let Some(left) = budget.left {
        let _ = write!(
            html,
            "<p>{left:.2} of the gap is left in the end; {}.</p>",
            escape(&budget.told_on())
        );
    }
    if !budget.parts.is_empty() {
        html.push_str(
            "<h2>Constants that differ</h2><table><tr><th>Key</th><th class=\"n\">File</th><th class=\"n\">Found</th>\
             <th class=\"n\">90 %</th><th class=\"n\">Closes alone</th><th class=\"n\">Left after</th></tr>",
        );
        for part in &budget.parts {
            let share = |share: Option<f64>| share.map_or("-".to_owned(), |s| format!("{s:.2}"));
            let _ = write!(
                html,
                "<tr><td>{}{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{} to {}</td>\
                 <td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
                part.key,
                escape(&part.or_words()),
                number(part.file),
                number(part.value),
                number(part.low),
                number(part.high),
                share(part.share),
                share(part.left_after),
            );
        }
        html.push_str("</table>");
    }
    if !budget.blocks.is_empty() {
        html.push_str(
            "<h2>By block</h2><table><tr><th>Block</th><th class=\"n\">Before</th><th class=\"n\">Left</th></tr>",
        );
        for block in &budget.blocks {
            let _ = write!(
                html,
                "<tr><td>{}</td><td class=\"n\">{:.2}</td><td class=\"n\">{:.2}</td></tr>",
                block.block, block.before, block.left
            );
        }
        html.push_str(
            "</table><p class=\"note\">Mean squared distance of statistics beyond what simulated flights of the vehicle as found do to \
             one another, in sigma of what healthy vehicles differ by.</p>",
        );
    }
}

/// A constant of the vehicle file in four digits: some are millionths.
pub fn number(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 12) as usize;
    format!("{value:.digits$}")
}
