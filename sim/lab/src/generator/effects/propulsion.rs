//! Motors, wings, battery: P1 to P6.
//!
//! Forms: lost lift with a part of the drag of the beat (P1); half of the resistance ohmic, half behind
//! the polarisation (P2); capacity with Peukert's exponent (P3); a second lag in series, of the inflow
//! (P4); a soft speed limit of the motor (P5); unequal gears instead of unequal lift (P6).

use super::aero::spec;
use super::{Deviations, Draw, Spec};
use crate::generator::craft::Craft;

/// Current that the capacity is stated for, A, and Peukert's exponent less one of a worn pack.
const RATED_A: f64 = 3.0;
const PEUKERT: f64 = 0.08;
/// Sharpness of the soft limit.
const SHARP: f64 = 10.0;
/// Supply that the limit is stated for, V.
const LIMIT_V: f64 = 7.4;

/// What deviates.
#[derive(Debug, Clone)]
pub struct Propulsion {
    loss: f64,
    /// Further ohmic resistance, Ω.
    pub ohmic: f64,
    /// Further polarisation resistance, Ω.
    pub slow_ohm: f64,
    capacity_loss: f64,
    /// Lag of thrust behind flapping, s.
    pub lag_s: f64,
    limit: f64,
    gear: [f64; 2],
}

impl Default for Propulsion {
    fn default() -> Self {
        Self {
            loss: 0.0,
            ohmic: 0.0,
            slow_ohm: 0.0,
            capacity_loss: 0.0,
            lag_s: 0.0,
            limit: 0.0,
            gear: [1.0; 2],
        }
    }
}

impl Propulsion {
    /// Factor on the thrust of a wing.
    pub fn lift(&self, _wing: usize) -> f64 {
        1.0 - self.loss
    }
    /// Ratio of the gears of a wing.
    pub fn gear(&self, wing: usize) -> f64 {
        self.gear[wing]
    }
    /// Capacity, A·s.
    pub fn capacity(&self, healthy_as: f64) -> f64 {
        healthy_as * (1.0 - self.capacity_loss)
    }
    /// Charge per second that a current costs, A.
    pub fn drain(&self, current_a: f64) -> f64 {
        if self.capacity_loss > 0.0 {
            current_a * (current_a.max(0.1) / RATED_A).powf(PEUKERT)
        } else {
            current_a
        }
    }
    /// What the motor can be driven with, Hz without friction.
    pub fn drive(&self, wanted: f64, supply_v: f64, craft: &Craft) -> f64 {
        if self.limit <= 0.0 || wanted <= 0.0 {
            return wanted;
        }
        // The limit is a flap rate; the drive that holds it includes the friction there.
        let most = self.limit * craft.hover_hz * supply_v / LIMIT_V;
        let most = most * (1.0 + craft.gear_drag * most / craft.hover_hz);
        wanted / (1.0 + (wanted / most).powf(SHARP)).powf(1.0 / SHARP)
    }
}

fn loss(d: &mut Deviations, w: &mut Draw<'_>) {
    d.propulsion.loss = w.size;
    w.set.note("loss", w.size);
}

fn resistance(d: &mut Deviations, w: &mut Draw<'_>) {
    let slow = w.rng.between(0.3, 0.5);
    d.propulsion.ohmic = w.size * (1.0 - slow);
    d.propulsion.slow_ohm = w.size * slow;
    w.set.note("extra", w.size);
}

fn capacity(d: &mut Deviations, w: &mut Draw<'_>) {
    d.propulsion.capacity_loss = w.size;
    w.set.note("loss", w.size);
}

fn lag(d: &mut Deviations, w: &mut Draw<'_>) {
    d.propulsion.lag_s = w.size;
    w.set.note("extra", w.size);
}

fn limit(d: &mut Deviations, w: &mut Draw<'_>) {
    d.propulsion.limit = 1.0 + w.size;
    w.set.note("ratio", 1.0 + w.size);
}

fn asymmetry(d: &mut Deviations, w: &mut Draw<'_>) {
    let epsilon = w.size * w.rng.sign();
    d.propulsion.gear = [1.0 + epsilon, 1.0 - epsilon];
    w.set.note("epsilon", epsilon);
}

/// Entries.
pub static SPECS: &[Spec] = &[
    spec!("P1", "thrust gain loss", "thrust", "", [0.03, 0.2], true, loss),
    spec!("P2", "battery resistance", "battery", "Ω", [0.05, 0.22], false, resistance),
    spec!("P3", "battery capacity", "battery", "", [0.1, 0.5], false, capacity),
    spec!("P4", "thrust lag", "thrust", "s", [0.03, 0.065], false, lag),
    spec!("P5", "motor saturation", "thrust", "", [0.35, 0.2], false, limit, Inverse),
    spec!("P6", "wing asymmetry", "thrust", "", [0.01, 0.06], true, asymmetry),
];
