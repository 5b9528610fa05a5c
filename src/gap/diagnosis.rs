//! The diagnosis of one flight: gate 0, where, which, how far, and what could not be tested.

use serde::Serialize;

use crate::advice::Advice;
use crate::attribute::{Attribution, Attributor, Candidate, PairCandidate};
use crate::balance::beside::Beside;
use crate::bank::library::whole;
use crate::bank::workshop::Workshop;
use crate::commission::Fitted;
use crate::commission::budget::Budget;
use crate::flight::beside_truth::BesideTruth;
use crate::flight::logs::{Flown, ParameterDifference};
use crate::flight::statistics::{Observation, observe};
use crate::nominal::Nominal;
use crate::outcome::{Ending, Named, Outcome, Remainder};
use crate::picture::Picture;
use crate::places::{Heard, exonerated, places, take_anchors};
pub use crate::places::{Part, Where};
use crate::said::{chosen, said};
use crate::shrink::{medians, scales};
use haltere_log::record::LogFlight;
use haltere_log::replay::{Differs, Report};
use haltere_model::effects::Kind;

/// A named parameter.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// Name.
    pub name: String,
    /// Of a choice, what was chosen: `anchor 4`. Its value is the place in the survey, as in a scenario.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub chosen: Option<String>,
    /// Best value.
    pub value: f64,
    /// Lower end of 90 %.
    pub low: f64,
    /// Upper end of 90 %.
    pub high: f64,
    /// Unit.
    pub unit: String,
}

/// An effect with its parameters by name.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Effect {
    /// Id of docs/EFFECTS.md.
    pub id: String,
    /// Name.
    pub name: String,
    /// Calibrated probability.
    pub probability: f64,
    /// What it is, with its sizes and directions, as a sentence.
    pub said: String,
    /// Parameters in the order of the specification.
    pub parameters: Vec<Parameter>,
}

/// Everything about one flight.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Diagnosis {
    /// The log.
    pub log: String,
    /// Which flight in it; absent: it holds none, or cannot be read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flight: Option<LogFlight>,
    /// Key of the outcome.
    pub outcome: Ending,
    /// The verdict in a line of terms; [`crate::door::in_words`] says it to anybody.
    pub verdict: String,
    /// Why nothing is named, where that has a reason of its own.
    #[serde(skip)]
    pub why: String,
    /// What the best explanation explains and what it leaves; absent without a gap.
    pub explained: Option<Explained>,
    /// Where: blocks that can be the cause, likeliest first, then those where its consequences show.
    #[serde(rename = "where")]
    pub places: Vec<Where>,
    /// Blocks that cannot be the cause, since they replay bit for bit from their logged inputs.
    pub exonerated: Vec<String>,
    /// Effects that are named, or the set that cannot be told apart.
    pub effects: Vec<Effect>,
    /// Their ids.
    pub set: Vec<String>,
    /// Effects of the library that this flight would not have shown, or with which its mission is not flown.
    pub not_testable: Vec<String>,
    /// How far, on held-out flights; absent without any.
    pub shrink: Option<ShrinkResult>,
    /// The balance of forces by accepted flights alone, and whether it says the same; absent without accepted flights.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub balance: Option<Beside>,
    /// Which constants of the vehicle file differ, where no accepted flights told what the vehicle itself differs by.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub budget: Option<Budget>,
    /// The vehicle that the simulator flew, where accepted flights had to say it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub commissioned: Option<Fitted>,
    /// What the replay came to.
    pub replay: String,
    /// Reasons why the log cannot be judged.
    pub faults: Vec<String>,
    /// Oddities of the log.
    pub remarks: Vec<String>,
    /// The estimate beside the truth, where that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<BesideTruth>,
    /// Keys of the configuration that are not at their default.
    pub parameters_changed: Vec<ParameterDifference>,
    /// Hash of the bank.
    pub bank: String,
    /// What else the verdict hangs on.
    pub made_with: MadeWith,
    /// Reference flights behind the floor; 0: relative to the nominal simulator.
    pub references: usize,
    /// What adding explanations leaves, from none to two effects.
    pub ladder: Vec<Rung>,
    /// Cells, onset, floor plan, signature; absent where they were not asked for.
    pub picture: Option<Picture>,
    /// Experiments, best first; absent where they were not asked for.
    pub advice: Option<Advised>,
    /// Everything behind the verdict.
    pub attribution: Option<Attribution>,
    /// Whether a budget is to be asked for ([`Diagnosis::budgeted`]): a whole mission, no accepted flights, and no effect that explains it.
    #[serde(skip)]
    pub wants_budget: bool,
}

/// How far the best explanation of a gap goes, whether or not it is believed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Explained {
    /// Its effects.
    pub by: Vec<String>,
    /// Share of the gap that it explains.
    pub share: f64,
    /// Share of the gap that the first effect foretells in statistics that its size was not fitted to.
    pub foretold: f64,
    /// What is left, and in which block.
    pub left: Remainder,
}

impl Explained {
    fn of(attribution: &Attribution) -> Option<Self> {
        let outcome = &attribution.outcome;
        if matches!(outcome, Outcome::NoMaterialGap | Outcome::Fault { .. }) {
            return None;
        }
        let first = attribution.candidates.first()?;
        let by = match outcome {
            Outcome::Several { effects } => effects.iter().map(|e| e.id.clone()).collect(),
            _ => vec![first.id.clone()],
        };
        let adequacy = &attribution.adequacy;
        let left = attribution.remainder.clone();
        Some(Self { by, share: adequacy.explained, foretold: adequacy.foretold, left })
    }

    /// For people.
    pub fn words(&self) -> String {
        let all = whole();
        let name = |id: &String| {
            let spec = all.iter().find(|spec| spec.id == *id);
            spec.map_or_else(|| id.clone(), |spec| format!("{id} {}", spec.name))
        };
        let by: Vec<String> = self.by.iter().map(name).collect();
        let foretold = if self.by.len() == 1 {
            format!(", of which {:.2} is foretold from other statistics", self.foretold.max(0.0))
        } else {
            String::new()
        };
        let by = by.join(" and ");
        format!("{:.2} of the gap by {by}{foretold}; left {}", self.share, self.left.sentence())
    }
}

/// What a verdict hangs on besides the log.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct MadeWith {
    /// SHA-256 of the log; empty where it could not be read.
    pub log_sha256: String,
    /// Program version.
    pub program: String,
    /// Hash of the program's sources.
    pub source_hash: String,
    /// Ids of the library.
    pub library: Vec<String>,
    /// Flights in the bank: seeds, with jitter, of each effect at least.
    pub bank_flights: [usize; 3],
}

/// A step of the ladder of explanations.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rung {
    /// What is added to the nominal model.
    pub name: String,
    /// Normal score of the distance that is left on this flight.
    pub left: f64,
    /// Distance that is left on held-out flights, where there are any.
    pub held_out: Option<f64>,
}

/// What could be done next.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Advised {
    /// Candidates that are not ruled out, with their share of the probability.
    pub open: Vec<(String, f64)>,
    /// Probability that the first of them is right.
    pub correct_now: f64,
    /// Candidates and untestable effects that were not looked at.
    pub left_out: Vec<String>,
    /// Experiments, best first.
    pub experiments: Vec<Advice>,
}

/// Shrink for people and scripts.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct ShrinkResult {
    /// Share of the gap that is closed; `None`: nothing to shrink.
    pub value: Option<f64>,
    /// Lower end of 95 %.
    pub low: Option<f64>,
    /// Upper end of 95 %.
    pub high: Option<f64>,
    /// Distance of two flights of the fitted model.
    pub floor: f64,
    /// Distance before and after.
    pub before: f64,
    /// After.
    pub after: f64,
    /// 95 % noise of a distance above the floor; below it there is nothing to shrink.
    pub noise: f64,
    /// The best that any explanation reached.
    pub attainable: Option<f64>,
    /// Which one.
    pub attained_by: String,
    /// Shrink over attainable.
    pub efficiency: Option<f64>,
    /// By channel.
    pub channels: Vec<(String, crate::shrink::Shrink)>,
    /// Shrink of each other effect that was tried.
    pub others: Vec<(String, Option<f64>)>,
    /// Median over other effects of the library.
    pub wrong: Option<f64>,
    /// Held-out flights that it was measured on.
    pub flights: usize,
    /// Accepted flights on the held-out mission; without them the distance holds all that this airframe
    /// differs from the nominal simulator by.
    pub references: usize,
}

impl ShrinkResult {
    /// In a line of terms.
    pub fn words(&self) -> String {
        let value = self.value.map_or("nothing to shrink".to_owned(), |v| format!("{v:.2}"));
        let interval = match (self.low, self.high) {
            (Some(low), Some(high)) => format!(" (95 %: {low:.2} to {high:.2})"),
            _ => " (no interval: fewer than three held-out flights)".to_owned(),
        };
        let more =
            |name: &str, v: Option<f64>| v.map_or(String::new(), |v| format!(", {name} {v:.2}"));
        format!(
            "{value}{interval}: distance {:.2} to {:.2}, floor {:.2}{}{}",
            self.before,
            self.after,
            self.floor,
            more("best of what was tried", self.attainable),
            more("median of other effects", self.wrong)
        )
    }
}

/// Least held-out shrink that overrules a refusal: three times what retuning all constants reaches without any effect
/// (docs/GAP_SCORES.md; judgement).
const PREDICTS: f64 = 0.3;
/// Held-out shrink below which a name is taken back: no more than retuned constants reach without any effect (0.09 there).
const PREDICTS_NOTHING: f64 = 0.1;
/// Least probability of an effect whose refusal other flights can overrule: it must be the first by far.
const LIKELY: f64 = 0.5;

impl Diagnosis {
    /// What was compared with what.
    pub fn compared(&self) -> String {
        let against = match self.references {
            0 => "the nominal simulator".to_owned(),
            n => format!("the nominal simulator and {n} reference flights"),
        };
        let flight = self.flight.filter(|flight| flight.of > 1);
        let flight = flight.map_or(String::new(), |flight| format!(", {flight},"));
        format!("{}{flight} against {against}, replay {}", self.log, self.replay)
    }

    /// Exit code of `haltere gap diagnose`.
    pub fn exit_code(&self) -> u8 {
        self.outcome.exit_code()
    }

    /// Takes a budget for the answer, if it has parts.
    pub fn budgeted(&mut self, budget: Budget) {
        if budget.parts.is_empty() {
            self.remarks.push(format!("the vehicle file: {}", budget.words()));
        } else {
            let outcome = Outcome::Budget { why: budget.words() };
            self.outcome = outcome.kind();
            self.verdict = outcome.sentence(str::to_owned);
            self.why = outcome.why().to_owned();
        }
        self.budget = Some(budget);
    }

    /// The effect whose shrink is measured though the verdict refuses it: other flights may know better.
    pub fn suspect(&self) -> Option<&Candidate> {
        let refused = self.outcome == Ending::NotInLibrary;
        let first = self.attribution.as_ref().filter(|_| refused)?.candidates.first()?;
        (first.posterior >= LIKELY && !first.theta.is_empty()).then_some(first)
    }

    /// Held against flights that the fit did not see: a refused effect that makes the simulator more like them, and no other does so
    /// more, is named with what it leaves; a name that makes it no more like them is taken back. Nothing is weighed without accepted
    /// flights of their mission: then the distance holds all that the vehicle differs by.
    pub fn weigh_held_out(&mut self, workshop: &Workshop) {
        let (Some(shrink), Some(attribution)) = (&self.shrink, &self.attribution) else { return };
        let Some(value) = shrink.value.filter(|_| shrink.references > 0) else { return };
        let singles = shrink.others.iter().filter(|(name, _)| !name.contains('+'));
        let best = singles.filter_map(|(_, other)| *other).all(|other| other <= value);
        let predicts = value >= PREDICTS && shrink.low.is_none_or(|low| low > 0.0) && best;
        let predicts_nothing =
            value < PREDICTS_NOTHING && shrink.high.is_none_or(|high| high < PREDICTS);
        let remainder = attribution.remainder.clone();
        let (outcome, remark) = match (self.suspect(), &attribution.outcome) {
            (Some(first), _) if predicts => {
                let effect = Named {
                    id: first.id.clone(),
                    probability: first.posterior,
                    theta: first.theta.clone(),
                    theta_90: first.theta_90.clone(),
                };
                let remark = format!(
                    "refused on this flight alone; named since it closes {value:.2} of the gap of other flights"
                );
                (Outcome::NamedWithRemainder { effect, remainder }, remark)
            }
            (None, Outcome::Named { effect } | Outcome::NamedWithRemainder { effect, .. })
                if predicts_nothing =>
            {
                let remark = format!(
                    "{} was named on this flight alone; taken back since it closes {value:.2} of the gap of other flights",
                    effect.id
                );
                (Outcome::NotInLibrary { remainder }, remark)
            }
            _ => return,
        };
        self.remarks.push(remark);
        self.conclude(workshop, &outcome);
        if let Some(attribution) = &mut self.attribution {
            attribution.outcome = outcome;
        }
    }

    /// The verdict in all its words.
    fn conclude(&mut self, workshop: &Workshop, outcome: &Outcome) {
        self.outcome = outcome.kind();
        self.effects = outcome.effects().iter().map(|e| effect(workshop, e)).collect();
        self.set = self.effects.iter().map(|e| e.id.clone()).collect();
        self.why = outcome.why().to_owned();
        self.verdict = outcome.sentence(|id| {
            let spec = workshop.spec(id);
            spec.map_or_else(|| id.to_owned(), |spec| format!("{} {}", spec.id, spec.name))
        });
    }
}

/// A flight that was observed.
#[derive(Debug, Clone)]
pub struct Observed {
    /// Log and trace.
    pub flown: Flown,
    /// What was seen; `Err`: why nothing.
    pub observation: Result<Observation, String>,
}

/// Observes a log.
pub fn observed(flown: Flown, nominal: &Nominal) -> Observed {
    let observation = observe(&flown.trace, nominal).map_err(|e| e.to_string());
    Observed { flown, observation }
}

/// The verdict on a log that cannot even be read or replayed.
pub fn unreadable(log: String, why: String) -> Diagnosis {
    let outcome = Outcome::Fault { why: why.clone() };
    Diagnosis {
        log,
        outcome: outcome.kind(),
        verdict: outcome.sentence(str::to_owned),
        why: why.clone(),
        replay: "not_possible".to_owned(),
        faults: vec![why],
        ..Diagnosis::default()
    }
}

/// The verdict on one observed flight.
pub fn judge(
    workshop: &Workshop,
    attributor: &Attributor,
    references: usize,
    seen: &Observed,
) -> Diagnosis {
    let flown = &seen.flown;
    let mut result = Diagnosis {
        log: flown.path.display().to_string(),
        flight: flown.flight,
        replay: replay_word(&flown.replay),
        faults: flown.faults.clone(),
        remarks: flown.remarks.clone(),
        parameters_changed: flown.parameters.clone(),
        bank: format!("{:016x}", workshop.bank_hash),
        made_with: made_with(workshop),
        references,
        ..Diagnosis::default()
    };
    let outcome = match (&seen.observation, flown.faults.first()) {
        (_, Some(fault)) => Outcome::Fault { why: fault.clone() },
        (Err(why), None) => Outcome::NotTestable { why: why.clone() },
        (Ok(observation), None) => {
            let mut attribution = attributor.attribute(&observation.statistics);
            let heard = Heard {
                statistics: &observation.statistics,
                worst: &observation.anchors,
                surveyed: flown.trace.survey.ids(),
            };
            take_anchors(&mut attribution, heard);
            result.places = places(&attribution, heard, &workshop.bank);
            result.exonerated = exonerated(&flown.replay);
            result.not_testable = not_testable(workshop, observation);
            let came_far = flown.trace.came_as_far_as(workshop.nominal.until_s);
            let unsure = matches!(
                attribution.outcome,
                Outcome::NotInLibrary { .. } | Outcome::NamedWithRemainder { .. }
            );
            let alone = unsure && references == 0;
            result.wants_budget = alone && came_far;
            let outcome = comparable(&attribution, came_far, alone);
            // What is said has shown.
            result.not_testable.retain(|id| !outcome.effects().iter().any(|e| e.id == *id));
            result.ladder = ladder(&attribution, &result.not_testable);
            result.explained = Explained::of(&attribution);
            result.attribution = Some(attribution);
            outcome
        }
    };
    result.conclude(workshop, &outcome);
    result
}

/// The outcome of an attribution, unless it says nothing about the library: half a mission differs from a whole one in most
/// statistics, and without accepted flights all that the vehicle itself differs from the simulator by is a gap. `alone`: it is not
/// sure, and there are none.
fn comparable(attribution: &Attribution, came_far: bool, alone: bool) -> Outcome {
    let refused = matches!(attribution.outcome, Outcome::NotInLibrary { .. });
    if refused && !came_far {
        let why = "the mission ended too early to be compared with whole ones; the last events in the log say why";
        return Outcome::NotTestable { why: why.to_owned() };
    }
    if alone {
        let why = "no effect makes this flight of the simulated vehicle, and without accepted flights all that this \
                   vehicle differs by counts as gap: give eight or more of its healthy flights (--reference)";
        return Outcome::NotTestable { why: why.to_owned() };
    }
    attribution.outcome.clone()
}

/// What the replay came to in one word: which of both differs where another build flew.
fn replay_word(replay: &Report) -> String {
    match replay.differs {
        Some(Differs::OtherTraffic) if !replay.same_source => "other_traffic_differs".to_owned(),
        Some(Differs::Setpoints) if !replay.same_source => "setpoints_differ".to_owned(),
        _ => format!("{:?}", replay.verdict).to_lowercase(),
    }
}

fn made_with(workshop: &Workshop) -> MadeWith {
    let build = haltere_log::record::BuildIdentity::current();
    let bank = &workshop.bank;
    MadeWith {
        log_sha256: String::new(),
        program: build.program_version.clone(),
        source_hash: build.source_hash.clone(),
        library: workshop.library.iter().map(|s| s.id.to_owned()).collect(),
        bank_flights: [
            bank.seeds.len(),
            bank.jitter.len(),
            bank.effects.iter().map(|e| e.draws.len()).min().unwrap_or(0),
        ],
    }
}

/// Nominal, the best effect, the best two of those that this flight can show.
fn ladder(attribution: &Attribution, not_testable: &[String]) -> Vec<Rung> {
    let rung = |name: String, left: f64| Rung { name, left, held_out: None };
    let mut rungs = vec![rung("nominal".to_owned(), attribution.gate.distance)];
    if let Some(best) = attribution.candidates.first() {
        rungs.push(rung(format!("+ {}", best.id), best.residual_score));
    }
    let shown = |pair: &&PairCandidate| !pair.ids.iter().any(|id| not_testable.contains(id));
    if let Some(pair) = attribution.pairs.iter().find(shown) {
        rungs.push(rung(format!("+ {}", pair.ids.join(" + ")), pair.residual_score));
    }
    rungs
}

fn effect(workshop: &Workshop, named: &Named) -> Effect {
    let spec = workshop.spec(&named.id);
    let parameters = spec.map_or(&[][..], |s| s.parameters);
    let anchors = workshop.scene.survey.ids();
    Effect {
        id: named.id.clone(),
        name: spec.map_or("", |s| s.name).to_owned(),
        probability: named.probability,
        said: spec
            .map_or_else(String::new, |spec| said(spec, &named.theta, &named.theta_90, anchors)),
        parameters: parameters
            .iter()
            .zip(named.theta.iter().zip(&named.theta_90))
            .map(|(p, (value, [low, high]))| Parameter {
                name: p.name.to_owned(),
                chosen: match p.kind {
                    Kind::Which(which) => Some(chosen(which, *value, anchors)),
                    _ => None,
                },
                value: p.told(*value),
                low: p.told(*low),
                high: p.told(*high),
                unit: p.unit.to_owned(),
            })
            .collect(),
    }
}

/// An effect is testable when most of its own flights lie outside what null flights do, on the
/// statistics that this flight has. One that is not in the bank, since no flight with it came to its end, is not.
fn not_testable(workshop: &Workshop, seen: &Observation) -> Vec<String> {
    let sigma = scales(&workshop.bank.jitter);
    let middle = medians(&workshop.bank.jitter);
    // The loudest known statistic is a poor test and a fair description of "would be seen".
    let loudest = |row: &[f64]| {
        row.iter()
            .zip(&seen.statistics)
            .zip(middle.iter().zip(&sigma))
            .filter(|((_, own), _)| own.is_finite())
            .map(|((v, _), (m, s))| ((v - m) / s).abs())
            .filter(|z| z.is_finite())
            .fold(0.0, f64::max)
    };
    let mut nulls: Vec<f64> = workshop.bank.jitter.iter().map(|r| loudest(r)).collect();
    nulls.sort_by(f64::total_cmp);
    let limit = nulls.get(nulls.len() * 19 / 20).copied().unwrap_or(f64::INFINITY);
    let is_testable = |id: &str| {
        let flown = workshop.bank.effects.iter().find(|e| e.id == id);
        flown.is_some_and(|e| {
            let loud = e.draws.iter().filter(|d| loudest(&d.statistics) > limit).count();
            2 * loud >= e.draws.len()
        })
    };
    let ids = workshop.library.iter().map(|spec| spec.id);
    ids.filter(|id| !is_testable(id)).map(str::to_owned).collect()
}

#[cfg(test)]
mod tests;
