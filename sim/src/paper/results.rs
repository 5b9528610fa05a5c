//! What an experiment found: our number beside the source's, what was tried to explain a
//! difference, tables, figures, targets.
//!
//! A difference is explained only by a **trial**: a run of the same experiment with one thing
//! changed, or a calculation from its data. A trial that closes the difference within [`CREDIT`] is
//! credited; without one the report says "not explained".

use haltere::report::svg::Plot;
use haltere::report::verdict::Check;
use serde::Serialize;

/// Share of a difference that a trial must close to count as its explanation, and the most of it: what
/// overshoots by more than half explains another difference.
pub const CREDIT: [f64; 2] = [0.5, 1.5];
/// A difference of less than this share of the source's number is none.
const SAME: f64 = 0.10;

/// Mean and standard deviation over repetitions.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Standard deviation of the repetitions, when there are two or more.
    pub std: Option<f64>,
    /// Each repetition.
    pub values: Vec<f64>,
}

impl Spread {
    /// Of these repetitions.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let values: Vec<f64> = values.into_iter().collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let var = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
        Self { mean, std: (values.len() > 1).then(|| var.sqrt()), values }
    }

    /// Mean, and spread behind ±.
    pub fn text(&self, decimals: usize) -> String {
        match self.std {
            Some(std) => format!("{:.decimals$} \u{b1} {std:.decimals$}", self.mean),
            None => format!("{:.decimals$}", self.mean),
        }
    }
}

/// A number of the source, and where it stands there.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Source {
    /// Least and greatest; equal for a single number.
    pub range: [f64; 2],
    /// Table, figure or section.
    pub origin: &'static str,
}

impl Source {
    /// A single number.
    pub const fn number(value: f64, origin: &'static str) -> Self {
        Self { range: [value, value], origin }
    }

    /// How far a number is from it; 0 inside the range.
    pub fn difference(&self, ours: f64) -> f64 {
        ours - ours.clamp(self.range[0], self.range[1])
    }
}

/// The same quantity with one thing changed.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// What was changed.
    pub change: String,
    /// What came out.
    pub value: f64,
}

/// Our number beside the source's.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Quantity.
    pub what: String,
    /// Unit.
    pub unit: &'static str,
    /// Digits behind the point.
    pub decimals: usize,
    /// Our number over the repetitions.
    pub ours: Spread,
    /// The source's; `None`: not available to us.
    pub source: Option<Source>,
    /// What was tried to explain the difference.
    pub trials: Vec<Trial>,
}

/// What a row says of its difference.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// The source's number is not available to us.
    NotAvailable,
    /// Within a tenth of the source's number, or within our own spread.
    Agrees,
    /// Trials that close the difference, and how much of it.
    Explained(Vec<(String, f64)>),
    /// None does.
    NotExplained,
}

impl Row {
    /// A row; trials and source are added by hand.
    pub fn new(what: impl Into<String>, unit: &'static str, decimals: usize, ours: Spread) -> Self {
        Self { what: what.into(), unit, decimals, ours, source: None, trials: Vec::new() }
    }

    /// With the source's number.
    pub fn beside(mut self, source: Source) -> Self {
        self.source = Some(source);
        self
    }

    /// With something that was tried.
    pub fn tried(mut self, change: impl Into<String>, value: f64) -> Self {
        self.trials.push(Trial { change: change.into(), value });
        self
    }

    /// Share of the difference that a trial closes; more than 1 overshoots.
    pub fn closes(&self, trial: &Trial) -> Option<f64> {
        let source = self.source?;
        let before = source.difference(self.ours.mean);
        let edge = self.ours.mean - before;
        (before != 0.0).then(|| (self.ours.mean - trial.value) / (self.ours.mean - edge))
    }

    /// What the difference comes to.
    pub fn verdict(&self) -> Verdict {
        let Some(source) = self.source else { return Verdict::NotAvailable };
        let difference = source.difference(self.ours.mean).abs();
        let scale = source.range[0].abs().max(source.range[1].abs());
        if difference <= (SAME * scale).max(self.ours.std.unwrap_or(0.0)) {
            return Verdict::Agrees;
        }
        let credited: Vec<(String, f64)> = self
            .trials
            .iter()
            .filter_map(|t| Some((t.change.clone(), self.closes(t)?)))
            .filter(|(_, share)| (CREDIT[0]..=CREDIT[1]).contains(share))
            .collect();
        if credited.is_empty() { Verdict::NotExplained } else { Verdict::Explained(credited) }
    }

    /// Difference and its share of the source's number, as text.
    pub fn difference_text(&self) -> String {
        let Some(source) = self.source else { return "\u{2013}".into() };
        let difference = source.difference(self.ours.mean);
        if difference == 0.0 {
            return "inside".into();
        }
        let decimals = self.decimals;
        let edge = self.ours.mean - difference;
        format!("{difference:+.decimals$} ({:+.0} %)", 100.0 * difference / edge.abs())
    }

    /// The source's number as text.
    pub fn source_text(&self) -> String {
        let decimals = self.decimals;
        match self.source {
            None => "not available to us".into(),
            Some(Source { range: [low, high], .. }) if low == high => format!("{low:.decimals$}"),
            Some(Source { range: [low, high], .. }) => {
                format!("{low:.decimals$} to {high:.decimals$}")
            }
        }
    }

    /// Why it is believed to differ.
    pub fn why_text(&self) -> String {
        let trial = |change: &str, share: f64| {
            let value =
                self.trials.iter().find(|t| t.change == change).map_or(f64::NAN, |t| t.value);
            format!("{change}: {value:.*}, closes {:.0} %", self.decimals, 100.0 * share)
        };
        match self.verdict() {
            Verdict::NotAvailable => String::new(),
            Verdict::Agrees => "agrees: within a tenth or our spread".into(),
            Verdict::Explained(credited) => credited
                .iter()
                .map(|(change, share)| trial(change, *share))
                .collect::<Vec<_>>()
                .join("; "),
            Verdict::NotExplained if self.trials.is_empty() => "not explained".into(),
            Verdict::NotExplained => format!(
                "not explained; tried {}",
                self.trials
                    .iter()
                    .map(|t| trial(&t.change, self.closes(t).unwrap_or(0.0)))
                    .collect::<Vec<_>>()
                    .join("; ")
            ),
        }
    }
}

/// One cell of a table.
#[derive(Debug, Clone, PartialEq)]
pub enum Cell {
    /// Words.
    Text(String),
    /// A number over repetitions, and its digits.
    Spread(Spread, usize),
}

impl Cell {
    /// As shown.
    pub fn text(&self) -> String {
        match self {
            Cell::Text(text) => text.clone(),
            Cell::Spread(spread, decimals) => spread.text(*decimals),
        }
    }
}

impl<T: Into<String>> From<T> for Cell {
    fn from(text: T) -> Self {
        Cell::Text(text.into())
    }
}

/// A table.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Table {
    /// Heading.
    pub title: String,
    /// Heads of the columns.
    pub columns: Vec<String>,
    /// Cells by row.
    pub rows: Vec<Vec<Cell>>,
    /// What to know when reading it.
    pub note: String,
}

/// A figure of the source, or one of ours.
#[derive(Debug, Clone, PartialEq)]
pub struct Figure {
    /// Such as "Figure 3".
    pub name: &'static str,
    /// What is to be seen.
    pub caption: String,
    /// Drawings, two a row.
    pub plots: Vec<Plot>,
}

/// All of one experiment.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Section {
    /// How it was done, and where that had to be chosen.
    pub method: String,
    /// Ours beside the source's.
    pub rows: Vec<Row>,
    /// Tables.
    pub tables: Vec<Table>,
    /// Figures.
    pub figures: Vec<Figure>,
    /// What else was found; each a sentence or two.
    pub findings: Vec<String>,
    /// What it must reach.
    pub targets: Vec<Check>,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(ours: &[f64], source: Source) -> Row {
        Row::new("a", "m", 3, Spread::of(ours.iter().copied())).beside(source)
    }

    #[test]
    fn prop_only_a_trial_that_closes_the_difference_explains_it() {
        let source = Source::number(0.10, "table 0");
        let apart = row(&[0.19, 0.20, 0.21], source);
        assert_eq!(apart.verdict(), Verdict::NotExplained);
        assert_eq!(apart.why_text(), "not explained");
        let tried = apart.clone().tried("less wind", 0.18);
        assert_eq!(tried.verdict(), Verdict::NotExplained);
        assert!(
            tried.why_text().starts_with("not explained; tried less wind"),
            "{}",
            tried.why_text()
        );
        let wrong_way = apart.clone().tried("more wind", 0.30);
        assert_eq!(wrong_way.verdict(), Verdict::NotExplained);
        let found = apart.tried("no wind", 0.12);
        assert!(matches!(found.verdict(), Verdict::Explained(_)));
        assert!(found.why_text().contains("closes 80 %"), "{}", found.why_text());
        assert_eq!(row(&[0.105, 0.104], source).verdict(), Verdict::Agrees);
    }

    #[test]
    fn prop_a_range_is_left_at_its_nearer_end() {
        let range = Source { range: [0.08, 0.10], origin: "section 4" };
        assert_eq!(range.difference(0.09), 0.0);
        let below = row(&[0.02], range);
        assert!((range.difference(0.02) + 0.06).abs() < 1e-12);
        assert_eq!(below.difference_text(), "-0.060 (-75 %)");
        let half = below.tried("worse radio", 0.05);
        assert!((half.closes(&half.trials[0]).unwrap() - 0.5).abs() < 1e-9);
    }

    #[test]
    fn val_standard_deviation_of_the_sample() {
        let s = Spread::of([1.0, 2.0, 3.0, 4.0]);
        assert!((s.std.unwrap() - (5.0f64 / 3.0).sqrt()).abs() < 1e-12);
        assert_eq!(Spread::of([1.0]).std, None);
    }
}
