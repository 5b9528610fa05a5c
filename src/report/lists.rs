//! What of a flight is told as a list: facts, losses, modes, messages, configuration, parameters, pairs.

use std::fmt::Write as _;

use super::flight::Flight;
use super::plots;
use super::svg::escape;

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
    let modes = plots::mode_list(flight);
    if !modes.is_empty() {
        table(html, "Modes", true, &["#s", "mode", "cause"], &modes);
    }
    parameters(html, flight);
    configuration(html, flight);
    texts(html, flight);
    pairs(html, flight);
}

/// `heads` that begin with # are of numbers.
fn table(html: &mut String, title: &str, open: bool, heads: &[&str], rows: &str) {
    let open = if open { " open" } else { "" };
    let _ = write!(html, "<details{open}><summary>{}</summary><table><thead><tr>", escape(title));
    for head in heads {
        let _ = match head.strip_prefix('#') {
            Some(head) => write!(html, "<th class=\"n\">{}</th>", escape(head)),
            None => write!(html, "<th>{}</th>", escape(head)),
        };
    }
    let _ = write!(html, "</tr></thead><tbody>{rows}</tbody></table></details>");
}

fn losses(html: &mut String, flight: &Flight) {
    let drops = flight.drops();
    let mut rows = String::new();
    for (reason, count) in drops.iter() {
        let _ = write!(
            rows,
            "<tr><td>{}</td><td class=\"n\">{count}</td></tr>",
            escape(&reason.name().replace('_', " "))
        );
    }
    if rows.is_empty() {
        let known = !flight.health.is_empty();
        let text = if known { "nothing was thrown away" } else { "not told in this log" };
        let _ = write!(rows, "<tr><td>{text}</td><td></td></tr>");
    }
    table(html, "Losses, by reason", true, &["reason", "#count"], &rows);
}

fn parameters(html: &mut String, flight: &Flight) {
    let start = flight.started.or(flight.ends().map(|ends| ends.0)).unwrap_or_default();
    let mut rows = String::new();
    for row in &flight.parameters {
        let from = row.from.map_or("\u{2013}".to_owned(), |v| v.to_string());
        let _ = write!(
            rows,
            "<tr><td class=\"n\">{:.1}</td><td>{}</td><td class=\"n\">{from}</td>\
             <td class=\"n\">{}</td><td>{}</td></tr>",
            row.at.seconds_since(start),
            escape(&row.name),
            row.to,
            escape(&row.unit)
        );
    }
    if !rows.is_empty() {
        let heads = ["#s", "parameter", "#before", "#since then", "unit"];
        table(html, "Parameters changed by a station", true, &heads, &rows);
    }
}

fn configuration(html: &mut String, flight: &Flight) {
    let mut rows = String::new();
    for [key, value, default] in &flight.configuration {
        let _ = write!(
            rows,
            "<tr><td>{}</td><td>{}</td><td>{}</td></tr>",
            escape(key),
            escape(value),
            escape(default)
        );
    }
    if !rows.is_empty() {
        let heads = ["key", "flown with", "default"];
        table(html, "Configuration, where it differs from the defaults", true, &heads, &rows);
    }
}

fn texts(html: &mut String, flight: &Flight) {
    let start = flight.started.or(flight.ends().map(|ends| ends.0)).unwrap_or_default();
    let mut rows = String::new();
    for text in flight.texts.iter().take(MOST_TEXTS) {
        let (class, word) = match text.severity {
            0..=3 => ("bad", "error"),
            4 => ("none", "warning"),
            _ => ("", "note"),
        };
        let _ = write!(
            rows,
            "<tr><td class=\"n\">{:.1}</td><td class=\"{class}\">{word}</td><td>{}</td></tr>",
            text.at.seconds_since(start),
            escape(&text.text)
        );
    }
    if flight.texts.len() > MOST_TEXTS {
        let more = flight.texts.len() - MOST_TEXTS;
        let _ = write!(rows, "<tr><td></td><td></td><td>and {more} more</td></tr>");
    }
    if !rows.is_empty() {
        table(html, "Messages", true, &["#s", "", "what people were told"], &rows);
    }
}

fn pairs(html: &mut String, flight: &Flight) {
    let mut rows = String::new();
    for ((a, b), stats) in flight.pairs() {
        let number =
            |value: Option<f64>| value.map_or("\u{2013}".to_owned(), |v| format!("{v:.3}"));
        let _ = write!(
            rows,
            "<tr><td>{a}\u{2013}{b}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
             <td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
            stats.fused,
            stats.rejected,
            number(stats.mean_m()),
            number(stats.std_m()),
            number(stats.mean_normalised())
        );
    }
    if !rows.is_empty() {
        let heads = ["pair", "#fused", "#rejected", "#mean, m", "#std, m", "#consistency"];
        table(html, "Innovations by pair", false, &heads, &rows);
    }
}
