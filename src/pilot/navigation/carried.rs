//! Whether the floor carries a vehicle that is meant to fly, by its thrust and what it feels.
//!
//! Near the floor the estimate's height is up to half a metre too high (multipath). Asked for a low height, the loops
//! then press the vehicle onto the floor, where the estimate goes on to say that it flies.
//!
//! **Law.** In the air the specific force is the thrust over the mass, with what the ground effect adds. Who feels gravity
//! with less thrust than lifts off stands on something:
//!
//! ```text
//! f = k g u                         u thrust over the configured base, f specific force upwards
//! stands:  k₀ u < 0.7, f ≈ g        k₀ least of k in this flight, at least 1
//! ```
//! A floor only adds to f, so the least of k is that of the air: of a vehicle that is lighter than configured more than 1.
//!
//! **Asking.** The thrust of one that stands may be any that does not lift off, and within a hand of the floor its cushion
//! carries with as little. So where less carries than free air needs, the vehicle is asked: its thrust is held below what
//! carries anything, for 0.3 s. In the air it falls, which is felt at once, by a few centimetres, and it is asked half as
//! often from then on. What stands feels nothing.
//!
//! **Source.** Both bounds are those by which a landing finds the floor. The means are over as long as the land detector of
//! ArduPilot looks (`LAND_DETECTOR_TRIGGER_SEC`, 1 s): in lockstep a vehicle that sinks from 1.5 to 0.3 m as fast as it can
//! has so little thrust for 0.34 s. **Validity.** The base thrust is at most a tenth too small. A lighter vehicle, whose least
//! thrust is nearer to what carries it, is found by asking alone.

use haltere_core::frames::G_MPS2;

use super::Navigation;
use super::floor::{CARRIED_MPS2, DOWN_SHARE};
use crate::flight::modes::Mode;
use crate::view::View;

/// Time constant of the means, s.
const MEAN_S: f64 = 1.0;
/// Less thrust than this, as a share of the base, tells nothing of what thrust makes of force: half of the least that is sent.
const LEAST_SHARE: f64 = 0.25;
/// Less thrust than this, as the mean is, does not carry in free air: it stands, or the cushion of the floor carries, which
/// is a fifth at most …
const SEEMS_SHARE: f64 = 0.88;
/// … and after so long it is asked, s, with this share, which carries nothing …
const SEEMS_S: f64 = 1.5;
const ASKED_SHARE: f64 = 0.6;
/// … and has answered after this time, s, if it did not fall by so much, m/s²: as a landing feels for the floor.
const ANSWER_S: f64 = 0.15;
const FALLS_MPS2: f64 = 1.0;

/// What is known of thrust and force in a flight.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Carried {
    /// Means of the thrust over the base, and of the specific force upwards, m/s².
    means: Option<[f64; 2]>,
    /// Least of force over thrust, in units of gravity and of the base.
    least: Option<f64>,
    /// How long it has seemed to stand, s, and so many times longer it must before it is asked.
    seems_s: f64,
    patience: u32,
    /// How long too little thrust has been felt to carry it while it is asked, s.
    asked_s: Option<f64>,
}

impl Carried {
    /// Takes a control step in. Whether the floor carries.
    fn step(&mut self, share: f64, force_mps2: f64, dt_s: f64) -> bool {
        let weight = dt_s / (MEAN_S + dt_s);
        let [mean_share, mean_mps2] = self.means.get_or_insert([share, force_mps2]);
        *mean_share += (share - *mean_share) * weight;
        *mean_mps2 += (force_mps2 - *mean_mps2) * weight;
        let ratio = *mean_mps2 / G_MPS2 / mean_share.max(LEAST_SHARE);
        let least = self.least.get_or_insert(ratio);
        *least = least.min(ratio);
        *mean_share * least.max(1.0) < DOWN_SHARE && (*mean_mps2 - G_MPS2).abs() < CARRIED_MPS2
    }

    /// Least of what thrust makes of force, at least 1.
    fn least(&self) -> f64 {
        self.least.unwrap_or(1.0).max(1.0)
    }

    /// Asks one that seems to stand. Whether it has answered that it does.
    fn ask(&mut self, share: f64, force_mps2: f64, dt_s: f64) -> bool {
        let least = self.least();
        let Some(asked_s) = &mut self.asked_s else {
            let seems = self.means.is_some_and(|[mean_share, mean_mps2]| {
                mean_share * least < SEEMS_SHARE && (mean_mps2 - G_MPS2).abs() < CARRIED_MPS2
            });
            self.seems_s = if seems { self.seems_s + dt_s } else { 0.0 };
            if self.seems_s > SEEMS_S * f64::from(1 << self.patience.min(6)) {
                self.asked_s = Some(0.0);
            }
            return false;
        };
        if share * least < DOWN_SHARE {
            *asked_s += dt_s;
        }
        if force_mps2 < G_MPS2 - FALLS_MPS2 {
            (self.asked_s, self.seems_s, self.patience) = (None, 0.0, self.patience + 1);
            return false;
        }
        *asked_s > ANSWER_S
    }

    /// Most thrust while it is asked, as a share of the base.
    pub(crate) fn most_share(&self) -> Option<f64> {
        self.asked_s.map(|_| ASKED_SHARE / self.least())
    }
}

impl Navigation {
    /// Whether the floor carries a vehicle that was not asked to stand. `watched`: the mode flies where it may be found so;
    /// `heard`: the accelerometer can be asked.
    pub(crate) fn watch_floor(
        &mut self,
        view: &View<'_>,
        [watched, heard]: [bool; 2],
        dt_s: f64,
    ) -> bool {
        if !view.mode.has_thrust() || view.mode == Mode::Spool {
            self.carried = Carried::default();
            return false;
        }
        if !heard || !(watched || view.mode == Mode::Takeoff) {
            self.carried.asked_s = None;
            return false;
        }
        // Low-passed as the force is.
        let share = self.touch.thrust_frac / view.thrust.base_frac.max(0.05);
        let force_mps2 = -self.touch.acc_z_mps2;
        let carried = self.carried.step(share, force_mps2, dt_s);
        if watched && self.is_near_floor(view) {
            return self.carried.ask(share, force_mps2, dt_s) || carried;
        }
        (self.carried.asked_s, self.carried.seems_s) = (None, 0.0);
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Seconds until the floor is found, of at most 10, after a hover with this share of the base, for vehicles that then feel
    /// this much of gravity with another share.
    fn found_after_s(hover: f64, share: f64, felt_g: f64) -> Option<f64> {
        let mut carried = Carried::default();
        assert!((0..500).all(|_| !carried.step(hover, G_MPS2, 0.01)));
        (1..=1000)
            .find(|_| carried.step(share, felt_g * G_MPS2, 0.01))
            .map(|step| 0.01 * f64::from(step))
    }

    #[test]
    fn prop_who_feels_gravity_with_less_thrust_than_lifts_off_stands() {
        let after_s = found_after_s(1.0, 0.52, 1.0).unwrap();
        assert!((0.5..1.5).contains(&after_s), "{after_s} s");
        // In the air that thrust is felt, however hard the floor's cushion carries.
        assert_eq!(found_after_s(1.0, 0.52, 0.52 / 0.8), None);
        // Hover, and hover at the floor's cushion.
        assert_eq!(found_after_s(1.0, 1.0, 1.0), None);
        assert_eq!(found_after_s(1.0, 0.8, 1.0), None);
    }

    /// Found with a vehicle that took off to 0.5 m for the first time, where no hover thrust is learned.
    #[test]
    fn regress_a_vehicle_that_is_lighter_than_configured_flies() {
        for hover in [0.5, 0.65, 0.8] {
            assert_eq!(found_after_s(hover, 0.9 * hover, 1.0), None, "{hover}");
            assert!(found_after_s(hover, 0.6 * hover, 1.0).is_some(), "{hover}");
        }
    }

    #[test]
    fn prop_the_start_of_a_descent_is_no_floor() {
        let mut carried = Carried::default();
        carried.step(1.0, G_MPS2, 0.01);
        // Nearly no thrust for as long as 0.34 s, whatever is felt.
        assert!((0..34).all(|_| !carried.step(0.3, G_MPS2, 0.01)));
    }
}
