//! How a flight begins and ends: the last look before the take-off, what is remembered on the way to the floor (which
//! `schedule/supervise` walks), and disarming. What goes wrong in between is the `supervisor`'s; what must hold before
//! arming is in `arming`.

use haltere_core::time::HostTime;

use super::Flight;
use super::awaited::Next;
use super::modes::Event;
use crate::navigation::floor::WayDown;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::view::Around;
use crate::wish::Wish;

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
    pub(crate) fn way_down(&self) -> WayDown {
        WayDown { mode_since: self.mode_since, descents: self.supervisor.descents }
    }

    /// How long an estimate must be good to be flown on again, s: what comes and goes would otherwise keep
    /// the vehicle in the air for ever.
    pub(crate) fn back_for_s(&self) -> f64 {
        BACK_FOR_S * BACK_GROWTH.powi((self.supervisor.descents - 1).clamp(0, 6))
    }

    /// Nothing takes off with an estimate that is none, however long ago the vehicle was armed.
    pub(crate) fn lift_off(&mut self, around: &Around<'_>, out: &mut Out, wishes: &mut Vec<Wish>) {
        self.lift_off_asked = false;
        if let Err(why) = around.sight(self, out).may_lift_off() {
            self.guidance.next = Next::Nothing;
            out.say(around.at, Severity::Error, format!("take-off refused: {why}"));
            return;
        }
        self.happened(around, Event::LiftOffAsked, None, out, wishes);
    }

    /// The board refuses to disarm, or does not answer. Motors have no thrust by our setpoints;
    /// asking goes on, forced.
    pub(crate) fn insist_on_disarming(
        &self,
        at: HostTime,
        why: &str,
        out: &mut Out,
        wishes: &mut Vec<Wish>,
    ) {
        // A forced disarm works in the air too. The board's land detector may be slow; if it is right
        // and we are not, so much time without thrust has brought the vehicle down anyway.
        let force = at.seconds_since(self.mode_since) > FORCE_AFTER_S;
        wishes.push(Wish::Disarm { force, later: true });
        // Land detectors take a second to agree.
        let late = at.seconds_since(self.mode_since) > INSIST_FIRST_S;
        if late && out.told.insisted_at.is_none_or(|t| at.seconds_since(t) > INSIST_TELL_S) {
            out.told.insisted_at = Some(at);
            out.say(at, Severity::Critical, format!("disarming failed, still trying: {why}"));
        }
    }
}
