//! What of a flight is told as a list: facts, losses, modes, messages, configuration, parameters, pairs.

use std::fmt::Write as _;

use super::flight::Flight;
use super::html::{self, Cell};
use super::svg::escape;
use haltere_core::time::HostTime;

/// Messages shown; more would be a page of their own.
const MOST_TEXTS: usize = 400;

/// What to know first.
pub(super) fn facts(html: &mut String, flight: &Flight) {
    if flight.facts.is_empty() {
        return;
    }
    html.push_str("<dl class=\"facts\">");
    for (name, value) in &flight.facts {
        let _ = write!(html, "<div><dt>{}</dt><dd>{}</dd></div>", escape(name), escape(value));
    }
    html.push_str("</dl>");
}

/// The lists at the end of the page.
pub(super) fn all(html: &mut String, flight: &Flight) {
    losses(html, flight);
    modes(html, flight);
    parameters(html, flight);
    configuration(html, flight);
    texts(html, flight);
    pairs(html, flight);
}

fn section(html: &mut String, title: &str, open: bool, heads: &[&str], rows: &[Vec<Cell>]) {
    if rows.is_empty() {
        return;
    }
    let open = if open { " open" } else { "" };
    let table = html::table(heads.iter().copied(), rows);
    let _ = write!(html, "<details{open}><summary>{}</summary>{table}</details>", escape(title));
}

/// Since the nought of the time axes, s.
fn seconds(flight: &Flight, at: HostTime) -> Cell {
    let start = flight.started.or(flight.ends().map(|ends| ends.0)).unwrap_or_default();
    format!("{:.1}", at.seconds_since(start)).into()
}

/// Modes as a list for people who cannot see the shading.
fn modes(html: &mut String, flight: &Flight) {
    let rows = flight.modes.iter();
    let rows =
        rows.map(|row| vec![seconds(flight, row.at), (&row.mode).into(), (&row.cause).into()]);
    section(html, "Modes", true, &["#s", "mode", "cause"], &rows.collect::<Vec<_>>());
}

fn losses(html: &mut String, flight: &Flight) {
    let drops = flight.drops();
    let rows = drops.iter().map(|(reason, count)| {
        let usual = if reason.is_usual() { ", as at every start" } else { "" };
        vec![format!("{}{usual}", reason.name().replace('_', " ")).into(), count.to_string().into()]
    });
    let mut rows: Vec<Vec<Cell>> = rows.collect();
    if rows.is_empty() {
        let known = !flight.health.is_empty();
        let text = if known { "nothing was thrown away" } else { "not told in this log" };
        rows.push(vec![text.into()]);
    }
    section(html, "Losses, by reason", true, &["reason", "#count"], &rows);
}

fn parameters(html: &mut String, flight: &Flight) {
    let rows = flight.parameters.iter().map(|row| {
        let from = row.from.map_or("\u{2013}".to_owned(), |v| v.to_string());
        let rest = [&row.name, &from, &row.to.to_string(), &row.unit].map(Cell::from);
        std::iter::once(seconds(flight, row.at)).chain(rest).collect()
    });
    let heads = ["#s", "parameter", "#before", "#since then", "unit"];
    let rows: Vec<Vec<Cell>> = rows.collect();
    section(html, "Parameters changed by a station", true, &heads, &rows);
}

fn configuration(html: &mut String, flight: &Flight) {
    let rows = flight.configuration.iter().map(|row| row.iter().map(Cell::from).collect());
    let rows: Vec<Vec<Cell>> = rows.collect();
    let heads = ["key", "flown with", "default"];
    section(html, "Configuration, where it differs from the defaults", true, &heads, &rows);
}

fn texts(html: &mut String, flight: &Flight) {
    let rows = flight.texts.iter().take(MOST_TEXTS).map(|text| {
        let (class, word) = match text.severity {
            0..=3 => ("bad", "error"),
            4 => ("none", "warning"),
            _ => ("", "note"),
        };
        vec![seconds(flight, text.at), Cell::of(class, word), (&text.text).into()]
    });
    let mut rows: Vec<Vec<Cell>> = rows.collect();
    if let Some(more) = flight.texts.len().checked_sub(MOST_TEXTS + 1) {
        rows.push(vec!["".into(), "".into(), format!("and {} more", more + 1).into()]);
    }
    section(html, "Messages", true, &["#s", "", "what people were told"], &rows);
}

fn pairs(html: &mut String, flight: &Flight) {
    let number = |value: Option<f64>| value.map_or("\u{2013}".to_owned(), |v| format!("{v:.3}"));
    let rows = flight.pairs().into_iter().map(|((a, b), stats)| {
        let pair = format!("{a}\u{2013}{b}");
        let counts = [stats.fused, stats.rejected].map(|n| n.to_string());
        let sizes = [stats.mean_m(), stats.std_m(), stats.mean_normalised()].map(number);
        [pair].iter().chain(&counts).chain(&sizes).map(Cell::from).collect()
    });
    let rows: Vec<Vec<Cell>> = rows.collect();
    let heads = ["pair", "#fused", "#rejected", "#mean, m", "#std, m", "#consistency"];
    section(html, "Innovations by pair", false, &heads, &rows);
}
