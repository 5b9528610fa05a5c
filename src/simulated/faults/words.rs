//! Words of a scenario's `[[fault]]`.

use haltere_model::faults::{CrazyflieFault, FaultKind, LineId, SecondVoice, Sensor};
use serde::{Deserialize, Serialize};

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
    /// Is about to meet the floor, meets it, and stops its wings.
    Touchdown,
}

impl Phase {
    /// Every phase, in the order of a flight.
    pub const ALL: [Phase; 7] = [
        Phase::Spool,
        Phase::Climb,
        Phase::Hover,
        Phase::Waypoints,
        Phase::Return,
        Phase::Landing,
        Phase::Touchdown,
    ];

    /// Name in files and tables.
    pub fn name(self) -> &'static str {
        match self {
            Phase::Spool => "spool",
            Phase::Climb => "climb",
            Phase::Hover => "hover",
            Phase::Waypoints => "waypoints",
            Phase::Return => "return",
            Phase::Landing => "landing",
            Phase::Touchdown => "touchdown",
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
    /// Scale of the accelerometer; needs `scale`.
    AccelerometerScale,
    /// A sensor that works reads something else; needs `sensor`, and one or more of `scale`, `axes`, `turn_deg`, `offset`.
    Misread,
    /// The tag says its last `window_s` again and again; `times_go_on`.
    TagReplay,
    /// Heartbeats of the board that say disarmed; `count`, 1 without it.
    FalseHeartbeat,
    /// A second board with the system id of ours; `voice`, everything without it.
    SecondBoard,
    /// A second pack; needs `pack_v`.
    SecondPack,
    /// The board's heading; needs `angle_deg`.
    Heading,
    /// A leg of the gear, `off` or `healthy`.
    Gear,
    /// A Crazyflie, its radio or its anchors; needs `event`.
    Crazyflie,
    /// The companion's computer stands still; needs `length_s`, and a `phase`.
    Pause,
    /// A station sends `MAV_CMD_INJECT_FAILURE`; needs `unit`, and a `phase`.
    InjectFailure,
    /// A station draws a fence across the way of a mode and asks for that mode; needs `way`, and a `phase`.
    Fence,
    /// A station asks for a place outside of the flight volume; needs `way` goto or offboard, and a `phase`.
    Outside,
    /// A station puts home where the fence forbids it and asks for the return; needs a `phase`.
    Home,
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

/// A sensor that misreads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SensorName {
    /// Accelerometer, m/s².
    Accelerometer,
    /// Gyroscope, rad/s.
    Gyroscope,
    /// Accelerometer and gyroscope alike.
    Imu,
    /// Barometer, Pa, on the first axis.
    Barometer,
    /// Voltage and current, V and A, on the first two axes.
    Battery,
    /// The board's attitude: turns alone.
    Attitude,
}

impl SensorName {
    /// As the plant knows it.
    pub fn sensor(self) -> Sensor {
        match self {
            SensorName::Accelerometer => Sensor::Accelerometer,
            SensorName::Gyroscope => Sensor::Gyroscope,
            SensorName::Imu => Sensor::Imu,
            SensorName::Barometer => Sensor::Barometer,
            SensorName::Battery => Sensor::Battery,
            SensorName::Attitude => Sensor::Attitude,
        }
    }
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

/// How much a second board says.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Voice {
    /// Its heartbeat.
    Heartbeat,
    /// All that ours says.
    Everything,
}

impl State {
    /// As sensors and parts know it.
    pub fn kind(self) -> FaultKind {
        match self {
            State::Healthy => FaultKind::Healthy,
            State::Off => FaultKind::Off,
            State::Stuck => FaultKind::Stuck,
            State::Garbage => FaultKind::Garbage,
            State::Wrong => FaultKind::Wrong,
            State::Intermittent => FaultKind::Intermittent,
            State::Drift => FaultKind::Drift,
            State::Spike => FaultKind::Spike,
        }
    }
}

impl LineName {
    /// As the plant knows it.
    pub fn id(self) -> LineId {
        match self {
            LineName::FromTag => LineId::FromTag,
            LineName::FromBoard => LineId::FromBoard,
            LineName::ToBoard => LineId::ToBoard,
        }
    }
}

impl Voice {
    /// As the plant knows it.
    pub fn second(self) -> SecondVoice {
        match self {
            Voice::Heartbeat => SecondVoice::Heartbeat,
            Voice::Everything => SecondVoice::Everything,
        }
    }
}

/// What happens to a Crazyflie, its radio or its anchors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Event {
    /// Nothing passes by radio; needs `length_s`.
    Fade,
    /// The UWB chip does not answer.
    ChipDead,
    /// The log blocks are gone.
    BlocksGone,
    /// The main processor restarts.
    MainReset,
    /// The radio's processor restarts.
    RadioReset,
    /// The radio carries less than is sent.
    Congested,
    /// It restarts with other tables.
    OtherTable,
    /// Somebody else connects and sends setpoints.
    SecondClient,
    /// Somebody disarms it.
    Disarm,
    /// It takes itself for crashed.
    Crash,
    /// It is locked until it is restarted.
    Lock,
    /// A deck does not answer.
    DeckFault,
    /// The anchors speak TDoA3.
    Tdoa3,
    /// The anchors say that they stand somewhere else; needs `offset`: their own x, y, z.
    AnchorsOff,
    /// The dongle is out.
    DongleOut,
    /// Its firmware is older than the supervisor's port.
    NoPort9,
}

impl Event {
    /// As the plant takes it, or what mends it; `for_s` and `off_m` where it needs them.
    pub fn fault(self, on: bool, for_s: f64, off_m: [f64; 3]) -> CrazyflieFault {
        match self {
            Self::Fade => CrazyflieFault::Fade { for_s: if on { for_s } else { 0.0 } },
            Self::ChipDead => CrazyflieFault::ChipDead(on),
            Self::BlocksGone => CrazyflieFault::BlocksGone,
            Self::MainReset => CrazyflieFault::MainReset,
            Self::RadioReset => CrazyflieFault::RadioReset,
            Self::Congested => CrazyflieFault::Congested(on),
            Self::OtherTable => CrazyflieFault::OtherTable,
            Self::SecondClient => CrazyflieFault::SecondClient(on),
            Self::Disarm => CrazyflieFault::Disarm,
            Self::Crash => CrazyflieFault::Crash,
            Self::Lock => CrazyflieFault::Lock,
            Self::DeckFault => CrazyflieFault::DeckFault(on),
            Self::Tdoa3 => CrazyflieFault::Tdoa3(on),
            Self::AnchorsOff => CrazyflieFault::AnchorsOff(if on { off_m } else { [0.0; 3] }),
            Self::DongleOut => CrazyflieFault::DongleOut(on),
            Self::NoPort9 => CrazyflieFault::NoPort9(on),
        }
    }
}
