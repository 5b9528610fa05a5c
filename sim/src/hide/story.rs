//! What was hidden beside what was said, for people and scripts.

use std::fmt::Write;

use haltere_gap::diagnosis::{Diagnosis, ShrinkResult};
use haltere_gap::outcome::Ending;
use haltere_model::effects::Kind;
use haltere_sim::hidden::Hidden;
use serde_json::{Value, json};

/// The page's word on what this shows.
pub const REMARK: &str = "what is wrong here was hidden by the simulator's own laws, which the diagnosis knows: a real vehicle's are \
                          others (docs/GAP_SCORES.md has what is reached where they are)";
/// Candidates among which the right one is worth something.
const FEW: usize = 3;

/// What came of a diagnosis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// What was hidden stands first, or nothing was hidden and nothing found.
    Right,
    /// It is one of the first three candidates.
    AmongThree,
    /// It is not.
    Wrong,
    /// No gap was found.
    NotSeen,
    /// The flight could not be judged.
    NotJudged,
}

impl Mark {
    /// All, in the order in which they are counted.
    pub const ALL: [Self; 5] =
        [Self::Right, Self::AmongThree, Self::Wrong, Self::NotSeen, Self::NotJudged];

    /// Of this diagnosis.
    pub fn of(hidden: &Hidden, diagnosis: &Diagnosis) -> Self {
        let first = diagnosis.effects.first().is_some_and(|effect| effect.id == hidden.id());
        match (diagnosis.outcome, hidden.spec) {
            (Ending::NoGap, None) => Self::Right,
            (Ending::NoGap, Some(_)) => Self::NotSeen,
            (Ending::Fault | Ending::NotTestable, _) => Self::NotJudged,
            _ if first => Self::Right,
            _ if rank(hidden, diagnosis).is_some_and(|rank| rank <= FEW) => Self::AmongThree,
            _ => Self::Wrong,
        }
    }

    /// For people and scripts.
    pub fn word(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::AmongThree => "among three",
            Self::Wrong => "wrong",
            Self::NotSeen => "not seen",
            Self::NotJudged => "not judged",
        }
    }
}

/// Place of what was hidden among the candidates, from 1; `None`: there are none, or it is not one of them.
pub fn rank(hidden: &Hidden, diagnosis: &Diagnosis) -> Option<usize> {
    let candidates = &diagnosis.attribution.as_ref()?.candidates;
    candidates.iter().position(|candidate| candidate.id == hidden.id()).map(|place| place + 1)
}

/// The end of the story. `early`: what was done about flights that ended early.
pub fn story(hidden: &Hidden, early: &[String], diagnosis: &Diagnosis) -> String {
    let mut out = String::new();
    let _ = writeln!(out, "HIDDEN  {}", what(hidden));
    for line in early {
        let _ = writeln!(out, "        {line}");
    }
    let _ = writeln!(out, "SAID    {}", diagnosis.verdict);
    let remarks = diagnosis.remarks.iter().filter(|remark| *remark != REMARK);
    for remark in diagnosis.faults.iter().chain(remarks) {
        let _ = writeln!(out, "        {remark}");
    }
    let place = rank(hidden, diagnosis).map_or(String::new(), |rank| {
        let of = diagnosis.attribution.as_ref().map_or(0, |all| all.candidates.len());
        format!(", {} is candidate {rank} of {of}", hidden.id())
    });
    let sizes = sizes(hidden, diagnosis);
    let missed = match sizes.iter().filter(|(holds, _)| !holds).count() {
        0 => String::new(),
        n => format!("; {n} of {} numbers lie outside of what was said", sizes.len()),
    };
    let _ = writeln!(out, "RESULT  {}{place}{missed}", Mark::of(hidden, diagnosis).word());
    for (_, line) in sizes {
        let _ = writeln!(out, "{line}");
    }
    if diagnosis.not_testable.iter().any(|id| id == hidden.id()) {
        let _ =
            writeln!(out, "        what {} does to this flight is lost in its noise", hidden.id());
    }
    let _ = writeln!(
        out,
        "SHRINK  {}",
        diagnosis.shrink.as_ref().map_or(
            "not measured: no effect was named, or no other flight came to its end".to_owned(),
            closed,
        )
    );
    out
}

fn what(hidden: &Hidden) -> String {
    let Some(spec) = hidden.spec else {
        return "nothing: the vehicle is healthy".to_owned();
    };
    let left = match hidden.halvings {
        0 => String::new(),
        n => format!(", 1/{} of that", 1_u32 << n),
    };
    let numbers: Vec<_> = hidden
        .values()
        .iter()
        .zip(spec.parameters)
        .map(|(v, spec)| match spec.kind {
            Kind::Which(_) => format!("{} {:.0}", v.name, v.value),
            _ => format!("{} {:.3} {}", v.name, v.value, v.unit).trim_end().to_owned(),
        })
        .collect();
    format!("{} {} ({}{left}): {}", spec.id, spec.name, hidden.strength, numbers.join(", "))
}

/// Of what was hidden and named: each number as it was hidden beside what was found, and whether that holds it. Which one of
/// several is no size.
fn sizes(hidden: &Hidden, diagnosis: &Diagnosis) -> Vec<(bool, String)> {
    let found = diagnosis.effects.iter().find(|effect| effect.id == hidden.id());
    let values = hidden.values();
    let specs = hidden.spec.map_or(&[][..], |spec| spec.parameters);
    let beside = values.iter().zip(specs).filter_map(|(value, spec)| {
        let p = found?.parameters.iter().find(|p| p.name == value.name)?;
        if matches!(spec.kind, Kind::Which(_)) {
            let (hidden, found) = (value.value, p.value);
            let line = format!(
                "WHICH   {} hidden {hidden:.0}, found {found:.0}; from 0: {}",
                value.name, spec.doc
            );
            return Some((hidden == found, line));
        }
        let line = format!(
            "SIZE    {} hidden {:.3}, found {:.3} (90 %: {:.3} to {:.3}) {}",
            value.name, value.value, p.value, p.low, p.high, value.unit
        );
        Some(((p.low..=p.high).contains(&value.value), line.trim_end().to_owned()))
    });
    beside.collect()
}

fn closed(shrink: &ShrinkResult) -> String {
    let closed = shrink.value.map_or("there was nothing to shrink".to_owned(), |value| {
        format!("{:.0} % of the gap is gone", 100.0 * value)
    });
    format!(
        "{closed} on flights that the diagnosis had not seen: distance {:.2}, with the effect added {:.2}, of healthy \
         flights {:.2}",
        shrink.before, shrink.after, shrink.floor
    )
}

/// The same for scripts.
pub fn result(hidden: &Hidden, early: &[String], diagnosis: &Diagnosis) -> Value {
    let ids: Vec<&str> = diagnosis.effects.iter().map(|effect| effect.id.as_str()).collect();
    let mark = Mark::of(hidden, diagnosis);
    json!({
        "hidden": { "id": hidden.id(), "parameters": hidden.values(), "halvings": hidden.halvings },
        "said": { "outcome": diagnosis.outcome, "ids": ids },
        "right": mark == Mark::Right,
        "mark": mark.word(),
        "rank": rank(hidden, diagnosis),
        "early": early,
        "shrink": diagnosis.shrink.as_ref().and_then(|shrink| shrink.value),
    })
}
