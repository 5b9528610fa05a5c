//! A row of the list: what is watched for, for how long, and what is done about it.

use haltere_dialect::mav::haltere::MavSysStatusSensor;

use super::reaction::Reaction;
use crate::config::PilotConfig;
use crate::flight::modes::Mode;
use crate::out::voice::Severity;
use crate::view::Sight;

/// When a condition is looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Watched {
    /// Always, on the floor too.
    Always,
    /// From arming to disarming.
    Armed,
    /// While motors may turn, or the board flies by itself.
    Flight,
    /// From the take-off on.
    Air,
    /// In these modes.
    In(&'static [Mode]),
}

impl Watched {
    /// Whether it is looked for in this mode.
    pub fn holds(self, mode: Mode) -> bool {
        match self {
            Watched::Always => true,
            Watched::Armed => !matches!(mode, Mode::Disarmed | Mode::Arming | Mode::Disarming),
            Watched::Flight => mode.has_thrust() || mode == Mode::Yielded,
            Watched::Air => (mode.has_thrust() && mode != Mode::Spool) || mode == Mode::Yielded,
            Watched::In(modes) => modes.contains(&mode),
        }
    }
}

/// A number that a condition depends on.
#[derive(Clone, Copy)]
pub struct Number {
    /// Key of the configuration; empty: fixed.
    pub key: &'static str,
    /// Its value under a configuration.
    pub value: fn(&PilotConfig) -> f64,
    /// Unit; empty: none.
    pub unit: &'static str,
    /// Where its default comes from.
    pub origin: &'static str,
}

/// One row.
pub struct Condition {
    /// Name in lists and events.
    pub name: &'static str,
    /// How it is seen, for people.
    pub seen_by: &'static str,
    /// Numbers in that.
    pub numbers: &'static [Number],
    /// How long it must be seen without a pause, s.
    pub lasts_s: fn(&PilotConfig) -> f64,
    /// How long it must be gone to be over, s; at 0 it is over at once.
    pub gone_s: f64,
    /// Once there, it stays until the vehicle is disarmed.
    pub latched: bool,
    /// When it is looked for.
    pub watched: Watched,
    /// What it wants in flight.
    pub wanted: fn(&PilotConfig) -> Reaction,
    /// The reason, in the text of the change of mode and in refusals.
    pub because: &'static str,
    /// Told when it is over.
    pub over: &'static str,
    /// Bits of SYS_STATUS that it takes away.
    pub health: MavSysStatusSensor,
    pub(crate) severity: Severity,
    pub(crate) is_seen: fn(&Sight<'_>) -> bool,
    /// Told when it begins.
    pub(crate) words: fn(&Sight<'_>) -> String,
}

impl Condition {
    /// What it comes to in a mode.
    pub fn reaction(&self, mode: Mode, config: &PilotConfig) -> Reaction {
        if !self.watched.holds(mode) {
            return Reaction::Nothing;
        }
        (self.wanted)(config).max(Reaction::Tell).in_mode(mode)
    }

    /// MAVLink severity of its first text in flight; on the floor it is at most a warning.
    pub fn severity(&self) -> u8 {
        self.severity as u8
    }
}

impl std::fmt::Debug for Condition {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Condition").field("name", &self.name).finish_non_exhaustive()
    }
}

/// What most rows have in common.
pub(super) const ROW: Condition = Condition {
    name: "",
    seen_by: "",
    numbers: &[],
    lasts_s: |_| 0.0,
    gone_s: 0.3,
    latched: false,
    watched: Watched::Flight,
    wanted: |_| Reaction::Tell,
    because: "",
    over: "",
    health: MavSysStatusSensor::empty(),
    severity: Severity::Warning,
    is_seen: |_| false,
    words: |_| String::new(),
};
