//! What a vehicle carries beside body, wings and battery: inner loops of its board, IMU, radio, links. Part of the
//! vehicle file, since no flight of a vehicle is simulated rightly with another's.
//!
//! Defaults are those of the effects that act by them (docs/EFFECTS.md), of usual parts.

use serde::{Deserialize, Serialize};

use haltere_core::checks::Problems;

/// Attitude loops of the board: `model::board::loops`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct InnerLoop {
    /// Natural frequency of roll, pitch and yaw, rad/s.
    pub frequency_radps: [f64; 3],
    /// Damping ratio of the same.
    pub damping: [f64; 3],
    /// Gain that the error of roll and pitch gains at low frequency: a leaky integrator. A steady moment leans the
    /// vehicle by 1 / (1 + boost) of what it would without.
    pub boost: f64,
    /// The same of yaw.
    pub boost_yaw: f64,
    /// Time constant of the boosts, s.
    pub boost_s: f64,
    /// Setpoints wait for this long in the board, ms.
    pub delay_ms: f64,
}

/// Inertial sensor and barometer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Imu {
    /// What the wing beat adds to the accelerometer in hover along x, y, z, standard deviation, g.
    pub vibration_g: [f64; 3],
    /// The same on each axis of the gyroscope, rad/s.
    pub vibration_radps: f64,
    /// White noise of a sample of the accelerometer, m/s².
    pub std_acc_mps2: f64,
    /// The same of the gyroscope, rad/s.
    pub std_gyro_radps: f64,
    /// The same of the barometer, Pa.
    pub std_pressure_pa: f64,
    /// Wandering lean of the attitude that the board believes in, deg.
    pub std_lean_deg: f64,
}

/// UWB radio in its room.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Uwb {
    /// White noise of a reception as a path, m; a TDOA has √3 of it.
    pub std_m: f64,
    /// Bias of a path that changes with the place, m; a pair has √2 of it.
    pub path_bias_m: f64,
    /// Share of receptions that are lost.
    pub loss: f64,
}

/// Lines between tag, board and companion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Link {
    /// Least delay of a delivery, ms.
    pub delay_ms: f64,
    /// Width of its jitter, ms.
    pub jitter_ms: f64,
}

impl Default for InnerLoop {
    fn default() -> Self {
        Self {
            frequency_radps: [9.0, 9.0, 5.0],
            damping: [0.9, 0.9, 1.2],
            boost: 4.0,
            boost_yaw: 0.0,
            boost_s: 1.0,
            delay_ms: 0.0,
        }
    }
}

impl Default for Imu {
    fn default() -> Self {
        Self {
            vibration_g: [0.56, 1.76, 0.79],
            vibration_radps: 0.15,
            std_acc_mps2: 0.05,
            std_gyro_radps: 0.004,
            std_pressure_pa: 2.5,
            std_lean_deg: 0.4,
        }
    }
}

impl Default for Uwb {
    fn default() -> Self {
        Self { std_m: 0.035, path_bias_m: 0.035, loss: 0.01 }
    }
}

impl Default for Link {
    fn default() -> Self {
        Self { delay_ms: 0.5, jitter_ms: 1.0 }
    }
}

/// Largest boost: what a steady moment leaves then, nobody sees.
const MOST_BOOST: f64 = 200.0;

impl InnerLoop {
    /// A board of which a steady moment leaves this share of the error that it leaves now, 0 to 1: what it does in a second
    /// stays nearly the same, and only its integrator leaks less.
    pub(crate) fn keeping(&self, share: f64) -> Self {
        if share >= 1.0 {
            return self.clone();
        }
        let stiffer = 1.0 / share.max(1.0 / MOST_BOOST);
        let boost = |now: f64| ((1.0 + now) * stiffer - 1.0).min(MOST_BOOST);
        Self {
            boost: boost(self.boost),
            boost_yaw: boost(self.boost_yaw),
            boost_s: self.boost_s * stiffer,
            ..self.clone()
        }
    }

    pub(crate) fn check(&self, key: &str, problems: &mut Problems) {
        let mut range = |name: &str, value: f64, low: f64, high: f64, unit: &str| {
            problems.range(format_args!("{key}.{name}"), value, low..=high, unit);
        };
        for (axis, i) in ["x", "y", "z"].into_iter().zip(0..3) {
            let (w, z) = (self.frequency_radps[i], self.damping[i]);
            range(&format!("frequency_radps.{axis}"), w, 0.5, 40.0, "rad/s");
            range(&format!("damping.{axis}"), z, 0.2, 3.0, "");
        }
        range("boost", self.boost, 0.0, 20.0, "");
        range("boost_yaw", self.boost_yaw, 0.0, 20.0, "");
        range("boost_s", self.boost_s, 0.05, 10.0, "s");
        range("delay_ms", self.delay_ms, 0.0, 300.0, "ms");
    }
}

impl Imu {
    pub(crate) fn check(&self, key: &str, problems: &mut Problems) {
        let mut range = |name: &str, value: f64, high: f64, unit: &str| {
            problems.range(format_args!("{key}.{name}"), value, 0.0..=high, unit);
        };
        for (axis, vibration_g) in ["x", "y", "z"].into_iter().zip(self.vibration_g) {
            range(&format!("vibration_g.{axis}"), vibration_g, 7.0, "g");
        }
        range("vibration_radps", self.vibration_radps, 3.0, "rad/s");
        range("std_acc_mps2", self.std_acc_mps2, 1.0, "m/s²");
        range("std_gyro_radps", self.std_gyro_radps, 0.1, "rad/s");
        range("std_pressure_pa", self.std_pressure_pa, 50.0, "Pa");
        range("std_lean_deg", self.std_lean_deg, 8.0, "deg");
    }
}

impl Uwb {
    pub(crate) fn check(&self, key: &str, problems: &mut Problems) {
        let mut range = |name: &str, value: f64, high: f64, unit: &str| {
            problems.range(format_args!("{key}.{name}"), value, 0.0..=high, unit);
        };
        range("std_m", self.std_m, 0.5, "m");
        range("path_bias_m", self.path_bias_m, 1.0, "m");
        range("loss", self.loss, 0.5, "");
    }
}

impl Link {
    pub(crate) fn check(&self, key: &str, problems: &mut Problems) {
        problems.range(format_args!("{key}.delay_ms"), self.delay_ms, 0.0..=25.0, "ms");
        problems.range(format_args!("{key}.jitter_ms"), self.jitter_ms, 0.0..=30.0, "ms");
    }
}
