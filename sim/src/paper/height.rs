//! Table 2 and figure 8: P and PI height control, constant and variable base thrust, five motions.
//!
//! P: the integral gains of height and climb are zero. Constant base thrust is the one that is right
//! at 7.4 V; the variable one follows the battery. All else is `modified`.

use anyhow::{Context, Result, bail};
use haltere::report::svg::{Mark, Plot, Series, Tone};
use haltere_core::control::{ControlConfig, Version};
use haltere_model::PlantConfig;
use haltere_model::lockstep::{Flight, Sample};

use super::bench::{Bench, Plan, SEED, leg, since_s};
use super::results::{Cell, Figure, Row, Section, Spread, Table};

/// Height of all that is not a step in height, m.
const HEIGHT_M: f64 = 1.2;
/// Stay at each point, s.
const STAY_S: f64 = 8.0;
/// Size of steps, m.
const STEP_M: f64 = 1.0;
/// Half the side of the square, m, and the speed along it, m/s.
const SQUARE_M: f64 = 0.7;
const SQUARE_MPS: f64 = 0.7;
/// Simulated time of a flight, s.
const FLIGHT_S: f64 = 75.0;
/// Charge that the repetitions begin with: over the life of a battery, so that a flight ends before
/// the critical voltage.
const CHARGE: [f64; 2] = [1.0, 0.45];
const MOTIONS: [&str; 5] = ["hover", "step in x", "step in y", "step in z", "square"];
/// Name, integral action, variable base thrust.
const VARIANTS: [(&str, bool, bool); 4] = [
    ("P, constant", false, false),
    ("P, variable", false, true),
    ("PI, constant", true, false),
    ("PI, variable", true, true),
];
const PLOT_PX: [f64; 2] = [1100.0, 240.0];

/// Simulated seconds.
pub fn cost(bench: &Bench) -> u64 {
    bench.cost(VARIANTS.len(), FLIGHT_S)
}

/// Motions of one flight: numbers of the first leg and of the one after the last.
fn plan() -> (Plan, [[usize; 2]; 5]) {
    let mut plan = Plan::from_height(HEIGHT_M, FLIGHT_S + 30.0);
    let home = [0.0, 0.0, HEIGHT_M];
    let hover = plan.step(home, STAY_S);
    let mut spans = [[hover, hover + 1]; 5];
    for (k, to) in [[STEP_M, 0.0, HEIGHT_M], [0.0, STEP_M, HEIGHT_M], [0.0, 0.0, HEIGHT_M + STEP_M]]
        .into_iter()
        .enumerate()
    {
        let first = plan.step(to, STAY_S);
        plan.step(home, STAY_S);
        spans[k + 1] = [first, first + 2];
    }
    plan.speed(Some(SQUARE_MPS));
    let first = plan.go([SQUARE_M, SQUARE_M, HEIGHT_M]);
    for [n, e] in [[1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]] {
        plan.go([n * SQUARE_M, e * SQUARE_M, HEIGHT_M]);
    }
    spans[4] = [first, first + 4];
    (plan.land(), spans)
}

fn control(bench: &Bench, integral: bool, variable: bool) -> ControlConfig {
    let mut control = bench.version(Version::Modified);
    control.voltage_base_thrust = Some(variable);
    if !integral {
        control.gains.pos_z_i_per_s2 = 0.0;
        control.gains.vel_z_i_frac_per_m = 0.0;
    }
    control
}

fn motion(flight: &Flight, [from, to]: [usize; 2]) -> &[Sample] {
    let (first, last) = (leg(flight, from), leg(flight, to - 1));
    let start = flight.samples.partition_point(|s| first.first().is_none_or(|f| s.t_us < f.t_us));
    let end = flight.samples.partition_point(|s| last.last().is_some_and(|l| s.t_us <= l.t_us));
    flight.samples.get(start..end).unwrap_or_default()
}

fn height_error_m(sample: &Sample) -> Option<f64> {
    Some(-(sample.truth.pos_E_m.z() - sample.control.pos_setpoint_E_m[2]?))
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    let (plan, spans) = plan();
    let step = (CHARGE[1] - CHARGE[0]) / (bench.repetitions.max(2) - 1) as f64;
    let flown = bench.each(&VARIANTS, FLIGHT_S, |(name, integral, variable), seed| {
        let mut plant = PlantConfig::hall(seed);
        plant.vehicle.battery.charge_frac = CHARGE[0] + step * (seed - SEED) as f64;
        let flight = bench.fly_in(plant, &control(bench, *integral, *variable), &plan)?;
        let mut mae_m = [0.0; 5];
        for (error_m, span) in mae_m.iter_mut().zip(spans) {
            let errors: Vec<f64> =
                motion(&flight, span).iter().filter_map(height_error_m).map(f64::abs).collect();
            if errors.is_empty() {
                bail!("{name}, seed {seed}: a motion is missing; {:?}", flight.texts.last());
            }
            *error_m = errors.iter().sum::<f64>() / errors.len() as f64;
        }
        let keep = seed == SEED + bench.repetitions - 1;
        Ok((mae_m, keep.then_some(flight)))
    })?;
    let of = |variant: usize, motion: usize| Spread::of(flown[variant].iter().map(|f| f.0[motion]));
    let mut section = Section {
        method: format!(
            "Which five motions the source flew is not available to us; taken: hover, steps of {STEP_M:.0} m out \
             and back in x, y and z, a square at {SQUARE_MPS} m/s. Mean |truth \u{2212} command| of the height \
             over each motion. Repetitions begin at charges from {:.0} down to {:.0} %, so that the spread is \
             that over the life of a battery. Constant base thrust is that of 7.4 V.",
            100.0 * CHARGE[0],
            100.0 * CHARGE[1]
        ),
        ..Section::default()
    };
    section.tables.push(Table {
        title: "Table 2: mean absolute error of the height, m".into(),
        columns: std::iter::once("height control, base thrust")
            .chain(MOTIONS)
            .map(String::from)
            .collect(),
        rows: VARIANTS
            .iter()
            .enumerate()
            .map(|(v, (name, ..))| {
                std::iter::once(Cell::from(*name))
                    .chain((0..MOTIONS.len()).map(|m| Cell::Spread(of(v, m), 3)))
                    .collect()
            })
            .collect(),
        note: String::new(),
    });
    for (what, pair) in [
        ("P control: constant over variable base thrust", [0, 1]),
        ("PI control: constant over variable base thrust", [2, 3]),
        ("variable base thrust: P over PI control", [1, 3]),
    ] {
        let ratio = (0..MOTIONS.len()).map(|m| of(pair[0], m).mean / of(pair[1], m).mean);
        let mean = ratio.sum::<f64>() / MOTIONS.len() as f64;
        let each = (0..bench.repetitions as usize).map(|i| {
            let sum = |v: usize| flown[v][i].0.iter().sum::<f64>();
            sum(pair[0]) / sum(pair[1])
        });
        let mut row = Row::new(format!("height error, {what}"), "", 2, Spread::of(each));
        row.decimals = if mean > 10.0 { 1 } else { 2 };
        section.rows.push(row);
    }
    let tones = [Tone::Command, Tone::Family(3), Tone::Family(1), Tone::Estimate];
    let kept: Vec<&Flight> = flown.iter().filter_map(|f| f.last()?.1.as_ref()).collect();
    let first = kept.first().context("no flight was kept")?;
    let whole = |flight: &Flight| -> Vec<Sample> {
        motion(flight, [spans[0][0], spans[4][1]]).iter().step_by(4).copied().collect()
    };
    let reference = whole(first);
    let mut series = vec![Series {
        name: "command".into(),
        tone: Tone::Truth,
        mark: Mark::Dashed,
        points: reference
            .iter()
            .map(|s| {
                let z = s.control.pos_setpoint_E_m[2].map_or(f64::NAN, |z| -z);
                [since_s(&reference, s), z]
            })
            .collect(),
    }];
    for ((flight, (name, ..)), tone) in kept.iter().zip(VARIANTS).zip(tones) {
        let samples = whole(flight);
        let points = samples.iter().map(|s| [since_s(&samples, s), -s.truth.pos_E_m.z()]).collect();
        series.push(Series { name: name.into(), tone, mark: Mark::Line, points });
    }
    section.figures.push(Figure {
        name: "Figure 8",
        caption: "Height over the five motions with the emptiest battery of the repetitions."
            .into(),
        plots: vec![Plot {
            title: "Height".into(),
            x_label: "s".into(),
            y_label: "m".into(),
            series,
            size_px: PLOT_PX,
            ..Plot::default()
        }],
    });
    Ok(section)
}
