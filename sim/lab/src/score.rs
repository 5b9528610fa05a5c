//! Scores many attributions against their truths (GAP.md 4.3): a table for people, JSON for scripts.

use std::collections::BTreeMap;
use std::fmt::Write;

use serde::{Deserialize, Serialize};

use haltere_gap::attribute::Attribution;
use haltere_gap::outcome::Outcome;

/// What really was the matter with a flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "truth", rename_all = "snake_case")]
pub enum Truth {
    /// Nothing.
    NoGap,
    /// One effect of the library, with the block it lives in and, where comparable, its parameters.
    Single {
        /// Id.
        id: String,
        /// Name of the block.
        block: String,
        /// Parameters in the order of the specification; NaN or missing where not comparable.
        theta: Vec<f64>,
    },
    /// Two.
    Pair {
        /// Ids.
        ids: [String; 2],
    },
    /// An effect that the library does not have.
    Unknown {
        /// What it was.
        name: String,
    },
}

/// One judged flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Case<'a> {
    /// Truth.
    pub truth: Truth,
    /// Verdict.
    pub verdict: &'a Attribution,
    /// Blocks of the named effects, for "where"; empty: the loudest block counts.
    pub blocks: Vec<String>,
}

/// A share with its count and Wilson 95 % limits.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Share {
    /// How many.
    pub hits: usize,
    /// Of how many.
    pub of: usize,
    /// Lower limit.
    pub low: f64,
    /// Upper limit.
    pub high: f64,
}

impl Share {
    /// With its limits (Wilson 1927).
    pub fn new(hits: usize, of: usize) -> Self {
        if of == 0 {
            return Self { hits, of, low: 0.0, high: 1.0 };
        }
        let (n, p, z) = (of as f64, hits as f64 / of as f64, 1.959_964);
        let middle = (p + z * z / (2.0 * n)) / (1.0 + z * z / n);
        let half = z / (1.0 + z * z / n) * (p * (1.0 - p) / n + z * z / (4.0 * n * n)).sqrt();
        Self { hits, of, low: (middle - half).max(0.0), high: (middle + half).min(1.0) }
    }

    fn of<'b, T: 'b>(items: impl Iterator<Item = T>, hit: impl Fn(T) -> bool) -> Self {
        let (mut hits, mut of) = (0, 0);
        for item in items {
            of += 1;
            hits += usize::from(hit(item));
        }
        Self::new(hits, of)
    }

    /// Hits by all; `None` without any.
    pub fn value(&self) -> Option<f64> {
        (self.of > 0).then(|| self.hits as f64 / self.of as f64)
    }
}

/// All scores.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Score {
    /// The first name that is said is right, alone or of a set.
    pub named: Share,
    /// A wrong name is first.
    pub wrong: Share,
    /// Right effect first, a gap seen.
    pub top_1: Share,
    /// Right effect among the first three, a gap seen.
    pub top_3: Share,
    /// Right effect in the declared set.
    pub in_set: Share,
    /// Mean size of the declared set, where one was declared.
    pub set_size: f64,
    /// Right block.
    pub subsystem: Share,
    /// No-gap flights with any other verdict.
    pub false_alarm: Share,
    /// Of two effects one is named, or both, and none wrong.
    pub one_of_two: Share,
    /// Pairs exactly right, number unknown.
    pub pair_exact: Share,
    /// Unknown effects called "not in the library".
    pub unknown_rejected: Share,
    /// Single known effects called so.
    pub known_rejected: Share,
    /// Area under the curve of the adequacy score, unknown against single known.
    pub unknown_auroc: f64,
    /// Unknown effects above the adequacy score that 5 % of the known ones exceed.
    pub unknown_at_5: Share,
    /// Expected calibration error of the first name over ten bins, flights with an alarm.
    pub ece: f64,
    /// 90 % intervals of the right effect that hold the parameter.
    pub covered: Share,
    /// Truth to verdict to count; verdict: first name, or the outcome where nothing is named.
    pub confusion: BTreeMap<String, BTreeMap<String, usize>>,
    /// Outcomes.
    pub outcomes: BTreeMap<String, usize>,
}

/// Bins of the calibration error.
pub const BINS: usize = 10;

pub fn alarmed(a: &Attribution) -> bool {
    !matches!(
        a.outcome,
        Outcome::NoMaterialGap | Outcome::NotTestable { .. } | Outcome::Fault { .. }
    )
}

/// Place of `id` among the candidates, if a gap was seen.
pub fn rank(a: &Attribution, id: &str) -> Option<usize> {
    let found = a.candidates.iter().position(|c| c.id == id);
    found.filter(|_| alarmed(a))
}

/// First name that is said.
pub fn first_name(a: &Attribution) -> Option<&str> {
    a.outcome.effects().first().map(|e| e.id.as_str())
}

/// Right names of two effects, and names that are said. A set is one effect that goes by several names.
pub fn names_of_two(a: &Attribution, ids: &[String; 2]) -> [usize; 2] {
    let said = a.outcome.effects();
    let most = if matches!(a.outcome, Outcome::OneOf { .. }) { 1 } else { said.len() };
    let right = said.iter().take(most).filter(|e| ids.contains(&e.id)).count();
    [right, most.min(said.len())]
}

/// Scores a suite.
pub fn score(cases: &[Case<'_>]) -> Score {
    let singles = || {
        cases.iter().filter_map(|c| match &c.truth {
            Truth::Single { id, block, theta } => Some((c, id, block, theta)),
            _ => None,
        })
    };
    let unknowns = || cases.iter().filter(|c| matches!(c.truth, Truth::Unknown { .. }));
    let rejected = |c: &Case<'_>| matches!(c.verdict.outcome, Outcome::NotInLibrary { .. });
    let within = |most: usize| {
        Share::of(singles(), |(c, id, ..)| rank(c.verdict, id).is_some_and(|r| r < most))
    };
    let declared: Vec<usize> = singles()
        .map(|(c, ..)| c.verdict.outcome.effects().len())
        .filter(|size| *size > 0)
        .collect();
    let mean = |sum: f64, count: usize| if count > 0 { sum / count as f64 } else { f64::NAN };
    let adequacy = |c: &Case<'_>| c.verdict.adequacy.score;
    let known: Vec<f64> = singles().map(|(c, ..)| adequacy(c)).collect();
    let foreign: Vec<f64> = unknowns().map(adequacy).collect();
    let limit = upper(&known, 0.05);
    let mut covered = (0, 0);
    for (c, id, _, theta) in singles() {
        if let Some(best) = rank(c.verdict, id).and_then(|r| c.verdict.candidates.get(r)) {
            for (truth, [low, high]) in theta.iter().zip(&best.theta_90) {
                if truth.is_finite() {
                    covered.1 += 1;
                    covered.0 += usize::from((*low..=*high).contains(truth));
                }
            }
        }
    }
    let mut result = Score {
        named: Share::of(singles(), |(c, id, ..)| first_name(c.verdict) == Some(id.as_str())),
        wrong: Share::of(singles(), |(c, id, ..)| first_name(c.verdict).is_some_and(|n| n != id)),
        top_1: within(1),
        top_3: within(3),
        in_set: Share::of(singles(), |(c, id, ..)| {
            c.verdict.outcome.effects().iter().any(|e| e.id == *id)
        }),
        set_size: mean(declared.iter().sum::<usize>() as f64, declared.len()),
        subsystem: Share::of(singles(), |(c, _, block, _)| match c.blocks.first() {
            Some(own) => alarmed(c.verdict) && own == block,
            None => {
                alarmed(c.verdict) && c.verdict.blocks.first().is_some_and(|b| b.block == *block)
            }
        }),
        false_alarm: Share::of(cases.iter().filter(|c| c.truth == Truth::NoGap), |c| {
            c.verdict.outcome != Outcome::NoMaterialGap
        }),
        unknown_rejected: Share::of(unknowns(), rejected),
        known_rejected: Share::of(singles(), |(c, ..)| rejected(c)),
        unknown_auroc: auroc(&foreign, &known),
        unknown_at_5: Share::of(foreign.iter(), |v| *v > limit),
        ece: calibration_error(singles().map(|(c, id, ..)| (c.verdict, id.as_str()))),
        covered: Share::new(covered.0, covered.1),
        ..Score::default()
    };
    pairs(cases, &mut result);
    for c in cases {
        let key = c.verdict.outcome.key().to_string();
        *result.outcomes.entry(key).or_default() += 1;
        let truth = match &c.truth {
            Truth::NoGap => "no_gap".to_string(),
            Truth::Single { id, .. } => id.clone(),
            Truth::Pair { .. } => "pair".to_string(),
            Truth::Unknown { .. } => "unknown".to_string(),
        };
        let said = match (&c.truth, c.verdict.outcome.effects()) {
            (Truth::Pair { .. }, _) | (_, []) => c.verdict.outcome.key().to_string(),
            (_, [first, ..]) => first.id.clone(),
        };
        *result.confusion.entry(truth).or_default().entry(said).or_default() += 1;
    }
    result
}

fn pairs(cases: &[Case<'_>], result: &mut Score) {
    let (mut exact, mut one, mut count) = (0, 0, 0);
    for c in cases {
        if let Truth::Pair { ids } = &c.truth {
            let [hits, named] = names_of_two(c.verdict, ids);
            count += 1;
            exact += usize::from([hits, named] == [2, 2]);
            one += usize::from(hits > 0 && hits == named);
        }
    }
    result.pair_exact = Share::new(exact, count);
    result.one_of_two = Share::new(one, count);
}

/// Mean gap between said and true share of right first names, weighted by bin.
fn calibration_error<'b>(cases: impl Iterator<Item = (&'b Attribution, &'b str)>) -> f64 {
    let mut bins = [(0.0, 0.0); BINS];
    let mut count = 0.0;
    for (a, id) in cases.filter(|(a, _)| alarmed(a)) {
        if let Some(first) = a.candidates.first() {
            let bin = ((first.posterior * BINS as f64) as usize).min(BINS - 1);
            bins[bin].0 += first.posterior;
            bins[bin].1 += f64::from(u8::from(first.id == id));
            count += 1.0;
        }
    }
    bins.iter().map(|(said, right)| (said - right).abs()).sum::<f64>() / count
}

/// Probability that a value of `high` exceeds one of `low`; ties count half.
fn auroc(high: &[f64], low: &[f64]) -> f64 {
    let mut sum = 0.0;
    for h in high {
        for l in low {
            sum += if h > l { 1.0 } else { 0.5 * f64::from(u8::from(h == l)) };
        }
    }
    sum / (high.len() * low.len()) as f64
}

/// Value that a share of the values exceeds.
fn upper(values: &[f64], share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.iter().copied().filter(|v| !v.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    let rank = ((1.0 - share) * sorted.len() as f64).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).copied().unwrap_or(f64::INFINITY)
}

impl Score {
    /// Table for people.
    pub fn table(&self) -> String {
        let mut out = String::new();
        let mut share = |name: &str, s: &Share| {
            let _ = match s.value() {
                Some(v) => writeln!(
                    out,
                    "{name:<34} {v:6.3}  [{:.3}, {:.3}]  {} of {}",
                    s.low, s.high, s.hits, s.of
                ),
                None => writeln!(out, "{name:<34} not checked: no such case"),
            };
        };
        share("first name right", &self.named);
        share("first name wrong", &self.wrong);
        share("top-1", &self.top_1);
        share("top-3", &self.top_3);
        share("truth in the declared set", &self.in_set);
        share("block", &self.subsystem);
        share("false alarm, no gap", &self.false_alarm);
        share("one of two, none wrong", &self.one_of_two);
        share("pair exact", &self.pair_exact);
        share("unknown rejected", &self.unknown_rejected);
        share("unknown rejected at 5 % of known", &self.unknown_at_5);
        share("known rejected", &self.known_rejected);
        share("90 % intervals that hold", &self.covered);
        let mut number = |name: &str, v: f64| {
            let _ = if v.is_finite() {
                writeln!(out, "{name:<34} {v:6.3}")
            } else {
                writeln!(out, "{name:<34} not checked: no such case")
            };
        };
        number("mean set size", self.set_size);
        number("unknown AUROC", self.unknown_auroc);
        number("calibration error", self.ece);
        let _ = writeln!(out, "outcomes: {:?}", self.outcomes);
        for (truth, said) in &self.confusion {
            let wrong: Vec<String> = said
                .iter()
                .filter(|(name, _)| *name != truth)
                .map(|(name, count)| format!("{name} {count}"))
                .collect();
            if !wrong.is_empty() {
                let all: usize = said.values().sum();
                let right = said.get(truth).copied().unwrap_or(0);
                let _ = writeln!(out, "  {truth}: {right} of {all}; else {}", wrong.join(", "));
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_gap::attribute::{Adequacy, Candidate, Gate};
    use haltere_gap::outcome::{Named, Remainder};

    fn named(id: &str) -> Named {
        Named { id: id.into(), probability: 0.9, theta: vec![1.0], theta_90: vec![[0.5, 1.5]] }
    }

    fn verdict(outcome: Outcome, order: &[&str], adequacy: f64) -> Attribution {
        let candidate = |id: &&str| Candidate {
            id: (*id).into(),
            posterior: 0.9,
            log_evidence: 10.0,
            theta: vec![1.0],
            theta_90: vec![[0.5, 1.5]],
            explained: 0.0,
            residual_score: 0.0,
        };
        Attribution {
            outcome,
            candidates: order.iter().map(candidate).collect(),
            pairs: vec![],
            pair_limit: 3.3,
            blocks: vec![],
            gate: Gate::default(),
            adequacy: Adequacy { score: adequacy, limit: 2.0, ..Adequacy::default() },
            remainder: Remainder::default(),
            used: 10,
            unknown: vec![],
        }
    }

    #[test]
    fn val_wilson_limits() {
        // Wilson 1927 as in Newcombe 1998, table I: 81 of 263 gives 0.2553 to 0.3662.
        let s = Share::new(81, 263);
        assert!((s.low - 0.2553).abs() < 1e-4 && (s.high - 0.3662).abs() < 1e-4, "{s:?}");
        assert!((Share::new(0, 20).high - 0.1611).abs() < 1e-4);
    }

    #[test]
    fn prop_scores_count_what_they_say() {
        let truth = |id: &str, theta: f64| Truth::Single {
            id: id.into(),
            block: "uwb".into(),
            theta: vec![theta],
        };
        let right = verdict(Outcome::Named { effect: named("A1") }, &["A1", "A2"], 0.0);
        let second =
            verdict(Outcome::OneOf { effects: vec![named("A2"), named("A1")] }, &["A2", "A1"], 1.0);
        let unseen = verdict(Outcome::NoMaterialGap, &["A1"], 0.5);
        let both =
            verdict(Outcome::Several { effects: vec![named("A1"), named("A2")] }, &["A1"], 0.0);
        let rest = Remainder::default();
        let foreign = verdict(Outcome::NotInLibrary { remainder: rest }, &["A1"], 5.0);
        let case = |truth, verdict| Case { truth, verdict, blocks: vec!["uwb".into()] };
        let pair = |b: &str| Truth::Pair { ids: ["A1".into(), b.into()] };
        let cases = [
            case(truth("A1", 1.2), &right),
            case(truth("A1", 9.0), &second),
            case(truth("A1", 1.0), &unseen),
            case(Truth::NoGap, &unseen),
            case(Truth::NoGap, &right),
            case(pair("A2"), &both),
            case(pair("A3"), &both),
            case(Truth::Unknown { name: "rattle".into() }, &foreign),
            case(Truth::Unknown { name: "cable".into() }, &right),
        ];
        let s = score(&cases);
        let counts = |s: Share| (s.hits, s.of);
        assert_eq!(counts(s.top_1), (1, 3));
        assert_eq!(counts(s.top_3), (2, 3));
        assert_eq!(counts(s.in_set), (2, 3));
        assert_eq!(s.set_size, 1.5);
        assert_eq!(counts(s.subsystem), (2, 3));
        assert_eq!(counts(s.false_alarm), (1, 2));
        assert_eq!(counts(s.pair_exact), (1, 2));
        assert_eq!([s.named, s.wrong].map(counts), [(1, 3), (1, 3)]);
        assert_eq!(counts(s.one_of_two), (1, 2));
        assert_eq!(counts(s.unknown_rejected), (1, 2));
        assert_eq!(counts(s.covered), (1, 2), "an unseen gap has no interval");
        assert!((s.unknown_auroc - 3.5 / 6.0).abs() < 1e-12, "{}", s.unknown_auroc);
        assert!((s.ece - 0.4).abs() < 1e-12, "one of two right at 0.9: {}", s.ece);
        assert_eq!(s.confusion["A1"]["A2"], 1);
        let table = s.table();
        assert!(table.contains("1 of 3") && table.contains("unknown"), "{table}");
        assert!(score(&[]).table().contains("not checked"));
    }
}
