//! A change of mode: what it begins, what it ends, and how it is told.

use haltere_core::time::HostTime;
use haltere_core::topics::{ModeRecord, Topic};

use super::Flight;
use super::awaited::Next;
use super::event_list::{MODE_CHANGED, cause_number, mode_number};
use super::modes::{Event, Mode, transition};
use super::resume::Resumption;
use super::supervisor::{Descent, RESPONSE_MOST_S};
use crate::Pilot;
use crate::out::voice::Severity;
use crate::view::view;

/// A take-off that leaves the floor's cushion rises with so many times its speed for a moment: in lockstep with up to 1.3 m/s
/// where 0.5 is asked for.
const OVERSHOOTS: f64 = 2.6;

/// Why a mode changed: the words, how grave it is, and the number for events.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cause {
    pub because: &'static str,
    pub severity: Severity,
    pub number: u8,
}

impl Cause {
    fn of_row(from: Mode, event: Event, because: &'static str) -> Self {
        let severity = match event {
            Event::NotLifted | Event::SetpointsIgnored | Event::LandingOverdue => Severity::Error,
            Event::NoWayHome | Event::FloorCarries => Severity::Warning,
            _ => Severity::Info,
        };
        Self { because, severity, number: cause_number(from, event) }
    }
}

impl Flight {
    pub(crate) fn call_off_lift_off(&mut self) {
        self.lift_off_asked = false;
        self.guidance.next = Next::Nothing;
    }

    /// The mode that clients are shown. On the floor one that waits for arming is shown as if it
    /// were in force: clients that asked for it give up when it does not appear (GROUND.md).
    pub(crate) fn shown_mode(&self) -> Mode {
        let next = self.guidance.next.mode();
        match (self.mode, next) {
            (
                Mode::Disarmed | Mode::Arming | Mode::Idle | Mode::Spool | Mode::Takeoff,
                Some(next),
            ) => next,
            (Mode::Disarmed | Mode::Arming | Mode::Idle, None) if self.lift_off_asked => {
                Mode::Takeoff
            }
            (mode, _) => mode,
        }
    }
}

impl Pilot {
    /// Lets an event change the mode. `false`: there is no row for it.
    pub(crate) fn fire(&mut self, at: HostTime, event: Event) -> bool {
        self.fire_because(at, event, None)
    }

    /// The same for a reason that is not the row's.
    pub(crate) fn fire_because(
        &mut self,
        at: HostTime,
        event: Event,
        cause: Option<Cause>,
    ) -> bool {
        let Some(row) = transition(self.flight.mode, event) else { return false };
        let from = self.flight.mode;
        let cause = cause.unwrap_or_else(|| Cause::of_row(from, event, row.because));
        if from == Mode::Land
            && matches!(event, Event::TouchDown | Event::BoardDisarmed)
            && let Some(seq) = self.flight.guidance.landed()
        {
            self.tell_reached(at, seq);
        }
        if !matches!(row.to, Mode::Return | Mode::Land) {
            self.flight.guidance.landing = false;
        }
        self.flight.mode = row.to;
        if !matches!(row.to, Mode::Arming | Mode::Idle | Mode::Spool | Mode::Takeoff) {
            self.flight.guidance.next = Next::Nothing;
        }
        self.flight.mode_since = at;
        self.navigation.touch = self.navigation.touch.in_mode(from, row.to, at);
        self.flight.good_since = None;
        self.flight.guidance.enter(row.to, &self.estimate, &self.stations.services.plans.fence, at);
        match row.to {
            Mode::Spool => {
                self.flight.supervisor.begin_flight(at);
                self.flight.controller.reset(None);
                // A real board lets its motors stand for seconds yet: until it shows thrust, the vehicle stands
                // too, and near the floor UWB alone loses its height.
                if !self.board.link.firmware().is_real() {
                    self.navigation.estimator.set_airborne(true);
                }
                self.flight.lift_off_asked = false;
            }
            Mode::Takeoff => self.navigation.estimator.set_airborne(true),
            Mode::Disarming => {
                // With thrust on, a board may refuse the plain order even on the floor.
                let force = from.has_thrust() && event != Event::TouchDown;
                self.board.link.command_arm(false, force, at);
                self.out.told.insisted_at = None;
                self.flight.call_off_lift_off();
            }
            Mode::Yielded => {
                self.flight.land_when_back = false;
                // What the integrators learn while nobody listens is wrong.
                self.flight.controller.reset(None);
            }
            Mode::Hold if from == Mode::Yielded => self.take_over_level(),
            Mode::Descend => {
                // Height and speed as they were while they could be trusted, or as measured after a pause.
                let (height_m, sink_mps) = self
                    .flight
                    .resumption
                    .descends_from(self.flight.last_height_m)
                    .unwrap_or_else(|| self.height_and_sink_to_descend_from(at));
                self.flight.supervisor.descent = Descent::begin(height_m, sink_mps);
                if from == Mode::Takeoff {
                    let up_mps = OVERSHOOTS * self.config.flight.takeoff_speed_mps;
                    self.flight.supervisor.descent.may_rise(up_mps);
                }
                self.flight.supervisor.descents += 1;
                let late_s = self.board.link.response_lag_s().filter(|s| *s > RESPONSE_MOST_S);
                self.navigation.touch.lag_s = late_s.unwrap_or(0.0);
                if from == Mode::Land {
                    self.navigation.hold_thrust_near_floor(&view!(self, at));
                }
            }
            Mode::Land => self.flight.land_from_m = self.height_above_floor_m().max(0.0),
            Mode::Disarmed => {
                self.flight.resumption = Resumption::default();
                self.flight.supervisor.end_flight();
                self.navigation.estimator.set_airborne(false);
                self.flight.call_off_lift_off();
                if event == Event::ArmFailed {
                    // It may still arm on an order that is under way.
                    self.board.link.command_arm(false, false, at);
                }
            }
            _ => {}
        }
        self.record_mode(at, row.to.name(), cause.because);
        let Cause { because, severity, number } = cause;
        let arguments = [mode_number(from), mode_number(row.to), number];
        self.out.event(at, MODE_CHANGED, severity.into(), &[&arguments]);
        self.out.say_of_event(at, severity, format!("{}: {because}", row.to.name()));
        true
    }

    pub(crate) fn record_mode(&mut self, at: HostTime, mode: &'static str, because: &str) {
        let armed = self.board.link.is_armed();
        self.out.record(|| Topic::Mode(ModeRecord { at, mode, armed, cause: because.to_owned() }));
    }
}
