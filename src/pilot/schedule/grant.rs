//! Wishes of the flight are granted.

use haltere_core::time::HostTime;

use super::act::Act;
use crate::view::view;
use crate::wish::Wish;

impl Act<'_> {
    /// Grants in order what was wished for in the call that has just returned.
    pub(super) fn grant(&mut self, at: HostTime) {
        let mut wishes = std::mem::take(self.wishes);
        for wish in wishes.drain(..) {
            match wish {
                Wish::Disarm { force, later: false } => {
                    self.board.link.command_arm(false, force, at);
                }
                Wish::Disarm { force, later: true } => {
                    self.board.link.command_arm_later(false, force, at);
                }
                Wish::Airborne(airborne) => self.navigation.estimator.set_airborne(airborne),
                Wish::FeelAnew { from, to } => {
                    self.navigation.touch = self.navigation.touch.in_mode(from, to, at);
                }
                Wish::ForgetFall => self.navigation.touch.forget_fall(),
                Wish::DownLate { lag_s } => self.navigation.touch.lag_s = lag_s,
                Wish::HoldThrustNearFloor => {
                    self.navigation.hold_thrust_near_floor(&view!(self, at));
                }
                Wish::StayDownNearFloor => {
                    self.navigation.stay_down_near_floor(&view!(self, at));
                }
            }
        }
        *self.wishes = wishes;
    }
}
