//! Mass and its place: I1, I2.
//!
//! Forms: a payload under the body, which adds to the moments of inertia and lowers the centre of mass
//! (I1); a shifted centre of mass about which every air force acts (I2).

use nalgebra::Vector3;

use super::aero::spec;
use super::{Deviations, Draw, Spec};

/// Place of a payload below the centre of mass, m.
const BELOW_M: f64 = 0.025;

/// What deviates.
#[derive(Debug, Clone, Default)]
pub struct Inertia {
    payload_kg: f64,
    offset_B_m: Vector3<f64>,
}

impl Inertia {
    /// Further mass, kg.
    pub fn extra_kg(&self, _t_s: f64) -> f64 {
        self.payload_kg
    }
    /// Centre of mass from its drawn place, body, m.
    pub fn offset_B_m(&self, healthy_kg: f64) -> Vector3<f64> {
        let sink_m = BELOW_M * self.payload_kg / (healthy_kg + self.payload_kg);
        self.offset_B_m + Vector3::new(0.0, 0.0, sink_m)
    }
    /// Moments of inertia, kg·m².
    pub fn of(&self, healthy: [f64; 3]) -> Vector3<f64> {
        let around = self.payload_kg * BELOW_M * BELOW_M;
        Vector3::from(healthy) + Vector3::new(around, around, 0.1 * around)
    }
}

fn mass(d: &mut Deviations, w: &mut Draw<'_>) {
    d.inertia.payload_kg = w.size * 1e-3;
    w.set.note("extra", w.size);
}

fn offset(d: &mut Deviations, w: &mut Draw<'_>) {
    let to = w.rng.between(0.0, std::f64::consts::TAU);
    d.inertia.offset_B_m = Vector3::new(to.cos(), to.sin(), 0.0) * (w.size * 1e-3);
    w.set.note("x", w.size * to.cos());
    w.set.note("y", w.size * to.sin());
}

/// Entries.
pub static SPECS: &[Spec] = &[
    spec!("I1", "mass", "thrust", "g", [2.0, 12.0], false, mass),
    spec!("I2", "centre of mass", "aerodynamics", "mm", [1.0, 5.0], true, offset),
];
