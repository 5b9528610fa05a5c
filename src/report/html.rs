//! What every page of ours has in common: head, style, the table of what was checked, the end.

use std::fmt::Write as _;

use crate::report::svg::escape;
use crate::report::verdict::{Check, Verdict};

/// Style of every page.
pub const STYLE: &str = include_str!("page.css");
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

/// The end of a page.
pub fn close(mut html: String) -> String {
    let _ = write!(html, "</main><script>{SCRIPT}</script></body></html>");
    html
}

/// A table of checks; nothing without a check.
pub fn checks(checks: &[Check]) -> String {
    let mut html = String::new();
    if checks.is_empty() {
        return html;
    }
    html.push_str(
        "<table><thead><tr><th>Bound</th><th>Found</th><th>Allowed</th><th>Verdict</th></tr>\
         </thead><tbody>",
    );
    for check in checks {
        let (class, word) = match &check.verdict {
            Verdict::Pass => ("good", "\u{2713} pass".to_string()),
            Verdict::Warn => ("none", "! look".to_string()),
            Verdict::Fail => ("bad", "\u{2717} fail".to_string()),
            Verdict::NotChecked { why } => ("bad", format!("\u{2717} not checked: {why}")),
        };
        let _ = write!(
            html,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td class=\"{class}\">{}</td></tr>",
            escape(&check.name),
            escape(&check.found),
            escape(&check.allowed),
            escape(&word)
        );
    }
    html.push_str("</tbody></table>");
    html
}
