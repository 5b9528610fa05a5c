//! What to do next: experiments with what they are worth.

use std::fmt::Write as _;

use crate::report::html::{self, Cell};
use crate::report::svg::escape;
use haltere_gap::advice::experiments::telling_apart;
use haltere_gap::bank::library::find;
use haltere_gap::diagnosis::{Diagnosis, Effect};
use haltere_gap::outcome::Ending;

use super::named;

/// Experiments that the table lists.
const LISTED: usize = 10;
/// Effects whose repair is told: of a long set the first ones.
const REPAIRS: usize = 3;
/// Worth below which an experiment would change nothing.
const LEAST_WORTH: f64 = 0.01;
/// Probability from which an experiment "would show" an effect.
const SHOWS: f64 = 0.5;

/// Candidates that are left, in a line.
pub(super) fn open(d: &Diagnosis) -> String {
    let Some(a) = d.advice.as_ref().filter(|a| a.open.len() > 1) else { return String::new() };
    let all: Vec<String> = a.open.iter().map(|(id, p)| format!("{} {p:.2}", named(id))).collect();
    escape(&all.join(", "))
}

/// What to do about what is named, cheapest first: of a set the test that tells it apart, before anything is replaced.
pub(super) fn remedy(d: &Diagnosis) -> String {
    let mut steps = Vec::new();
    if d.effects.len() > 1 && d.outcome == Ending::OneOf {
        let cheapest = telling_apart(&d.set).into_iter().next();
        steps.extend(cheapest.map(|e| {
            let minutes = (e.whole_cost_s() / 60.0).ceil();
            format!("<b>first {}</b> ({minutes:.0} min): {}", escape(e.title), escape(e.how))
        }));
    }
    let if_it_is = if steps.is_empty() { "" } else { "if it is " };
    let of = |e: &Effect| {
        let remedy = find(&e.id).map_or("", |spec| spec.remedy());
        format!("{if_it_is}{} {}: {}", escape(&e.id), escape(&e.name), escape(remedy))
    };
    steps.extend(repaired(d).map(of));
    steps.join("<br>")
}

/// Effects whose repair is told.
fn repaired(d: &Diagnosis) -> impl Iterator<Item = &Effect> {
    d.effects.iter().filter(|_| d.outcome.is_explained()).take(REPAIRS)
}

/// The first advice, in a line.
pub(super) fn first(d: &Diagnosis) -> String {
    let best = d.advice.as_ref().and_then(|a| Some((a, a.experiments.first()?)));
    let Some((a, best)) = best.filter(|(_, e)| e.value() > 0.0) else { return String::new() };
    let kind = if best.flight { "fly" } else { "bench" };
    let worth = match best.correct_after {
        Some(p) => format!(": probability of the right name {:.2} → {p:.2}", a.correct_now),
        None => String::new(),
    };
    escape(&format!("{kind}: {} ({:.0} s){worth}", best.title, best.cost_s))
}

/// The table.
pub(super) fn section(html: &mut String, d: &Diagnosis) {
    html.push_str("<h2>What next</h2>");
    for effect in repaired(d) {
        let _ = write!(
            html,
            "<p><b>{} {}</b> in the simulator: <code>haltere gap accept REPORT.json --effect {} \
             --scenario FILE</code>, <code>haltere gap undo FILE</code> takes it back.</p>",
            escape(&effect.id),
            escape(&effect.name),
            escape(&effect.id)
        );
    }
    let Some(a) = &d.advice else {
        html.push_str("<p class=\"note\">No advice was asked for: <code>haltere gap advise REPORT.json</code>.</p>");
        return;
    };
    if a.experiments.is_empty() {
        html.push_str("<p>Nothing is open: one explanation, and no effect of the library that this flight could not have shown.</p>");
        return;
    }
    let worth =
        a.experiments.iter().filter(|e| e.not_possible.is_none() && e.value() >= LEAST_WORTH);
    let number = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:.2}"));
    let rows = worth.take(LISTED).map(|e| {
        let hardest = e
            .hardest
            .as_ref()
            .map_or(String::new(), |(x, y, d)| format!("{x} and {y}: {d:.1} sigma"));
        let shown = e.would_show.iter().filter(|(_, p)| *p >= SHOWS);
        let shown: Vec<String> = shown.map(|(id, p)| format!("{id} {p:.2}")).collect();
        let (how, title) = (escape(&e.how), escape(&e.title));
        vec![
            Cell::markup("", format!("<span title=\"{how}\">{title}</span>")),
            (if e.flight { "fly" } else { "bench" }).into(),
            format!("{:.0} s", e.cost_s).into(),
            number(e.correct_after).into(),
            number(e.gain).into(),
            hardest.into(),
            shown.join(", ").into(),
        ]
    });
    let heads = ["Experiment", "", "#Cost", "#P after", "#Gain", "Hardest pair", "Would show"];
    *html += &html::table(heads, &rows.collect::<Vec<_>>());
    let _ = write!(
        html,
        "<p class=\"note\">P: predicted probability that the right one of {} is named, now {:.2}; from flights \
         of these candidates in the nominal simulator, and from the resolution of instruments. Costs with two minutes of \
         preparation a flight. Mission files: <code>haltere gap advise REPORT.json --out DIR</code>, then <code>haltere ctl \
         mission FILE</code>.</p>",
        escape(&a.open.iter().map(|(id, _)| id.as_str()).collect::<Vec<_>>().join(", ")),
        a.correct_now
    );
    for e in &a.experiments {
        if let Some(why) = &e.not_possible {
            let _ = write!(
                html,
                "<p class=\"note\">Not here: {}: {}.</p>",
                escape(&e.title),
                escape(why)
            );
        }
    }
}
