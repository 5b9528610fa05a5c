//! Vertical velocity of the estimate against its own height.
//!
//! In flight the filter takes its vertical velocity from the accelerometer and its height from UWB and
//! barometer. Where both are right, one is the rate of the other. An accelerometer that errs along body z
//! leaves a velocity that UWB has to take back from the height, sample by sample:
//!
//! ```text
//! s = low-pass(dz/dt − v_z)        z, v_z of the estimate, downwards
//! ```
//!
//! Gusts part the two as well, for a moment: UWB follows the height later than the accelerometer the velocity.
//! Then the specific force is that of the thrust. So it counts only where the accelerometer also says another
//! force than was sent, in the direction that explains s:
//!
//! ```text
//! o = low-pass(f_z + g T / T_hover)        > 0 where s < 0
//! ```
//!
//! In a landing, which flies by velocity, s is what it climbs by instead of sinking. Horizontally there is
//! nothing of the kind: there the filter takes the force from drag, not from the accelerometer.

use haltere_core::frames::G_MPS2;

use super::Navigation;
use crate::view::View;

/// Time constant of the low-pass, s: multipath near the floor moves the height by half a metre within it.
const FILTER_S: f64 = 1.5;
/// It must last so long, s …
const LASTS_S: f64 = 0.8;
/// … or so long within the first seconds of a take-off, of which the mean is over as long as they have lasted: one that
/// climbs by a wrong velocity is at the ceiling after two.
const LASTS_FIRST_S: f64 = 0.1;
const FIRST_S: [f64; 2] = [0.25, 1.5];
/// A step of the height counts as no faster than this, m/s: the filter may seek its position anew.
const MOST_MPS: f64 = 2.0;
/// Difference that no flight has, m/s.
pub(crate) const SLIP_MPS: f64 = 0.6;
/// Force beyond the thrust that was sent, m/s².
pub(crate) const OFF_MPS2: f64 = 1.0;
/// UWB must be as new as this, s: without it the height is the integral of the velocity.
const UWB_AGE_S: f64 = 0.3;
/// And the accelerometer as this, s: what is missing is another condition.
const IMU_AGE_S: f64 = 0.05;

/// What the height does beyond its velocity.
#[derive(Debug, Default)]
pub(crate) struct Slip {
    last_down_m: Option<f64>,
    /// Low-passed, downwards, m/s.
    pub mps: f64,
    /// Specific force beyond the thrust that was sent, low-passed, body z, m/s².
    off_mps2: f64,
    /// Since the take-off began, s, and how long it has been of the accelerometer.
    flown_s: f64,
    seen_s: f64,
}

impl Slip {
    /// A control step of flight; `off_mps2`: specific force minus that of the thrust.
    pub fn step(&mut self, down_m: f64, vel_down_mps: f64, off_mps2: f64, dt_s: f64) {
        let weight = dt_s / (self.flown_s.min(FILTER_S) + dt_s);
        self.flown_s += dt_s;
        self.seen_s = if self.is_of_the_accelerometer() { self.seen_s + dt_s } else { 0.0 };
        if off_mps2.is_finite() {
            self.off_mps2 += (off_mps2 - self.off_mps2) * weight;
        }
        let Some(was_m) = self.last_down_m.replace(down_m) else { return };
        let slip_mps = (down_m - was_m) / dt_s - vel_down_mps;
        if slip_mps.is_finite() {
            self.mps += (slip_mps.clamp(-MOST_MPS, MOST_MPS) - self.mps) * weight;
        }
    }

    /// Whether the accelerometer is what parts height and velocity.
    fn is_of_the_accelerometer(&self) -> bool {
        self.mps.abs() > SLIP_MPS && -self.off_mps2 * self.mps.signum() > OFF_MPS2
    }

    /// Whether that is so for long enough.
    pub fn is_wrong(&self) -> bool {
        let first = (FIRST_S[0]..FIRST_S[1]).contains(&self.flown_s);
        self.seen_s > if first { LASTS_FIRST_S } else { LASTS_S }
    }
}

impl Navigation {
    /// Follows height and vertical velocity while both are measured.
    pub(crate) fn watch_slip(&mut self, view: &View<'_>, dt_s: f64) {
        let at = view.at;
        let measured = self.last_fused.is_some_and(|t| at.seconds_since(t) < UWB_AGE_S);
        if !view.mode.is_flying() {
            self.slip = Slip::default();
        } else if view.is_usable() && measured && self.imu_age_s(at) < IMU_AGE_S {
            let vel_down_mps = view.estimate.vel_E_mps().z();
            let hover_frac = (view.thrust.hover_frac * view.thrust.ground_factor).max(0.05);
            // Low-passed as the force is.
            let sent_mps2 = G_MPS2 * self.touch.thrust_frac / hover_frac;
            let off_mps2 = self.touch.acc_z_mps2 + sent_mps2;
            self.slip.step(view.estimate.pos_E_m.z(), vel_down_mps, off_mps2, dt_s);
        } else {
            self.slip.last_down_m = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Slip after so many seconds of steps of 10 ms, of height and velocity over time.
    fn after(seconds: f64, down_m: impl Fn(f64) -> f64, vel_mps: impl Fn(f64) -> f64) -> f64 {
        let mut slip = Slip::default();
        for n in 0..(seconds * 100.0) as u32 {
            let t = f64::from(n) * 0.01;
            slip.step(down_m(t), vel_mps(t), 0.0, 0.01);
        }
        slip.mps
    }

    #[test]
    fn prop_what_moves_as_it_says_does_not_slip() {
        assert!(after(10.0, |t| -1.2 + 0.4 * t, |_| 0.4).abs() < 1e-9);
        let swing = after(20.0, |t| (2.0 * t).sin(), |t| 2.0 * (2.0 * t).cos());
        assert!(swing.abs() < 0.02, "{swing}");
    }

    #[test]
    fn prop_a_velocity_that_errs_is_found_with_its_sign() {
        // It says that it sinks, and it stands.
        let slip = after(6.0, |_| -1.2, |_| 0.5);
        assert!((slip + 0.5).abs() < 0.02, "{slip}");
    }

    #[test]
    fn prop_a_jump_of_the_height_is_no_slip() {
        let slip = after(5.0, |t| if t < 4.9 { -1.2 } else { 3.0 }, |_| 0.0);
        assert!(slip.abs() < 0.05, "{slip}");
    }

    #[test]
    fn prop_only_a_force_that_was_not_sent_makes_it_the_accelerometer_s() {
        let seen = |off_mps2: f64| {
            let mut slip = Slip::default();
            for _ in 0..600 {
                slip.step(-1.2, 0.8, off_mps2, 0.01);
            }
            slip.is_of_the_accelerometer()
        };
        assert!(seen(2.0), "it says that it sinks, by a force that nothing sent");
        assert!(!seen(0.5) && !seen(-2.0), "a gust, or a force the other way");
    }
}
