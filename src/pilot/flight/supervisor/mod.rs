//! The supervisor: what can go wrong in flight, and what is done about it.
//!
//! [`CONDITIONS`] is the one list. In every control step it is walked once: each row is looked at, held
//! against its time, told when it begins and ends; of all that hold the hardest reaction wins, the first in
//! the list where several want the same. It is ordered as an event, and `modes::TABLE` says which mode
//! follows. Nothing else ends a flight. A client cannot order what is milder than the reaction in force.
//!
//! One family of conditions per file, with what has to be remembered to see them. `reaction` holds the
//! order of hardness, `descent` the way down without an estimate.

mod battery;
mod condition;
mod config;
mod descent;
mod envelope;
mod estimator;
mod imu;
mod links;
mod list;
mod log;
mod lying;
mod reaction;
mod room;
mod scale;
mod slip;
mod timing;
mod uwb;

#[cfg(test)]
mod tests;

pub use condition::{Condition, Number, Watched};
pub use config::SupervisorConfig;
pub use list::CONDITIONS;
pub use reaction::{Action, Reaction};

pub(crate) use descent::{Descent, LONGEST_S as LONGEST_DESCENT_S};
pub(crate) use links::RESPONSE_MOST_S;

use haltere_dialect::mav::haltere::MavSysStatusSensor;

use super::change::Cause;
use super::event_list::{CONDITION_BEGINS, CONDITION_ENDS};
use super::modes::{Event, Mode, TABLE, transition};
use crate::config::PilotConfig;
use crate::flight::Flight;
use crate::navigation::Navigation;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::view::Around;
use crate::wish::Wish;
use haltere_core::time::HostTime;

/// Where a condition stands.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct State {
    /// Since when it is seen without a pause.
    seen_since: Option<HostTime>,
    /// Since when it is gone without a pause, while it holds.
    gone_since: Option<HostTime>,
    holds: bool,
}

/// One for every condition.
#[derive(Debug)]
struct States([State; CONDITIONS.len()]);

impl Default for States {
    fn default() -> Self {
        Self([State::default(); CONDITIONS.len()])
    }
}

/// State of the supervisor.
#[derive(Debug, Default)]
pub(crate) struct Supervisor {
    states: States,
    pub speed: envelope::Speed,
    pub heard: links::Heard,
    pub discharge: battery::Discharge,
    pub punctuality: timing::Punctuality,
    pub descent: Descent,
    /// Descents in this flight.
    pub descents: i32,
    /// Bits of health that conditions take away.
    pub unhealthy: MavSysStatusSensor,
}

impl Supervisor {
    /// Conditions that hold, by their place in the list.
    pub fn holding(&self) -> impl Iterator<Item = (usize, &'static Condition)> + '_ {
        let held = self.states.0.iter().map(|s| s.holds);
        CONDITIONS.iter().enumerate().zip(held).filter(|(_, holds)| *holds).map(|(row, _)| row)
    }

    /// Whether the condition of this name holds.
    pub fn has(&self, name: &str) -> bool {
        self.holding().any(|(_, row)| row.name == name)
    }

    /// The motors begin to turn: what was before does not count.
    pub fn begin_flight(&mut self, at: HostTime) {
        self.heard.board_gap_s = None;
        self.heard.flight_at = Some(at);
        self.descents = 0;
        self.punctuality.begin_flight();
    }

    /// The vehicle is disarmed: nothing is latched any more.
    pub fn end_flight(&mut self) {
        self.heard.board_gap_s = None;
        self.heard.flight_at = None;
        self.punctuality.begin_flight();
        for (state, row) in self.states.0.iter_mut().zip(&CONDITIONS) {
            if row.latched {
                *state = State::default();
            }
        }
    }
}

/// What a step of one condition came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Change {
    None,
    Begins,
    Ends,
}

/// One step of one condition.
fn proceed(
    state: &mut State,
    row: &Condition,
    seen: bool,
    watched: bool,
    at: HostTime,
    lasts_s: f64,
) -> Change {
    if !watched {
        // Nobody looks: it neither holds nor is told to be over, unless it stays for the flight.
        if !(row.latched && state.holds) {
            *state = State::default();
        }
        return Change::None;
    }
    if seen {
        state.gone_since = None;
        let since = *state.seen_since.get_or_insert(at);
        if !state.holds && at.seconds_since(since) >= lasts_s {
            state.holds = true;
            return Change::Begins;
        }
        return Change::None;
    }
    state.seen_since = None;
    if !state.holds || row.latched {
        return Change::None;
    }
    let gone = *state.gone_since.get_or_insert(at);
    if at.seconds_since(gone) >= row.gone_s {
        *state = State::default();
        return Change::Ends;
    }
    Change::None
}

impl Flight {
    /// Walks the list once, and orders what the hardest reaction asks for.
    pub(crate) fn walk_conditions(
        &mut self,
        around: &Around<'_>,
        out: &mut Out,
        wishes: &mut Vec<Wish>,
    ) {
        let mut unhealthy = MavSysStatusSensor::empty();
        let view = around.view(self);
        for (index, row) in CONDITIONS.iter().enumerate() {
            let watched = row.watched.holds(self.mode);
            let seen = watched && (row.is_seen)(&around.sight_with(view, self, out));
            let lasts_s = if seen { (row.lasts_s)(around.config) } else { 0.0 };
            let state = &mut self.supervisor.states.0[index];
            let change = proceed(state, row, seen, watched, around.at, lasts_s);
            if state.holds || (seen && row.health != MavSysStatusSensor::empty() && lasts_s == 0.0)
            {
                unhealthy |= row.health;
            }
            match change {
                Change::None => {}
                Change::Begins => self.tell_condition(around, index, true, out),
                Change::Ends => self.tell_condition(around, index, false, out),
            }
        }
        self.supervisor.unhealthy = unhealthy;
        if let Some((index, row, reaction)) = self.winner(self.mode, around.config) {
            let cause = Cause {
                because: row.because,
                severity: row.severity,
                number: u8::try_from(TABLE.len() + index).unwrap_or(u8::MAX),
            };
            self.happened(around, Event::Ordered(reaction), Some(cause), out, wishes);
        }
    }

    /// The condition whose reaction holds in a mode, with that reaction: the hardest of all, the first in
    /// the list of those that want the same. `None`: nothing has to be done.
    fn winner(
        &self,
        mode: Mode,
        config: &PilotConfig,
    ) -> Option<(usize, &'static Condition, Reaction)> {
        let wanted = |row: &Condition| row.reaction(mode, config);
        let all = self.supervisor.holding().map(|(i, row)| (i, row, wanted(row)));
        all.filter(|(_, _, reaction)| *reaction > Reaction::Tell)
            .reduce(|best, next| if next.2 > best.2 { next } else { best })
    }

    /// Whether something holds for which the estimate cannot be flown on.
    pub(crate) fn needs_descent(&self, config: &PilotConfig) -> bool {
        let wanted = |row: &Condition| (row.wanted)(config);
        self.supervisor.holding().any(|(_, row)| wanted(row) == Reaction::Descend)
    }

    /// Why a client may not have a mode now: something holds that wants more.
    pub(crate) fn forbids(
        &self,
        event: Event,
        config: &PilotConfig,
        navigation: &Navigation,
    ) -> Option<&'static str> {
        let to = transition(self.mode, event)?.to;
        if let Some(why) = self.ending_forbids(to) {
            return Some(why);
        }
        if navigation.is_touching_down(self.mode) && to.is_flying() {
            return Some("it touches down: take off again from the floor");
        }
        let wanted = |row: &Condition| {
            if row.watched.holds(to) { row.reaction(to, config) } else { Reaction::Nothing }
        };
        self.supervisor
            .holding()
            .find(|(_, row)| wanted(row) > Reaction::of_mode(to).max(Reaction::TakeOver))
            .map(|(_, row)| row.because)
    }

    fn tell_condition(&self, around: &Around<'_>, index: usize, begins: bool, out: &mut Out) {
        let row = &CONDITIONS[index];
        let in_flight = self.mode.has_thrust() || self.mode == Mode::Yielded;
        let severity = match row.severity {
            _ if !begins => Severity::Info,
            Severity::Emergency | Severity::Critical | Severity::Error if !in_flight => {
                Severity::Warning
            }
            severity => severity,
        };
        let number = if begins { CONDITION_BEGINS } else { CONDITION_ENDS };
        let argument = [u8::try_from(index).unwrap_or(u8::MAX)];
        out.event(around.at, number, severity.into(), &[&argument]);
        let sight = around.sight(self, out);
        let text = if begins { (row.words)(&sight) } else { row.over.to_owned() };
        if !text.is_empty() {
            out.say(around.at, severity, text);
        }
    }
}
