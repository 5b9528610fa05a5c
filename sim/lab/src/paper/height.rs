//! Table 2 and figure 8: P and PI height control, constant and variable base thrust, five motions.
//!
//! P: the integral gains of height and climb are zero. Constant base thrust is the one that is right
//! at 7.4 V; the variable one follows the battery. All else is `modified`.

use anyhow::{Context, Result, bail};
use haltere::report::svg::{Mark, Plot, Series, Tone};
use haltere::report::verdict::Check;
use haltere_core::control::{ControlConfig, Version};
use haltere_model::PlantConfig;
use haltere_model::lockstep::Sample;

use super::bench::{Bench, Plan, leg};
use super::limits::least_height_m;
use super::results::{Claim, Figure, Line, Row, Section, Sense, Source, Spread};
use super::source::{MOTIONS, TABLE_2_M};
use super::table_3::WINDOWS_S;
use crate::steps::WINDOW_S;

/// Height of all that is not a step in height, m.
const HEIGHT_M: f64 = 1.2;
/// Size of steps along each axis of the motion, m: the smaller of the source's table 3; table 2 states none.
const STEP_M: f64 = 1.0;
/// Where each motion goes, as in [`MOTIONS`]: north, east, up.
const WAYS: [[f64; 3]; 5] =
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0]];
/// Simulated time of a flight, s.
const FLIGHT_S: f64 = 125.0;
/// Charge that the repetitions begin with: over the life of a battery, so that a flight ends before
/// the critical voltage.
const CHARGE: [f64; 2] = [1.0, 0.55];
/// Name, integral action, variable base thrust; in the order of the source.
const VARIANTS: [(&str, bool, bool); 4] = [
    ("constant P", false, false),
    ("constant PI", true, false),
    ("variable P", false, true),
    ("variable PI", true, true),
];
/// The one that the source prefers.
const PREFERRED: usize = 3;
/// What was asked of it overall, m.
const MOST_M: f64 = 0.044;
/// Motions of figure 8.
const DRAWN: [usize; 2] = [0, 3];
const PLOT_PX: [f64; 2] = [540.0, 240.0];

/// Simulated seconds of a repetition.
pub fn seconds() -> u64 {
    VARIANTS.len() as u64 * FLIGHT_S as u64
}

/// All motions of one flight, there and back: number of the first leg of each.
fn plan() -> (Plan, [usize; 5]) {
    let mut plan = Plan::from_height(HEIGHT_M, FLIGHT_S + 30.0);
    let home = [0.0, 0.0, HEIGHT_M];
    let firsts = WAYS.map(|[north, east, up]| {
        let first = plan.step([STEP_M * north, STEP_M * east, HEIGHT_M + STEP_M * up], WINDOW_S);
        plan.step(home, WINDOW_S);
        first
    });
    (plan.land(), firsts)
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

/// Height over the command, m.
fn error_m(sample: &Sample) -> Option<f64> {
    Some(-(sample.truth.pos_E_m.z() - sample.control.pos_setpoint_E_m[2]?))
}

/// What a flight shows: mean absolute error and standard deviation of the error by motion, and of all, m; and the heights
/// of the steps out of [`DRAWN`].
struct Heights {
    scores: [[f64; 2]; 6],
    drawn: [Vec<f64>; 2],
}

fn score(errors: &[f64]) -> [f64; 2] {
    let n = errors.len() as f64;
    let mean = errors.iter().sum::<f64>() / n;
    let var = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / n;
    [errors.iter().map(|e| e.abs()).sum::<f64>() / n, var.sqrt()]
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    let window_s = WINDOWS_S[bench.raw()?.window];
    let count = window_s * 100;
    let (plan, firsts) = plan();
    let step = (CHARGE[1] - CHARGE[0]) / (bench.repetitions.max(2) - 1) as f64;
    let flown = bench.each(&VARIANTS, FLIGHT_S, |(name, integral, variable), seed| {
        let mut plant = PlantConfig::hall(seed);
        plant.vehicle.battery.charge_frac = CHARGE[0] + step * (seed - bench.seed) as f64;
        let flight = bench.fly_in(plant, &control(bench, *integral, *variable), &plan)?;
        let mut errors: Vec<Vec<f64>> = Vec::new();
        let mut drawn = [Vec::new(), Vec::new()];
        for (motion, first) in firsts.into_iter().enumerate() {
            let mut of = Vec::new();
            for number in [first, first + 1] {
                let samples = leg(&flight, number).get(..count).with_context(|| {
                    format!(
                        "{name}, seed {seed}: motion {} is missing; {}",
                        MOTIONS[motion],
                        flight.last_words()
                    )
                })?;
                of.extend(samples.iter().filter_map(error_m));
                if let Some(k) = DRAWN.iter().position(|d| *d == motion && number == first) {
                    drawn[k] = samples.iter().map(|s| -s.truth.pos_E_m.z()).collect();
                }
            }
            if of.len() < 2 * count {
                bail!("{name}, seed {seed}: motion {} has no command of height", MOTIONS[motion]);
            }
            errors.push(of);
        }
        let mut scores = [[0.0; 2]; 6];
        for (score_m, errors) in scores.iter_mut().zip(&errors) {
            *score_m = score(errors);
        }
        scores[5] = score(&errors.concat());
        Ok(Heights { scores, drawn })
    })?;
    let of = |variant: usize, motion: usize, which: usize| {
        Spread::of(flown[variant].iter().map(|f| f.scores[motion][which]))
    };
    let mut section = Section {
        method: format!(
            "Steps of {STEP_M:.0} m out and back along each axis of the motion. Mean |truth \u{2212} command| of the height and \
             standard deviation of truth \u{2212} command, over the {window_s} s from each jump on that table 3 chose. \
             Repetitions begin at charges from {:.0} down to {:.0} %, so that the spread is that over the life of a battery. \
             Constant base thrust is that of 7.4 V.",
            100.0 * CHARGE[0],
            100.0 * CHARGE[1]
        ),
        ..Section::default()
    };
    let control = &bench.pilot.control;
    for (variant, (name, ..)) in VARIANTS.into_iter().enumerate() {
        // What is left where no step in height was asked for.
        let rest_m = 0.5 * (of(variant, 0, 0).mean + of(variant, 1, 0).mean);
        let least = least_height_m(control, STEP_M, window_s as f64, rest_m);
        for (motion, cells) in TABLE_2_M[variant].iter().enumerate() {
            for (which, quantity) in ["mean", "std. dev."].into_iter().enumerate() {
                let on = MOTIONS.get(motion).copied().unwrap_or("overall");
                let source = Source::number(cells[which], "table 2");
                let what = format!("{name}, {on}, {quantity}");
                let ours = of(variant, motion, which);
                let mut row = Row::new(what, "m", 3, ours, source, Sense::Less);
                for (battery, flight) in
                    [("full", flown[variant].first()), ("emptiest", flown[variant].last())]
                {
                    if let Some(flight) = flight {
                        row = row.tried(
                            format!("the {battery} battery alone"),
                            flight.scores[motion][which],
                        );
                    }
                }
                let of_steps = match (motion, which) {
                    (0 | 1, _) => None,
                    (2..=4, _) => Some(least[which]),
                    // Of five motions three step in height.
                    (_, 0) => Some(0.4 * rest_m + 0.6 * least[0]),
                    _ => Some(0.6f64.sqrt() * least[1]),
                };
                row.limit = of_steps.map(|at| {
                    (
                        format!(
                            "full and least thrust, and {rest_m:.3} m left without a step in height"
                        ),
                        at,
                    )
                });
                section.rows.push(row);
            }
        }
    }
    let best_in = |of: &dyn Fn(usize, usize) -> f64| {
        let best =
            |m: &usize| VARIANTS.iter().enumerate().all(|(v, _)| of(v, *m) >= of(PREFERRED, *m));
        (0..MOTIONS.len()).filter(best).count()
    };
    let ours = best_in(&|v, m| of(v, m, 0).mean);
    let theirs = best_in(&|v, m| TABLE_2_M[v][m][0]);
    let mut row = Row::new(
        "motions of five in which variable PI has the least mean",
        "",
        0,
        Spread::of([ours as f64]),
        Source::number(theirs as f64, "table 2"),
        Sense::More,
    );
    for (k, _) in bench.seeds().enumerate() {
        let alone = best_in(&|v, m| flown[v][k].scores[m][0]);
        row = row.tried(format!("battery {} of the repetitions alone", k + 1), alone as f64);
    }
    section.rows.push(row);
    let overall: Vec<f64> = (0..VARIANTS.len()).map(|v| of(v, MOTIONS.len(), 0).mean).collect();
    let lowest = overall.iter().all(|o| *o >= overall[PREFERRED]);
    section.targets.push(Check::at_most(
        "variable PI, height overall",
        Some(overall[PREFERRED]),
        MOST_M,
        "m",
    ));
    section.targets.push(Check::that(
        "variable PI is the lowest overall",
        lowest,
        overall.iter().map(|o| format!("{o:.3}")).collect::<Vec<_>>().join(", "),
    ));
    let level = of(PREFERRED, 0, 0).mean;
    let climb = of(PREFERRED, 2, 0).mean;
    section.lines.push(Line::new(
        match (lowest, overall[PREFERRED] <= MOST_M) {
            (true, true) => Claim::Reproduced,
            (false, false) => Claim::NotReproduced,
            _ => Claim::Partly,
        },
        format!(
            "Table 2, variable PI: overall {:.3} m (0.044), {} of the four, least in {ours} of 5 motions ({theirs}); height \
             held in X {level:.3} m (0.049), stepped in Z {climb:.3} m (0.060).",
            overall[PREFERRED],
            if lowest { "least" } else { "not least" },
        ),
    ));
    section.figures.push(figure(&flown));
    Ok(section)
}

/// Figure 8: height after the step out, mean of the repetitions.
fn figure(flown: &[Vec<Heights>]) -> Figure {
    let tones = [Tone::Command, Tone::Family(1), Tone::Family(3), Tone::Estimate];
    let plots = DRAWN
        .into_iter()
        .enumerate()
        .map(|(k, motion)| {
            let mut series = vec![Series {
                name: "command".into(),
                tone: Tone::Truth,
                mark: Mark::Dashed,
                points: [0.0, WINDOW_S].map(|t| [t, HEIGHT_M + STEP_M * WAYS[motion][2]]).to_vec(),
            }];
            for ((flights, (name, ..)), tone) in flown.iter().zip(VARIANTS).zip(tones) {
                let length = flights.iter().map(|f| f.drawn[k].len()).min().unwrap_or(0);
                let mean = |i: usize| {
                    flights.iter().map(|f| f.drawn[k][i]).sum::<f64>() / flights.len() as f64
                };
                series.push(Series {
                    name: name.into(),
                    tone,
                    mark: Mark::Line,
                    points: (0..length).step_by(4).map(|i| [i as f64 * 0.01, mean(i)]).collect(),
                });
            }
            Plot {
                title: format!("Height, {} motion", MOTIONS[motion]),
                x_label: "s".into(),
                y_label: "m".into(),
                series,
                size_px: PLOT_PX,
                least_height: 0.2,
                x_range: None,
                ..Plot::default()
            }
        })
        .collect();
    Figure {
        name: "Figure 8",
        caption: "Height after the step out, mean of the repetitions.".into(),
        plots,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The source's overall means are those of its motions.
    #[test]
    fn val_overall_of_the_source_is_the_mean_of_its_motions() {
        for row in TABLE_2_M {
            let mean = row[..5].iter().map(|c| c[0]).sum::<f64>() / 5.0;
            assert!((mean - row[5][0]).abs() < 0.0011, "{mean} {}", row[5][0]);
        }
    }

    #[test]
    fn val_mean_and_deviation() {
        assert_eq!(score(&[1.0, -1.0, 1.0, -1.0]), [1.0, 1.0]);
        assert_eq!(score(&[0.5, 0.5]), [0.5, 0.0]);
    }
}
