//! The table that the issue asks for, from reports.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use haltere_gap::balance::causes::{Cause, Kind};
use haltere_gap::outcome::Ending;

use super::Judged;
use super::state::Done;

/// Cut off a propeller, from which on it is to be named; of two, mm.
const NAMED_MM: f64 = 3.0;
const NAMED_TWO_MM: f64 = 4.5;
/// Cut off a propeller, up to which nothing has to be named, mm.
const SMALL_MM: f64 = 1.5;
/// Cut off a propeller, from which on sizes are compared, mm.
const SIZED_MM: f64 = 2.5;

/// A row of the table.
pub struct Row {
    /// Its name.
    pub key: &'static str,
    what: &'static str,
    to_reach: &'static str,
    /// What came out; not a number where no flight is of this kind.
    pub value: f64,
    /// Flights that it is of.
    count: usize,
}

impl Judged {
    fn ending(&self) -> Ending {
        self.report.as_ref().map_or(Ending::NotTestable, |report| report.outcome.kind())
    }

    /// Causes that are named, alone or as a set.
    fn set(&self) -> Vec<Cause> {
        let effects = self.report.iter().flat_map(|report| report.outcome.effects());
        effects.filter_map(|effect| Cause::find(&effect.id)).collect()
    }

    /// Whether something is named, and all of it at these motors.
    fn is_at(&self, motors: &[usize]) -> bool {
        let set = self.set();
        !set.is_empty() && set.iter().all(|cause| cause.motors == motors)
    }

    /// Whether a cause is what was done.
    fn is_true(&self, cause: &Cause) -> bool {
        let at_place = cause.motors == self.done.motors();
        match (&self.done, cause.kind) {
            (Done::Cut(_) | Done::Tape(_), Kind::WeakMotor) => at_place,
            (Done::Cut(_) | Done::Tape(_), Kind::Unbalanced) => true,
            (Done::Weight(..) | Done::OnString(..), Kind::Load) => at_place,
            (Done::OnString(..), Kind::Swinging) => true,
            _ => false,
        }
    }

    /// Mean of the estimated sizes of a kind at the motors that were changed.
    fn size(&self, kind: Kind) -> Option<f64> {
        let id = Cause { kind, motors: self.done.motors() }.id();
        let named = self.report.as_ref()?.candidates.iter().find(|named| named.id == id)?;
        Some(named.theta.iter().sum::<f64>() / named.theta.len().max(1) as f64)
    }

    /// Most and least that was cut off one of the propellers, mm, and of how many.
    fn cut(&self) -> Option<(f64, f64, usize)> {
        let Done::Cut(cuts) = &self.done else { return None };
        let mm = || cuts.iter().map(|(_, mm)| *mm);
        Some((mm().fold(0.0, f64::max), mm().fold(f64::INFINITY, f64::min), cuts.len()))
    }

    fn is_one_to_name(&self) -> bool {
        match &self.done {
            Done::Weight(_, motors) => motors.len() == 1,
            _ => self.cut().is_some_and(|(_, least, count)| count == 1 && least >= NAMED_MM),
        }
    }

    fn is_two_to_name(&self) -> bool {
        self.cut().is_some_and(|(_, least, count)| count == 2 && least >= NAMED_TWO_MM)
    }

    fn is_small(&self) -> bool {
        matches!(self.done, Done::Tape(_)) || self.cut().is_some_and(|(most, ..)| most <= SMALL_MM)
    }

    /// A kind of cause alone counts whole, both kinds half.
    fn told_apart(&self) -> f64 {
        let right = match self.done {
            Done::Cut(_) => [Kind::WeakMotor, Kind::Unbalanced],
            _ => [Kind::Load, Kind::Swinging],
        };
        let set = self.set();
        let count = set.iter().filter(|cause| right.contains(&cause.kind)).count();
        match count {
            0 => 0.0,
            n if n == set.len() => 1.0,
            _ => 0.5,
        }
    }
}

/// Every row, from the flights that are there.
pub fn rows(judged: &[Judged]) -> Vec<Row> {
    let own = || judged.iter().filter(|j| !j.by_another);
    let mean = |of: &dyn Fn(&Judged) -> Option<f64>| {
        let values: Vec<f64> = own().filter_map(of).collect();
        (values.iter().sum::<f64>() / values.len() as f64, values.len())
    };
    let share = |among: &dyn Fn(&Judged) -> bool, is: &dyn Fn(&Judged) -> bool| {
        mean(&|j: &Judged| among(j).then(|| f64::from(u8::from(is(j)))))
    };
    let wrong = |j: &Judged| j.ending() == Ending::Named && !j.set().iter().any(|c| j.is_true(c));
    let tolerable = |j: &Judged| match j.ending() {
        Ending::NoGap | Ending::NotTestable => true,
        _ => j.set().iter().any(|cause| j.is_true(cause)),
    };
    let swings = |j: &Judged| match j.ending() {
        Ending::NotInLibrary => true,
        _ => j.set().iter().any(|c| matches!(c.kind, Kind::Load | Kind::Swinging)),
    };
    let on_string = |j: &Judged| matches!(j.done, Done::OnString(..));
    let healthy = |j: &Judged| j.done == Done::Healthy;
    let others: Vec<&Judged> = judged.iter().filter(|j| j.by_another).collect();
    let as_another = others.iter().filter(|j| j.ending() == Ending::NotInLibrary).count();
    let cut = |j: &Judged| {
        let (most, ..) = j.cut().filter(|(most, ..)| *most >= SIZED_MM)?;
        Some((most, j.size(Kind::WeakMotor)?))
    };
    let weight = |j: &Judged| match &j.done {
        Done::Weight(size, _) => Some((*size as f64, j.size(Kind::Load)?)),
        _ => None,
    };
    let row = |key, what, to_reach, (value, count)| Row { key, what, to_reach, value, count };
    let slowest = judged.iter().map(|j| j.took.as_secs_f64()).fold(0.0, f64::max);
    let another = (as_another as f64 / others.len() as f64, others.len());
    vec![
        row(
            "named",
            "one propeller cut by 3 mm or more, weight at one motor: something named there",
            "0.95",
            share(&Judged::is_one_to_name, &|j| j.is_at(&j.done.motors())),
        ),
        row(
            "apart",
            "of these, propeller and load told apart (both: half)",
            "0.75",
            mean(&|j| (j.is_one_to_name() && j.is_at(&j.done.motors())).then(|| j.told_apart())),
        ),
        row(
            "two",
            "two propellers cut by 4.5 mm or more: these two motors",
            "0.80",
            share(&Judged::is_two_to_name, &|j| j.is_at(&j.done.motors())),
        ),
        row(
            "small",
            "cut by 1.5 mm at most, tape: no gap, not testable, or a set with the truth",
            "0.80",
            share(&Judged::is_small, &tolerable),
        ),
        row(
            "wrong",
            "of these, a wrong single name",
            "at most 0.05",
            share(&Judged::is_small, &wrong),
        ),
        row("string", "weight on a string: a load, or unknown", "0.70", share(&on_string, &swings)),
        row(
            "healthy",
            "healthy flights called a gap",
            "at most 0.08",
            share(&healthy, &|j| j.ending().is_gap()),
        ),
        row(
            "cut",
            "cut in mm against loss of thrust, rank correlation",
            "0.90",
            ranks(own().filter_map(cut)),
        ),
        row(
            "weight",
            "weight against mass, rank correlation",
            "0.90",
            ranks(own().filter_map(weight)),
        ),
        row("another", "healthy under another's references: another vehicle", "0.95", another),
        row(
            "told",
            "smallest loss that was told over that of flights",
            "0.67 to 1.5",
            told(judged),
        ),
        row("shrink", "held-out shrink, pooled over changed flights", "0.6", shrink(judged)),
        row("slowest", "slowest flight, s", "under 5", (slowest, judged.len())),
    ]
}

/// The size at which flights begin to be called a gap, as told and as the flights show it: where the fewest lie on the wrong
/// side.
fn told(judged: &[Judged]) -> (f64, usize) {
    let losses: Vec<(f64, bool, f64)> = judged
        .iter()
        .filter(|j| !j.by_another && matches!(&j.done, Done::Cut(cuts) if cuts.len() == 1))
        .filter_map(|j| {
            let told = j.report.as_ref()?.can_show.iter().find(|s| s.kind == Kind::WeakMotor)?;
            Some((j.size(Kind::WeakMotor)?, j.ending().is_gap(), told.size?))
        })
        .collect();
    let wrong =
        |limit: f64| losses.iter().filter(|(size, called, _)| (*size >= limit) != *called).count();
    let shown = losses.iter().map(|loss| loss.0).min_by_key(|limit| wrong(*limit));
    let mean = losses.iter().map(|loss| loss.2).sum::<f64>() / losses.len() as f64;
    (shown.map_or(f64::NAN, |shown| mean / shown), losses.len())
}

/// Over flights with a change; what is not explained does not shrink.
fn shrink(judged: &[Judged]) -> (f64, usize) {
    let changed = judged.iter().filter(|j| !j.by_another && j.done != Done::Healthy);
    let (mut before, mut after, mut count) = (0.0, 0.0, 0);
    for held_out in changed.filter_map(|j| j.report.as_ref()?.held_out.as_ref()) {
        before += held_out.before;
        after += held_out.after;
        count += 1;
    }
    (1.0 - after / before, count)
}

/// Spearman's rank correlation; equal values share their rank.
fn ranks(pairs: impl Iterator<Item = (f64, f64)>) -> (f64, usize) {
    let (a, b): (Vec<f64>, Vec<f64>) = pairs.unzip();
    let ranked = |values: &[f64]| -> Vec<f64> {
        let rank = |value: &f64| {
            let below = values.iter().filter(|other| *other < value).count() as f64;
            let same = values.iter().filter(|other| *other == value).count() as f64;
            below + 0.5 * (same + 1.0)
        };
        values.iter().map(rank).collect()
    };
    let (a, b) = (ranked(&a), ranked(&b));
    let middle = (a.len() as f64 + 1.0) / 2.0;
    let product = |a: &[f64], b: &[f64]| -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - middle) * (b - middle)).sum()
    };
    (product(&a, &b) / (product(&a, &a) * product(&b, &b)).sqrt(), a.len())
}

/// The outcomes, state by state.
pub fn flights(judged: &[Judged]) -> String {
    let mut states: BTreeMap<(String, String), Vec<String>> = BTreeMap::new();
    for j in judged {
        let kind =
            if j.by_another { format!("{}, another's", j.place[0]) } else { j.place[0].clone() };
        let said = match j.ending() {
            Ending::Named | Ending::OneOf => {
                let ids: Vec<String> = j.set().iter().map(Cause::id).collect();
                ids.join(" | ")
            }
            other => other.key().to_owned(),
        };
        let nothing = j.report.as_ref().map_or(f64::NAN, |report| report.nothing);
        states
            .entry((j.place[1].clone(), kind))
            .or_default()
            .push(format!("{said} ({nothing:.2})"));
    }
    let mut out = String::from("outcome, and probability that nothing is changed\n");
    for ((state, kind), said) in states {
        let _ = writeln!(out, "{state} [{kind}]\n    {}", said.join("; "));
    }
    out
}

/// The table.
pub fn table(judged: &[Judged]) -> String {
    let mut out = String::from("\n| | what | to reach | here | flights |\n|---|---|---|---|---|\n");
    for row in rows(judged) {
        let value =
            if row.value.is_finite() { format!("{:.2}", row.value) } else { "not checked".into() };
        let Row { key, what, to_reach, count, .. } = row;
        let _ = writeln!(out, "| {key} | {what} | {to_reach} | {value} | {count} |");
    }
    out
}
