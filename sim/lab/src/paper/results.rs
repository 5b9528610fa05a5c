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
/// Standard errors either way in which the mean of many repetitions is taken to lie.
const SURE: f64 = 2.0;

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

    /// Where the mean of many such repetitions lies; of one alone nobody knows.
    fn interval(&self) -> [f64; 2] {
        let n = self.values.len() as f64;
        let off = self.std.map_or(f64::INFINITY, |std| SURE * std / n.sqrt());
        [self.mean - off, self.mean + off]
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

    /// The number of it that is nearest to ours.
    pub fn nearest(&self, ours: f64) -> f64 {
        ours.clamp(self.range[0], self.range[1])
    }

    /// How far a number is from it; 0 inside the range.
    pub fn difference(&self, ours: f64) -> f64 {
        ours - self.nearest(ours)
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

/// Which way a number of ours is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sense {
    /// Neither: it should be the source's.
    Equal,
    /// An error.
    Less,
    /// A gain.
    More,
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
    /// Ours as shipped, over the repetitions.
    pub ours: Spread,
    /// The source's system as printed, flown here; nothing where it is the same flight.
    pub printed: Option<Spread>,
    /// The source's.
    pub source: Source,
    /// Which way ours would be better.
    pub sense: Sense,
    /// Whether the simulator is known to be kinder than reality here: then ours is never better.
    pub kinder: bool,
    /// What was tried to explain the difference.
    pub trials: Vec<Trial>,
}

/// What a row says of a difference.
#[derive(Debug, Clone, PartialEq)]
pub enum Verdict {
    /// Surely within a tenth of the source's number.
    Agrees,
    /// Surely on the good side of it.
    Better,
    /// As [`Verdict::Better`], in a world that is kinder than the source's.
    Kinder,
    /// The repetitions scatter too much to say.
    Scatters,
    /// Surely elsewhere, with the trials that close the difference, and how much of it.
    Explained(Vec<(String, f64)>),
    /// Surely elsewhere, and no trial closes it.
    NotExplained,
}

impl Verdict {
    /// For people.
    pub fn word(&self) -> &'static str {
        match self {
            Verdict::Agrees => "agrees",
            Verdict::Better => "better",
            Verdict::Kinder => "kinder world",
            Verdict::Scatters => "scatters",
            Verdict::Explained(_) => "differs, explained",
            Verdict::NotExplained => "differs",
        }
    }
}

impl Row {
    /// A row; trials and the rest are added by hand.
    pub fn new(
        what: impl Into<String>,
        unit: &'static str,
        decimals: usize,
        ours: Spread,
        source: Source,
        sense: Sense,
    ) -> Self {
        Self {
            what: what.into(),
            unit,
            decimals,
            ours,
            printed: None,
            source,
            sense,
            kinder: false,
            trials: Vec::new(),
        }
    }

    /// With something that was tried.
    pub fn tried(mut self, change: impl Into<String>, value: f64) -> Self {
        self.trials.push(Trial { change: change.into(), value });
        self
    }

    /// Share of the difference that a trial closes; more than 1 overshoots.
    pub fn closes(&self, trial: &Trial) -> Option<f64> {
        self.closes_of(self.printed.as_ref().unwrap_or(&self.ours), trial)
    }

    fn closes_of(&self, found: &Spread, trial: &Trial) -> Option<f64> {
        let difference = self.source.difference(found.mean);
        (difference != 0.0).then(|| (found.mean - trial.value) / difference)
    }

    /// Whether it is where the source has it, or on the good side of it: as printed, else ours.
    pub fn reached(&self) -> bool {
        matches!(self.verdict(), Verdict::Agrees | Verdict::Better)
    }

    /// What the difference comes to, of the source's system as printed where that was flown.
    pub fn verdict(&self) -> Verdict {
        self.verdict_of(self.printed.as_ref().unwrap_or(&self.ours))
    }

    /// The same of either column.
    pub fn verdict_of(&self, found: &Spread) -> Verdict {
        let [low, high] = self.source.range;
        let bounds = [low - SAME * low.abs(), high + SAME * high.abs()];
        let [least, most] = found.interval();
        if least >= bounds[0] && most <= bounds[1] {
            return Verdict::Agrees;
        }
        let better = match self.sense {
            Sense::Equal => false,
            Sense::Less => most < low,
            Sense::More => least > high,
        };
        if better {
            return if self.kinder { Verdict::Kinder } else { Verdict::Better };
        }
        if most >= bounds[0] && least <= bounds[1] {
            return Verdict::Scatters;
        }
        let share = |t: &Trial| Some((t.change.clone(), self.closes_of(found, t)?));
        let credited: Vec<(String, f64)> = self
            .trials
            .iter()
            .filter_map(share)
            .filter(|(_, share)| (CREDIT[0]..=CREDIT[1]).contains(share))
            .collect();
        if credited.is_empty() { Verdict::NotExplained } else { Verdict::Explained(credited) }
    }

    /// The source's number as text.
    pub fn source_text(&self) -> String {
        let decimals = self.decimals;
        match self.source.range {
            [low, high] if low == high => format!("{low:.decimals$}"),
            [low, f64::INFINITY] => format!("above {low:.decimals$}"),
            [low, high] => format!("{low:.decimals$} to {high:.decimals$}"),
        }
    }

    /// Why it is believed to differ; nothing where it does not.
    pub fn why_text(&self) -> String {
        let trial = |change: &str, share: f64| {
            let value =
                self.trials.iter().find(|t| t.change == change).map_or(f64::NAN, |t| t.value);
            format!("{change}: {value:.*}, closes {:.0} %", self.decimals, 100.0 * share)
        };
        match self.verdict() {
            Verdict::Agrees | Verdict::Better | Verdict::Kinder => String::new(),
            Verdict::Scatters => "more repetitions than were flown would tell".into(),
            Verdict::Explained(credited) => credited
                .iter()
                .map(|(change, share)| trial(change, *share))
                .collect::<Vec<_>>()
                .join("; "),
            Verdict::NotExplained => {
                let closes = |t: &Trial| self.closes(t).unwrap_or(0.0);
                let some = self.trials.iter().filter(|t| closes(t) >= SAME);
                let some: Vec<String> = some.map(|t| trial(&t.change, closes(t))).collect();
                match (self.trials.len(), some.is_empty()) {
                    (0, _) => "nothing tried".into(),
                    (tried, true) => format!("none of {tried} trials closes a tenth of it"),
                    (tried, false) => format!("of {tried} trials: {}", some.join("; ")),
                }
            }
        }
    }
}

/// How a claim of the source stands here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Claim {
    /// Ours says the same.
    Reproduced,
    /// Ours is on the good side of it.
    Better,
    /// A part of it.
    Partly,
    /// Ours says something else.
    NotReproduced,
    /// Nothing was flown for it.
    NotFlown,
}

impl Claim {
    /// Of several rows: what all of them come to.
    pub fn of<'a>(rows: impl IntoIterator<Item = &'a Row>) -> Self {
        let verdicts: Vec<Verdict> = rows.into_iter().map(Row::verdict).collect();
        let count = |of: &[Verdict]| verdicts.iter().filter(|v| of.contains(v)).count();
        let agrees = count(&[Verdict::Agrees]);
        let better = count(&[Verdict::Better, Verdict::Kinder]);
        match verdicts.len() {
            0 => Self::NotFlown,
            all if better + agrees == all && better > agrees => Self::Better,
            all if better + agrees == all => Self::Reproduced,
            _ if better + agrees > 0 => Self::Partly,
            _ => Self::NotReproduced,
        }
    }

    /// For people.
    pub fn word(self) -> &'static str {
        match self {
            Self::Reproduced => "reproduced",
            Self::Better => "better",
            Self::Partly => "in part",
            Self::NotReproduced => "not reproduced",
            Self::NotFlown => "not flown",
        }
    }
}

/// A line of the summary.
#[derive(Debug, Clone, PartialEq)]
pub struct Line {
    /// How the claim stands.
    pub claim: Claim,
    /// The claim, and what ours is.
    pub text: String,
}

impl Line {
    /// A line.
    pub fn new(claim: Claim, text: impl Into<String>) -> Self {
        Self { claim, text: text.into() }
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
    /// Whether it is short and told enough to stand in docs/PAPER.md too.
    pub in_document: bool,
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
    /// Its lines of the summary.
    pub lines: Vec<Line>,
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
        Row::new("a", "m", 3, Spread::of(ours.iter().copied()), source, Sense::Less)
    }

    #[test]
    fn prop_only_a_trial_explains_a_difference() {
        let source = Source::number(0.10, "table 0");
        let apart = row(&[0.19, 0.20, 0.21], source);
        assert_eq!(apart.verdict(), Verdict::NotExplained);
        assert_eq!(apart.why_text(), "nothing tried");
        let tried = apart.clone().tried("less wind", 0.18);
        assert_eq!(tried.verdict(), Verdict::NotExplained);
        assert!(tried.why_text().starts_with("of 1 trials: less wind"), "{}", tried.why_text());
        let wrong_way = apart.clone().tried("more wind", 0.30);
        assert_eq!(wrong_way.verdict(), Verdict::NotExplained);
        assert_eq!(wrong_way.why_text(), "none of 1 trials closes a tenth of it");
        let found = apart.clone().tried("no wind", 0.12);
        assert!(matches!(found.verdict(), Verdict::Explained(_)));
        assert!(found.why_text().contains("closes 80 %"), "{}", found.why_text());
    }

    /// Noise agrees with nothing, and neither does one flight.
    #[test]
    fn prop_what_agrees_is_sure_to() {
        let source = Source::number(0.10, "table 0");
        assert_eq!(row(&[0.105, 0.104], source).verdict(), Verdict::Agrees);
        assert_eq!(row(&[0.10], source).verdict(), Verdict::Scatters);
        assert_eq!(row(&[0.02, 0.18, 0.10], source).verdict(), Verdict::Scatters);
        let printed = Row { printed: Some(Spread::of([0.3, 0.31])), ..row(&[0.1, 0.1], source) };
        assert_eq!(printed.verdict(), Verdict::NotExplained);
        assert_eq!(printed.verdict_of(&printed.ours), Verdict::Agrees);
    }

    #[test]
    fn prop_what_is_better_depends_on_sense_and_world() {
        let half = row(&[0.05, 0.051], Source::number(0.10, "table 0"));
        assert_eq!(half.verdict(), Verdict::Better);
        assert_eq!(Row { kinder: true, ..half.clone() }.verdict(), Verdict::Kinder);
        for sense in [Sense::More, Sense::Equal] {
            let other = Row { sense, ..half.clone() };
            assert_eq!((other.verdict(), other.reached()), (Verdict::NotExplained, false));
        }
        let twice = row(&[0.2, 0.201], Source::number(0.10, "table 0"));
        assert_eq!(Claim::of([&half, &half]), Claim::Better);
        assert_eq!(Claim::of([&half, &twice]), Claim::Partly);
        assert_eq!(Claim::of([&twice]), Claim::NotReproduced);
        assert_eq!(Claim::of([]), Claim::NotFlown);
    }

    #[test]
    fn prop_a_range_is_left_at_its_nearer_end() {
        let range = Source { range: [0.08, 0.10], origin: "section 4" };
        assert_eq!(range.difference(0.09), 0.0);
        let below = Row { sense: Sense::Equal, ..row(&[0.02], range) };
        assert!((range.difference(0.02) + 0.06).abs() < 1e-12);
        let half = below.tried("worse radio", 0.05);
        assert!((half.closes(&half.trials[0]).unwrap() - 0.5).abs() < 1e-9);
        let open = row(&[0.5], Source { range: [1.0, f64::INFINITY], origin: "section 4" });
        assert_eq!(open.source_text(), "above 1.000");
    }

    #[test]
    fn val_standard_deviation_of_the_sample() {
        let s = Spread::of([1.0, 2.0, 3.0, 4.0]);
        assert!((s.std.unwrap() - (5.0f64 / 3.0).sqrt()).abs() < 1e-12);
        assert_eq!(Spread::of([1.0]).std, None);
    }
}
