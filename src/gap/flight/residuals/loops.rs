//! LOOP: what the closed loops make of it all: tracking errors, trims, throttle in hover. Consequences, whatever the
//! cause: they are of the controller and the estimator, which cannot be it.

use nalgebra::Vector3;

use super::{Channel, Flight, LAG_KNOWN_S, Sheet};
use crate::flight::regress::{Ridge, log, moments};
use haltere_model::effects::Block;

/// Writes the statistics; `None` lists them.
pub fn put(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    tracking(f, sheet);
    trims(f, sheet);
    filter(f, sheet);
}

fn tracking(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    let mut v = [f64::NAN; 12];
    if let Some(f) = f {
        let error = |k: usize| f.states[k].pos_E_m - f.line.target_E_m[k];
        let fast = |k: usize| f.clear[k] && f.states[k].vel_E_mps.xy().norm() > 0.4;
        let along = |k: usize| {
            let v = f.states[k].vel_E_mps;
            let e = error(k);
            let s = v.xy().norm().max(0.1);
            ((e.x * v.x + e.y * v.y) / s, (e.y * v.x - e.x * v.y) / s)
        };
        let points: Vec<usize> = f.clear_points().collect();
        let axis = |a: usize| moments(points.iter().map(|k| error(*k)[a]));
        let (x, y, z) = (axis(0), axis(1), axis(2));
        let moving: Vec<usize> = points.iter().copied().filter(|k| fast(*k)).collect();
        let ahead = moments(moving.iter().map(|k| along(*k).0));
        let side = moments(moving.iter().map(|k| along(*k).1));
        let still =
            moments(points.iter().filter(|k| f.hovering(**k)).map(|k| error(*k).xy().norm()));
        let still_z = moments(points.iter().filter(|k| f.hovering(**k)).map(|k| error(*k).z));
        v = [
            x.mean,
            y.mean,
            z.mean,
            log(x.std),
            log(y.std),
            log(z.std),
            ahead.mean,
            side.mean,
            log(side.std),
            log(still.mean),
            log(still_z.std),
            log(x.most.max(y.most)),
        ];
    }
    let names = [
        ("north", "m", "mean error of position north, by kinematics"),
        ("east", "m", "east"),
        ("down", "m", "down"),
        ("north_std", "ln", "its spread"),
        ("east_std", "ln", "its spread"),
        ("down_std", "ln", "its spread"),
        ("ahead", "m", "error along the way"),
        ("side", "m", "error across the way"),
        ("side_std", "ln", "its spread"),
        ("hover", "ln", "distance from the target in hover"),
        ("hover_down", "ln", "spread of height in hover"),
        ("most", "ln", "largest"),
    ];
    for ((name, unit, meaning), value) in names.into_iter().zip(v) {
        let at = (Block::Controller, Channel::Loop);
        sheet.put(at, format!("loop.{name}"), unit, meaning, value);
    }
}

fn trims(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    let mut v = [f64::NAN; 16];
    if let Some(f) = f {
        let hover: Vec<usize> =
            f.clear_points().filter(|k| f.hovering(*k) && f.height_m[*k] > 0.6).collect();
        let mut roll = Ridge::new(&[0.2, 0.2, 0.2], 0.05);
        let mut pitch = Ridge::new(&[0.2, 0.2, 0.2], 0.05);
        let mut roll_m = Ridge::new(&[0.2, 0.2, 0.2], 0.05);
        let mut pitch_m = Ridge::new(&[0.2, 0.2, 0.2], 0.05);
        for &k in &hover {
            let (sin, cos) = f.yaw_rad[k].sin_cos();
            let s = f.line.setpoint_rad[k];
            let e = f.line.euler_rad[k];
            roll.row(&[1.0, cos, sin], s[0]);
            pitch.row(&[1.0, cos, sin], s[1]);
            roll_m.row(&[1.0, cos, sin], e[0]);
            pitch_m.row(&[1.0, cos, sin], e[1]);
        }
        let (r, p) = (roll.solve(), pitch.solve());
        let (rm, pm) = (roll_m.solve(), pitch_m.solve());
        let thrust = moments(hover.iter().map(|k| f.line.thrust_frac[*k] * f.line.supply_v[*k]));
        let all = moments(f.clear_points().map(|k| f.line.thrust_frac[k] * f.line.supply_v[k]));
        let yaw =
            moments(hover.iter().map(|k| f.line.setpoint_rad[*k][2] - f.line.euler_rad[*k][2]));
        let lean = moments(f.clear_points().map(|k| f.line.setpoint_rad[k][1]));
        let bank = moments(f.clear_points().map(|k| f.line.setpoint_rad[k][0]));
        let enough = |x: f64| if hover.len() > 100 { x } else { f64::NAN };
        let effort = |k: usize| f.line.thrust_frac[k] * f.line.supply_v[k];
        let ceiling_m = f.nominal.room.ceiling_m;
        let still = |k: usize| f.clear[k] && f.states[k].vel_E_mps.norm() < 0.35;
        let low = moments((0..f.len()).filter(|k| still(*k) && f.height_m[*k] < 0.45).map(effort));
        let high = moments(
            (0..f.len())
                .filter(|k| still(*k) && ceiling_m + f.states[*k].pos_E_m.z < 0.8)
                .map(effort),
        );
        let middle = |k: &usize| f.height_m[*k] < 0.75 * ceiling_m;
        let thrust_middle = moments(hover.iter().filter(|k| middle(k)).map(|k| effort(*k)));
        let first = hover.iter().take(hover.len() / 3).filter(|k| middle(k)).map(|k| effort(*k));
        let last = hover.iter().skip(hover.len() * 2 / 3).filter(|k| middle(k));
        let first = moments(first.collect::<Vec<_>>().into_iter());
        let last = moments(last.map(|k| effort(*k)).collect::<Vec<_>>().into_iter());
        let some = |m: &crate::flight::regress::Moments, x: f64| {
            if m.count > 25 { x } else { f64::NAN }
        };
        v = [
            enough(r[0]),
            enough(p[0]),
            enough(0.5 * (r[2] - p[1])),
            enough(0.5 * (r[1] + p[2])),
            enough(rm[0]),
            enough(pm[0]),
            enough(thrust.mean),
            enough(log(thrust.std)),
            log(all.std),
            enough(yaw.mean),
            log(lean.std),
            log(bank.std),
            all.most,
            some(&low, low.mean - thrust_middle.mean),
            some(&high, high.mean - thrust_middle.mean),
            enough(last.mean - first.mean),
        ];
    }
    let names = [
        ("roll", "rad", "mean roll setpoint in hover"),
        ("pitch", "rad", "mean pitch setpoint in hover"),
        ("lean_north", "rad", "lean towards north in hover, any heading"),
        ("lean_east", "rad", "lean towards east in hover"),
        ("roll_measured", "rad", "mean roll in hover"),
        ("pitch_measured", "rad", "mean pitch in hover"),
        ("thrust", "V", "throttle times voltage in hover"),
        ("thrust_hover_std", "ln", "its spread in hover"),
        ("thrust_std", "ln", "its spread"),
        ("yaw", "rad", "mean yaw setpoint minus yaw in hover"),
        ("pitch_std", "ln", "spread of the pitch setpoint"),
        ("roll_std", "ln", "spread of the roll setpoint"),
        ("thrust_most", "V", "largest departure of throttle times voltage"),
        ("thrust_low", "V", "throttle times voltage near the floor, beyond that of hover"),
        ("thrust_high", "V", "near the ceiling, beyond that of hover"),
        ("thrust_change", "V", "last third of the hovers beyond the first third"),
    ];
    for ((name, unit, meaning), value) in names.into_iter().zip(v) {
        let at = (Block::Controller, Channel::Loop);
        sheet.put(at, format!("trim.{name}"), unit, meaning, value);
    }
}

/// The pilot's filter against the smoother.
fn filter(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    let mut v = [f64::NAN; 8];
    if let Some(f) = f {
        let d = |k: usize| f.line.pos_E_m[k] - f.states[k].pos_E_m;
        let in_body = |k: usize| {
            let (sin, cos) = f.yaw_rad[k].sin_cos();
            let e = d(k);
            Vector3::new(cos * e.x + sin * e.y, cos * e.y - sin * e.x, e.z)
        };
        let mut fit = Ridge::new(&[0.3, 0.3, 0.3, 0.3], 0.1);
        for k in f.clear_points() {
            let v = f.states[k].vel_E_mps;
            fit.row(&[1.0, 0.0, -v.x, v.y], d(k).x);
            fit.row(&[0.0, 1.0, -v.y, -v.x], d(k).y);
        }
        let b = fit.solve();
        let m = |a: usize| moments(f.clear_points().map(|k| in_body(k)[a]));
        let (x, y, z) = (m(0), m(1), m(2));
        v = [x.mean, y.mean, z.mean, log(x.std), log(y.std), log(z.std), b[2], b[3]];
    }
    let names = [
        ("x", "m", "pilot's position minus smoothed, forward"),
        ("y", "m", "to the right"),
        ("z", "m", "down"),
        ("x_std", "ln", "its spread"),
        ("y_std", "ln", "its spread"),
        ("z_std", "ln", "its spread"),
        ("late", "s", "against velocity"),
        ("turn", "s", "across velocity"),
    ];
    for ((name, unit, meaning), value) in names.into_iter().zip(v) {
        let at = (Block::Estimator, Channel::Loop);
        sheet.put(at, format!("filter.{name}"), unit, meaning, value);
        if name == "late" {
            sheet.resolved_to(LAG_KNOWN_S);
        }
    }
}
