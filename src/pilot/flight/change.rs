//! A change of mode: what it begins, what it ends, and how it is told.

use haltere_core::control::Handover;
use haltere_core::topics::{ModeRecord, Topic};

use super::Flight;
use super::awaited::Next;
use super::event_list::{MODE_CHANGED, cause_number, mode_number};
use super::modes::{Event, Mode, transition};
use super::resume::Resumption;
use super::supervisor::{Descent, RESPONSE_MOST_S};
use crate::out::Out;
use crate::out::voice::Severity;
use crate::view::Around;
use crate::wish::Wish;

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
    /// were in force: clients that asked for it give up when it does not appear (STATIONS.md).
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

    /// The item of the mission that a landing has flown which this event ends.
    pub(crate) fn landed_item(&mut self, event: Event) -> Option<u16> {
        let ends = self.mode == Mode::Land
            && matches!(event, Event::TouchDown | Event::BoardDisarmed)
            && transition(self.mode, event).is_some();
        if ends { self.guidance.landed() } else { None }
    }

    /// Lets an event change the mode, by the row's reason or another one. `false`: there is no row for it. What a landing
    /// has reached is told before ([`Self::landed_item`]).
    pub(crate) fn happened(
        &mut self,
        around: &Around<'_>,
        event: Event,
        cause: Option<Cause>,
        out: &mut Out,
        wishes: &mut Vec<Wish>,
    ) -> bool {
        let Some(row) = transition(self.mode, event) else { return false };
        let (at, from) = (around.at, self.mode);
        let cause = cause.unwrap_or_else(|| Cause::of_row(from, event, row.because));
        if !matches!(row.to, Mode::Return | Mode::Land) {
            self.guidance.landing = false;
        }
        self.mode = row.to;
        if !matches!(row.to, Mode::Arming | Mode::Idle | Mode::Spool | Mode::Takeoff) {
            self.guidance.next = Next::Nothing;
        }
        self.mode_since = at;
        wishes.push(Wish::FeelAnew { from, to: row.to });
        self.good_since = None;
        self.guidance.enter(row.to, around.estimate, &self.plans.fence, at);
        self.enter(around, from, event, out, wishes);
        self.record_mode(around, cause.because, out);
        let Cause { because, severity, number } = cause;
        let arguments = [mode_number(from), mode_number(row.to), number];
        out.event(at, MODE_CHANGED, severity.into(), &[&arguments]);
        out.say_of_event(at, severity, format!("{}: {because}", row.to.name()));
        true
    }

    /// What a mode begins, which is in force already.
    fn enter(
        &mut self,
        around: &Around<'_>,
        from: Mode,
        event: Event,
        out: &mut Out,
        wishes: &mut Vec<Wish>,
    ) {
        match self.mode {
            Mode::Spool => {
                self.supervisor.begin_flight(around.at);
                self.controller.reset(None);
                // A real board lets its motors stand for seconds yet: until it shows thrust, the vehicle stands
                // too, and near the floor UWB alone loses its height.
                if !around.board.link.firmware().is_real() {
                    wishes.push(Wish::Airborne(true));
                }
                self.lift_off_asked = false;
            }
            Mode::Takeoff => wishes.push(Wish::Airborne(true)),
            Mode::Disarming => {
                // With thrust on, a board may refuse the plain order even on the floor.
                let force = from.has_thrust() && event != Event::TouchDown;
                wishes.push(Wish::Disarm { force, later: false });
                out.told.insisted_at = None;
                self.call_off_lift_off();
            }
            Mode::Yielded => {
                self.land_when_back = false;
                // What the integrators learn while nobody listens is wrong.
                self.controller.reset(None);
            }
            Mode::Hold if from == Mode::Yielded => self.take_over_level(around),
            Mode::Descend => self.begin_descent(around, from, out, wishes),
            Mode::Land => {
                self.land_from_m = around.height_above_floor_m().max(0.0);
            }
            Mode::Disarmed => {
                self.resumption = Resumption::default();
                self.supervisor.end_flight();
                wishes.push(Wish::Airborne(false));
                self.call_off_lift_off();
                if event == Event::ArmFailed {
                    // It may still arm on an order that is under way.
                    wishes.push(Wish::Disarm { force: false, later: false });
                }
            }
            _ => {}
        }
    }

    fn begin_descent(
        &mut self,
        around: &Around<'_>,
        from: Mode,
        out: &Out,
        wishes: &mut Vec<Wish>,
    ) {
        // Height and speed as they were while they could be trusted, or as measured after a pause.
        let (height_m, sink_mps) = self
            .resumption
            .descends_from(self.last_height_m)
            .unwrap_or_else(|| around.sight(self, out).height_and_sink_to_descend_from());
        self.supervisor.descent = Descent::begin(height_m, sink_mps);
        if from == Mode::Takeoff {
            self.supervisor.descent.may_rise(OVERSHOOTS * around.config.flight.takeoff_speed_mps);
        }
        self.supervisor.descents += 1;
        let late_s = around.board.link.response_lag_s().filter(|s| *s > RESPONSE_MOST_S);
        wishes.push(Wish::DownLate { lag_s: late_s.unwrap_or(0.0) });
        if from == Mode::Land {
            wishes.push(Wish::HoldThrustNearFloor);
        }
    }

    /// The loops take over from level flight at the base thrust: nobody has flown by them meanwhile.
    fn take_over_level(&mut self, around: &Around<'_>) {
        self.controller.reset(Some(&Handover {
            roll_rad: 0.0,
            pitch_rad: 0.0,
            yaw_rad: around.estimate.R_EB.yaw_rad(),
            thrust_frac: self.hover_thrust_frac(around.config),
        }));
    }

    /// Records the mode in force, with the reason.
    pub(super) fn record_mode(&self, around: &Around<'_>, because: &str, out: &mut Out) {
        let (mode, armed) = (self.mode.name(), around.board.link.is_armed());
        out.record(|| {
            Topic::Mode(ModeRecord { at: around.at, mode, armed, cause: because.to_owned() })
        });
    }
}
