//! The way of a flight, one look in each control step: what waits begins, what goes wrong is answered, and the floor is
//! felt for.

use haltere_core::estimate::Health;
use haltere_core::time::HostTime;

use super::act::Act;
use crate::flight::modes::{Event, Mode};
use crate::navigation::floor::{Felt, HELD_UP_FOR_S, NEAR_FLOOR_M, Reason, TOUCH_FOR_S};
use crate::view::{around, view};

/// With less than this share of the hover thrust, and hardly sinking, floor or ground effect carry: 0.9 leave 1 m/s²,
/// which drag alone holds up at 1.2 m/s. Where no accelerometer can show that it was wrong thrust is taken away gently,
/// so less is enough: 0.95 would sink with 0.6 m/s.
const HELD_UP_SHARE: f64 = 0.9;
const BLIND_HELD_UP_SHARE: f64 = 0.95;

impl Act<'_> {
    pub(super) fn supervise(&mut self, at: HostTime) {
        // The board was never seen armed, or its heartbeat came before we asked: nothing is left
        // to wait for.
        if self.flight.mode == Mode::Disarming
            && !self.board.link.is_armed()
            && !self.board.link.is_commanding()
        {
            self.fire(at, Event::BoardDisarmed);
        }
        self.flight.pursue_next(&around!(self, at), self.out, self.wishes);
        self.grant(at);
        if self.flight.mode == Mode::Idle {
            if self.flight.lift_off_asked {
                self.flight.lift_off(&around!(self, at), self.out, self.wishes);
                self.grant(at);
            } else if at.seconds_since(self.flight.mode_since) > self.config.flight.idle_disarm_s {
                self.fire(at, Event::IdleTooLong);
            }
        }
        self.flight.pursue_end(&around!(self, at), self.out, self.wishes);
        self.grant(at);
        self.flight.watch_resumption(&around!(self, at), self.wishes);
        self.grant(at);
        self.walk_conditions(at);
        if !self.flight.mode.has_thrust() {
            return;
        }
        let usable = matches!(self.estimate.health, Health::Good | Health::Degraded);
        match self.flight.mode {
            Mode::Land => {
                let (way, from_m) = (self.flight.way_down(), self.flight.land_from_m);
                let felt = self.navigation.watch_touch_down(&view!(self, at), &way, from_m);
                self.take_floor(at, felt);
            }
            Mode::Descend => self.watch_descent(at),
            _ => {}
        }
        // What a descent begins with is what was known before anything was wrong.
        if usable && self.flight.mode != Mode::Descend {
            self.flight.last_height_m = self.height_above_floor_m();
            self.flight.last_sink_mps = self.estimate.vel_E_mps().z();
        }
    }

    /// In a descent without an estimate: whether the floor is there, and whether the estimate is back.
    fn watch_descent(&mut self, at: HostTime) {
        // So near the floor nothing is to be gained by an estimate that was just lost: it is over sooner than that is known.
        let near = self.flight.supervisor.descent.height_m < NEAR_FLOOR_M
            || self.navigation.is_low_by_baro(&view!(self, at));
        let bad =
            !self.navigation.is_uwb_fresh(at) || !self.navigation.estimate_is_back(self.estimate);
        if near || bad || self.flight.needs_descent(self.config) {
            self.flight.good_since = None;
        } else if at.seconds_since(*self.flight.good_since.get_or_insert(at))
            > self.flight.back_for_s()
        {
            self.fire(at, Event::EstimateBack);
            return;
        }
        let is_alive = self.sight(at).imu_is_alive();
        self.flight.supervisor.descent.numb = self.navigation.is_numb() || !is_alive;
        if is_alive {
            if self.navigation.touch.fell_at.is_none()
                && self.navigation.touch.ceiling_frac.is_none()
            {
                self.navigation.touch.ceiling_frac = self.flight.standing_ceiling_frac();
            }
            let share = self.flight.control.thrust_frac
                / self.flight.hover_thrust_frac(self.config).max(0.05);
            let low = self.flight.supervisor.descent.is_low()
                || self.navigation.is_low_by_baro(&view!(self, at));
            let held_up = self.flight.supervisor.descent.is_held_up(share, HELD_UP_SHARE);
            let for_s = if low { TOUCH_FOR_S } else { HELD_UP_FOR_S };
            let reason = Reason { low, is_one: low || held_up, for_s, sink_mps: None };
            let way = self.flight.way_down();
            let felt = self.navigation.feel_for_floor(&view!(self, at), &way, &reason);
            self.take_floor(at, felt);
        } else if self.navigation.touch.stands {
            let felt = self.navigation.lower_thrust(&view!(self, at));
            self.take_floor(at, felt);
        } else {
            let share = self.flight.control.thrust_frac
                / self.flight.hover_thrust_frac(self.config).max(0.05);
            let descent = &self.flight.supervisor.descent;
            let low = descent.is_low() || self.navigation.is_low_by_baro(&view!(self, at));
            let held_up = low && descent.is_held_up(share, BLIND_HELD_UP_SHARE);
            self.navigation.take_hold_of_floor(at, held_up);
            let felt = self.navigation.sink_blindly(&view!(self, at));
            self.take_floor(at, felt);
        }
    }

    /// What was felt of the floor.
    fn take_floor(&mut self, at: HostTime, felt: Felt) {
        match felt {
            Felt::Nothing => {}
            Felt::Fall => self.flight.supervisor.descent.floor_not_found(),
            Felt::Floor => {
                self.fire(at, Event::TouchDown);
            }
        }
    }
}
