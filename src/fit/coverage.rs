//! Every stated standard error against the truth, over hundreds of simulated data sets.
//!
//! Noise is what our logs hold: a Gauss-Markov part that lasts, white noise on top, and where the
//! loops swing a resonance that no fit knows of. An interval that says 68 % or 95 % must hold the truth
//! that often, within three sigma of what chance does to so many sets.

use nalgebra::{DVector, Vector3};

use super::anchors::{self, Difference, Positions};
use super::correlated::Noise;
use super::coverage_noise::{Log, Markov, Stream};
use super::linear::Rows;
use super::tell::{drag, thrust};
use super::value::Value;
use super::{ground, imu, lag, polynomial, steady, transient};
use haltere_core::control::drag::DragConfig;
use haltere_core::control::trim::{HoverSample, trims_from_hover};
use haltere_core::frames::{G_MPS2, Rot, Vec3};
use haltere_core::time::HostTime;
use haltere_log::import::motion::Sample;
use haltere_log::import::stand::StandRow;

/// Data sets per fit.
const SETS: u64 = 240;

/// How often the truth was inside.
struct Cover {
    name: &'static str,
    n: f64,
    inside: [f64; 2],
    square: f64,
    stated: f64,
}

const LEVELS: [f64; 2] = [0.6827, 0.95];

impl Cover {
    fn new(name: &'static str) -> Self {
        Self { name, n: 0.0, inside: [0.0; 2], square: 0.0, stated: 0.0 }
    }

    fn add(&mut self, value: Value, truth: f64) {
        self.n += 1.0;
        let error = (value.value - truth).abs();
        for (inside, level) in self.inside.iter_mut().zip(LEVELS) {
            *inside += f64::from(u8::from(error <= value.half_width(level)));
        }
        self.square += error * error;
        self.stated += value.std * value.std;
    }

    /// Holds the shares against what they should be. `sets`: independent data sets behind them.
    fn judge(&self, sets: f64) {
        let [one, two] = self.inside.map(|i| i / self.n);
        println!(
            "{}: 68 %: {:.1}, 95 %: {:.1}, rms {:.4}, stated {:.4}",
            self.name,
            one * 100.0,
            two * 100.0,
            (self.square / self.n).sqrt(),
            (self.stated / self.n).sqrt()
        );
        for (found, level) in [one, two].into_iter().zip(LEVELS) {
            let chance = 3.0 * (level * (1.0 - level) / sets).sqrt();
            assert!(
                (found - level).abs() <= chance,
                "{}: an interval of {:.0} % holds the truth in {:.1} % of {} sets, allowed ± {:.1}",
                self.name,
                level * 100.0,
                found * 100.0,
                self.n,
                chance * 100.0
            );
        }
    }
}

fn noise_of(t: &[f64], y: &[f64]) -> Noise {
    let mean = y.iter().sum::<f64>() / y.len() as f64;
    let residual: Vec<f64> = y.iter().map(|v| v - mean).collect();
    Noise::learn(t, &Rows::from_fn(t.len(), 1, |_, row| row[0] = 1.0), &residual).unwrap()
}

#[test]
fn val_transients_cover() {
    const DT_S: f64 = 0.02;
    let (a, b, c) = (2.0, 1.8, 3.0);
    let mut covers: Vec<Cover> =
        ["a at 50 %", "c at 50 %", "a at 90 %", "c at 90 %"].map(Cover::new).into();
    for seed in 0..SETS {
        let mut rng = Stream::new(seed, "transient");
        let mut noise = Log::new(0.05, 0.3, 0.02, DT_S, &mut rng);
        // Half a minute of hover, as the program flies it, then the step. Half of that leaves the
        // intervals a seventh too wide (75 to 78 % instead of 68 %).
        let hover: Vec<f64> = (0..1500).map(|_| noise.step(&mut rng)).collect();
        let times: Vec<f64> = (0..1500).map(|i| f64::from(i) * DT_S).collect();
        let learned = noise_of(&times, &hover);
        let t = &times[..150];
        let v: Vec<f64> = t.iter().map(|t| a - b * (-c * t).exp() + noise.step(&mut rng)).collect();
        for (k, share) in [0.5, 0.9].into_iter().enumerate() {
            let fit = transient::fit_in_noise(t, &v, share, Some(&learned)).unwrap();
            covers[2 * k].add(fit.a_mps, a);
            covers[2 * k + 1].add(fit.c_per_s, c);
            assert!(fit.determined);
        }
    }
    covers.iter().for_each(|c| c.judge(SETS as f64));
}

#[test]
fn val_steady_laws_cover() {
    let mut covers: Vec<Cover> =
        ["a", "b", "c", "drag at rest", "inverse c", "line p1"].map(Cover::new).into();
    let (lean, speed) = ([12.0, 22.0, 33.0, 45.0, 52.0], |l: f64| -((90.0 - l) / 90.0).ln() / 0.3);
    for seed in 0..SETS {
        let mut rng = Stream::new(seed, "steady");
        let mut points = |of: &dyn Fn(f64) -> f64| -> Vec<steady::Point> {
            [lean, lean]
                .concat()
                .into_iter()
                .map(|l| steady::Point {
                    lean_deg: l,
                    speed_mps: of(l) + 0.03 * rng.normal(),
                    std_mps: 0.0,
                })
                .collect()
        };
        let fit = steady::fit(&points(&speed)).unwrap();
        let law = fit.law(steady::Form::AngleOfVelocity).unwrap();
        for (cover, (found, truth)) in
            covers.iter_mut().zip(law.parameters.iter().zip([-90.0, 90.0, 0.3]))
        {
            cover.add(found.1, truth);
        }
        covers[3].add(law.drag_per_s, G_MPS2 * 27f64.to_radians());
        let fit = steady::fit(&points(&|l| -2.5 + 2.5 * (0.0143 * l).exp())).unwrap();
        let law = fit.law(steady::Form::VelocityOfAngle).unwrap();
        covers[4].add(law.parameters[2].1, 0.0143);
        let fit = steady::fit(&points(&|l| 0.1 + 0.05 * l)).unwrap();
        covers[5].add(fit.law(steady::Form::Linear).unwrap().parameters[1].1, 0.05);
    }
    covers.iter().for_each(|c| c.judge(SETS as f64));
}

#[test]
fn val_thrust_over_voltage_covers() {
    const DT_S: f64 = 0.5;
    let mut covers: Vec<Cover> =
        ["exponent", "command at 7.4 V", "c0 of order 1", "c1 of order 3"].map(Cover::new).into();
    for seed in 0..SETS {
        let mut rng = Stream::new(seed, "voltage");
        let mut noise = Log::new(0.008, 2.0, 0.006, DT_S, &mut rng).swinging(0.004, 3.0, DT_S);
        let t: Vec<f64> = (0..500).map(|i| f64::from(i) * DT_S).collect();
        let v: Vec<f64> = t.iter().map(|t| 8.0 - 1.2 * t / 250.0).collect();
        let law: Vec<f64> = v.iter().map(|v| 4.73 / v + noise.step(&mut rng)).collect();
        let found = polynomial::fit(&t, &v, &law, 7.4).unwrap();
        covers[0].add(found.power.exponent, -1.0);
        covers[1].add(found.power.at_centre, 4.73 / 7.4);
        // The orders are judged on truths that they can hold.
        let line: Vec<f64> =
            v.iter().map(|v| 0.64 - 0.09 * (v - 7.4) + noise.step(&mut rng)).collect();
        let found = polynomial::fit(&t, &v, &line, 7.4).unwrap();
        covers[2].add(found.polynomials[0].coefficients[0], 0.64);
        covers[3].add(found.polynomials[2].coefficients[1], -0.09);
    }
    covers.iter().for_each(|c| c.judge(SETS as f64));
}

/// Ladders of heights with this much swing of the loops.
fn ladders(swing: f64) -> Vec<Cover> {
    const DT_S: f64 = 0.5;
    let (lambda, a, free) = (0.00093, 0.2213, 0.64);
    let mut covers: Vec<Cover> =
        ["lambda", "a", "free air", "ratio at the lowest"].map(Cover::new).into();
    for seed in 0..SETS {
        let mut rng = Stream::new(seed, "ground");
        let mut noise = Log::new(0.006, 1.5, 0.004, DT_S, &mut rng).swinging(swing, 3.0, DT_S);
        let (mut t, mut h, mut y) = (Vec::new(), Vec::new(), Vec::new());
        let mut now_s = 0.0;
        for rung in [1.2, 0.33, 0.65, 0.45, 1.2f64] {
            for _ in 0..140 {
                now_s += DT_S;
                t.push(now_s);
                h.push(rung);
                y.push(free * (1.0 - lambda / (rung - a).powi(2)) + noise.step(&mut rng));
            }
            now_s += 4.0;
        }
        let found = ground::fit(&t, &h, &y).unwrap();
        let at_lowest = 1.0 - lambda / (0.33f64 - a).powi(2);
        for (cover, (value, truth)) in covers.iter_mut().zip([
            (found.lambda_m2, lambda),
            (found.a_m, a),
            (found.free, free),
            (found.at_lowest, at_lowest),
        ]) {
            cover.add(value, truth);
        }
    }
    covers
}

#[test]
fn val_ground_covers() {
    ladders(0.0).iter().for_each(|c| c.judge(SETS as f64));
}

#[test]
fn val_a_swing_that_the_noise_model_does_not_know_costs_little() {
    // Half as large as the slow part is the worst mix found: over 800 sets 63 to 65 % and 92 to 95 %
    // are held instead of 68 and 95 %. A larger swing is seen and covered again. What is asked here
    // is that much less three sigma of chance.
    for cover in ladders(0.003) {
        let [one, two] = cover.inside.map(|i| i / cover.n);
        println!("{}: 68 %: {:.1}, 95 %: {:.1}", cover.name, one * 100.0, two * 100.0);
        assert!(one > 0.54 && two > 0.87, "{}: {one:.3} {two:.3}", cover.name);
    }
}

/// A second of doublets after a second of rest, again and again.
fn doublets(n: usize, dt_s: f64) -> Vec<f64> {
    (0..n)
        .map(|i| match (i as f64 * dt_s) % 2.5 {
            t if t < 1.0 => 0.0,
            t if t < 1.4 => 0.14,
            t if t < 1.8 => -0.14,
            _ => 0.0,
        })
        .collect()
}

#[test]
fn val_lags_cover() {
    const DT_S: f64 = 0.01;
    let mut covers: Vec<Cover> =
        ["delay", "time constant", "gain", "late", "delay of second order", "frequency", "damping"]
            .map(Cover::new)
            .into();
    let n = 1000;
    let u = doublets(n, DT_S);
    for seed in 0..SETS {
        let mut rng = Stream::new(seed, "lag");
        let mut noise = Log::new(0.008, 0.2, 0.002, DT_S, &mut rng);
        let delayed = |i: usize| if i >= 3 { u[i - 3] } else { 0.0 };
        let mut x = 0.0;
        let y: Vec<f64> = (0..n)
            .map(|i| {
                x = delayed(i) + (x - delayed(i)) * (-DT_S / 0.08f64).exp();
                0.01 + 0.95 * x + noise.step(&mut rng)
            })
            .collect();
        let found = lag::fit(DT_S, &u, &y).unwrap();
        covers[0].add(found.first.delay_s, 0.03);
        covers[1].add(found.first.time_s.unwrap(), 0.08);
        covers[2].add(found.first.gain, 0.95);
        covers[3].add(found.first.late_s, 0.11);
        let (mut x, mut v) = (0.0, 0.0);
        let y: Vec<f64> = (0..n)
            .map(|i| {
                for _ in 0..20 {
                    v += DT_S / 20.0 * (144.0 * (delayed(i) - x) - 14.4 * v);
                    x += DT_S / 20.0 * v;
                }
                0.95 * x + noise.step(&mut rng)
            })
            .collect();
        let found = lag::fit(DT_S, &u, &y).unwrap();
        let second = found.second.as_ref().unwrap();
        covers[4].add(second.delay_s, 0.03);
        covers[5].add(second.omega_radps.unwrap(), 12.0);
        covers[6].add(second.damping.unwrap(), 0.6);
    }
    covers.iter().for_each(|c| c.judge(SETS as f64));
}

#[test]
fn val_inertial_sensors_cover() {
    const DT_S: f64 = 0.005;
    let mut covers: Vec<Cover> = ["bias", "wing beat"].map(Cover::new).into();
    for seed in 0..SETS {
        let mut rng = Stream::new(seed, "imu");
        let mut noise = Log::new(0.002, 0.3, 0.01, DT_S, &mut rng);
        let t: Vec<f64> = (0..1600).map(|i| f64::from(i) * DT_S).collect();
        let y: Vec<f64> = t.iter().map(|_| 0.01 + noise.step(&mut rng)).collect();
        covers[0].add(imu::at_rest(&t, &y).unwrap().mean, 0.01);
        // The beat follows the thrust, which wanders over a second.
        let mut wander = Markov::new(0.3, 0.7, DT_S, &mut rng);
        let mut phase = 0.0;
        let v: Vec<f64> = (0..6000)
            .map(|_| {
                phase += 2.0 * std::f64::consts::PI * (12.5 + wander.step(&mut rng)) * DT_S;
                5.0 * f64::sin(phase) + 2.0 * f64::sin(2.0 * phase + 0.3) + rng.normal()
            })
            .collect();
        covers[1].add(imu::vibration(200.0, &v).unwrap().line.unwrap().hz, 12.5);
    }
    covers.iter().for_each(|c| c.judge(SETS as f64));
}

#[test]
fn val_anchors_cover_with_and_without_truth() {
    const DT_S: f64 = 0.02;
    let survey: Vec<[f64; 3]> = (0..8)
        .map(|i| {
            let of = |bit: i32, far: f64| if i & bit != 0 { far } else { 0.0 };
            [of(1, 10.0), of(2, 10.0), of(4, -7.0)]
        })
        .collect();
    let places: Vec<Vector3<f64>> = survey.iter().map(|s| Vector3::from(*s)).collect();
    for (positions, names) in [
        (Positions::Known, ["offset, known positions", "bias, known positions"]),
        (Positions::Estimated, ["offset, no truth", "bias, no truth"]),
    ] {
        let mut covers: Vec<Cover> = names.map(Cover::new).into();
        for seed in 0..SETS {
            let mut rng = Stream::new(seed, "anchors");
            let truth: Vec<f64> = (0..32).map(|_| 0.1 * rng.normal()).collect();
            let mut of_anchor: Vec<Markov> =
                (0..8).map(|_| Markov::new(0.08, 0.1, DT_S, &mut rng)).collect();
            let mut of_filter: Vec<Markov> =
                (0..3).map(|_| Markov::new(0.05, 0.7, DT_S, &mut rng)).collect();
            let differences: Vec<Difference> = (0..3000usize)
                .map(|k| {
                    let t = k as f64 * DT_S;
                    let p = Vector3::new(
                        5.0 + 3.5 * (0.35 * t).sin(),
                        5.0 + 3.5 * (0.27 * t + 1.0).sin(),
                        -3.0 + 2.2 * (0.5 * t).sin(),
                    );
                    let noise: Vec<f64> = of_anchor.iter_mut().map(|m| m.step(&mut rng)).collect();
                    let wrong =
                        Vector3::from_iterator(of_filter.iter_mut().map(|m| m.step(&mut rng)));
                    let (a, b) = (k % 8, (k + 1 + (k / 8) % 7) % 8);
                    let range = |i: usize| {
                        let off = Vector3::new(truth[4 * i], truth[4 * i + 1], truth[4 * i + 2]);
                        (p - places[i] - off).norm() + truth[4 * i + 3] + noise[i]
                    };
                    let told = if positions == Positions::Known { p } else { p + wrong };
                    Difference {
                        t_s: t,
                        a,
                        b,
                        difference_m: range(b) - range(a) + 0.05 * rng.normal(),
                        pos_E_m: told.into(),
                    }
                })
                .collect();
            let found = anchors::fit(&survey, &differences, positions).unwrap();
            let seen = anchors::gauge(&places, positions) * DVector::from_vec(truth.clone());
            for (i, anchor) in found.anchors.iter().enumerate() {
                for (k, value) in anchor.offset_E_m.into_iter().enumerate() {
                    covers[0].add(value, seen[4 * i + k]);
                }
                covers[1].add(anchor.bias_m, seen[4 * i + 3]);
            }
        }
        covers.iter().for_each(|c| c.judge(SETS as f64));
    }
}

#[test]
fn val_drag_of_recordings_covers() {
    const DT_S: f64 = 0.05;
    let mut cover = Cover::new("drag of a recording");
    let mut constant = Cover::new("constant beside it");
    for seed in 0..SETS {
        let mut rng = Stream::new(seed, "drag");
        let mut noise = Log::new(0.6, 0.5, 0.3, DT_S, &mut rng);
        let mut speed = Markov::new(0.6, 1.5, DT_S, &mut rng);
        let samples: Vec<Sample> = (0..1200)
            .map(|i| {
                let v = speed.step(&mut rng);
                Sample {
                    t_s: f64::from(i) * DT_S,
                    vel_B_mps: Vec3::new(v, 0.0, 0.0),
                    force_B_mps2: Vec3::new(0.2 - 3.8 * v + noise.step(&mut rng), 0.0, -9.8),
                    R_EB: Rot::identity(),
                    height_m: 1.0,
                    command_frac: 0.6,
                    command_rate_per_s: 0.0,
                    supply_v: 7.5,
                    tilt_apart_rad: [0.0; 2],
                }
            })
            .collect();
        let found = drag::along(&samples, 0).unwrap();
        cover.add(found.rate_per_s, 3.8);
        constant.add(found.constant_mps2, 0.2);
    }
    cover.judge(SETS as f64);
    constant.judge(SETS as f64);
}

#[test]
fn val_the_stand_covers() {
    let mut cover = Cover::new("command over voltage on a stand");
    for seed in 0..SETS {
        let mut rng = Stream::new(seed, "stand");
        let mut noise = Log::new(0.01, 20.0, 0.004, 1.0, &mut rng);
        let rows: Vec<StandRow> = (0..900)
            .map(|i| {
                let x = f64::from(i) / 900.0;
                let command_frac = 0.2 + 0.7 * (7.0 * x).fract();
                let supply_v = 3.8 - 0.4 * x - 0.3 * command_frac;
                let thrust_n = 0.035 * command_frac.powf(1.5) * supply_v.powf(1.6);
                StandRow { command_frac, supply_v, thrust_n: thrust_n + noise.step(&mut rng) }
            })
            .map(|r| StandRow { thrust_n: r.thrust_n.max(0.002), ..r })
            .collect();
        let law = thrust::stand_law(&rows, true).unwrap();
        cover.add(law.command, -1.6 / 1.5);
    }
    cover.judge(SETS as f64);
}

#[test]
fn val_trims_cover() {
    const DT_S: f64 = 0.05;
    let mut covers: Vec<Cover> = ["roll trim", "pitch trim", "yaw trim"].map(Cover::new).into();
    for seed in 0..SETS {
        let mut rng = Stream::new(seed, "trim");
        let mut noise: Vec<Log> =
            (0..3).map(|_| Log::new(0.01, 0.3, 0.003, DT_S, &mut rng)).collect();
        let samples: Vec<HoverSample> = (0..800u64)
            .map(|i| {
                let wander: Vec<f64> = noise.iter_mut().map(|n| n.step(&mut rng)).collect();
                HoverSample {
                    at: HostTime::from_us(i * 50_000),
                    roll_rad: 1.5f64.to_radians() + wander[0],
                    pitch_rad: -2f64.to_radians() + wander[1],
                    yaw_rad: 1f64.to_radians() + wander[2],
                    yaw_estimate_rad: 0.0,
                    vel_heading_mps: [0.0; 3],
                    saturated: false,
                }
            })
            .collect();
        let trims = trims_from_hover(&samples, &DragConfig::default()).unwrap();
        let dof = (trims.blocks - 1) as f64;
        for (cover, (trim, truth)) in
            covers.iter_mut().zip([(trims.roll, 1.5), (trims.pitch, -2.0), (trims.yaw, 1.0)])
        {
            cover.add(Value { value: trim.value_deg, std: trim.std_deg, dof }, truth);
        }
    }
    covers.iter().for_each(|c| c.judge(SETS as f64));
}
