//! What a fit says: parameters with errors, quality, tables, plots, and a configuration snippet, as
//! text, JSON and one HTML page.

use std::fmt::Write as _;

use serde::Serialize;

use super::programs::Program;
use super::value::Value;
use crate::report::STYLE;
use crate::report::svg::{Plot, escape};
use haltere_core::checks::Problems;
use haltere_pilot::settings::Config;

/// Size of a plot that is the only one, pixels.
const ALONE_PX: [f64; 2] = [1120.0, 380.0];

/// Probability of the intervals that are shown.
const SHOWN: f64 = 0.95;

/// Cells longer than this wrap.
const LONG_CELL: usize = 30;

/// A parameter with its name and unit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Named {
    /// What it is.
    pub name: String,
    /// Unit, empty for none.
    pub unit: &'static str,
    /// Value and standard error.
    #[serde(flatten)]
    pub value: Value,
}

/// A figure that says how good the fit is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Quality {
    /// What it is.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Unit, empty for none.
    pub unit: &'static str,
}

/// A table for the eye.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Table {
    /// Heading.
    pub title: String,
    /// Names of the columns.
    pub head: Vec<String>,
    /// Rows of cells.
    pub rows: Vec<Vec<String>>,
}

/// Result of a fit.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Outcome {
    /// `drag`, `thrust`, …
    pub what: &'static str,
    /// Files that it was fitted on.
    pub source: Vec<String>,
    /// The law that was fitted, as an equation in words people can read.
    pub law: String,
    /// Parameters.
    pub parameters: Vec<Named>,
    /// Quality.
    pub quality: Vec<Quality>,
    /// Tables.
    pub tables: Vec<Table>,
    /// What the reader must know: range of validity, what was left out, what is not determined.
    pub notes: Vec<String>,
    /// TOML for the companion's configuration. `None`: nothing in it holds what was fitted.
    pub snippet: Option<String>,
    /// Drawings.
    #[serde(skip)]
    pub plots: Vec<Plot>,
}

/// Why a log gives no answer.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// The log does not hold what is asked.
    #[error("{why}; {}", .program.advice())]
    NotExcited {
        /// What is missing, with numbers.
        why: String,
        /// The flight that would show it.
        program: Program,
    },
    /// This kind of file cannot hold it.
    #[error("{why}")]
    WrongKind {
        /// Which file, and what would do.
        why: String,
    },
}

impl Outcome {
    /// An outcome without anything but its name and law.
    pub fn new(what: &'static str, source: Vec<String>, law: impl Into<String>) -> Self {
        Self {
            what,
            source,
            law: law.into(),
            parameters: Vec::new(),
            quality: Vec::new(),
            tables: Vec::new(),
            notes: Vec::new(),
            snippet: None,
            plots: Vec::new(),
        }
    }

    /// Adds a parameter.
    pub fn parameter(&mut self, name: impl Into<String>, unit: &'static str, value: Value) {
        self.parameters.push(Named { name: name.into(), unit, value });
    }

    /// Adds a figure of quality.
    pub fn quality(&mut self, name: impl Into<String>, value: f64, unit: &'static str) {
        self.quality.push(Quality { name: name.into(), value, unit });
    }

    /// Takes a snippet if the companion's configuration accepts it, else says why it does not.
    pub fn offer(&mut self, snippet: String) {
        match accepted(&snippet) {
            Ok(()) => self.snippet = Some(snippet),
            Err(problems) => self.notes.push(format!(
                "no configuration snippet: the companion would refuse these values ({})",
                problems.lines().join("; ")
            )),
        }
    }

    /// For the terminal.
    pub fn text(&self) -> String {
        let mut out = String::new();
        let _ = writeln!(out, "fit {}: {}", self.what, self.source.join(", "));
        let _ = writeln!(out, "{}", self.law);
        let width = self.parameters.iter().map(|p| p.name.chars().count()).max().unwrap_or(0);
        for p in &self.parameters {
            let [low, high] = p.value.interval(SHOWN);
            let _ = writeln!(
                out,
                "  {:<width$}  {} ± {} {}  (95 %: {} to {})",
                p.name,
                number(p.value.value),
                number(p.value.std),
                p.unit,
                number(low),
                number(high),
            );
        }
        for q in &self.quality {
            let _ = writeln!(out, "  {}: {} {}", q.name, number(q.value), q.unit);
        }
        for table in &self.tables {
            let _ = writeln!(out, "\n{}", table.title);
            let widths: Vec<usize> = (0..table.head.len())
                .map(|c| {
                    let cells = table.rows.iter().filter_map(|r| r.get(c));
                    cells.chain([&table.head[c]]).map(|x| x.chars().count()).max().unwrap_or(0)
                })
                .collect();
            for row in std::iter::once(&table.head).chain(&table.rows) {
                let cells: Vec<String> =
                    row.iter().zip(&widths).map(|(c, w)| format!("{c:>w$}")).collect();
                let _ = writeln!(out, "  {}", cells.join("  "));
            }
        }
        for note in &self.notes {
            let _ = writeln!(out, "note: {note}");
        }
        if let Some(snippet) = &self.snippet {
            let _ = write!(out, "\n{snippet}");
        }
        out
    }

    /// One self-contained page.
    pub fn html(&self) -> String {
        let mut html = String::new();
        let _ = write!(
            html,
            "<!DOCTYPE html><html lang=\"en\"><head><meta charset=\"utf-8\">\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\
             <title>Fit: {what}</title><style>{STYLE}</style></head><body><main>\
             <header><div><h1>Fit: {what}</h1><p>{}</p></div></header><p>{}</p>\
             <table><tr><th>Parameter</th><th class=\"n\">Value</th><th class=\"n\">Standard error</th>\
             <th class=\"n\">95 % interval</th><th>Unit</th></tr>",
            escape(&self.source.join(", ")),
            escape(&self.law),
            what = self.what,
        );
        for p in &self.parameters {
            let [low, high] = p.value.interval(SHOWN);
            let _ = write!(
                html,
                "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
                 <td class=\"n\">{} to {}</td><td>{}</td></tr>",
                escape(&p.name),
                number(p.value.value),
                number(p.value.std),
                number(low),
                number(high),
                escape(p.unit),
            );
        }
        html.push_str("</table>");
        if !self.quality.is_empty() {
            html.push_str("<h2>Quality</h2><table>");
            for q in &self.quality {
                let _ = write!(
                    html,
                    "<tr><td>{}</td><td class=\"n\">{} {}</td></tr>",
                    escape(&q.name),
                    number(q.value),
                    escape(q.unit)
                );
            }
            html.push_str("</table>");
        }
        if !self.plots.is_empty() {
            html.push_str("<h2>Data and fit</h2><div class=\"two\">");
            for plot in &self.plots {
                let mut plot = plot.clone();
                if self.plots.len() == 1 {
                    // Alone it gets the whole width; drawn for it, letters keep their size.
                    plot.size_px = ALONE_PX;
                }
                let _ = write!(html, "<figure>{}</figure>", plot.render());
            }
            html.push_str("</div>");
        }
        for table in &self.tables {
            let _ = write!(html, "<h2>{}</h2><table><tr>", escape(&table.title));
            for head in &table.head {
                let _ = write!(html, "<th class=\"n\">{}</th>", escape(head));
            }
            html.push_str("</tr>");
            for row in &table.rows {
                html.push_str("<tr>");
                for cell in row {
                    // A long one may wrap.
                    let class = if cell.chars().count() > LONG_CELL { "" } else { "n" };
                    let _ = write!(html, "<td class=\"{class}\">{}</td>", escape(cell));
                }
                html.push_str("</tr>");
            }
            html.push_str("</table>");
        }
        if !self.notes.is_empty() {
            html.push_str("<h2>What to know</h2><ul>");
            for note in &self.notes {
                let _ = write!(html, "<li>{}</li>", escape(note));
            }
            html.push_str("</ul>");
        }
        if let Some(snippet) = &self.snippet {
            let _ = write!(html, "<h2>For the configuration</h2><pre>{}</pre>", escape(snippet));
        }
        html.push_str(
            "<p class=\"note\">Standard errors count the time over which noise lasts; intervals take \
             Student's quantile for how well that is known.</p></main></body></html>",
        );
        html
    }
}

/// Whether the companion's configuration takes a snippet.
pub fn accepted(snippet: &str) -> Result<(), Problems> {
    let config = Config::from_toml("snippet", snippet)?;
    let mut problems = Problems::new();
    config.check(&mut problems);
    problems.into_result()
}

/// Four significant digits without a zero too many.
pub fn number(value: f64) -> String {
    if !value.is_finite() {
        return format!("{value}");
    }
    if value == 0.0 {
        return "0".to_owned();
    }
    let digits = (3 - value.abs().log10().floor() as i32).clamp(0, 8) as usize;
    format!("{value:.digits$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_snippet_that_the_companion_refuses_is_not_offered() {
        let mut outcome = Outcome::new("drag", vec!["a".into()], "law");
        outcome.offer("[control.ground]\nlambda_m2 = 0.00093\na_m = 0.4213\n".into());
        assert!(outcome.snippet.is_none() && outcome.notes[0].contains("misprint"));
        outcome.offer("[control.ground]\nlambda_m2 = 0.0009\na_m = 0.22\n".into());
        assert!(outcome.snippet.is_some());
        outcome.offer("[control.grund]\n".into());
        assert!(outcome.notes[1].contains("grund"), "{:?}", outcome.notes);
    }

    #[test]
    fn prop_text_and_page_hold_every_part() {
        let mut outcome = Outcome::new("thrust", vec!["<flight>".into()], "law");
        outcome.parameter("exponent", "", Value { value: -1.01, std: 0.02, dof: 30.0 });
        outcome.quality("R²", 0.98, "");
        outcome.notes.push("only here".into());
        let text = outcome.text();
        assert!(text.contains("-1.010 ± 0.02000") && text.contains("note: only here"), "{text}");
        let html = outcome.html();
        assert!(html.contains("&lt;flight&gt;") && html.contains("-1.010"));
        assert_eq!(number(f64::NAN), "NaN");
    }
}
