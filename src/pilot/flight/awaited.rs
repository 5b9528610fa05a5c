//! What follows the take-off: a mode that a client asked for on the floor, or while the vehicle climbs.

use haltere_core::frames::{E, Vec3};
use haltere_core::time::HostTime;

use super::Flight;
use super::modes::{Event, Mode};
use super::setpoint::{Setpoint, rests_at_E_m};
use crate::out::Out;
use crate::out::voice::Severity;
use crate::view::Around;
use crate::wish::Wish;

/// A stream of setpoints that lifts the vehicle off has run for so long, s: one that stops at once would leave it in
/// the air with nobody who flies it.
const STREAM_S: f64 = 1.0;
/// The point that a vehicle lifts off to is no further away than this, m: what a place that was measured by eye may be
/// off. Farther ones are flown to from the air.
const LIFT_OFF_M: f64 = 1.0;
/// A take-off is so high before it turns into something else, m: clear of the floor's cushion, with room to lean.
const CLEAR_M: f64 = 0.5;
/// So much less than was asked for is told of a climb by its rate, m, and as a share of it.
const SHORT_M: f64 = 0.5;
const SHORT_SHARE: f64 = 0.2;

/// A climb that a client asks for by its rate, from its first setpoint to its last.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Climb {
    /// Down, where it began, m.
    from_z_m: f64,
    /// What rate and time come to so far, m.
    asked_m: f64,
    since: HostTime,
    looked_at: HostTime,
}

/// What follows the take-off.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) enum Next {
    /// Hold.
    #[default]
    Nothing,
    /// The mission.
    Mission,
    /// The setpoints of a client. Asked for on the floor, their stream lifts off by itself.
    Offboard,
    /// The same once the stream lifts off.
    Stream,
    /// A joystick.
    Manual,
    /// A point.
    Point { pos_E_m: Vec3<E>, yaw_rad: Option<f64> },
}

impl Next {
    /// The mode that it is.
    pub fn mode(self) -> Option<Mode> {
        match self {
            Next::Nothing => None,
            Next::Mission => Some(Mode::Mission),
            Next::Offboard | Next::Stream => Some(Mode::Offboard),
            Next::Manual => Some(Mode::Manual),
            Next::Point { .. } => Some(Mode::Goto),
        }
    }
}

/// Why a setpoint lifts nothing off: its point is too far from where the vehicle stands.
pub(crate) fn too_far(setpoint: &Setpoint, pos_E_m: Vec3<E>) -> Option<String> {
    let away_m = setpoint.away_m(pos_E_m);
    (away_m > LIFT_OFF_M).then(|| {
        format!(
            "offboard refused on the floor: the setpoint is {away_m:.1} m away, allowed {LIFT_OFF_M} m; begin \
             above the vehicle"
        )
    })
}

impl Flight {
    /// Whether the mission is flown: its take-off is a part of it.
    pub(crate) fn flies_mission(&self) -> bool {
        let lifts_off = matches!(self.mode, Mode::Spool | Mode::Takeoff);
        self.mode == Mode::Mission || lifts_off && self.guidance.next == Next::Mission
    }

    /// Begins what can begin now, one look in each control step.
    pub(crate) fn pursue_next(
        &mut self,
        around: &Around<'_>,
        out: &mut Out,
        wishes: &mut Vec<Wish>,
    ) {
        self.follow_climb(around, out);
        match (self.guidance.next, self.mode) {
            (Next::Offboard, Mode::Disarmed | Mode::Arming | Mode::Idle) => {
                self.lift_to_stream(around, out, wishes)
            }
            (Next::Stream, Mode::Spool) if self.stream(around).is_none() => {
                self.call_off_stream(around, out);
                self.happened(around, Event::LandAsked, None, out, wishes);
            }
            (Next::Manual | Next::Point { .. }, Mode::Takeoff)
                if around.height_above_floor_m() >= CLEAR_M =>
            {
                self.begin_next(around, out, wishes);
            }
            _ => {}
        }
    }

    /// Adds up a climb by rate, and tells when it is over how much of it was flown: on the floor the stream must run for a
    /// while, and the take-off has a speed of its own.
    fn follow_climb(&mut self, around: &Around<'_>, out: &mut Out) {
        let at = around.at;
        let waits = matches!(self.guidance.next, Next::Offboard | Next::Stream);
        let setpoint = self.stream(around).filter(|_| waits || self.mode == Mode::Offboard);
        let rate_mps = setpoint.map_or(0.0, |s| s.climb_mps());
        let z_m = rests_at_E_m(around.estimate).z();
        let fresh = Climb { from_z_m: z_m, asked_m: 0.0, since: at, looked_at: at };
        let climb = self.guidance.climb.get_or_insert(fresh);
        if rate_mps > 0.0 {
            climb.asked_m += rate_mps * at.seconds_since(climb.looked_at);
            climb.looked_at = at;
            return;
        }
        let Climb { from_z_m, asked_m, since, looked_at } = *climb;
        self.guidance.climb = None;
        let flown_m = (from_z_m - z_m).max(0.0);
        if asked_m - flown_m > SHORT_M.max(SHORT_SHARE * asked_m) {
            let took_s = looked_at.seconds_since(since);
            let text = format!(
                "offboard climb: {flown_m:.1} of {asked_m:.1} m flown that its rate asked for in {took_s:.1} s, stays \
                 at {:.1} m",
                -z_m
            );
            out.say(at, Severity::Info, text);
        }
    }

    /// Offboard on the floor: the vehicle lifts off to the first setpoint that is up, once the stream has run for a
    /// while. A stream that stops calls it off.
    fn lift_to_stream(&mut self, around: &Around<'_>, out: &mut Out, wishes: &mut Vec<Wish>) {
        let at = around.at;
        let Some(setpoint) = self.stream(around) else { return self.call_off_stream(around, out) };
        // Between its first and its newest setpoint: what follows the newest is silence.
        let runs = at.seconds_since(setpoint.since) - setpoint.age_s(at) >= STREAM_S;
        let Some(height_m) = setpoint.climbs_to_m(CLEAR_M).filter(|_| runs) else { return };
        if self.mode != Mode::Idle {
            return;
        }
        if let Some(why) = too_far(&setpoint, around.estimate.pos_E_m) {
            self.guidance.next = Next::Nothing;
            out.say(at, Severity::Warning, why);
            return;
        }
        self.guidance.set_takeoff_height(height_m);
        self.guidance.next = Next::Stream;
        self.lift_off(around, out, wishes);
    }

    /// The newest setpoint of a client, if their stream has not stopped.
    fn stream(&self, around: &Around<'_>) -> Option<Setpoint> {
        let limit_s = around.config.limits.offboard_loss_s;
        self.guidance.setpoint.filter(|s| s.age_s(around.at) < limit_s)
    }

    fn call_off_stream(&mut self, around: &Around<'_>, out: &mut Out) {
        self.guidance.next = Next::Nothing;
        let limit_s = around.config.limits.offboard_loss_s;
        out.say(
            around.at,
            Severity::Warning,
            format!("offboard called off: no setpoint for {limit_s} s"),
        );
    }

    /// Lets what waits for the take-off follow it. `false`: nothing does, or what it follows has stopped.
    pub(crate) fn begin_next(
        &mut self,
        around: &Around<'_>,
        out: &mut Out,
        wishes: &mut Vec<Wish>,
    ) -> bool {
        let at = around.at;
        let limit_s = around.config.limits.offboard_loss_s;
        let runs = |s: &Option<Setpoint>| s.is_some_and(|s| s.age_s(at) < limit_s);
        let next = std::mem::take(&mut self.guidance.next);
        let (event, runs) = match next {
            Next::Nothing | Next::Mission => return false,
            Next::Offboard | Next::Stream => {
                let height_m = self.guidance.takeoff_height_m();
                if let Some(setpoint) = &mut self.guidance.setpoint {
                    setpoint.took_off(height_m);
                }
                let stays = self.guidance.setpoint.is_some_and(|s| !s.needs_stream());
                (Event::OffboardAsked, stays || runs(&self.guidance.setpoint))
            }
            Next::Manual => (Event::ManualAsked, runs(&self.guidance.sticks)),
            Next::Point { .. } => (Event::GotoAsked, true),
        };
        // What has come up since it was asked for may forbid it.
        let begins = runs
            && self.forbids(event, around.config, around.navigation).is_none()
            && self.happened(around, event, None, out, wishes);
        if let (true, Next::Point { pos_E_m, yaw_rad }) = (begins, next) {
            self.guidance.fly_to(pos_E_m, yaw_rad);
        }
        begins
    }
}
