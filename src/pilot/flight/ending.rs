//! The program is asked to end: what flies is landed first, and nothing takes off again.
//!
//! ```text
//! disarmed                     ends at once
//! arming, idle, spool          disarms, then ends
//! in the air                   lands here, then ends; a landing that takes far too long becomes a descent
//! yielded                      waits: the board flies by itself. Control that comes back is landed with
//! board that does not answer   ends after a while: nothing that we send need arrive
//! ```
//! Clients may order what is harder than a landing, and nothing that would keep the vehicle in the air: whoever
//! ends the program (a person, the system that goes down, an update) ends it soon, landed or not.

use haltere_core::time::HostTime;

use super::Flight;
use super::modes::{Event, Mode};
use super::supervisor::{LONGEST_DESCENT_S, Reaction};
use crate::config::FlightConfig;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::view::Around;
use crate::wish::Wish;

/// What clients are told that ask for more.
pub(crate) const ENDS: &str = "the program is asked to end";

/// A landing may take so many times longer than its speeds say …
const LANDING_SHARE: f64 = 2.0;
/// … and so much besides, s: from outside the walls back inside, and to feel for the floor.
const LANDING_SLACK_S: f64 = 10.0;
/// The board is asked for so long to disarm, s: it is forced after three (`supervise`).
const DISARM_S: f64 = 6.0;
/// A board that flies by itself is waited for so long, s: its own landing from the height of a hall.
const YIELDED_S: f64 = 30.0;
/// So much longer everybody hears that the motors are off, s.
const LAST_WORDS_S: f64 = 0.5;

/// The end that was asked for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ending {
    asked_at: HostTime,
    may_end: bool,
}

/// A landing that takes longer than this becomes a descent, s. `top_m` is the height of the volume, m.
pub(crate) fn longest_landing_s(flight: &FlightConfig, top_m: f64) -> f64 {
    LANDING_SHARE * flight.landing_s(top_m) + LANDING_SLACK_S
}

/// Longest time from the wish to the end, s.
pub(crate) fn longest_end_s(flight: &FlightConfig, top_m: f64) -> f64 {
    let down_s = longest_landing_s(flight, top_m) + LONGEST_DESCENT_S;
    down_s.max(YIELDED_S) + DISARM_S + LAST_WORDS_S
}

impl Flight {
    pub(crate) fn end_asked(&mut self, at: HostTime, out: &mut Out) {
        if self.ending.is_some() {
            return;
        }
        let may_end = self.mode == Mode::Disarmed;
        self.ending = Some(Ending { asked_at: at, may_end });
        self.call_off_lift_off();
        if may_end {
            out.say(at, Severity::Info, "haltere ends".to_owned());
        } else {
            out.say(at, Severity::Warning, "haltere is asked to end: it lands first".to_owned());
        }
    }

    fn give_up(&mut self, at: HostTime, out: &mut Out) {
        let text = "haltere ends while the board is armed: its own failsafe is in charge";
        out.say(at, Severity::Critical, text.to_owned());
        self.end();
    }

    fn end(&mut self) {
        if let Some(ending) = &mut self.ending {
            ending.may_end = true;
        }
    }

    /// Why a client may not have a mode: the program ends, and that is milder than landing.
    pub(crate) fn ending_forbids(&self, to: Mode) -> Option<&'static str> {
        (self.ending.is_some() && Reaction::of_mode(to) < Reaction::Land).then_some(ENDS)
    }

    /// Whether the program may end: it was asked to, and nothing flies by it any more.
    pub(crate) fn may_end(&self) -> bool {
        self.ending.is_some_and(|ending| ending.may_end)
    }

    /// The way to the end, one look in each control step.
    pub(crate) fn pursue_end(
        &mut self,
        around: &Around<'_>,
        out: &mut Out,
        wishes: &mut Vec<Wish>,
    ) {
        let Some(Ending { asked_at, may_end: false }) = self.ending else { return };
        let (at, flight) = (around.at, &around.config.flight);
        let top_m = self.guidance.volume().height_m;
        let asked_s = at.seconds_since(asked_at);
        // Not of time that passed before it was asked.
        let here_s = asked_s.min(at.seconds_since(self.mode_since));
        if asked_s > longest_end_s(flight, top_m) {
            self.give_up(at, out);
            return;
        }
        match self.mode {
            Mode::Disarmed if here_s >= LAST_WORDS_S => self.end(),
            Mode::Disarming if here_s > DISARM_S => self.give_up(at, out),
            Mode::Yielded if here_s > YIELDED_S => self.give_up(at, out),
            Mode::Land if asked_s > longest_landing_s(flight, top_m) => {
                self.happened(around, Event::LandingOverdue, None, out, wishes);
            }
            _ => {
                self.happened(around, Event::EndAsked, None, out, wishes);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Pilot;
    use crate::config::PilotConfig;
    use crate::view::around;
    use haltere_core::frames::Vec3;
    use haltere_core::measure::AnchorId;
    use haltere_core::survey::Survey;

    fn pilot(mode: Mode) -> (Pilot, HostTime) {
        let corner = |i: u8| {
            let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
            (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
        };
        let survey = Survey::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        let at = HostTime::from_us(1_000_000);
        let mut pilot = Pilot::new(PilotConfig::default(), survey, at);
        (pilot.flight.mode, pilot.flight.mode_since) = (mode, at);
        pilot.flight.end_asked(at, &mut pilot.out);
        (pilot, at)
    }

    /// Mode and whether it may end, this long after it was asked, s.
    fn after(mode: Mode, elapsed_s: f64) -> (Mode, bool) {
        let (mut pilot, at) = pilot(mode);
        let later = at.offset_us((elapsed_s * 1e6) as i64);
        let (out, wishes) = (&mut pilot.out, &mut pilot.wishes);
        pilot.flight.pursue_end(&around!(pilot, later), out, wishes);
        (pilot.flight.mode, pilot.may_end())
    }

    #[test]
    fn prop_what_does_not_come_to_an_end_is_ended() {
        let high_m = pilot(Mode::Land).0.flight.guidance.volume().height_m;
        let landing_s = longest_landing_s(&FlightConfig::default(), high_m);
        let end_s = longest_end_s(&FlightConfig::default(), high_m);
        for (mode, elapsed_s, then) in [
            (Mode::Land, landing_s - 1.0, (Mode::Land, false)),
            (Mode::Land, landing_s + 1.0, (Mode::Descend, false)),
            (Mode::Descend, landing_s + 1.0, (Mode::Descend, false)),
            (Mode::Descend, end_s + 1.0, (Mode::Descend, true)),
            (Mode::Disarming, DISARM_S - 1.0, (Mode::Disarming, false)),
            (Mode::Disarming, DISARM_S + 1.0, (Mode::Disarming, true)),
            (Mode::Yielded, YIELDED_S - 1.0, (Mode::Yielded, false)),
            (Mode::Yielded, YIELDED_S + 1.0, (Mode::Yielded, true)),
            (Mode::Hold, 0.0, (Mode::Land, false)),
            (Mode::Manual, 0.0, (Mode::Land, false)),
            (Mode::Offboard, 0.0, (Mode::Land, false)),
            (Mode::Idle, 0.0, (Mode::Disarming, false)),
        ] {
            assert_eq!(after(mode, elapsed_s), then, "{mode:?} after {elapsed_s} s");
        }
    }

    /// A volume as high as a sports hall, default speeds: systemd must not end a landing.
    #[test]
    fn prop_the_service_is_given_the_longest_end() {
        let unit = include_str!("../../../packaging/haltere.service");
        let stop = unit.lines().find_map(|line| line.strip_prefix("TimeoutStopSec="));
        let stop_s: f64 = stop.unwrap().parse().unwrap();
        assert!(longest_end_s(&FlightConfig::default(), 15.0) < stop_s);
    }
}
