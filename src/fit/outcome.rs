//! What a fit says: parameters with errors, quality, tables, plots, and a configuration snippet, as
//! text, JSON and one HTML page.

use std::fmt::Write as _;

use serde::Serialize;

use super::programs::Program;
use super::value::Value;
use crate::report::html::{self, Cell};
use crate::report::svg::{Plot, escape};
use haltere_core::checks::Problems;
use haltere_pilot::settings::Config;

/// Size of a plot that is the only one, pixels.
const ALONE_PX: [f64; 2] = [1120.0, 380.0];

/// Probability of the intervals that are shown.
const SHOWN: f64 = 0.95;

/// How often nothing is taken for something.
const CHANCE: f64 = 0.05;
/// Parameters that the sentence on top tells.
const MOST_SAID: usize = 3;

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
        let _ = writeln!(out, "{}\n{}", self.sentence(), self.law);
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

    /// Whether a parameter differs from nothing by more than the surest of so many does by chance once in twenty times.
    pub fn differs(&self) -> bool {
        let each = 1.0 - CHANCE / self.parameters.len().max(1) as f64;
        self.parameters.iter().any(|p| p.value.value.abs() > p.value.half_width(each))
    }

    /// What came out, in a sentence.
    pub fn sentence(&self) -> String {
        // Of several for one thing (axis, anchor) the first: it is what was asked for.
        let thing = |p: &Named| p.name.split(' ').next().unwrap_or_default().to_owned();
        let mut firsts: Vec<&Named> = Vec::new();
        for p in &self.parameters {
            if firsts.iter().all(|first| thing(first) != thing(p)) {
                firsts.push(p);
            }
        }
        // All of one thing: the one that is surest to differ from nothing.
        let many = firsts.len() == 1 && self.parameters.len() > MOST_SAID;
        if many {
            let sure = |p: &Named| (p.value.value / p.value.std).abs();
            firsts = self.parameters.iter().collect();
            firsts.sort_by(|a, b| sure(b).total_cmp(&sure(a)));
        }
        firsts.truncate(if many { 1 } else { MOST_SAID });
        let told = firsts.iter().map(|p| {
            let Value { value, std, .. } = p.value;
            format!("{} = {} {}", p.name, with_error(value, std), p.unit).trim_end().to_owned()
        });
        let told = told.collect::<Vec<_>>().join("; ");
        let first = match (many, self.differs()) {
            (false, _) => String::new(),
            (true, true) => "surest: ".to_owned(),
            (true, false) => {
                format!("nothing beyond chance; surest of {}: ", self.parameters.len())
            }
        };
        let offered = match self.snippet {
            Some(_) => "what the configuration gets stands at the end",
            None => "nothing of it goes into the configuration",
        };
        let more = self.parameters.len().saturating_sub(firsts.len());
        let more = if more > 0 { format!("; {more} more below") } else { String::new() };
        format!("{first}{told}{more}; {offered}.")
    }

    /// One self-contained page.
    pub fn html(&self) -> String {
        let title = format!("Fit: {}", self.what);
        let mut html = html::open(&title, "");
        html += &html::header(None, &title, &self.source.join(", "));
        html += &html::said("", &self.sentence());
        let _ = write!(html, "<p>{}</p>", escape(&self.law));
        if !self.plots.is_empty() {
            html.push_str("<h2>Data and fit</h2><div class=\"two\">");
            for plot in &self.plots {
                let mut plot = plot.clone();
                if self.plots.len() == 1 {
                    // Alone it gets the whole width; drawn for it, letters keep their size.
                    plot.size_px = ALONE_PX;
                }
                html.push_str(&plot.render());
            }
            html.push_str("</div>");
        }
        let rows = self.parameters.iter().map(|p| {
            let [low, high] = p.value.interval(SHOWN);
            let interval = format!("{} to {}", number(low), number(high));
            let [value, std] = [p.value.value, p.value.std].map(number);
            [&*p.name, &value, &std, &interval, p.unit].map(Cell::from).into()
        });
        let heads = ["Parameter", "#Value", "#Standard error", "#95 % interval", "Unit"];
        html += &html::table(heads, &rows.collect::<Vec<_>>());
        let rows = self.quality.iter();
        let rows = rows.map(|q| [&*q.name, &number(q.value), q.unit].map(Cell::from).into());
        html += &html::titled("Quality", ["", "#Value", "Unit"], &rows.collect::<Vec<_>>());
        for table in &self.tables {
            html += &html::heading(&table.title);
            let heads: Vec<String> = table.head.iter().map(|head| format!("#{head}")).collect();
            let cell = |text: &String| {
                let class = if text.chars().count() > LONG_CELL { html::WRAPS } else { "" };
                Cell::of(class, text)
            };
            let rows = table.rows.iter().map(|row| row.iter().map(cell).collect());
            html += &html::table(heads.iter().map(String::as_str), &rows.collect::<Vec<_>>());
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
            "<footer>Standard errors count the time over which noise lasts; intervals take \
             Student's quantile for how well that is known.</footer>",
        );
        html::close(html)
    }
}

/// Whether the companion's configuration takes a snippet.
pub fn accepted(snippet: &str) -> Result<(), Problems> {
    let config = Config::from_toml("snippet", snippet)?;
    let mut problems = Problems::new();
    config.check("", &mut problems);
    problems.into_result()
}

/// A value and its standard error, of which two digits tell enough.
fn with_error(value: f64, std: f64) -> String {
    if !(value.is_finite() && std.is_finite() && std > 0.0) {
        return format!("{} \u{b1} {}", number(value), number(std));
    }
    let digits = (1 - std.log10().floor() as i32).clamp(0, 8) as usize;
    format!("{value:.digits$} \u{b1} {std:.digits$}")
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
        let sentence = "exponent = -1.010 ± 0.020; nothing of it goes into the configuration.";
        assert!(text.contains(sentence) && outcome.html().contains(sentence), "{text}");
        let html = outcome.html();
        assert!(html.contains("&lt;flight&gt;") && html.contains("-1.010"));
        assert_eq!(number(f64::NAN), "NaN");
    }
}
