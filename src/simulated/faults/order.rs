//! What somebody at a station does that a vehicle should not suffer from.

use haltere_dialect::mav::haltere::{FailureType, FailureUnit};
use haltere_model::faults::FaultKind;
use serde::{Deserialize, Serialize};

/// An order, or what is done before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// `MAV_CMD_INJECT_FAILURE`: a test of the bench, sent in flight.
    InjectFailure {
        /// What is to fail.
        unit: Unit,
        /// How.
        kind: FaultKind,
    },
    /// A fence is drawn between the vehicle and where a mode would fly, and that mode is asked for.
    FenceAcross {
        /// The mode.
        way: Way,
        /// The fence.
        shape: Shape,
    },
    /// A place outside of the flight volume is asked for.
    Outside {
        /// In which mode.
        way: Way,
    },
    /// Home is put where the fence forbids it, and the return is asked for.
    ForbiddenHome,
}

/// What a station orders to fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unit {
    /// Accelerometer.
    Accelerometer,
    /// Gyroscope.
    Gyroscope,
    /// Barometer.
    Barometer,
    /// What tells the position.
    Position,
    /// Battery.
    Battery,
    /// Both motors.
    Motor,
    /// Both servos.
    Servo,
    /// The board's link.
    Link,
}

/// A mode by what it flies to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Way {
    /// A place that is asked for.
    Goto,
    /// Home.
    Return,
    /// The next leg of the mission.
    Mission,
    /// Setpoints of a client.
    Offboard,
}

/// A fence.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Shape {
    /// Nobody may be in a circle.
    Circle,
    /// Nobody may be in a square.
    Square,
}

impl Unit {
    /// As MAVLink numbers it.
    pub fn number(self) -> f32 {
        let unit = match self {
            Unit::Accelerometer => FailureUnit::FAILURE_UNIT_SENSOR_ACCEL,
            Unit::Gyroscope => FailureUnit::FAILURE_UNIT_SENSOR_GYRO,
            Unit::Barometer => FailureUnit::FAILURE_UNIT_SENSOR_BARO,
            Unit::Position => FailureUnit::FAILURE_UNIT_SENSOR_VIO,
            Unit::Battery => FailureUnit::FAILURE_UNIT_SYSTEM_BATTERY,
            Unit::Motor => FailureUnit::FAILURE_UNIT_SYSTEM_MOTOR,
            Unit::Servo => FailureUnit::FAILURE_UNIT_SYSTEM_SERVO,
            Unit::Link => FailureUnit::FAILURE_UNIT_SYSTEM_MAVLINK_SIGNAL,
        };
        unit as u32 as f32
    }
}

/// A failure as MAVLink numbers it; spikes have no number there, and are the nearest: garbage.
pub fn failure_number(kind: FaultKind) -> f32 {
    let kind = match kind {
        FaultKind::Healthy => FailureType::FAILURE_TYPE_OK,
        FaultKind::Off => FailureType::FAILURE_TYPE_OFF,
        FaultKind::Stuck => FailureType::FAILURE_TYPE_STUCK,
        FaultKind::Garbage | FaultKind::Spike => FailureType::FAILURE_TYPE_GARBAGE,
        FaultKind::Wrong => FailureType::FAILURE_TYPE_WRONG,
        FaultKind::Intermittent => FailureType::FAILURE_TYPE_INTERMITTENT,
        FaultKind::Drift => FailureType::FAILURE_TYPE_DRIFT,
    };
    kind as u32 as f32
}
