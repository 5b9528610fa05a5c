//! Failures of a scenario, `[[fault]]`: what breaks, how, and when.

use haltere::checks::Problems;
use haltere::model::faults::FaultKind;
use haltere::model::{Fault, Plant};
use serde::{Deserialize, Serialize};

/// One failure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultAt {
    /// Simulated time, s.
    pub at_s: f64,
    /// What breaks.
    pub part: Part,
    /// How; `healthy` mends it.
    #[serde(default = "off")]
    pub state: State,
    /// Which wing; absent: both.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wing: Option<Wing>,
    /// Share of thrust that a broken wing keeps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// Voltage that the battery loses, V.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drop_v: Option<f64>,
    /// Mode that somebody else puts the board into, by its own number.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mode: Option<u32>,
    /// Which anchor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub anchor: Option<u8>,
}

/// What can break.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Part {
    /// Accelerometer as reported.
    Accelerometer,
    /// Gyroscope as reported.
    Gyroscope,
    /// Barometer.
    Barometer,
    /// Both servos.
    Servos,
    /// Link between board and companion.
    BoardLink,
    /// The way from the companion to the board only.
    ToBoard,
    /// The board restarts.
    BoardReboot,
    /// Somebody else puts the board into a mode; needs `mode`.
    BoardMode,
    /// Thrust of a wing; needs `gain`.
    Wing,
    /// Supply; needs `drop_v`.
    Battery,
    /// The UWB tag, `off` or `healthy`.
    Tag,
    /// An anchor, `off` or `healthy`; needs `anchor`.
    Anchor,
}

/// How a part misbehaves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// Sound again.
    Healthy,
    /// Gives nothing.
    Off,
    /// Holds its last value.
    Stuck,
    /// Random values.
    Garbage,
    /// Constant wrong offset.
    Wrong,
    /// Comes and goes.
    Intermittent,
    /// Offset that grows.
    Drift,
}

/// Sides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Wing {
    /// Left.
    Left,
    /// Right.
    Right,
}

fn off() -> State {
    State::Off
}

impl FaultAt {
    /// Breaks or mends what it names, now. It was checked when the scenario was read; an effect that cannot
    /// switch is told.
    pub fn happen(&self, plant: &mut Plant) {
        let mut problems = Problems::new();
        if let Some(fault) = self.to_fault("fault", &mut problems) {
            tracing::info!("fault at {:.3} s: {fault:?}", self.at_s);
            if let Err(why) = plant.inject(fault) {
                tracing::warn!("fault refused: {why}");
            }
        }
    }

    /// As the plant takes it; says what is missing or out of range.
    pub fn to_fault(&self, key: &str, problems: &mut Problems) -> Option<Fault> {
        problems.range(format_args!("{key}.at_s"), self.at_s, 0.0..=36_000.0, "s");
        let kind = match self.state {
            State::Healthy => FaultKind::Healthy,
            State::Off => FaultKind::Off,
            State::Stuck => FaultKind::Stuck,
            State::Garbage => FaultKind::Garbage,
            State::Wrong => FaultKind::Wrong,
            State::Intermittent => FaultKind::Intermittent,
            State::Drift => FaultKind::Drift,
        };
        let mut silent = || {
            if !matches!(self.state, State::Off | State::Healthy) {
                problems.say(format!("{key}.state: this part can be \"off\" or \"healthy\""));
            }
            self.state == State::Off
        };
        let fault = match self.part {
            Part::Accelerometer => Fault::Accelerometer(kind),
            Part::Gyroscope => Fault::Gyroscope(kind),
            Part::Barometer => Fault::Barometer(kind),
            Part::Servos => Fault::Servos(kind),
            Part::BoardLink => Fault::BoardLink(kind),
            Part::ToBoard => Fault::ToBoard(kind),
            Part::BoardReboot => Fault::BoardReboot,
            Part::BoardMode => Fault::BoardMode(need(self.mode, key, "mode", problems)?),
            Part::Tag => Fault::TagSilent(silent()),
            Part::Anchor => {
                let silent = silent();
                Fault::AnchorSilent { anchor: need(self.anchor, key, "anchor", problems)?, silent }
            }
            Part::Battery => {
                let drop_v = need(self.drop_v, key, "drop_v", problems)?;
                problems.range(format_args!("{key}.drop_v"), drop_v, 0.0..=10.0, "V");
                Fault::BatteryDrop(drop_v)
            }
            Part::Wing => {
                let gain = need(self.gain, key, "gain", problems)?;
                problems.range(format_args!("{key}.gain"), gain, 0.0..=2.0, "");
                let wing = self.wing.map(|wing| usize::from(wing == Wing::Right));
                Fault::WingThrust { wing, gain }
            }
        };
        Some(fault)
    }
}

fn need<T>(value: Option<T>, key: &str, field: &str, problems: &mut Problems) -> Option<T> {
    if value.is_none() {
        problems.say(format!("{key}.{field} is missing, this part needs it"));
    }
    value
}
