//! Servos and attitude loops: L1, L3 to L6.
//!
//! Forms: soft gains of both cascaded loops (L1); a linkage that is off (L3); a smooth dead band about
//! the middle instead of play (L4); a soft limit of tilt (L5); a yaw moment that grows less than
//! the roll moment (L6).

use nalgebra::{UnitQuaternion, Vector3};

use super::aero::spec;
use super::{Deviations, Draw, Spec};

/// Sharpness of the soft tilt limit.
const SHARP: f64 = 4.0;
/// Roll moment beyond which the yaw moment no longer follows, N·m.
const TWIST_NM: f64 = 0.02;

/// What deviates.
#[derive(Debug, Clone)]
pub struct InnerLoop {
    /// Factor on the bandwidth of the loops.
    pub slow: f64,
    /// Dihedral and wing root off, rad.
    pub trim_rad: [f64; 2],
    band_rad: f64,
    tilt_rad: f64,
    coupling: f64,
}

impl Default for InnerLoop {
    fn default() -> Self {
        Self { slow: 1.0, trim_rad: [0.0; 2], band_rad: 0.0, tilt_rad: 0.0, coupling: 0.0 }
    }
}

impl InnerLoop {
    /// Dihedral of the wings for that of the servo, rad.
    pub fn wing_rad(&self, servo_rad: f64) -> f64 {
        let half = 0.5 * self.band_rad;
        let dead =
            if half > 0.0 { servo_rad - half * (servo_rad / half).tanh() } else { servo_rad };
        dead + self.trim_rad[0]
    }

    /// Yaw moment of a roll moment, N·m.
    pub fn twist_nm(&self, roll_nm: f64) -> f64 {
        self.coupling * TWIST_NM * (roll_nm / TWIST_NM).tanh()
    }

    /// The setpoint that is obeyed.
    pub fn limited(&self, q: UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        if self.tilt_rad <= 0.0 {
            return q;
        }
        let up = q * Vector3::z();
        let tilt = up.z.clamp(-1.0, 1.0).acos();
        if tilt < 1e-6 {
            return q;
        }
        let soft = tilt / (1.0 + (tilt / self.tilt_rad).powf(SHARP)).powf(1.0 / SHARP);
        // Turns the body's z back towards the vertical, heading kept.
        let axis = up.cross(&Vector3::z());
        match nalgebra::Unit::try_new(axis, 1e-9) {
            Some(axis) => UnitQuaternion::from_axis_angle(&axis, tilt - soft) * q,
            None => q,
        }
    }
}

fn lag(d: &mut Deviations, w: &mut Draw<'_>) {
    d.inner_loop.slow = w.size;
    w.set.note("factor", w.size);
}

fn trim(d: &mut Deviations, w: &mut Draw<'_>) {
    let dihedral = w.size * w.rng.sign();
    d.inner_loop.trim_rad = [dihedral.to_radians(), 0.0];
    w.set.note("dihedral", dihedral);
}

fn band(d: &mut Deviations, w: &mut Draw<'_>) {
    d.inner_loop.band_rad = w.size.to_radians();
    w.set.note("play", w.size);
}

fn tilt(d: &mut Deviations, w: &mut Draw<'_>) {
    d.inner_loop.tilt_rad = w.size.to_radians();
    w.set.note("limit", w.size);
}

fn coupling(d: &mut Deviations, w: &mut Draw<'_>) {
    d.inner_loop.coupling = w.size * w.rng.sign();
    w.set.note("coupling", d.inner_loop.coupling);
}

/// Entries. L3 in degrees of the dihedral: about twice the lean that GAP.md counts in.
pub static SPECS: &[Spec] = &[
    spec!("L1", "attitude lag", "inner_loop", "", [0.8, 0.5], false, lag, Below),
    spec!("L3", "servo trim", "inner_loop", "deg", [1.5, 6.0], true, trim),
    spec!("L4", "backlash", "inner_loop", "deg", [0.5, 3.0], false, band),
    spec!("L5", "tilt saturation", "inner_loop", "deg", [15.0, 8.0], false, tilt, Inverse),
    spec!("L6", "roll-yaw coupling", "inner_loop", "", [0.1, 0.6], false, coupling),
];
