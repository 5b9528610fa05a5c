//! How a flight begins and ends: the last look before the take-off, the way to the floor, how it is told,
//! and disarming. What goes wrong in between is the `supervisor`'s; what must hold before arming is in
//! `arming`.

use haltere_core::estimate::Health;
use haltere_core::time::HostTime;

use super::Flight;
use super::awaited::Next;
use super::modes::{Event, Mode};
use crate::Pilot;
use crate::navigation::floor::{Felt, HELD_UP_FOR_S, NEAR_FLOOR_M, Reason, TOUCH_FOR_S, WayDown};
use crate::out::voice::Severity;
use crate::view::view;

/// With less than this share of the hover thrust, and hardly sinking, floor or ground effect carry: 0.9 leave 1 m/s²,
/// which drag alone holds up at 1.2 m/s. Where no accelerometer can show that it was wrong thrust is taken away gently,
/// so less is enough: 0.95 would sink with 0.6 m/s.
const HELD_UP_SHARE: f64 = 0.9;
const BLIND_HELD_UP_SHARE: f64 = 0.95;
/// The estimate must be good for this long before a blind descent becomes a landing again, s.
const BACK_FOR_S: f64 = 0.3;
/// After each descent of a flight it must be good for so many times longer.
const BACK_GROWTH: f64 = 3.0;
/// A board that refuses to disarm on the floor is forced after this time without thrust, s.
const FORCE_AFTER_S: f64 = 3.0;
/// People are told that a board does not disarm after this time, s …
const INSIST_FIRST_S: f64 = 2.0;
/// … and again after this, s.
const INSIST_TELL_S: f64 = 5.0;

impl Flight {
    fn way_down(&self) -> WayDown {
        WayDown { mode_since: self.mode_since, descents: self.supervisor.descents }
    }

    /// How long an estimate must be good to be flown on again, s: what comes and goes would otherwise keep
    /// the vehicle in the air for ever.
    fn back_for_s(&self) -> f64 {
        BACK_FOR_S * BACK_GROWTH.powi((self.supervisor.descents - 1).clamp(0, 6))
    }
}

impl Pilot {
    pub(crate) fn supervise(&mut self, at: HostTime) {
        // The board was never seen armed, or its heartbeat came before we asked: nothing is left
        // to wait for.
        if self.flight.mode == Mode::Disarming
            && !self.board.link.is_armed()
            && !self.board.link.is_commanding()
        {
            self.fire(at, Event::BoardDisarmed);
        }
        self.pursue_next(at);
        if self.flight.mode == Mode::Idle {
            if self.flight.lift_off_asked {
                self.lift_off(at);
            } else if at.seconds_since(self.flight.mode_since) > self.config.flight.idle_disarm_s {
                self.fire(at, Event::IdleTooLong);
            }
        }
        self.pursue_end(at);
        self.watch_resumption(at);
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

    /// Nothing takes off with an estimate that is none, however long ago the vehicle was armed.
    pub(crate) fn lift_off(&mut self, at: HostTime) {
        self.flight.lift_off_asked = false;
        if let Err(why) = self.may_lift_off(at) {
            self.flight.guidance.next = Next::Nothing;
            self.out.say(at, Severity::Error, format!("take-off refused: {why}"));
            return;
        }
        self.fire(at, Event::LiftOffAsked);
    }

    /// In a descent without an estimate: whether the floor is there, and whether the estimate is back.
    fn watch_descent(&mut self, at: HostTime) {
        // So near the floor nothing is to be gained by an estimate that was just lost: it is over sooner than that is known.
        let near = self.flight.supervisor.descent.height_m < NEAR_FLOOR_M
            || self.navigation.is_low_by_baro(&view!(self, at));
        let bad =
            !self.navigation.is_uwb_fresh(at) || !self.navigation.estimate_is_back(&self.estimate);
        if near || bad || self.needs_descent() {
            self.flight.good_since = None;
        } else if at.seconds_since(*self.flight.good_since.get_or_insert(at))
            > self.flight.back_for_s()
        {
            self.fire(at, Event::EstimateBack);
            return;
        }
        let numb = self.navigation.is_numb() || !self.imu_is_alive(at);
        self.flight.supervisor.descent.numb = numb;
        if self.imu_is_alive(at) {
            if self.navigation.touch.fell_at.is_none()
                && self.navigation.touch.ceiling_frac.is_none()
            {
                self.navigation.touch.ceiling_frac = self.flight.standing_ceiling_frac();
            }
            let share = self.flight.control.thrust_frac
                / self.flight.hover_thrust_frac(&self.config).max(0.05);
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
                / self.flight.hover_thrust_frac(&self.config).max(0.05);
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

    /// Height of the landing gear above the floor by the estimate, m.
    pub(crate) fn height_above_floor_m(&self) -> f64 {
        -self.estimate.pos_E_m.z() - self.config.flight.gear_height_m
    }

    /// The board refuses to disarm, or does not answer. Motors have no thrust by our setpoints;
    /// asking goes on, forced.
    pub(crate) fn insist_on_disarming(&mut self, at: HostTime, why: &str) {
        // A forced disarm works in the air too. The board's land detector may be slow; if it is right
        // and we are not, so much time without thrust has brought the vehicle down anyway.
        let force = at.seconds_since(self.flight.mode_since) > FORCE_AFTER_S;
        self.board.link.command_arm_later(false, force, at);
        // Land detectors take a second to agree.
        let late = at.seconds_since(self.flight.mode_since) > INSIST_FIRST_S;
        if late && self.out.told.insisted_at.is_none_or(|t| at.seconds_since(t) > INSIST_TELL_S) {
            self.out.told.insisted_at = Some(at);
            self.out.say(at, Severity::Critical, format!("disarming failed, still trying: {why}"));
        }
    }
}
