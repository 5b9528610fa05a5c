//! Force balance of recorded flights: which force is missing in the nominal model.
//!
//! For flights with motion capture, command and voltage, and no companion's log. Measured specific
//! force (motion capture, differentiated) stands against the nominal forces of the vehicle file; what
//! is left is regressed on candidates of the effect list. What counts is a flight that the fit has
//! not seen. Method and words: GAP.md 2.2 (equation error), 2.4, 2.5 and 2.7.

pub mod blocks;
pub mod report;
pub mod search;
pub mod terms;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_recorded;

use blocks::{Block, Fit, bootstrap, fit, mean, mean_square};
use haltere_core::frames::G_MPS2;
use haltere_log::import::{Recording, motion};
use haltere_model::vehicle::Vehicle;
use report::{Axis, Candidate, Effect, Outcome, Parameter, Report, Shrink, Where};
use search::{Found, LEVEL, MATERIAL_MPS2, Question, Verdict, fit_without};
use terms::{Column, Nominal, Part, Sign, Term};

/// Correlation time of the residual, s: a mean over a block still scatters by this (README of the
/// recordings and our own residuals: some 0.5 s).
const CORRELATION_S: f64 = 0.5;
/// A slope of the residual is told from this many sigmas on.
const SLOPE_SIGMAS: f64 = 3.0;
/// Blocks that a fit needs at least: fewer give no interval.
const LEAST_BLOCKS: usize = 6;

/// Names of the body axes.
pub const AXES: [&str; 3] = ["forward", "right", "down"];

/// Why a balance could not be made.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Too little flight.
    #[error(
        "{what}: {blocks} blocks of 5 s in the air with motion capture, at least {LEAST_BLOCKS} needed"
    )]
    TooShort {
        /// Which flights.
        what: String,
        /// Blocks found.
        blocks: usize,
    },
    /// The nominal model could not be calibrated.
    #[error("{0}: thrust scale and tilts cannot be fitted")]
    NoCalibration(String),
}

/// Diagnoses `held_out` flights against the nominal model calibrated on `fit_on`; with nothing held
/// out, the fit flights against themselves by cross-validation.
pub fn diagnose(
    fit_on: &[Recording],
    held_out: &[Recording],
    vehicle: &Vehicle,
    without: &[Part],
) -> Result<Report, Error> {
    let nominal = Nominal::new(vehicle, without);
    let terms = terms::candidates(&nominal);
    let mut columns = terms::calibrations();
    let mut first = Vec::new();
    for term in &terms {
        first.push(columns.len());
        columns.extend(&term.columns);
    }
    let probes_at = columns.len();
    let with_probes: Vec<Column> = columns.iter().copied().chain(probes()).collect();
    let sums = |flights: &[Recording]| {
        let mut found: Vec<Block> = Vec::new();
        let mut lost = 0;
        for flight in flights {
            let (samples, lost_here) = motion::samples(flight);
            lost += lost_here;
            found.extend(blocks::blocks(&samples, &nominal, &with_probes));
        }
        (found, lost)
    };
    let (fit_blocks, fit_lost) = sums(fit_on);
    let (held_blocks, held_lost) = sums(held_out);
    let names =
        |flights: &[Recording]| -> Vec<String> { flights.iter().map(|f| f.name.clone()).collect() };
    for (flights, blocks) in [(fit_on, &fit_blocks), (held_out, &held_blocks)] {
        if !flights.is_empty() && blocks.len() < LEAST_BLOCKS {
            let what = names(flights).join(", ");
            return Err(Error::TooShort { what, blocks: blocks.len() });
        }
    }
    let calibrations: Vec<usize> = (0..first.first().copied().unwrap_or(probes_at)).collect();
    let no_calibration = || Error::NoCalibration(names(fit_on).join(", "));
    let rough = fit(&fit_blocks, &calibrations, [1.0; 3]).ok_or_else(no_calibration)?;
    let weight = std::array::from_fn(|a| mean_square(&fit_blocks, a, &rough).max(1e-6).recip());
    let question = Question {
        terms: &terms,
        columns: &columns,
        first: &first,
        fit_on: &fit_blocks,
        held_out: &held_blocks,
        weight,
    };
    let before = fit(&fit_blocks, &calibrations, weight).ok_or_else(no_calibration)?;
    let found = question.search();
    let mut active = calibrations.clone();
    active.extend(found.steps.iter().flat_map(|s| s.columns.iter().copied()));
    active.sort_unstable();
    let after = fit(&fit_blocks, &active, weight).ok_or_else(no_calibration)?;

    let unseen: &[Block] = if held_blocks.is_empty() { &fit_blocks } else { &held_blocks };
    let axes = axes(unseen, &before, &after);
    let effects = effects(&question, &found, &after);
    let floor = |axis| floor(unseen, axis, &question, &found);
    let named_axes: Vec<usize> = touched(&found, &columns);
    let shrink = (!found.steps.is_empty() && !held_blocks.is_empty())
        .then(|| shrink(unseen, &named_axes, weight, &before, &after, floor));
    let candidates: Vec<Candidate> = found
        .first_round
        .iter()
        .filter_map(|trial| {
            terms.get(trial.term).map(|term| Candidate {
                id: term.id,
                name: term.name(),
                verdict: trial.verdict,
                gain: trial.gain,
            })
        })
        .collect();
    let pooled: Vec<Block> = fit_blocks.iter().chain(&held_blocks).cloned().collect();
    let places = places(&pooled, &before, probes_at);
    let remainder = axes.iter().any(|a| a.unexplained_mps2 >= a.material_mps2);
    let ids = |at: &[usize]| -> Vec<&'static str> {
        at.iter().filter_map(|t| terms.get(*t)).map(|t| t.id).collect()
    };
    // A rival of the first effect that was taken after it is no alternative to it.
    let set: Vec<&'static str> = found
        .steps
        .first()
        .map(|s| {
            let later = |t: &usize| found.steps.iter().all(|step| step.term != *t);
            let rivals: Vec<usize> = s.rivals.iter().copied().filter(later).collect();
            ids(&[&[s.term][..], &rivals].concat())
        })
        .unwrap_or_default();
    let outcome = match (found.steps.len(), held_out.is_empty()) {
        (0, _) if remainder => Outcome::NotInLibrary,
        (0, _) => Outcome::NoGap,
        (1, false) if set.len() > 1 => Outcome::Ambiguous,
        // One flight alone has nothing unseen: what it names is a set at best.
        (_, true) => Outcome::Ambiguous,
        (1, false) if remainder => Outcome::NamedWithRemainder,
        (1, false) => Outcome::Named,
        _ => Outcome::Several,
    };
    let control = control(&found);
    let mut not_testable: Vec<(&'static str, String)> = candidates
        .iter()
        .filter(|c| c.verdict == Verdict::NotTestable)
        .map(|c| (c.id, "not excited on the fitted flights".to_string()))
        .collect();
    not_testable.extend(terms::BEYOND.iter().map(|(id, why)| (*id, (*why).to_string())));
    Ok(Report {
        outcome,
        fitted_on: names(fit_on),
        held_out: names(held_out),
        without: without.iter().map(|p| report::part_name(*p)).collect(),
        blocks: [fit_blocks.len(), held_blocks.len()],
        lost_samples: fit_lost + held_lost,
        skipped_rows: fit_on.iter().chain(held_out).map(|f| f.skipped).collect(),
        thrust_scale: before.of(0).unwrap_or(f64::NAN),
        places,
        effects,
        set,
        candidates,
        axes,
        shrink,
        control,
        not_testable,
    })
}

/// Axes on which the credited effects act.
fn touched(found: &Found, columns: &[Column]) -> Vec<usize> {
    let acts = |axis: usize| {
        found.steps.iter().flat_map(|s| &s.columns).any(|c| {
            columns.get(*c).is_some_and(|c| match c.name {
                "forward" => axis == 0,
                "right" => axis == 1,
                "north" | "east" => axis < 2,
                _ => axis == 2,
            })
        })
    };
    (0..3).filter(|a| acts(*a)).collect()
}

/// Before and after along each axis.
fn axes(unseen: &[Block], before: &Fit, after: &Fit) -> Vec<Axis> {
    (0..3)
        .map(|a| {
            let mean_of = |fit: &Fit| {
                bootstrap(mean(unseen, a, fit), unseen, LEVEL, "mean", |drawn| {
                    let n: f64 = drawn.iter().map(|b| b.n).sum();
                    (n > 0.0).then(|| drawn.iter().map(|b| b.sum(a, fit)).sum::<f64>() / n)
                })
            };
            let rms = |fit: &Fit| mean_square(unseen, a, fit).sqrt();
            // Mean square of block means, less what noise alone would give them.
            let of_means: f64 = unseen.iter().map(|b| (b.sum(a, after) / b.n).powi(2)).sum::<f64>()
                / unseen.len().max(1) as f64;
            let of_noise = mean_square(unseen, a, after) * CORRELATION_S / blocks::BLOCK_S;
            Axis {
                axis: AXES[a],
                mean_before_mps2: mean_of(before),
                mean_after_mps2: mean_of(after),
                rms_before_mps2: rms(before),
                rms_after_mps2: rms(after),
                unexplained_mps2: (of_means - of_noise).max(0.0).sqrt(),
                material_mps2: MATERIAL_MPS2[a].max(reference_mps2(unseen, a)),
            }
        })
        .collect()
}

/// Horizontal force that the wander of the attitude reference feigns, m/s²: gravity times the
/// scatter over blocks of what motion capture and vehicle differ in tilt.
fn reference_mps2(blocks: &[Block], axis: usize) -> f64 {
    // Forward goes with pitch, right with roll.
    let Some(angle) = [1, 0].get(axis) else { return 0.0 };
    let n = blocks.len().max(1) as f64;
    let means: Vec<f64> = blocks.iter().map(|b| b.tilt_apart_rad[*angle] / b.n).collect();
    let mean = means.iter().sum::<f64>() / n;
    G_MPS2 * (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / n).sqrt()
}

fn effects(question: &Question<'_>, found: &Found, after: &Fit) -> Vec<Effect> {
    let parameter = |column: usize| {
        let spec = question.columns.get(column)?;
        let value = after.of(column)?;
        let interval = question.interval(&after.active, column, value);
        Some(Parameter { name: spec.name, unit: spec.unit, interval })
    };
    found
        .steps
        .iter()
        .filter_map(|step| {
            let term: &Term = question.terms.get(step.term)?;
            Some(Effect {
                id: term.id,
                name: term.name(),
                what: term.what,
                block: term.block().name(),
                parameters: step.columns.iter().filter_map(|c| parameter(*c)).collect(),
            })
        })
        .collect()
}

/// Least mean square that the library can reach along an axis when fitted on the unseen flight
/// itself, cross-validated there: what is left then is noise or not in the library.
fn floor(unseen: &[Block], axis: usize, question: &Question<'_>, found: &Found) -> f64 {
    let weight = question.weight;
    let calibrations = question.calibrations();
    let cross = |active: &[usize]| -> Option<f64> {
        let mut sum = 0.0;
        let mut n = 0.0;
        for (left, block) in unseen.iter().enumerate() {
            sum += block.square(axis, &fit_without(unseen, left, active, weight)?);
            n += block.n;
        }
        (n > 0.0).then(|| sum / n)
    };
    let with = |columns: Vec<usize>| {
        let mut all = calibrations.clone();
        all.extend(columns);
        all.sort_unstable();
        all.dedup();
        cross(&all)
    };
    let credited = found.steps.iter().flat_map(|s| s.columns.clone()).collect();
    // A2 is A3 with the other sign: one of them is enough.
    let everything = found
        .first_round
        .iter()
        .filter(|t| question.terms.get(t.term).is_some_and(|t| t.id != "A2"))
        .flat_map(|t| t.columns.clone())
        .collect();
    [cross(&calibrations), with(credited), with(everything)]
        .into_iter()
        .flatten()
        .fold(f64::INFINITY, f64::min)
}

/// Share of the gap that is closed on unseen blocks, over the axes that the effects act on.
fn shrink(
    unseen: &[Block],
    axes: &[usize],
    weight: [f64; 3],
    before: &Fit,
    after: &Fit,
    floor: impl Fn(usize) -> f64,
) -> Shrink {
    let floor_per_sample: f64 = axes.iter().map(|a| weight[*a] * floor(*a)).sum();
    let closed = |blocks: &[&Block]| {
        let n: f64 = blocks.iter().map(|b| b.n).sum();
        let sum = |fit: &Fit| blocks.iter().map(|b| b.loss(axes, fit, weight)).sum::<f64>() / n;
        let gap = sum(before) - floor_per_sample;
        (gap > 0.0).then(|| (sum(before) - sum(after)) / gap)
    };
    let all: Vec<&Block> = unseen.iter().collect();
    let value = closed(&all).unwrap_or(f64::NAN);
    let n: f64 = unseen.iter().map(|b| b.n).sum();
    let relative = |sum: f64| sum / (n * axes.len().max(1) as f64);
    Shrink {
        closed: bootstrap(value, unseen, LEVEL, "shrink", closed),
        axes: axes.iter().filter_map(|a| AXES.get(*a).copied()).collect(),
        before: relative(unseen.iter().map(|b| b.loss(axes, before, weight)).sum()),
        after: relative(unseen.iter().map(|b| b.loss(axes, after, weight)).sum()),
        floor: floor_per_sample / axes.len().max(1) as f64,
    }
}

/// Median share that the candidates which were not taken remove from the unseen flight.
fn control(found: &Found) -> Option<f64> {
    let taken =
        |term: usize| found.steps.iter().any(|s| s.term == term || s.rivals.contains(&term));
    let mut gains: Vec<f64> = found
        .first_round
        .iter()
        .filter(|t| !taken(t.term))
        .filter_map(|t| t.gain.map(|g| g.value))
        .collect();
    gains.sort_by(f64::total_cmp);
    gains.get(gains.len() / 2).copied()
}

/// What the residual is held against to say where it lies: name, unit.
const PROBES: [(&str, &str); 3] = [("voltage", "V"), ("speed", "m/s"), ("height", "m")];

fn probes() -> [Column; 3] {
    let probe = |(name, unit), force| Column { name, unit, plausible: 0.0, sign: Sign::Any, force };
    [
        probe(PROBES[0], |_, s| [s.supply_v; 3]),
        probe(PROBES[1], |_, s| s.vel_B_mps.to_array()),
        probe(PROBES[2], |_, s| [s.height_m; 3]),
    ]
}

/// Slopes of the nominal residual against voltage, speed along the axis and height.
fn places(blocks: &[Block], before: &Fit, probes_at: usize) -> Vec<Where> {
    let mut found = Vec::new();
    for (a, axis) in AXES.into_iter().enumerate() {
        for (p, (against, unit)) in PROBES.into_iter().enumerate() {
            let column = probes_at + p;
            let line = |blocks: &[&Block]| {
                let n: f64 = blocks.iter().map(|b| b.n).sum();
                let sum = |f: &dyn Fn(&Block) -> f64| blocks.iter().map(|b| f(b)).sum::<f64>() / n;
                let (x, xx) = (sum(&|b| b.moment(a, column)), sum(&|b| b.square_of(a, column)));
                let variance = xx - x * x;
                let together = sum(&|b| b.product(a, before, column));
                let slope = (together - x * sum(&|b| b.sum(a, before))) / variance;
                (variance > 1e-6 && n > 0.0).then_some((slope, variance.sqrt()))
            };
            let all: Vec<&Block> = blocks.iter().collect();
            let Some((slope, std)) = line(&all) else { continue };
            let interval =
                bootstrap(slope, blocks, LEVEL, "slope", |drawn| line(drawn).map(|(s, _)| s));
            let sigma = (interval.high - interval.low) / 3.92;
            let score = if sigma > 0.0 { slope.abs() / sigma } else { 0.0 };
            // Over the range that an even spread of this deviation would have.
            let change_mps2 = slope * std * 12f64.sqrt();
            if score >= SLOPE_SIGMAS && change_mps2.abs() >= MATERIAL_MPS2[a] {
                let block = match against {
                    "speed" => "aerodynamics",
                    _ => "thrust",
                };
                found.push(Where {
                    block,
                    axis,
                    against,
                    unit,
                    slope: interval,
                    change_mps2,
                    score,
                });
            }
        }
    }
    found.sort_by(|a, b| b.change_mps2.abs().total_cmp(&a.change_mps2.abs()));
    found
}
