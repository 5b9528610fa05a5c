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

use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::Pilot;
use crate::out::voice::Severity;
use haltere_core::estimate::Health;
use haltere_core::frames::G_MPS2;
use haltere_core::time::HostTime;

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
pub(super) const SLIP_MPS: f64 = 0.6;
/// Force beyond the thrust that was sent, m/s².
const OFF_MPS2: f64 = 1.0;
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
    fn is_wrong(&self) -> bool {
        let first = (FIRST_S[0]..FIRST_S[1]).contains(&self.flown_s);
        self.seen_s > if first { LASTS_FIRST_S } else { LASTS_S }
    }
}

impl Pilot {
    /// Follows height and vertical velocity while both are measured.
    pub(crate) fn watch_slip(&mut self, at: HostTime, dt_s: f64) {
        let usable = matches!(self.estimate.health, Health::Good | Health::Degraded);
        let measured = self.navigation.last_fused.is_some_and(|t| at.seconds_since(t) < UWB_AGE_S);
        if !self.flight.mode.is_flying() {
            self.flight.supervisor.slip = Slip::default();
        } else if usable && measured && self.imu_age_s(at) < IMU_AGE_S {
            let vel_down_mps = self.estimate.vel_E_mps().z();
            let hover_frac =
                (self.hover_thrust_frac() * self.flight.control.ground_factor).max(0.05);
            // Low-passed as the force is.
            let sent_mps2 = G_MPS2 * self.navigation.touch.thrust_frac / hover_frac;
            let off_mps2 = self.navigation.touch.acc_z_mps2 + sent_mps2;
            self.flight.supervisor.slip.step(
                self.estimate.pos_E_m.z(),
                vel_down_mps,
                off_mps2,
                dt_s,
            );
        } else {
            self.flight.supervisor.slip.last_down_m = None;
        }
    }
}

/// The velocity is not that of the height.
pub(super) const SLIP: Condition = Condition {
    name: "climb_differs",
    seen_by: "The estimated height changes by more than 0.6 m/s faster or slower, averaged over 1.5 s, than \
              the estimated vertical velocity says: UWB and barometer pull the height one way and the \
              accelerometer the other; and the specific force, averaged as long, is by more than 1 m/s² \
              not that of the thrust, in the direction that explains it, for 0.8 s. Gusts do the first without the second. Until 1.5 s after the take-off \
              began both are averaged over the time since, and 0.1 s is enough.",
    numbers: &[
        Number {
            key: "",
            value: |_| SLIP_MPS,
            unit: "m/s",
            origin: "nearly three times the largest in 160 flights over the shapes of the source (0.22 m/s)",
        },
        Number {
            key: "",
            value: |_| OFF_MPS2,
            unit: "m/s²",
            origin: "half of what a drift of 0.3 m/s² per second reaches before it is found; gusts stay below it, or for a moment only",
        },
    ],
    latched: true,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: vertical velocity is not that of the height",
    over: "",
    health: haltere_dialect::mav::haltere::MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_ACCEL,
    severity: Severity::Emergency,
    is_seen: |pilot, _| pilot.flight.supervisor.slip.is_wrong(),
    words: |pilot, _| {
        let slip_mps = -pilot.flight.supervisor.slip.mps;
        format!("height climbs {slip_mps:+.1} m/s faster than the vertical velocity says")
    },
    ..ROW
};

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
