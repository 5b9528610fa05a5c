//! The one door to a diagnosis: flights, a simulator, accepted flights and what is wanted go in, a [`Diagnosis`] comes out.
//!
//! [`diagnose`] does all of it; [`open`] stops before the verdict, for who asks the simulator something else about a flight.

mod asked;
mod references;
mod session;
mod words;

use crate::advice::{Effort, Hypothesis, Remaining, advise};
use crate::bank::library;
use crate::commission::budget::budget;
use crate::diagnosis::{Advised, Diagnosis, ShrinkResult};
use crate::flight::beside_truth::{BesideTruth, beside_truth};
use crate::outcome::Ending;
use crate::picture::details::details;
use crate::picture::picture;
use crate::scene::Scene;
use crate::shrink::held_out::{Explanation, measure};
pub use asked::{Audience, Flights, Options, References, Refused, Simulator, Truth, say_which};
use haltere_model::effects::EffectSpec;
pub use references::{Accepted, each_once, of_one_mission, read, same_survey};
pub use session::{Opened, Session, open};
pub use words::in_words;

/// Effects that are not named and flown as control.
const RIVALS: usize = 5;

/// Says where a flight differs from the simulator, which effect causes it, and how far the gap closes once that is added.
///
/// # Errors
/// [`Refused`]: a file that cannot be read, flights that do not fit one another, a mission that the simulator does not fly. A log that
/// cannot be trusted and a flight that cannot be judged are outcomes of a diagnosis.
pub fn diagnose(
    flights: &Flights,
    simulator: &Simulator,
    references: &References,
    options: &Options<'_>,
) -> Result<Diagnosis, Refused> {
    let session = match open(flights, simulator, references, options.audience)? {
        Opened::Ready(session) => session,
        Opened::Fault(diagnosis) => return Ok(*diagnosis),
    };
    let flown = &session.seen.flown;
    let truth = options.truth.map(|truth| match truth {
        Truth::File(points, source) => beside_truth(&flown.trace, points, source),
        Truth::Captured => {
            let captured = flown.trace.references.iter();
            let points: Vec<_> = captured.map(|r| (r.valid_at, r.pos_E_m)).collect();
            let source = format!("motion capture in {}", flown.path.display());
            beside_truth(&flown.trace, &points, &source)
        }
    });
    let truth: Option<BesideTruth> = truth.transpose()?;
    let mut diagnosis = session.judge();
    diagnosis.truth = truth;
    if diagnosis.wants_budget {
        budgeted(&session, &mut diagnosis, options.audience);
    }
    if !session.others.is_empty() {
        shrink(&session, &mut diagnosis, options.audience)?;
    }
    if options.picture {
        draw(&session, &mut diagnosis, options.audience);
    }
    if options.advice {
        advised(&session, &mut diagnosis, options.audience);
    }
    Ok(diagnosis)
}

/// Asks which constants of the vehicle file differ, by all flights of the mission.
fn budgeted(session: &Session, diagnosis: &mut Diagnosis, audience: &dyn Audience) {
    let own = &session.seen.flown;
    let fellows = session.others.iter().filter(|flown| references::same_flight(own, flown).is_ok());
    let flights: Vec<_> = std::iter::once(own).chain(fellows).collect();
    // What differs is told beside the file, also where that is not what flies.
    let scene = Scene { vehicle: session.file.clone(), ..session.scene.clone() };
    let found = budget(&scene, &session.workshop.items, &flights, |done, of| {
        audience.at("budget", done, of);
    });
    match found {
        Ok(found) => diagnosis.budgeted(found),
        Err(why) => diagnosis.remarks.push(format!("no budget: {why}")),
    }
}

/// What is named as one explanation: set members are alternatives, and the first stands for them;
/// several act together.
fn explanation(diagnosis: &Diagnosis) -> Option<Explanation> {
    let together = if diagnosis.outcome == Ending::Several { diagnosis.effects.len() } else { 1 };
    let effects: Vec<(&'static EffectSpec, Vec<f64>)> = diagnosis
        .effects
        .iter()
        .take(together)
        .filter_map(|e| {
            Some((library::find(&e.id)?, e.parameters.iter().map(|p| p.value).collect()))
        })
        .collect();
    let name = effects.iter().map(|(s, _)| s.id).collect::<Vec<_>>().join(" + ");
    (!effects.is_empty()).then_some(Explanation { name, effects })
}

/// Measures on the held-out flights how far what is named closes the gap, beside what is not named.
fn shrink(
    session: &Session,
    diagnosis: &mut Diagnosis,
    audience: &dyn Audience,
) -> Result<(), Refused> {
    let (flights, accepted) = (&session.others, &session.held_out_references);
    for flown in flights {
        if let Some(fault) = flown.faults.first() {
            let why = format!("{}: no held-out flight: {fault}", flown.path.display());
            return Err(Refused::Given(why));
        }
    }
    let spec = |id: &str| session.workshop.spec(id);
    let suspect = || {
        let first = diagnosis.suspect()?;
        let effects = vec![(spec(&first.id)?, first.theta.clone())];
        Some(Explanation { name: first.id.clone(), effects })
    };
    let Some(mut named) = explanation(diagnosis).or_else(suspect) else { return Ok(()) };
    let mut rivals: Vec<Explanation> = Vec::new();
    if let Some(attribution) = &diagnosis.attribution {
        let others = attribution.candidates.iter().filter(|c| {
            !diagnosis.set.contains(&c.id) && c.id != named.name && !c.theta.is_empty()
        });
        rivals.extend(others.take(RIVALS).filter_map(|c| {
            let effects = vec![(spec(&c.id)?, c.theta.clone())];
            Some(Explanation { name: c.id.clone(), effects })
        }));
        // More freedom than the named one has: what could be reached.
        let pair = attribution.pairs.first().filter(|_| named.effects.len() == 1);
        rivals.extend(pair.and_then(|pair| {
            let [a, b] = [spec(&pair.ids[0])?, spec(&pair.ids[1])?];
            let effects = vec![(a, pair.theta[0].clone()), (b, pair.theta[1].clone())];
            Some(Explanation { name: pair.ids.join(" + "), effects })
        }));
    }
    let all = std::iter::once(&mut named).chain(&mut rivals);
    session.resize(&mut all.collect::<Vec<_>>(), audience);
    let shelf = session.shelf();
    let r = measure(flights, accepted, &session.told, &named, &rivals, &shelf, |done, of| {
        audience.at("shrink", done, of);
    })?;
    for (k, rung) in diagnosis.ladder.iter_mut().enumerate() {
        rung.held_out = match k {
            0 => Some(r.whole.before),
            1 if diagnosis.set.first().is_some_and(|id| rung.name == format!("+ {id}")) => {
                Some(r.whole.after)
            }
            _ => None,
        };
    }
    diagnosis.shrink = Some(ShrinkResult {
        value: r.whole.value,
        low: r.whole.interval.map(|i| i[0]),
        high: r.whole.interval.map(|i| i[1]),
        floor: r.whole.floor,
        before: r.whole.before,
        after: r.whole.after,
        noise: r.whole.noise,
        attainable: r.attainable,
        attained_by: r.attained_by,
        efficiency: r.efficiency,
        channels: r.channels,
        others: r.wrong,
        wrong: r.wrong_median,
        flights: flights.len(),
        references: accepted.len(),
    });
    diagnosis.weigh_held_out(&session.workshop);
    Ok(())
}

/// Cells, onset, floor plan, signature.
fn draw(session: &Session, diagnosis: &mut Diagnosis, audience: &dyn Audience) {
    let flown = &session.seen.flown;
    let Ok(own) = details(&flown.trace, &session.workshop.nominal) else { return };
    let named = explanation(diagnosis);
    let effects = named.iter().flat_map(|n| &n.effects).map(|(spec, theta)| (*spec, &theta[..]));
    diagnosis.picture = Some(picture(
        &session.scene,
        &flown.mission,
        &own,
        &session.reference_details,
        &effects.collect::<Vec<_>>(),
        &session.shelf(),
        |done, of| audience.at("cells", done, of),
    ));
}

/// What a diagnosis left open.
pub fn remaining(d: &Diagnosis) -> Remaining {
    let candidates = d.attribution.as_ref().map_or(&[][..], |a| &a.candidates[..]);
    // What is not in the library is not told apart by effects of the library.
    let hypotheses = candidates.iter().filter(|_| d.outcome.is_explained()).filter_map(|c| {
        Some(Hypothesis {
            spec: library::find(&c.id)?,
            probability: c.posterior,
            theta: c.theta.clone(),
            theta_90: c.theta_90.clone(),
        })
    });
    let untested = d.not_testable.iter().filter_map(|id| library::find(id)).collect();
    Remaining::new(hypotheses.collect(), &d.set, untested)
}

/// Experiments, where anything is open.
fn advised(session: &Session, diagnosis: &mut Diagnosis, audience: &dyn Audience) {
    if diagnosis.attribution.is_none() {
        return;
    }
    let open = remaining(diagnosis);
    let experiments = if open.is_settled() {
        Vec::new()
    } else {
        let shelf = session.shelf();
        let tell = |done, of| audience.at("advice", done, of);
        advise(&session.scene, &open, Effort::Listed, &shelf, tell)
    };
    diagnosis.advice = Some(Advised {
        open: open.candidates.iter().map(|h| (h.spec.id.to_owned(), h.probability)).collect(),
        correct_now: open.correct_now(),
        left_out: open.left_out.clone(),
        experiments,
    });
}
