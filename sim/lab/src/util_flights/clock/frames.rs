//! Turn and shift between two tracks whose places stand beside one another.

use nalgebra::{Rotation3, Vector3};
use serde::Serialize;

/// Turn and shift that lay truth over estimate best, with what they leave; a hint, never applied.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Frames {
    /// Turn of the truth about the vertical, rad, positive from north to east; nothing where the horizontal path is a point.
    pub yaw_rad: Option<f64>,
    /// Shift behind it, north, east, down, m.
    pub shift_E_m: [f64; 3],
    /// Distance between estimate and truth, rms, m.
    pub rms_m: f64,
    /// The same shifted.
    #[serde(skip)]
    pub shifted_rms_m: f64,
    /// The same turned and shifted.
    pub fitted_rms_m: f64,
    /// How far the truth spreads, rms, m.
    #[serde(skip)]
    pub spread_m: f64,
    /// The same in that of the estimate; about 1 where both are metres.
    pub spread_factor: f64,
}

/// A horizontal path within this shows no turn, m rms.
const LEAST_SPREAD_M: f64 = 0.1;

impl Frames {
    /// Of estimates, each beside its truth, Earth frame, m.
    pub fn between(
        pairs: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)> + Clone,
    ) -> Option<Self> {
        let n = pairs.clone().count() as f64;
        if n < 2.0 {
            return None;
        }
        let (sum_e, sum_t) = pairs
            .clone()
            .fold((Vector3::zeros(), Vector3::zeros()), |(a, b), (e, t)| (a + e, b + t));
        let (mean_e, mean_t) = (sum_e / n, sum_t / n);
        let [mut dot, mut cross, mut ee, mut tt, mut level] = [0.0; 5];
        for (e, t) in pairs.clone() {
            let (e, t) = (e - mean_e, t - mean_t);
            dot += e.x * t.x + e.y * t.y;
            cross += e.y * t.x - e.x * t.y;
            ee += e.norm_squared();
            tt += t.norm_squared();
            level += t.x * t.x + t.y * t.y;
        }
        let yaw_rad = ((level / n).sqrt() > LEAST_SPREAD_M).then(|| cross.atan2(dot));
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad.unwrap_or(0.0));
        let shift = mean_e - turn * mean_t;
        let rms = |of: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| {
            (pairs.clone().map(|(e, t)| (e - of(&t)).norm_squared()).sum::<f64>() / n).sqrt()
        };
        Some(Self {
            yaw_rad,
            shift_E_m: shift.into(),
            rms_m: rms(&|t| *t),
            shifted_rms_m: rms(&|t| t + mean_e - mean_t),
            fitted_rms_m: rms(&|t| turn * t + shift),
            spread_m: (tt / n).sqrt(),
            spread_factor: if ee > 0.0 { (tt / ee).sqrt() } else { 1.0 },
        })
    }
}
