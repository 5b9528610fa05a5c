//! What each enhancement contributes alone: added to `raw`, and taken from `modified`. The source has
//! no such table.

use anyhow::{Context, Result, bail};
use haltere_core::control::{ControlConfig, TiltCompensation, Version};
use haltere_model::PlantConfig;
use haltere_model::lockstep::Sample;

use super::bench::{Bench, Plan, leg};
use super::results::{Cell, Section, Spread, Table};
use crate::compare::CENTRE_NE_M;
use crate::steps::{SIZES_M, fly_steps, is_complete, mean_of};

/// Simulated time of the step programme, and of a flight near the floor, s.
const STEPS_S: f64 = 145.0;
const LOW_S: f64 = 45.0;
/// Charges at which the flight near the floor begins: full, and below the middle.
const CHARGES: [f64; 2] = [1.0, 0.4];
/// Heights of it, m: centre of mass; the gear is 0.12 m lower, so that the lower one is the least
/// at which the source validated its ground effect.
const HIGH_M: f64 = 1.2;
const LOW_M: f64 = 0.45;
/// Stay at each, s.
const STAY_S: f64 = 12.0;

/// Control steps of the rise, which do not count: 4 s.
const RISE_SAMPLES: usize = 400;

/// Switches a part of the enhancements of a configuration.
type Switch = fn(&mut ControlConfig, bool);

fn drag_feed_forward(control: &mut ControlConfig, on: bool) {
    control.drag_feed_forward = Some(on);
}

fn drag_filter(control: &mut ControlConfig, on: bool) {
    control.filter_drag = Some(on);
}

fn drag_thrust(control: &mut ControlConfig, on: bool) {
    let kind = if on { TiltCompensation::DragAware } else { TiltCompensation::Off };
    control.tilt_compensation = Some(kind);
}

fn drag(control: &mut ControlConfig, on: bool) {
    drag_feed_forward(control, on);
    drag_filter(control, on);
    drag_thrust(control, on);
}

fn voltage(control: &mut ControlConfig, on: bool) {
    control.voltage_base_thrust = Some(on);
}

fn ground(control: &mut ControlConfig, on: bool) {
    control.ground_correction = Some(on);
}

fn noise(control: &mut ControlConfig, on: bool) {
    control.variable_uwb_noise = Some(on);
}

/// Name, version to start from, what is switched: on in `raw`, off in `modified`.
const CASES: [(&str, Version, Option<Switch>); 14] = [
    ("raw", Version::Raw, None),
    ("+ drag, feed-forward only", Version::Raw, Some(drag_feed_forward)),
    ("+ drag, filter only", Version::Raw, Some(drag_filter)),
    ("+ drag, tilt compensation only", Version::Raw, Some(drag_thrust)),
    ("+ drag, all three", Version::Raw, Some(drag)),
    ("+ voltage", Version::Raw, Some(voltage)),
    ("+ ground", Version::Raw, Some(ground)),
    ("+ noise", Version::Raw, Some(noise)),
    ("modified", Version::Modified, None),
    ("\u{2212} drag, all three", Version::Modified, Some(drag)),
    ("\u{2212} drag, filter only: the source's set", Version::Modified, Some(drag_filter)),
    ("\u{2212} voltage", Version::Modified, Some(voltage)),
    ("\u{2212} ground", Version::Modified, Some(ground)),
    ("\u{2212} noise", Version::Modified, Some(noise)),
];

/// What one repetition of a case showed, m: steps in x, y, z; hover, hover near the floor, estimate of
/// the height there.
type Scores = [f64; 6];
const COLUMNS: [&str; 7] = [
    "",
    "steps x, m",
    "steps y, m",
    "steps z, m",
    "hover 1.2 m, height, m",
    "hover 0.45 m, height, m",
    "estimate of it, m",
];

/// Simulated seconds of a repetition.
pub fn seconds() -> u64 {
    (CASES.len()) as u64 * (STEPS_S + CHARGES.len() as f64 * LOW_S) as u64
}

fn mean(samples: &[Sample], pick: impl Fn(&Sample) -> Option<f64>) -> Option<f64> {
    let values: Vec<f64> = samples.iter().filter_map(pick).map(f64::abs).collect();
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

fn fly(bench: &Bench, control: &ControlConfig, seed: u64) -> Result<Scores> {
    let mut world = bench.world(PlantConfig::hall(seed), control)?;
    let (steps, flight) = fly_steps(&mut world, CENTRE_NE_M)?;
    if !is_complete(&steps) {
        bail!("seed {seed}: {} steps flown; {}", steps.len(), flight.last_words());
    }
    let mut scores = [0.0; 6];
    for (axis, score) in scores.iter_mut().take(3).enumerate() {
        for size_m in SIZES_M {
            let error = mean_of(&steps, axis, size_m, |s| s.position_mae_m);
            *score += error.context("a step is missing")? / SIZES_M.len() as f64;
        }
    }
    let mut plan = Plan::from_height(HIGH_M, LOW_S + 30.0);
    let high = plan.step([0.0, 0.0, HIGH_M], STAY_S);
    let low = plan.step([0.0, 0.0, LOW_M], STAY_S);
    plan.step([0.0, 0.0, HIGH_M], 3.0);
    let plan = plan.land();
    for charge_frac in CHARGES {
        let mut plant = PlantConfig::hall(seed);
        plant.vehicle.battery.charge_frac = charge_frac;
        let flight = bench.fly_in(plant, control, &plan)?;
        let of = |number, pick: fn(&Sample) -> Option<f64>| {
            let leg = leg(&flight, number);
            mean(leg.get(RISE_SAMPLES..).unwrap_or_default(), pick).with_context(|| {
                format!("seed {seed}, charge {charge_frac}: no hover; {}", flight.last_words())
            })
        };
        let height = |s: &Sample| Some(s.truth.pos_E_m.z() - s.control.pos_setpoint_E_m[2]?);
        let share = 1.0 / CHARGES.len() as f64;
        scores[3] += share * of(high, height)?;
        scores[4] += share * of(low, height)?;
        scores[5] += share * of(low, |s| Some(s.truth.pos_E_m.z() - s.estimate.pos_E_m.z()))?;
    }
    Ok(scores)
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    let cost_s = STEPS_S + CHARGES.len() as f64 * LOW_S;
    let flown = bench.each(&CASES, cost_s, |(name, version, switch), seed| {
        let mut control = bench.version(*version);
        if let Some(switch) = switch {
            switch(&mut control, *version == Version::Raw);
        }
        fly(bench, &control, seed).with_context(|| (*name).to_string())
    })?;
    let of = |case: usize, score: usize| Spread::of(flown[case].iter().map(|s| s[score]));
    let mut table = Table {
        title: "Mean absolute error with each enhancement alone, and without it".into(),
        columns: COLUMNS.map(String::from).to_vec(),
        rows: Vec::new(),
        note: "Steps: mean of 1 m and 2 m, as in table 3. Hovers: truth against command over 8 s, 4 s after \
               the step, mean of a full battery and one at 40 %; estimate against \
               truth there."
            .into(),
    };
    for (case, (name, ..)) in CASES.iter().enumerate() {
        let mut row = vec![Cell::from(*name)];
        row.extend((0..COLUMNS.len() - 1).map(|score| Cell::Spread(of(case, score), 3)));
        table.rows.push(row);
    }
    let mut section = Section {
        method: "Each switch of the configuration turned on alone in `raw`, and turned off alone in \
                 `modified`. Drag has three: feed-forward of the lean, drag in the filter's prediction, \
                 and what drag carries of the weight in the tilt compensation of thrust."
            .into(),
        tables: vec![table],
        ..Section::default()
    };
    let noise_of = |case: usize, score: usize| of(case, score).std.unwrap_or(0.0);
    let names = ["steps in x", "steps in y", "steps in z", "hover", "hover near the floor"];
    for (score, name) in names.into_iter().enumerate() {
        let raw = of(0, score).mean;
        let best = [4, 5, 6, 7]
            .into_iter()
            .min_by(|a, b| of(*a, score).mean.total_cmp(&of(*b, score).mean));
        let Some(best) = best else { continue };
        let gain = 1.0 - of(best, score).mean / raw;
        let clear = raw - of(best, score).mean > noise_of(0, score).max(noise_of(best, score));
        section.findings.push(if clear {
            format!(
                "{name}: most from \u{201c}{}\u{201d} alone, {:.0} % less error than raw; all together {:.0} %.",
                CASES[best].0,
                100.0 * gain,
                100.0 * (1.0 - of(8, score).mean / raw)
            )
        } else {
            format!(
                "{name}: no enhancement alone changes it by more than its spread; all together {:.0} % less \
                 error than raw.",
                100.0 * (1.0 - of(8, score).mean / raw)
            )
        });
    }
    Ok(section)
}
