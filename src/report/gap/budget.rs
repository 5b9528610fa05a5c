//! The budget of a gap as one HTML page: what is left after each constant, and the table behind it.

use std::fmt::Write as _;

use super::bars;
use crate::report::html::{self, Cell};
use crate::report::svg::{Limit, Tone, escape};
use haltere_gap::commission::budget::Budget;

/// The whole page. `logs`: names of the flights.
pub fn render(budget: &Budget, logs: &[String]) -> String {
    let mut html = html::open("Gap budget", super::OWN_STYLE);
    let tone = if budget.exit_code() == 0 { "good" } else { "bad" };
    let badge = budget.outcome.key().replace('_', " ");
    let subtitle = format!("{} against the vehicle file", logs.join(", "));
    html += &html::header(Some((tone, &badge)), "Gap budget", &subtitle);
    let _ = write!(html, "<p>{}</p>", escape(&budget.words()));
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
    let share = |share: Option<f64>| share.map_or("-".to_owned(), |s| format!("{s:.2}"));
    let rows = budget.parts.iter().map(|part| {
        let interval = format!("{} to {}", number(part.low), number(part.high));
        let shares = [share(part.share), share(part.left_after)];
        let key = format!("{}{}", part.key, part.or_words());
        let cells = [key, number(part.file), number(part.value), interval].into_iter();
        cells.chain(shares).map(Cell::from).collect()
    });
    let heads = ["Key", "#File", "#Found", "#90 %", "#Closes alone", "#Left after"];
    *html += &html::titled("Constants that differ", heads, &rows.collect::<Vec<_>>());
    if !budget.blocks.is_empty() {
        let rows = budget.blocks.iter().map(|block| {
            let [before, left] = [block.before, block.left].map(|value| format!("{value:.2}"));
            vec![Cell::from(&block.block), before.into(), left.into()]
        });
        let heads = ["Block", "#Before", "#Left"];
        *html += &html::titled("By block", heads, &rows.collect::<Vec<_>>());
        *html += &html::note(
            "Mean squared distance of statistics beyond what simulated flights of the vehicle as found do to one another, \
             in sigma of what healthy vehicles differ by.",
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
