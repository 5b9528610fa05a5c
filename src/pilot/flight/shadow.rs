//! Shadow: estimate and controller beside a vehicle that somebody else flies, and nothing sent that arms or moves.
//!
//! The mode stays `disarmed`, for nothing here flies; stations are shown the board's own arming. The estimator is
//! told that the vehicle flies from when the board is armed and the IMU has not rested for
//! [`BEATING_S`], or the board tells a thrust; until the board is disarmed.
//!
//! What the controller is asked for: to hold a place on a leash. The place stays where it is while the vehicle is
//! within [`LEASH_M`] of it, and is dragged along behind it with its velocity when it is farther. So in hover the
//! record shows what we would have done about each disturbance, and on the way from place to place the lean and
//! thrust that the same speed would have cost us. Integrators stand still at nothing: our commands move nothing
//! that they could learn from; trims of the other pilot are a constant difference.

use haltere_core::control::Command;
use haltere_core::estimate::Health;
use haltere_core::frames::{E, Vec3};
use haltere_core::time::HostTime;
use haltere_core::topics::{ShadowRecord, Topic};

use super::Flight;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::view::Around;
use crate::wish::Wish;

/// The IMU must not have rested for so long, s: wings that beat, not a knock against the table.
const BEATING_S: f64 = 0.3;
/// It rests again after so long without motion, s.
const RESTS_S: f64 = 0.2;
/// A thrust that the board tells is one, as a share.
const THRUST_FRAC: f64 = 0.2;
/// How far the vehicle may go before the place is dragged along, m: twice what hovers wander.
const LEASH_M: f64 = 0.5;

/// What a shadow remembers.
#[derive(Debug, Default)]
pub(crate) struct Shadow {
    /// The board was armed when we last looked.
    armed: bool,
    /// Since when the IMU has not rested.
    beats_since: Option<HostTime>,
    pub airborne: bool,
    /// The place on the leash.
    place_E_m: Option<Vec3<E>>,
}

impl Shadow {
    /// Whether somebody else has the vehicle in the air.
    pub fn is_airborne(&self) -> bool {
        self.airborne
    }

    /// Drags the place along; what is held, and how fast it moves.
    fn hold(&mut self, pos_E_m: Vec3<E>, vel_E_mps: Vec3<E>) -> (Vec3<E>, Vec3<E>) {
        let place = *self.place_E_m.get_or_insert(pos_E_m);
        let ahead = pos_E_m - place;
        let away_m = ahead.norm();
        if !away_m.is_finite() || away_m <= LEASH_M {
            return (place, Vec3::zero());
        }
        let dragged = place + ahead * ((away_m - LEASH_M) / away_m);
        self.place_E_m = Some(dragged);
        (dragged, vel_E_mps)
    }
}

impl Flight {
    /// A control step of a shadow: records what would have been sent.
    pub(crate) fn shadow_step(&mut self, around: &Around<'_>, dt_s: f64, out: &mut Out) {
        let usable = matches!(around.estimate.health, Health::Good | Health::Degraded);
        if !(self.shadow.airborne && usable) {
            self.shadow.place_E_m = None;
            self.controller.reset(None);
            return;
        }
        let estimate = around.estimate;
        let (place_E_m, vel_E_mps) = self.shadow.hold(estimate.pos_E_m, estimate.vel_E_mps());
        let mut command = Command::hold(place_E_m, estimate.R_EB.yaw_rad());
        command.vel_ff_E_mps = vel_E_mps;
        let output = self.run_controller(around, &command, dt_s, true, None);
        let for_board = around.navigation.north.setpoint_for_board(output.R_EB);
        let theirs = around.board.link.target_in_force(around.at);
        out.record(|| {
            Topic::Shadow(ShadowRecord {
                at: around.at,
                place_E_m,
                attitude: for_board,
                thrust_frac: output.thrust_frac,
                theirs,
            })
        });
    }

    /// Whether the vehicle flies, by board and IMU.
    pub(crate) fn follow_flyer(
        &mut self,
        around: &Around<'_>,
        out: &mut Out,
        wishes: &mut Vec<Wish>,
    ) {
        let at = around.at;
        let armed = around.board.link.is_armed();
        if armed != std::mem::replace(&mut self.shadow.armed, armed) {
            let text = if armed { "shadow: armed by somebody else" } else { "shadow: disarmed" };
            out.say(at, Severity::Info, text.to_owned());
            self.record_mode(around, text, out);
        }
        if !armed {
            if self.shadow.airborne {
                wishes.push(Wish::Airborne(false));
            }
            self.shadow = Shadow::default();
            return;
        }
        if around.navigation.estimator.rested_s() > RESTS_S {
            self.shadow.beats_since = None;
        } else {
            self.shadow.beats_since.get_or_insert(at);
        }
        let beats = self.shadow.beats_since.is_some_and(|t| at.seconds_since(t) > BEATING_S);
        let told = around
            .board
            .link
            .target_in_force(around.at)
            .is_some_and(|(_, frac)| frac > THRUST_FRAC);
        if !self.shadow.airborne && (beats || told) {
            self.shadow.airborne = true;
            wishes.push(Wish::Airborne(true));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_the_place_stays_until_the_leash_is_tight_and_then_follows() {
        let mut shadow = Shadow::default();
        let v = Vec3::new(1.0, 0.0, 0.0);
        let at = |x: f64| Vec3::<E>::new(x, 0.0, -1.0);
        assert_eq!(shadow.hold(at(0.0), v), (at(0.0), Vec3::zero()));
        assert_eq!(shadow.hold(at(0.4), v), (at(0.0), Vec3::zero()));
        let (place, speed) = shadow.hold(at(0.8), v);
        assert!((place.x() - 0.3).abs() < 1e-12 && speed == v);
        // On the way back it waits again.
        assert_eq!(shadow.hold(at(0.1), v).1, Vec3::zero());
    }
}
