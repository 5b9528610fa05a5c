//! KIN: what kinematics alone says of the IMU and of north: level, ramp and dependence of the bias
//! that reconciles it with UWB. HEIGHT: air pressure against the smoother.

use super::{Channel, Flight, Sheet};
use crate::flight::regress::{Ridge, log, moments};
use haltere_model::effects::Block;

/// Pascal per metre of air at the ground.
const PA_PER_M: f64 = 12.0;

/// Writes the statistics; `None` lists them.
pub fn put(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    const NAMES: [(&str, &str, &str); 6] = [
        ("const", "m/s²", "level of the bias"),
        ("time", "m/s² per min", "its ramp"),
        ("thrust", "m/s²", "with thrust beyond hover"),
        ("cos_yaw", "m/s²", "with the cosine of yaw"),
        ("sin_yaw", "m/s²", "with the sine of yaw"),
        ("speed", "1/s", "with speed along the axis"),
    ];
    let at = (Block::Imu, Channel::Bias);
    for (axis, axis_name) in ["x", "y", "z"].into_iter().enumerate() {
        let mut b = vec![f64::NAN; 6];
        let mut std = f64::NAN;
        if let Some(f) = f {
            let mut fit = Ridge::new(&[1.0, 1.0, 1.0, 0.5, 0.5, 0.3], 0.3);
            for k in f.clear_points() {
                let (sin, cos) = f.yaw_rad[k].sin_cos();
                let x = [
                    1.0,
                    f.line.t_s[k] / 60.0 - 0.75,
                    f.thrust_ratio(k) - 1.0,
                    cos,
                    sin,
                    f.vel_B_mps[k][axis],
                ];
                fit.row(&x, f.states[k].bias_B_mps2[axis]);
            }
            b = fit.solve();
            std = log(moments(f.clear_points().map(|k| f.states[k].bias_B_mps2[axis])).std);
        }
        for ((name, unit, meaning), value) in NAMES.into_iter().zip(b) {
            sheet.put(at, format!("bias.{axis_name}.{name}"), unit, meaning, value);
        }
        sheet.put(at, format!("bias.{axis_name}.std"), "ln", "its spread", std);
    }
    north(f, sheet);
    height(f, sheet);
}

fn north(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    let mut v = [f64::NAN; 5];
    if let Some(f) = f {
        let mut fit = Ridge::new(&[0.5, 0.2], 0.05);
        let mut own = Ridge::new(&[0.5, 0.2], 0.05);
        for k in f.clear_points() {
            let x = [1.0, f.line.t_s[k] / 60.0 - 0.75];
            fit.row(&x, f.line.north_rad[k]);
            own.row(&x, f.states[k].north_rad);
        }
        let (pilot, own) = (fit.solve(), own.solve());
        let m = moments(f.clear_points().map(|k| f.line.north_rad[k]));
        v = [pilot[0], pilot[1], log(m.std), own[0], own[1]];
    }
    let at = (Block::Estimator, Channel::North);
    sheet.put(at, "north.pilot", "rad", "north of the board, by the pilot", v[0]);
    sheet.put(at, "north.pilot_time", "rad per min", "its ramp", v[1]);
    sheet.put(at, "north.pilot_std", "ln", "its spread", v[2]);
    let at = (Block::InnerLoop, Channel::North);
    sheet.put(at, "north.own", "rad", "north of the board, by kinematics", v[3]);
    sheet.put(at, "north.own_time", "rad per min", "its ramp", v[4]);
}

fn height(f: Option<&Flight<'_>>, sheet: &mut Sheet) {
    let mut b = vec![f64::NAN; 3];
    if let Some(f) = f.filter(|f| f.trace.baros.len() > 100) {
        let mut fit = Ridge::new(&[2.0, 1.0, 0.5], 0.3);
        let ground = moments(
            f.trace.baros.iter().filter(|s| s.valid_at < f.line.start).map(|s| s.pressure_pa),
        );
        let mut low = 0;
        for s in &f.trace.baros {
            let Some((k, _)) = f.line.place(s.valid_at).filter(|(k, _)| f.clear[*k]) else {
                continue;
            };
            let base = if ground.mean.is_finite() { ground.mean } else { s.pressure_pa };
            let by_air_m = (base - s.pressure_pa) / PA_PER_M;
            low += usize::from(f.height_m[k] < 0.4);
            let near = (1.0 - f.height_m[k] / 0.5).clamp(0.0, 1.0);
            fit.row(&[1.0, f.height_m[k] - 1.0, near], f.height_m[k] - by_air_m);
        }
        b = fit.solve();
        if low < 20 {
            b[2] = f64::NAN;
        }
    }
    let at = (Block::Uwb, Channel::Height);
    sheet.put(at, "height.const", "m", "height by UWB minus that by air pressure", b[0]);
    sheet.put(at, "height.scale", "1", "its growth with height", b[1]);
    sheet.put(at, "height.low", "m", "further difference near the floor", b[2]);
}
