//! ATT and YAW: measured attitude minus the nominal response of the inner loop to the logged
//! setpoints, rad, both in the board's own frame, so that its errors of attitude cancel. GYR: gyro
//! minus the change of the board's attitude, rad/s.

use super::{Channel, FINE, Flight, LAG_KNOWN_S, Sheet};
use crate::flight::regress::{Moments, Ridge, autocorrelation, log, moments};
use crate::flight::timeline::STEP_S;
use haltere_model::effects::Block;

/// Noise of a row, rad, as a correlated one.
const ROW_STD: f64 = 0.05;
/// Setpoints beyond this are large, rad: the mildest saturation of L5 is at 15°.
const LARGE_RAD: f64 = 0.14;
/// Setpoint activity below this is small, rad/s.
const SMALL_RADPS: f64 = 0.15;
/// Lags that are looked at, steps of 10 ms.
const LAGS: std::ops::RangeInclusive<i64> = -6..=18;
/// Highest rms of the lagged difference that counts as excited, rad.
const EXCITED_RAD: f64 = 2e-3;

const NAMES: [(&str, &str, &str, f64); 10] = [
    ("const", "rad", "constant", 0.1),
    ("thrust", "rad", "in proportion to thrust beyond hover", 0.3),
    ("speed", "rad per m/s", "with the speed that leans this axis", 0.2),
    ("lag", "s", "with the nominal rate: positive is late", 0.1),
    ("roll_off", "s²", "with the nominal acceleration", 0.01),
    ("large", "1", "share of the setpoint beyond 8° that is missing", 1.0),
    ("other", "1", "with the rate of the setpoint of the coupled axis", 0.3),
    ("time", "rad per min", "ramp", 0.05),
    ("drive", "1", "with the setpoint itself", 0.3),
    ("coupling", "s²", "with the roll acceleration (yaw), pitch acceleration (roll)", 0.05),
];

/// Residual of an axis at every point, rad.
pub fn residuals(f: &Flight<'_>, axis: usize) -> Vec<f64> {
    (0..f.len()).map(|k| f.line.euler_rad[k][axis] - f.response_rad[k][axis]).collect()
}

/// Writes the statistics; `None` lists them.
pub fn put(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    for axis in 0..3 {
        let (name, channel) = [
            ("roll", Channel::AttitudeRoll),
            ("pitch", Channel::AttitudePitch),
            ("yaw", Channel::Yaw),
        ][axis];
        let at = (Block::InnerLoop, channel);
        let mut b = vec![f64::NAN; NAMES.len()];
        let mut more = [f64::NAN; 10];
        if let Some(f) = f {
            let r = residuals(f, axis);
            let (coefficients, left) = regress(f, &r, axis);
            b = coefficients;
            more = shape(f, &left, axis);
        }
        for ((n, unit, meaning, _), value) in NAMES.iter().zip(b) {
            if axis == 2 && (*n == "large" || *n == "drive") {
                continue; // a heading has no zero
            }
            let at = if *n == "const" { (Block::Actuators, channel) } else { at };
            sheet.put(at, format!("att.{name}.{n}"), unit, meaning, value);
            if *n == "lag" {
                sheet.resolved_to(LAG_KNOWN_S);
            }
        }
        let [std, quiet, r1, most, lag, depth, gain, swing, busy, steep] = more;
        sheet.put(at, format!("att.{name}.std"), "ln", "spread of what is left", std);
        sheet.put(
            at,
            format!("att.{name}.quiet"),
            "ln",
            "the same while the setpoint rests",
            quiet,
        );
        sheet.put(at, format!("att.{name}.corr"), "1", "autocorrelation at 0.4 s", r1);
        sheet.put(at, format!("att.{name}.most"), "ln", "largest of what is left", most);
        sheet.put(at, format!("att.{name}.delay"), "s", "lag of the best match", lag);
        sheet.resolved_to(LAG_KNOWN_S);
        sheet.put(at, format!("att.{name}.match"), "ln", "misfit at that lag", depth);
        sheet.put(at, format!("att.{name}.gain"), "1", "slope on the nominal response", gain);
        sheet.put(at, format!("att.{name}.swing"), "ln", "spread of the rate in hover", swing);
        // What a servo out of trim and one with play show, whatever the loops.
        let of_servo = (Block::Actuators, channel);
        sheet.put(of_servo, format!("att.{name}.small"), "1", "slope for small movements", busy);
        sheet.put(
            at,
            format!("att.{name}.bursts"),
            "ln",
            "worst second over the median one",
            steep,
        );
    }
    gyro(f, sheet);
}

fn rate(f: &Flight<'_>, k: usize, axis: usize, order: usize) -> f64 {
    let fine = &f.fine_response_rad[axis];
    let j = (k * FINE).clamp(4, fine.len().saturating_sub(5));
    let h = 0.04;
    match order {
        1 => (fine[j + 4] - fine[j - 4]) / (2.0 * h),
        _ => (fine[j + 4] - 2.0 * fine[j] + fine[j - 4]) / (h * h),
    }
}

fn regress(f: &Flight<'_>, r: &[f64], axis: usize) -> (Vec<f64>, Vec<f64>) {
    let prior: Vec<f64> = NAMES.iter().map(|n| n.3).collect();
    let mut fit = Ridge::new(&prior, ROW_STD);
    let row = |k: usize| -> [f64; 10] {
        let s = f.line.setpoint_rad[k];
        let v = f.vel_B_mps[k];
        let speed = if axis == 0 { v.y } else { v.x };
        let large = s[axis].signum() * (s[axis].abs() - LARGE_RAD).max(0.0);
        let coupled = [1, 0, 0][axis];
        [
            1.0,
            f.thrust_ratio(k) - 1.0,
            speed,
            -rate(f, k, axis, 1),
            -rate(f, k, axis, 2),
            if axis == 2 { 0.0 } else { -large },
            rate(f, k, coupled, 1),
            f.line.t_s[k] / 60.0 - 0.75,
            if axis == 2 { 0.0 } else { s[axis] },
            rate(f, k, coupled, 2) * 0.1,
        ]
    };
    for k in f.clear_points() {
        fit.row(&row(k), r[k]);
    }
    let mut b = fit.solve();
    let left = (0..f.len())
        .map(|k| match f.clear[k] {
            true => r[k] - row(k).iter().zip(&b).map(|(x, b)| x * b).sum::<f64>(),
            false => f64::NAN,
        })
        .collect();
    let large =
        f.clear_points().filter(|k| f.line.setpoint_rad[*k][axis].abs() > LARGE_RAD).count();
    if axis == 2 || large < 15 {
        b[5] = f64::NAN;
    }
    if axis == 2 {
        b[8] = f64::NAN;
    }
    (b, left)
}

/// Change over 0.2 s, which slow errors do not reach.
fn change(values: &[f64], j: usize) -> f64 {
    values[j] - values[j - 20]
}

fn shape(f: &Flight<'_>, left: &[f64], axis: usize) -> [f64; 10] {
    let all = moments(left.iter().copied());
    let quiet = |k: usize| {
        f.hovering(k) && k > 0 && {
            let (a, b) = (f.line.setpoint_rad[k][axis], f.line.setpoint_rad[k - 1][axis]);
            (a - b).abs() < SMALL_RADPS * STEP_S
        }
    };
    let still = moments((0..f.len()).filter(|k| quiet(*k)).map(|k| left[k]));
    let swing =
        moments(f.clear_points().filter(|k| f.hovering(*k)).map(|k| f.line.rate_B_radps[k][axis]));
    let [lag, depth, gain] = best_lag(f, axis);
    let small = small_gain(f, axis);
    let mut seconds: Vec<f64> = left
        .chunks(25)
        .filter(|c| c.iter().all(|v| v.is_finite()))
        .map(|c| c.iter().map(|v| v * v).sum::<f64>() / c.len() as f64)
        .collect();
    seconds.sort_by(f64::total_cmp);
    let bursts = match seconds.len() {
        0..8 => f64::NAN,
        n => 0.5 * (log(seconds[n - 2]) - log(seconds[n / 2])),
    };
    [
        log(all.std),
        spread(&still),
        autocorrelation(left, 10),
        log(all.most),
        lag,
        depth,
        gain,
        spread(&swing),
        small,
        bursts,
    ]
}

/// Of a second or more: one point alone has no spread, which is not a small one.
fn spread(m: &Moments) -> f64 {
    if m.count >= 25 { log(m.std) } else { f64::NAN }
}

/// Lag at which the nominal response fits best, s; misfit there; slope there.
fn best_lag(f: &Flight<'_>, axis: usize) -> [f64; 3] {
    let fine = &f.fine_response_rad[axis];
    let measured: Vec<f64> = f.line.euler_rad.iter().map(|e| e[axis]).collect();
    let points: Vec<usize> = f.clear_points().filter(|k| *k >= 5).collect();
    if points.len() < 100 {
        return [f64::NAN; 3];
    }
    let span = 20usize;
    let mut best = (f64::INFINITY, 0i64, 0.0);
    let mut misfits = Vec::new();
    for lag in LAGS {
        let (mut yy, mut xy, mut xx) = (0.0, 0.0, 0.0);
        for &k in &points {
            let j = ((k * FINE) as i64 - lag).clamp(span as i64, fine.len() as i64 - 1) as usize;
            let x = change(fine, j);
            let y = measured[k] - measured[k - 5];
            (yy, xy, xx) = (yy + y * y, xy + x * y, xx + x * x);
        }
        let n = points.len() as f64;
        if (xx / n).sqrt() < EXCITED_RAD {
            return [f64::NAN; 3];
        }
        let misfit = (yy - xy * xy / xx) / n;
        misfits.push(misfit);
        if misfit < best.0 {
            best = (misfit, lag, xy / xx);
        }
    }
    let i = (best.1 - LAGS.start()) as usize;
    let mut lag_s = best.1 as f64;
    if i > 0 && i + 1 < misfits.len() {
        let (a, b, c) = (misfits[i - 1], misfits[i], misfits[i + 1]);
        lag_s += 0.5 * (a - c) / (a - 2.0 * b + c).max(1e-15);
    }
    [lag_s * 0.01, 0.5 * log(best.0), best.2]
}

/// Slope of the measured change on the nominal one, where the latter is small.
fn small_gain(f: &Flight<'_>, axis: usize) -> f64 {
    let fine = &f.fine_response_rad[axis];
    let (mut xy, mut xx) = (0.0, 1e-5);
    for k in f.clear_points().filter(|k| *k >= 5 && *k * FINE < fine.len()) {
        let x = change(fine, (k * FINE).max(20));
        if x.abs() < 0.02 {
            let y = f.line.euler_rad[k][axis] - f.line.euler_rad[k - 5][axis];
            (xy, xx) = (xy + x * y, xx + x * x);
        }
    }
    xy / xx
}

fn gyro(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let at = (Block::Imu, Channel::Gyro);
        let [mean, slope, std] = f.map_or([f64::NAN; 3], |f| {
            let r = gyro_residuals(f, axis);
            let m = moments(r.iter().copied());
            let mut fit = Ridge::new(&[0.1, 0.1], 0.05);
            for (k, r) in r.iter().enumerate() {
                fit.row(&[1.0, f.line.t_s[k] / 60.0 - 0.75], *r);
            }
            [m.mean, fit.solve()[1], log(m.std)]
        });
        sheet.put(at, format!("gyro.{name}.mean"), "rad/s", "gyro minus change of attitude", mean);
        sheet.put(at, format!("gyro.{name}.time"), "rad/s per min", "its ramp", slope);
        sheet.put(at, format!("gyro.{name}.std"), "ln", "its spread", std);
    }
}

/// Gyro minus the rate of the board's attitude, rad/s; NaN off the air.
pub fn gyro_residuals(f: &Flight<'_>, axis: usize) -> Vec<f64> {
    let n = f.len();
    (0..n)
        .map(|k| {
            if k == 0 || k + 1 >= n || !f.clear[k] {
                return f64::NAN;
            }
            let turn = f.line.board[k - 1].inverse() * f.line.board[k + 1];
            f.line.rate_B_radps[k][axis] - turn.scaled_axis()[axis] / (2.0 * STEP_S)
        })
        .collect()
}
