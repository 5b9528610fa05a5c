//! SERVO: what the board told motors and servos, against what it was asked and what it saw.
//!
//! Whatever holds the vehicle level has to be told: a servo out of trim, a centre of mass beside the middle and a weak wing
//! show here in full, while a board with an integrator leaves nothing of them in the attitude; a tilted accelerometer shows
//! nothing. Outputs in the order of the Flapper's firmware (Crazyflie, `power_distribution_flapper.c`, boards since 2022): pitch
//! servo, left motor, yaw servo, right motor. Per body axis
//!
//! ```text
//! u = c + P e - D ω + t (T/W - 1)     u command, µs from the middle, of roll left less right; e attitude error, rad;
//!                                     ω rate, rad/s; T/W thrust over weight
//! ```
//! and ± mean(u) / std(u) and ± `t` / std(u) with the sign of `P`: what the vehicle is held with against what it is steered with;
//! `P / D`, 1/s, of roll and pitch, for the airframe damps yaw by itself. Travel, unit and sign of an output cancel, so that boards
//! that differ in them can be compared.
//! Both motors follow the commanded throttle, so the lag of theirs is that of commands, without any dynamics of the vehicle.
//! Where one of them does not, outputs are in another order, as on the Flapper's board of 2021, and nothing is said. The regression is
//! our own, chosen by which numbers repeat from flight to flight.

use super::{Channel, Flight, Sheet};
use crate::flight::regress::{Ridge, log, moments};
use haltere_core::measure::ServoOutput;
use haltere_model::effects::Block;

/// Pulse widths, µs: what is beyond is in another unit.
const PULSES_US: std::ops::RangeInclusive<f32> = 800.0..=2200.0;
/// Middle of the travel, µs: of hobby servos, and where the Flapper's stand unless its owner trims them.
const MIDDLE_US: f64 = 1500.0;
/// Fewest outputs in the air: 20 s of them at 10 Hz.
const LEAST: usize = 200;
/// Least share of the variance that a regression must take away (judgement).
const FOLLOWS: f64 = 0.25;
/// Lags of the motors that are looked at, in steps of 10 ms.
const LAG_STEPS: std::ops::RangeInclusive<i32> = -5..=30;
const LAG_STEP_S: f64 = 0.01;
/// Commands come every 10 ms and are held, to half of which a lag is told.
const HELD_S: f64 = 0.005;
/// What the wait of a command for the board's step may change of that logarithm: half a command beside the lag that is told, the mean
/// square that is left is twice as large by the same parabola, and its root by half of the logarithm of two.
const HALF_A_COMMAND: f64 = 0.35;
/// Prior of `c`, `P`, `D`, `t`, µs: full travel; six times it per rad, twice per rad/s, once per weight.
const PRIOR_US: [f64; 4] = [500.0, 3000.0, 1000.0, 500.0];
/// Largest error of attitude that is looked at, rad: beyond it boards act on no more.
const ACTED_ON_RAD: f64 = 0.3;
/// What trims come to that nobody has to ask about, of what steering takes: a tenth, as moving air makes it.
const OF_SPREAD: f64 = 0.1;
/// What pulses come in, µs.
const QUANTUM_US: f64 = 1.0;
/// Noise of a row, µs: a tenth of the travel. Both are judgement: hundreds of rows outweigh them.
const ROW_US: f64 = 50.0;

const AXES: [(&str, Channel); 3] =
    [("roll", Channel::AttitudeRoll), ("pitch", Channel::AttitudePitch), ("yaw", Channel::Yaw)];

/// One reading: point of the grid, share of the step after it, time since the start (s), commands of roll, pitch, yaw and
/// throttle, µs.
struct Told {
    k: usize,
    share: f64,
    t_s: f64,
    axes_us: [f64; 3],
    motors_us: [f64; 2],
}

impl Told {
    fn throttle_us(&self) -> f64 {
        0.5 * (self.motors_us[0] + self.motors_us[1])
    }
}

/// Writes the statistics; `None` lists them.
pub fn put(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    let told = f.map(|f| (f, told(f)));
    let lag = told.as_ref().and_then(|(f, told)| motor_lag(f, told));
    for (axis, (name, channel)) in AXES.into_iter().enumerate() {
        let found = told.as_ref().filter(|_| lag.is_some());
        let [early, late, thrust, stiff] =
            found.and_then(|(f, told)| regress(f, told, axis)).unwrap_or([f64::NAN; 4]);
        // Two numbers, so that one can be held against what the other says.
        for (what, meaning, value) in [
            ("early", "mean command over its spread, first half", early),
            ("late", "the same of the second half", late),
            ("thrust", "in proportion to thrust beyond hover", thrust),
        ] {
            let at = (Block::Actuators, channel);
            sheet.put(at, format!("servo.{name}.{what}"), "1", meaning, value);
            sheet.relative();
            sheet.resolved_to(OF_SPREAD);
        }
        if axis == 2 {
            continue; // the airframe damps it by itself
        }
        let at = (Block::InnerLoop, channel);
        let meaning = "command per error over command per rate";
        sheet.put(at, format!("servo.{name}.stiff"), "1/s", meaning, stiff);
        sheet.relative();
    }
    let [late, misfit] = lag.unwrap_or([f64::NAN; 2]);
    let at = (Block::Link, Channel::Timing);
    sheet.put(at, "servo.thrust.delay", "s", "lag of the motors after the command", late);
    sheet.resolved_to(HELD_S);
    let meaning = "share that is left within half a command of that lag";
    sheet.put(at, "servo.thrust.match", "ln", meaning, misfit);
    sheet.relative();
    sheet.resolved_to(HALF_A_COMMAND);
}

fn told(f: &Flight<'_>) -> Vec<Told> {
    let one = |s: &ServoOutput| {
        let pulses = s.outputs().first_chunk::<4>().filter(|_| s.port == 0)?;
        if pulses.iter().any(|p| !PULSES_US.contains(p)) {
            return None;
        }
        let (k, share) = f.line.place(s.received_at).filter(|(k, _)| f.clear[*k])?;
        let [pitch, left, yaw, right] = pulses.map(f64::from);
        Some(Told {
            k,
            share,
            t_s: s.received_at.seconds_since(f.line.start),
            axes_us: [left - right, pitch - MIDDLE_US, yaw - MIDDLE_US],
            motors_us: [left, right],
        })
    };
    f.trace.servos.iter().filter_map(one).collect()
}

/// Lag at which the motors follow the commanded throttle best, s, and logarithm of the share of their spread that is left
/// there; `None`: they do not follow it.
fn motor_lag(f: &Flight<'_>, told: &[Told]) -> Option<[f64; 2]> {
    if told.len() < LEAST {
        return None;
    }
    let controls = &f.trace.controls;
    let times: Vec<f64> = controls.iter().map(|c| c.at.seconds_since(f.line.start)).collect();
    let throttle = |lag: i32| -> Vec<f64> {
        let held = |t: &Told| {
            let before = times.partition_point(|s| *s <= t.t_s - f64::from(lag) * LAG_STEP_S);
            controls[before.saturating_sub(1)].thrust_frac
        };
        told.iter().map(held).collect()
    };
    let both: Vec<f64> = told.iter().map(Told::throttle_us).collect();
    let misfits: Vec<f64> = LAG_STEPS.map(|lag| misfit(&throttle(lag), &both)).collect();
    let (i, best) = misfits.iter().copied().enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
    let at_best = throttle(*LAG_STEPS.start() + i as i32);
    let follows = |motor: usize| {
        let us: Vec<f64> = told.iter().map(|t| t.motors_us[motor]).collect();
        misfit(&at_best, &us) < (1.0 - FOLLOWS) * moments(us.iter().copied()).std.powi(2)
    };
    if !(follows(0) && follows(1)) {
        return None;
    }
    let mut lag = f64::from(*LAG_STEPS.start()) + i as f64;
    // What half a command beside the best lag leaves, by the parabola through it.
    let mut beside = 0.0;
    if i > 0 && i + 1 < misfits.len() {
        let (a, b, c) = (misfits[i - 1], misfits[i], misfits[i + 1]);
        let bend = (a - 2.0 * b + c).max(1e-9);
        lag += 0.5 * (a - c) / bend;
        beside = bend / 8.0;
    }
    let all = moments(both.iter().copied()).std.powi(2);
    Some([lag * LAG_STEP_S, 0.5 * log((best + beside + QUANTUM_US * QUANTUM_US) / all)])
}

/// Mean square that a line through `x` that rises leaves of `y`.
fn misfit(x: &[f64], y: &[f64]) -> f64 {
    let [mx, my] = [x, y].map(|v| moments(v.iter().copied()));
    let n = x.len() as f64;
    let together = x.iter().zip(y).map(|(x, y)| (x - mx.mean) * (y - my.mean)).sum::<f64>() / n;
    let variance = mx.std.powi(2).max(f64::MIN_POSITIVE);
    my.std.powi(2) - together.max(0.0).powi(2) / variance
}

/// ± mean(u) / std(u) of both halves of the flight, ± `t` / std(u) and `P / D` of an axis.
fn regress(f: &Flight<'_>, told: &[Told], axis: usize) -> Option<[f64; 4]> {
    let mut fit = Ridge::new(&PRIOR_US, ROW_US);
    let row = |t: &Told| -> [f64; 4] {
        let next = (t.k + 1).min(f.len() - 1);
        let between = |at: &dyn Fn(usize) -> f64| at(t.k) + (at(next) - at(t.k)) * t.share;
        // Setpoints are held, and not led from one to the next.
        let error = f.line.setpoint_rad[t.k][axis] - between(&|k| f.line.euler_rad[k][axis]);
        let rate = between(&|k| f.line.rate_B_radps[k][axis]);
        [1.0, error, -rate, between(&|k| f.thrust_ratio(k)) - 1.0]
    };
    let rows: Vec<([f64; 4], f64)> = told
        .iter()
        .map(|t| (row(t), t.axes_us[axis]))
        .filter(|(x, _)| x[1].abs() < ACTED_ON_RAD)
        .collect();
    for (x, u) in &rows {
        fit.row(x, *u);
    }
    let b = fit.solve();
    let all = moments(rows.iter().map(|(_, u)| *u));
    let squared =
        |(x, u): &([f64; 4], f64)| (u - x.iter().zip(&b).map(|(x, b)| x * b).sum::<f64>()).powi(2);
    let left = rows.iter().map(squared).sum::<f64>() / rows.len() as f64;
    if rows.len() < LEAST || left > (1.0 - FOLLOWS) * all.std.powi(2) {
        return None;
    }
    let [_, gain, rate, thrust] = b[..] else { return None };
    let over = gain.signum() / all.std;
    let (early, late) = rows.split_at(rows.len() / 2);
    let [early, late] = [early, late].map(|half| moments(half.iter().map(|(_, u)| *u)).mean);
    Some([early * over, late * over, thrust * over, gain / rate])
}
