//! Standing still: roll and pitch of the filter with UWB against a complementary filter that has the
//! IMU alone, with biased accelerometer and gyroscope.
//!
//! **Complementary filter.** φ' = p + (atan2(−f_y, −f_z) − φ)/τ and θ' = q + (atan2(f_x, −f_z) − θ)/τ:
//! the gyroscope carries the angle, the accelerometer pulls it to its own level within τ. φ roll, θ
//! pitch (rad), p, q rates (rad/s), f specific force (m/s²), body frame; for small angles. At rest it
//! settles at bias_f/g + τ·bias_ω: no setting of τ removes both.

use anyhow::Result;
use haltere::report::svg::{Mark, Plot, Series, Tone};
use haltere_core::control::Version;
use haltere_model::PlantConfig;
use haltere_pilot::PilotConfig;

use super::bench::Bench;
use super::results::{Cell, Claim, Figure, Line, Row, Section, Sense, Spread, Table};
use super::source;
use super::standing::{Measurement, Standing};

/// How long it stands, s.
const STAND_S: f64 = 60.0;
/// Errors are averaged over the last part, s: what is settled then.
const SETTLED_S: f64 = 30.0;
/// Time constants of the complementary filter, s: a quick, a usual and a slow one, and the gyroscope
/// alone.
const TAU_S: [f64; 4] = [0.5, 2.0, 10.0, f64::INFINITY];
/// Bias of the accelerometer on x and −y, m/s² (typical of effect M1), and of the gyroscope, rad/s:
/// none, one of a turn-on calibration (N11), the least of the range of M5.
const BIASES: [[f64; 2]; 3] = [[0.3, 0.0], [0.3, 0.003], [0.3, 0.01]];
/// The case that is drawn and stands in the rows.
const USUAL: usize = 1;
/// The gyroscope alone, behind two filters and the other time constants.
const GYRO: usize = 1 + TAU_S.len();
const PLOT_PX: [f64; 2] = [540.0, 220.0];

/// Simulated seconds of a repetition.
pub fn seconds() -> u64 {
    BIASES.len() as u64 * STAND_S as u64
}

/// Roll and pitch over time: s, rad.
type Angles = Vec<(f64, [f64; 2])>;

/// The complementary filter on a record, from level.
fn complementary(standing: &Standing, tau_s: f64) -> Angles {
    let mut angles = Vec::new();
    let mut level = [0.0; 2];
    let mut before = standing.start;
    for measurement in &standing.measurements {
        let Measurement::Imu(sample) = measurement else { continue };
        let dt_s = sample.valid_at.seconds_since(before).clamp(0.0, 0.1);
        before = sample.valid_at;
        let f = sample.acc_B_mps2;
        let tilt = [(-f.y()).atan2(-f.z()), f.x().atan2(-f.z())];
        let rate = [sample.rate_B_radps.x(), sample.rate_B_radps.y()];
        for i in 0..2 {
            level[i] += rate[i] * dt_s + (tilt[i] - level[i]) * (dt_s / (tau_s + dt_s));
        }
        angles.push((standing.since_s(sample.valid_at), level));
    }
    angles
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    let configs = bench
        .both(Version::Paper)
        .map(|control| PilotConfig { control, ..bench.pilot.clone() }.estimator_in_force());
    let mut names: Vec<String> =
        ["filter with UWB, as printed", "filter with UWB, as shipped"].map(String::from).to_vec();
    names.extend(TAU_S.map(|tau| {
        if tau.is_finite() {
            format!("IMU alone, \u{3c4} = {tau} s")
        } else {
            "gyroscope alone".into()
        }
    }));
    let stood = bench.each(&BIASES, STAND_S, |[acc, gyro], seed| {
        let mut plant = PlantConfig::hall(seed);
        plant.effects = plant.effects.with("M1", &[("x", *acc), ("y", -acc), ("z", 0.0)])?;
        if *gyro != 0.0 {
            plant.effects = plant.effects.with("M5", &[("x", *gyro), ("y", -gyro), ("z", 0.0)])?;
        }
        let standing = Standing::record(bench, plant, STAND_S)?;
        let mut all: Vec<Angles> = Vec::new();
        for config in &configs {
            let filtered = standing.filter(config)?;
            let angles = filtered.iter().map(|e| {
                let [roll, pitch, _] = e.R_EB.euler_rad();
                (standing.since_s(e.at), [roll, pitch])
            });
            all.push(angles.collect());
        }
        all.extend(TAU_S.map(|tau_s| complementary(&standing, tau_s)));
        let [roll, pitch, _] = standing.truth.R_EB.euler_rad();
        for angles in &mut all {
            for (_, a) in angles.iter_mut() {
                *a = [(a[0] - roll).to_degrees(), (a[1] - pitch).to_degrees()];
            }
        }
        Ok(all)
    })?;
    let settled = |angles: &Angles, axis: usize| {
        let late: Vec<f64> =
            angles.iter().filter(|a| a.0 > STAND_S - SETTLED_S).map(|a| a.1[axis].abs()).collect();
        late.iter().sum::<f64>() / late.len() as f64
    };
    let of = |bias: usize, k: usize, axis: usize| {
        Spread::of(stood[bias].iter().map(|s| settled(&s[k], axis)))
    };
    let mut section = Section {
        method: format!(
            "Standing for {STAND_S:.0} s with biased sensors, on top of noise and turn-on bias. The filter is not \
             told that it stands. Error: mean \
             |roll| and |pitch| off the truth over the last {SETTLED_S:.0} s."
        ),
        ..Section::default()
    };
    for (axis, name) in ["roll", "pitch"].into_iter().enumerate() {
        let best = |bias: usize, filter: usize| {
            Spread::of(stood[bias].iter().map(|s| {
                let alone = s[2..].iter().map(|a| settled(a, axis)).fold(f64::INFINITY, f64::min);
                alone / settled(&s[filter], axis)
            }))
        };
        let what = format!("error in {name}, best setting on IMU alone over filter with UWB");
        let mut row = Row::new(what, "", 2, best(USUAL, 1), source::DRIFT, Sense::More);
        row.printed = Some(best(USUAL, 0));
        let gyroscope = stood[USUAL].iter().map(|s| settled(&s[GYRO], axis) / settled(&s[0], axis));
        section.rows.push(
            row.tried("no bias of the gyroscope", best(0, 0).mean)
                .tried("the gyroscope alone", Spread::of(gyroscope).mean),
        );
    }
    section.lines.push(Line::new(
        Claim::of(&section.rows),
        format!(
            "Section 4, standing: the best complementary filter is off by {} times (roll, pitch) what the filter with UWB is, \
             which is {:.1}\u{b0} and not zero.",
            [0, 1].map(|k| section.rows[k].printed.as_ref().unwrap_or(&section.rows[k].ours).text(1)).join(" and "),
            (of(USUAL, 0, 0).mean + of(USUAL, 0, 1).mean) / 2.0
        ),
    ));
    let mut columns = vec![String::new()];
    for [acc, gyro] in BIASES {
        columns.push(format!("roll; {acc} m/s\u{b2}, {gyro} rad/s"));
        columns.push("pitch".into());
    }
    section.tables.push(Table {
        title: "Mean absolute error of the attitude, deg, by bias of accelerometer and gyroscope"
            .into(),
        columns,
        rows: names
            .iter()
            .enumerate()
            .map(|(k, name)| {
                let cells = (0..BIASES.len())
                    .flat_map(|bias| [0, 1].map(|axis| Cell::Spread(of(bias, k, axis), 2)));
                std::iter::once(Cell::from(name.as_str())).chain(cells).collect()
            })
            .collect(),
        note: "Turn-on biases of every part come on top, so that roll and pitch differ.".into(),
        ..Table::default()
    });
    let at = |bias: usize, k: usize| (of(bias, k, 0).mean + of(bias, k, 1).mean) / 2.0;
    section.findings.push(format!(
        "UWB takes the drift of the gyroscope away ({:.1} instead of {:.1} deg at a bias of {} rad/s) and makes \
         the attitude indifferent to a bias of the accelerometer ({:.2} deg against {:.2} on the IMU alone, \
         \u{3c4} = 2 s). A bias of the gyroscope is not removed but held in check: nine states have none for it, \
         and at {} rad/s the filter is at {:.1} deg, the IMU alone at {:.1}. The companion does better than all \
         of these: it averages the gyroscope while it stands.",
        at(USUAL, 0),
        at(USUAL, GYRO),
        BIASES[USUAL][1],
        at(0, 0),
        at(0, 3),
        BIASES[2][1],
        at(2, 0),
        at(2, 3),
    ));
    let first = stood[USUAL].first().map_or(&[][..], |s| &s[..]);
    let plots = ["Roll", "Pitch"]
        .into_iter()
        .enumerate()
        .map(|(axis, name)| Plot {
            title: name.into(),
            x_label: "s".into(),
            y_label: "deg".into(),
            series: first
                .iter()
                .zip(&names)
                .zip([
                    Tone::Estimate,
                    Tone::Truth,
                    Tone::Family(3),
                    Tone::Command,
                    Tone::Family(2),
                    Tone::Family(1),
                ])
                .map(|((angles, name), tone)| Series {
                    name: name
                        .replace("IMU alone, ", "")
                        .replace(" alone", "")
                        .replace("filter with ", ""),
                    tone,
                    mark: Mark::Line,
                    points: angles.iter().map(|(t, a)| [*t, a[axis]]).collect(),
                })
                .collect(),
            size_px: PLOT_PX,
            least_height: 2.0,
            ..Plot::default()
        })
        .collect();
    section.figures.push(Figure {
        name: "Drift",
        caption: format!(
            "Error of the attitude while standing, accelerometer off by {} m/s\u{b2} and gyroscope by {} rad/s, first \
             repetition. \u{3c4}: complementary filter on the IMU alone.",
            BIASES[USUAL][0], BIASES[USUAL][1]
        ),
        plots,
    });
    Ok(section)
}
