//! What every page of ours has in common: head, style, header, tables, the end.

use std::fmt::Write as _;

use crate::report::svg::escape;
use crate::report::verdict::{Check, Verdict};

/// Style of every page.
const STYLE: &str = include_str!("page.css");
/// Shows the values under the pointer.
const SCRIPT: &str = include_str!("page.js");

/// The begin of a page, with style of its own behind the common one.
pub fn open(title: &str, own_style: &str) -> String {
    let mut html = String::with_capacity(1 << 20);
    let _ = write!(
        html,
        "<!DOCTYPE html><html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
         <title>{}</title><style>{STYLE}{own_style}</style></head><body><main>",
        escape(title),
    );
    html
}

/// Heading and what stands under it, with a badge where somebody has judged: its class and its words.
pub fn header(badge: Option<(&str, &str)>, title: &str, subtitle: &str) -> String {
    let badge = badge.map_or_else(String::new, |(class, words)| {
        format!("<span class=\"verdict {class}\">{}</span>", escape(words))
    });
    format!(
        "<header>{badge}<div><h1>{}</h1><p>{}</p></div></header>",
        escape(title),
        escape(subtitle)
    )
}

/// The sentence that says what came out, of a class: good, bad or none.
pub fn said(class: &str, sentence: &str) -> String {
    format!("<p class=\"said {class}\">{}</p>", escape(sentence))
}

/// The end of a page.
pub fn close(mut html: String) -> String {
    let _ = write!(html, "</main><script>{SCRIPT}</script></body></html>");
    html
}

/// Class of a cell of words that wrap, among numbers too.
pub const WRAPS: &str = "why";

/// A cell of a table.
#[derive(Debug, Clone)]
pub struct Cell {
    class: &'static str,
    html: String,
}

impl Cell {
    /// Of a class of its own: good, bad, none, or [`WRAPS`].
    pub fn of(class: &'static str, text: &str) -> Self {
        Self { class, html: escape(text) }
    }

    /// The same of what is HTML already.
    pub fn markup(class: &'static str, html: String) -> Self {
        Self { class, html }
    }
}

impl<T: AsRef<str>> From<T> for Cell {
    fn from(text: T) -> Self {
        Self::of("", text.as_ref())
    }
}

/// A table. Heads that begin with # are of numbers. Nothing without a row, and no column in which nothing stands.
pub fn table<'a>(heads: impl IntoIterator<Item = &'a str>, rows: &[Vec<Cell>]) -> String {
    let filled = |k: usize| rows.iter().any(|row| row.get(k).is_some_and(|c| !c.html.is_empty()));
    let columns: Vec<(usize, &str)> =
        heads.into_iter().enumerate().filter(|(k, _)| filled(*k)).collect();
    let mut html = String::new();
    if columns.is_empty() {
        return html;
    }
    let class = |class: &str| match class.trim() {
        "" => String::new(),
        class => format!(" class=\"{class}\""),
    };
    let number = |head: &str| if head.starts_with('#') { "n" } else { "" };
    html.push_str("<table><thead><tr>");
    for (_, head) in &columns {
        let name = escape(head.trim_start_matches('#'));
        let _ = write!(html, "<th{}>{name}</th>", class(number(head)));
    }
    html.push_str("</tr></thead><tbody>");
    for row in rows {
        html.push_str("<tr>");
        for (k, head) in &columns {
            let (own, text) = row.get(*k).map_or(("", ""), |cell| (cell.class, &cell.html));
            let number = if own == WRAPS { "" } else { number(head) };
            let _ = write!(html, "<td{}>{text}</td>", class(&format!("{number} {own}")));
        }
        html.push_str("</tr>");
    }
    html.push_str("</tbody></table>");
    html
}

/// A table under a heading; nothing without a row.
pub fn titled<'a>(
    title: &str,
    heads: impl IntoIterator<Item = &'a str>,
    rows: &[Vec<Cell>],
) -> String {
    if rows.is_empty() { String::new() } else { heading(title) + &table(heads, rows) }
}

/// A heading within a page.
pub fn heading(title: &str) -> String {
    format!("<h2>{}</h2>", escape(title))
}

/// Words that explain a picture or a table.
pub fn note(words: &str) -> String {
    format!("<p class=\"note\">{}</p>", escape(words))
}

/// A table of checks; nothing without a check.
pub fn checks(checks: &[Check]) -> String {
    let rows = checks.iter().map(|check| {
        let (class, word) = match &check.verdict {
            Verdict::Pass => ("good", "\u{2713} pass".to_string()),
            Verdict::Warn => ("none", "! look".to_string()),
            Verdict::Fail => ("bad", "\u{2717} fail".to_string()),
            Verdict::NotChecked { why } => ("bad", format!("\u{2717} not checked: {why}")),
        };
        let words = [&check.name, &check.found, &check.allowed].map(Cell::from);
        words.into_iter().chain([Cell::of(class, &word)]).collect()
    });
    table(["Bound", "Found", "Allowed", "Verdict"], &rows.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_table_has_no_column_in_which_nothing_stands() {
        let row = |a: &str| vec![Cell::from(a), Cell::from(""), Cell::of("bad", "7")];
        let html = table(["name <", "why", "#count"], &[row("x & y"), row("")]);
        assert_eq!(
            html,
            "<table><thead><tr><th>name &lt;</th><th class=\"n\">count</th></tr></thead><tbody>\
             <tr><td>x &amp; y</td><td class=\"n bad\">7</td></tr>\
             <tr><td></td><td class=\"n bad\">7</td></tr></tbody></table>"
        );
        assert_eq!(table(["a"], &[]), "");
    }
}
