//! Accelerometer and gyroscope: M1 to M6.
//!
//! Forms: a bias that wanders a little (M1); warm-up `ḃ τ (1 - e^(-t/τ))` instead of a ramp (M2); a
//! scale with a share on every axis (M3); a board that sits crooked (M4); a gyroscope bias that also
//! feels acceleration (M5); a squared term of the accelerometer at 2 kHz, so that the mean of the
//! shaking comes out by itself (M6).

use nalgebra::{UnitQuaternion, Vector3};

use super::aero::spec;
use super::{Deviations, Draw, Spec};

/// Warm-up time, s.
const WARM_S: f64 = 150.0;
/// Wander of a bias, share of it, and its period, s.
const WANDER: [f64; 2] = [0.08, 47.0];

/// What deviates.
#[derive(Debug, Clone, Default)]
pub struct Imu {
    bias: Vector3<f64>,
    warm_per_s: Vector3<f64>,
    scale: Vector3<f64>,
    /// Attitude of the board on the airframe.
    pub crooked: UnitQuaternion<f64>,
    gyro: Vector3<f64>,
    /// Offset of z per squared acceleration, 1/(m/s²).
    pub square: f64,
}

impl Imu {
    /// Accelerometer at the board's rate.
    pub fn acc(&self, a: Vector3<f64>, t_s: f64) -> Vector3<f64> {
        let wander = 1.0 + WANDER[0] * (t_s / WANDER[1] * std::f64::consts::TAU).sin();
        let warm = self.warm_per_s * (WARM_S * (1.0 - (-t_s / WARM_S).exp()));
        a + a.component_mul(&self.scale) + self.bias * wander + warm
    }
    /// Gyroscope.
    pub fn rate(&self, w: Vector3<f64>, a: &Vector3<f64>) -> Vector3<f64> {
        w + self.gyro * (1.0 + 0.002 * a.norm())
    }
}

/// A direction with most of its length along one axis.
fn direction(w: &mut Draw<'_>) -> Vector3<f64> {
    let axis = w.rng.below(3);
    let mut v = Vector3::from_fn(|_, _| w.rng.between(-0.4, 0.4));
    v[axis] = w.rng.sign();
    v.normalize() * w.size
}

fn note(w: &mut Draw<'_>, v: &Vector3<f64>) {
    w.set.note("x", v.x);
    w.set.note("y", v.y);
    w.set.note("z", v.z);
}

fn bias(d: &mut Deviations, w: &mut Draw<'_>) {
    d.imu.bias = direction(w);
    let v = d.imu.bias;
    note(w, &v);
}

fn drift(d: &mut Deviations, w: &mut Draw<'_>) {
    let per_min = direction(w);
    // Mean rate over the first 100 s is as stated.
    let early = 100.0 / (WARM_S * (1.0 - (-100.0 / WARM_S).exp()));
    d.imu.warm_per_s = per_min * (early / 60.0);
    note(w, &per_min);
}

fn scale(d: &mut Deviations, w: &mut Draw<'_>) {
    let s = w.size * w.rng.sign();
    d.imu.scale = Vector3::new(0.4 * s, 0.3 * s, s);
    let v = d.imu.scale;
    note(w, &v);
}

fn crooked(d: &mut Deviations, w: &mut Draw<'_>) {
    let to = w.rng.between(0.0, std::f64::consts::TAU);
    let (roll, pitch) = (w.size * to.cos(), w.size * to.sin());
    d.imu.crooked = UnitQuaternion::from_euler_angles(roll.to_radians(), pitch.to_radians(), 0.0);
    w.set.note("roll", roll);
    w.set.note("pitch", pitch);
}

fn gyro(d: &mut Deviations, w: &mut Draw<'_>) {
    d.imu.gyro = direction(w);
    let v = d.imu.gyro;
    note(w, &v);
}

fn square(d: &mut Deviations, w: &mut Draw<'_>) {
    // The shaking along z is some 7 m/s² in hover: 50 m²/s⁴ make the stated offset.
    d.imu.square = w.size * w.rng.sign() / 50.0;
    w.set.note("offset", d.imu.square * 50.0);
}

/// Entries.
pub static SPECS: &[Spec] = &[
    spec!("M1", "accelerometer bias", "imu", "m/s²", [0.1, 0.6], false, bias),
    spec!("M2", "accelerometer bias drift", "imu", "m/s² per min", [0.15, 0.7], false, drift),
    spec!("M3", "accelerometer scale", "imu", "", [0.02, 0.05], false, scale),
    spec!("M4", "IMU misalignment", "imu", "deg", [1.0, 4.0], false, crooked),
    spec!("M5", "gyroscope bias", "imu", "rad/s", [0.01, 0.06], false, gyro),
    spec!("M6", "vibration rectification", "imu", "m/s²", [0.12, 0.4], false, square),
];
