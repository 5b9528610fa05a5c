//! Whether the floor carries a vehicle that is meant to fly, by its thrust and what it feels.
//!
//! Near the floor the estimate's height is up to half a metre too high (multipath). Asked for a low height, the loops
//! then press the vehicle onto the floor, where the estimate goes on to say that it flies.
//!
//! **Law.** In the air the specific force is the thrust over the mass, with what the ground effect adds. Who feels gravity
//! with less thrust than lifts off stands on something.
//!
//! **Source.** Both bounds are those by which a landing finds the floor. The mean is over as long as the land detector of
//! ArduPilot looks (`LAND_DETECTOR_TRIGGER_SEC`, 1 s): in lockstep a vehicle that sinks from 1.5 to 0.3 m as fast as it can
//! has so little thrust for 0.34 s. **Validity.** The base thrust is right to a tenth, or the hover thrust was learned.

use haltere_core::frames::G_MPS2;
use haltere_core::time::HostTime;

use super::Pilot;
use super::modes::{Event, transition};
use super::supervise::{CARRIED_MPS2, DOWN_SHARE};

/// Time constant of the means, s.
const MEAN_S: f64 = 1.0;

/// Means of thrust and specific force.
#[derive(Debug, Clone, Copy)]
pub(super) struct Carried {
    /// Thrust over what hovers.
    share: f64,
    /// Specific force along body z, m/s².
    acc_z_mps2: f64,
}

impl Default for Carried {
    /// As in hover.
    fn default() -> Self {
        Self { share: 1.0, acc_z_mps2: -G_MPS2 }
    }
}

impl Carried {
    /// Takes a control step in. Whether the floor carries.
    fn step(&mut self, share: f64, acc_z_mps2: f64, dt_s: f64) -> bool {
        let weight = dt_s / (MEAN_S + dt_s);
        self.share += (share - self.share) * weight;
        self.acc_z_mps2 += (acc_z_mps2 - self.acc_z_mps2) * weight;
        self.share < DOWN_SHARE && (self.acc_z_mps2 + G_MPS2).abs() < CARRIED_MPS2
    }
}

impl Pilot {
    /// A vehicle that came to stand without being asked to lands, where it is felt for the floor, and disarms.
    pub(super) fn watch_floor(&mut self, at: HostTime, dt_s: f64) {
        if transition(self.mode, Event::FloorCarries).is_none() {
            self.carried = Carried::default();
            return;
        }
        // What was learned with a load that was set down is too much, and what is configured may be.
        let hover_frac = self.control.thrust_base_frac.min(self.hover_thrust_frac()).max(0.05);
        let share = self.control.thrust_frac / hover_frac;
        let carried = self.carried.step(share, self.touch.acc_z_mps2, dt_s);
        let heard = self.imu_is_alive(at) && !self.is_numb();
        if carried && heard && self.is_near_floor(at) {
            self.fire(at, Event::FloorCarries);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds until the floor is found, of at most 10, for vehicles that feel this much of gravity.
    fn found_after_s(share: f64, felt_g: f64) -> Option<f64> {
        let mut carried = Carried::default();
        (1..=1000)
            .find(|_| carried.step(share, -felt_g * G_MPS2, 0.01))
            .map(|step| 0.01 * f64::from(step))
    }

    #[test]
    fn prop_who_feels_gravity_with_less_thrust_than_lifts_off_stands() {
        let after_s = found_after_s(0.52, 1.0).unwrap();
        assert!((0.5..1.5).contains(&after_s), "{after_s} s");
        // In the air that thrust is felt, however hard the floor's cushion carries.
        assert_eq!(found_after_s(0.52, 0.52 / 0.8), None);
        // Hover, and hover at the floor's cushion.
        assert_eq!(found_after_s(1.0, 1.0), None);
        assert_eq!(found_after_s(0.8, 1.0), None);
    }

    #[test]
    fn prop_the_start_of_a_descent_is_no_floor() {
        let mut carried = Carried::default();
        // Nearly no thrust for as long as 0.34 s, whatever is felt.
        assert!((0..34).all(|_| !carried.step(0.3, -G_MPS2, 0.01)));
    }
}
