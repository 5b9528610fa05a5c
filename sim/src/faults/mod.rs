//! Failures of a scenario, `[[fault]]`: what breaks, how, and when.

use std::collections::BTreeMap;

use haltere::checks::Problems;
use haltere::frames::Vec3;
use haltere::model::effects::EffectSet;
use haltere::model::faults::{FaultKind, LineId};
use haltere::model::gust::Gust;
use haltere::model::line_noise::LineNoise;
use haltere::model::{Fault, Plant};
use serde::{Deserialize, Serialize};

/// One failure.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultAt {
    /// Simulated time, s; with `phase` the time since that part of the flight began.
    #[serde(default)]
    pub at_s: f64,
    /// Part of the flight in which it happens. Absent: whatever is flown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub phase: Option<Phase>,
    /// It is mended after this time, s. Absent: it stays.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub for_s: Option<f64>,
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
    /// Which line.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub line: Option<LineName>,
    /// Share of the deliveries on a line that is lost.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lost: Option<f64>,
    /// Share that is late, by `late_s`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub late: Option<f64>,
    /// By how much, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub late_s: Option<f64>,
    /// Share that comes twice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub twice: Option<f64>,
    /// Share that is overtaken by the delivery behind it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub swapped: Option<f64>,
    /// Share of which bytes are damaged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub damaged: Option<f64>,
    /// Share in whose place the first one since the fault began comes again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frozen: Option<f64>,
    /// Peak of a gust: room north, east, down, m/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gust_mps: Option<[f64; 3]>,
    /// How long a gust lasts, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_s: Option<f64>,
    /// Effect that switches on, by its id; `healthy` switches it off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub effect: Option<String>,
    /// Values of its parameters.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub values: BTreeMap<String, f64>,
}

/// A part of a flight, as a bystander would tell it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Phase {
    /// Thrust rises on the floor.
    Spool,
    /// Off the floor, on the way to the height of the take-off.
    Climb,
    /// Stays at a place.
    Hover,
    /// From waypoint to waypoint.
    Waypoints,
    /// On the way back.
    Return,
    /// Sinks to the floor.
    Landing,
}

impl Phase {
    /// Every phase, in the order of a flight.
    pub const ALL: [Phase; 6] =
        [Phase::Spool, Phase::Climb, Phase::Hover, Phase::Waypoints, Phase::Return, Phase::Landing];

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Spool => "spool",
            Phase::Climb => "climb",
            Phase::Hover => "hover",
            Phase::Waypoints => "waypoints",
            Phase::Return => "return",
            Phase::Landing => "landing",
        }
    }
}

/// Lines of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum LineName {
    /// Tag to companion.
    FromTag,
    /// Board to companion.
    FromBoard,
    /// Companion to board.
    ToBoard,
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
    /// Noise on a line; needs `line` and one or more of `lost`, `late`, `twice`, `swapped`, `damaged`, `frozen`.
    Line,
    /// A gust; needs `gust_mps` and `length_s`.
    Gust,
    /// An effect of docs/EFFECTS.md; needs `effect`.
    Effect,
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
    /// Single wild samples among good ones.
    Spike,
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

/// Breaks or mends something, now. It was checked when it was read; an effect that cannot switch is told.
pub fn happen(fault: Fault, plant: &mut Plant) {
    tracing::info!("fault at {:.3} s: {fault:?}", plant.t_us() as f64 * 1e-6);
    if let Err(why) = plant.inject(fault) {
        tracing::warn!("fault refused: {why}");
    }
}

impl FaultAt {
    /// As the plant takes it; says what is missing or out of range.
    pub fn to_fault(&self, key: &str, problems: &mut Problems) -> Option<Fault> {
        problems.range(format_args!("{key}.at_s"), self.at_s, 0.0..=36_000.0, "s");
        if let Some(for_s) = self.for_s {
            problems.range(format_args!("{key}.for_s"), for_s, 0.001..=36_000.0, "s");
        }
        let kind = match self.state {
            State::Healthy => FaultKind::Healthy,
            State::Off => FaultKind::Off,
            State::Stuck => FaultKind::Stuck,
            State::Garbage => FaultKind::Garbage,
            State::Wrong => FaultKind::Wrong,
            State::Intermittent => FaultKind::Intermittent,
            State::Drift => FaultKind::Drift,
            State::Spike => FaultKind::Spike,
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
            Part::Line => {
                let line = match need(self.line, key, "line", problems)? {
                    LineName::FromTag => LineId::FromTag,
                    LineName::FromBoard => LineId::FromBoard,
                    LineName::ToBoard => LineId::ToBoard,
                };
                let noise = self.noise();
                noise.check(key, problems);
                if noise.is_quiet() && self.state != State::Healthy {
                    problems.say(format!(
                        "{key}: a line needs one or more of lost, late (with late_s), twice, swapped, \
                         damaged, frozen above 0; or state = \"healthy\""
                    ));
                }
                Fault::LineNoise { line, noise }
            }
            Part::Gust => {
                let peak = need(self.gust_mps, key, "gust_mps", problems)?;
                let length_s = need(self.length_s, key, "length_s", problems)?;
                let gust = Gust { peak_E_mps: Vec3::from_array(peak), length_s };
                gust.check(key, problems);
                Fault::Gust(gust)
            }
            Part::Effect => {
                let id = need(self.effect.clone(), key, "effect", problems)?;
                let values: Vec<_> = self.values.iter().map(|(k, v)| (k.clone(), *v)).collect();
                let named: Vec<_> = values.iter().map(|(k, v)| (k.as_str(), *v)).collect();
                if let Err(more) = EffectSet::none().with(&id, &named) {
                    more.lines().iter().for_each(|line| problems.say(format!("{key}: {line}")));
                    return None;
                }
                match self.state {
                    State::Healthy => Fault::EffectOff(id),
                    _ => Fault::EffectOn { id, values },
                }
            }
        };
        Some(fault)
    }

    fn noise(&self) -> LineNoise {
        if self.state == State::Healthy {
            return LineNoise::default();
        }
        let share = |value: Option<f64>| value.unwrap_or_default();
        LineNoise {
            lost: share(self.lost),
            late: share(self.late),
            late_s: share(self.late_s),
            twice: share(self.twice),
            swapped: share(self.swapped),
            damaged: share(self.damaged),
            frozen: share(self.frozen),
        }
    }
}

fn need<T>(value: Option<T>, key: &str, field: &str, problems: &mut Problems) -> Option<T> {
    if value.is_none() {
        problems.say(format!("{key}.{field} is missing, this part needs it"));
    }
    value
}
