//! Standing still: roll and pitch of the filter with UWB against a complementary filter that has the
//! IMU alone, with biased accelerometer and gyroscope.
//!
//! **Complementary filter.** φ' = p + (atan2(−f_y, −f_z) − φ)/τ and θ' = q + (atan2(f_x, −f_z) − θ)/τ:
//! the gyroscope carries the angle, the accelerometer pulls it to its own level within τ. φ roll, θ
//! pitch (rad), p, q rates (rad/s), f specific force (m/s²), body frame; for small angles. At rest it
//! settles at bias_f/g + τ·bias_ω: no setting of τ removes both.

use anyhow::Result;
use haltere::control::Version;
use haltere::model::PlantConfig;
use haltere::report::svg::{Mark, Plot, Series, Tone};

use super::bench::Bench;
use super::results::{Cell, Figure, Row, Section, Spread, Table};
use super::standing::{Measurement, Standing};

/// How long it stands, s.
const STAND_S: f64 = 60.0;
/// Errors are averaged over the last part, s: what is settled then.
const SETTLED_S: f64 = 30.0;
/// Time constants of the complementary filter, s: a quick, a usual and a slow one.
const TAU_S: [f64; 3] = [0.5, 2.0, 10.0];
/// Biases: accelerometer m/s², gyroscope rad/s. Typical ones of the effects M1 and M5.
const ACC_BIAS_MPS2: [f64; 2] = [0.3, -0.3];
const GYRO_BIAS_RADPS: [f64; 2] = [0.03, -0.03];
const PLOT_PX: [f64; 2] = [540.0, 220.0];

/// Simulated seconds.
pub fn cost(bench: &Bench) -> u64 {
    bench.cost(1, STAND_S)
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
            level[i] += rate[i] * dt_s + (tilt[i] - level[i]) * dt_s / (tau_s + dt_s);
        }
        angles.push((standing.since_s(sample.valid_at), level));
    }
    angles
}

/// Runs it.
pub fn run(bench: &Bench) -> Result<Section> {
    let mut pilot = bench.pilot.clone();
    pilot.control = bench.version(Version::Modified);
    let config = pilot.estimator_in_force();
    let mut names: Vec<String> = vec!["filter with UWB".into()];
    names.extend(TAU_S.map(|tau| format!("IMU alone, \u{3c4} = {tau} s")));
    let stood = bench.each(&[()], STAND_S, |(), seed| {
        let mut plant = PlantConfig::hall(seed);
        let [x, y] = ACC_BIAS_MPS2;
        plant.effects = plant.effects.with("M1", &[("x", x), ("y", y), ("z", 0.0)])?;
        let [x, y] = GYRO_BIAS_RADPS;
        plant.effects = plant.effects.with("M5", &[("x", x), ("y", y), ("z", 0.0)])?;
        let standing = Standing::record(bench, plant, STAND_S)?;
        let filter: Angles = standing
            .filter(&config)?
            .iter()
            .map(|e| {
                let [roll, pitch, _] = e.R_EB.euler_rad();
                (standing.since_s(e.at), [roll, pitch])
            })
            .collect();
        let mut all = vec![filter];
        all.extend(TAU_S.map(|tau_s| complementary(&standing, tau_s)));
        let [roll, pitch, _] = standing.truth.R_EB.euler_rad();
        for angles in &mut all {
            for (_, a) in angles.iter_mut() {
                *a = [(a[0] - roll).to_degrees(), (a[1] - pitch).to_degrees()];
            }
        }
        Ok(all)
    })?;
    let stood = &stood[0];
    let settled = |angles: &Angles, axis: usize| {
        let late: Vec<f64> =
            angles.iter().filter(|a| a.0 > STAND_S - SETTLED_S).map(|a| a.1[axis].abs()).collect();
        late.iter().sum::<f64>() / late.len() as f64
    };
    let of = |k: usize, axis: usize| Spread::of(stood.iter().map(|s| settled(&s[k], axis)));
    let mut section = Section {
        method: format!(
            "Standing for {STAND_S:.0} s with an accelerometer off by {} and {} m/s\u{b2} (x, y) and a \
             gyroscope off by {} and {} rad/s, on top of noise and turn-on bias. The filter is not told \
             that it stands, so that it can learn nothing of the biases by averaging at rest. Mean \
             absolute error of the last {SETTLED_S:.0} s.",
            ACC_BIAS_MPS2[0], ACC_BIAS_MPS2[1], GYRO_BIAS_RADPS[0], GYRO_BIAS_RADPS[1]
        ),
        ..Section::default()
    };
    for (axis, name) in ["roll", "pitch"].into_iter().enumerate() {
        let best = stood.iter().map(|s| {
            let alone = s[1..].iter().map(|a| settled(a, axis)).fold(f64::INFINITY, f64::min);
            alone / settled(&s[0], axis)
        });
        let what = format!("error in {name}, best on IMU alone over filter with UWB");
        section.rows.push(Row::new(what, "", 2, Spread::of(best)));
    }
    section.tables.push(Table {
        title: "Mean absolute error of the attitude, deg".into(),
        columns: ["", "roll", "pitch"].map(String::from).to_vec(),
        rows: names
            .iter()
            .enumerate()
            .map(|(k, name)| {
                vec![
                    Cell::from(name.as_str()),
                    Cell::Spread(of(k, 0), 2),
                    Cell::Spread(of(k, 1), 2),
                ]
            })
            .collect(),
        note: "On the IMU alone the error settles at bias of the accelerometer over g (1.75\u{b0}) plus \
               \u{3c4} times the bias of the gyroscope (1.72\u{b0} a second)."
            .into(),
    });
    let plots = ["Roll", "Pitch"]
        .into_iter()
        .enumerate()
        .map(|(axis, name)| Plot {
            title: format!("{name}, error, first repetition"),
            x_label: "s".into(),
            y_label: "deg".into(),
            series: [0, 1, 2]
                .into_iter()
                .zip([Tone::Estimate, Tone::Family(1), Tone::Command])
                .map(|(k, tone)| Series {
                    name: names[k].clone(),
                    tone,
                    mark: Mark::Line,
                    points: stood[0][k].iter().map(|(t, a)| [*t, a[axis]]).collect(),
                })
                .collect(),
            size_px: PLOT_PX,
            least_height: 2.0,
            ..Plot::default()
        })
        .collect();
    section.figures.push(Figure {
        name: "Drift",
        caption: "Attitude while standing, with biased sensors: UWB corrects what the IMU alone cannot \
                  know."
            .into(),
        plots,
    });
    Ok(section)
}
