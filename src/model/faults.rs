//! Faults: things that break in flight, by call or by `MAV_CMD_INJECT_FAILURE`.

use haltere_dialect::mav::haltere::{FailureType, FailureUnit};
use nalgebra::Vector3;

use crate::model::random::Stream;

/// How a sensor or part misbehaves; meanings of MAVLink's `FAILURE_TYPE`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FaultKind {
    /// Sound again.
    Healthy,
    /// Gives nothing.
    Off,
    /// Holds its last value.
    Stuck,
    /// Random values.
    Garbage,
    /// Constant wrong offset or reduced effect.
    Wrong,
    /// Comes and goes, one second each.
    Intermittent,
    /// Offset that grows.
    Drift,
}

/// Something that breaks or heals.
#[derive(Debug, Clone, PartialEq)]
pub enum Fault {
    /// Accelerometer as reported.
    Accelerometer(FaultKind),
    /// Gyroscope as reported; the inner loops fly on another.
    Gyroscope(FaultKind),
    /// Barometer.
    Barometer(FaultKind),
    /// Thrust of a wing (0 left, 1 right; `None` both) falls to this share.
    WingThrust {
        /// Which.
        wing: Option<usize>,
        /// What is left, 0 to 1.
        gain: f64,
    },
    /// Both servos.
    Servos(FaultKind),
    /// Supply sinks by this much at once, V.
    BatteryDrop(f64),
    /// Link between board and companion.
    BoardLink(FaultKind),
    /// Power of the tag is cut, or comes back.
    TagSilent(bool),
    /// An anchor (by id) falls silent, or comes back.
    AnchorSilent {
        /// Id of the anchor.
        anchor: u8,
        /// Silent or back.
        silent: bool,
    },
    /// An effect of the list switches on, with values by name.
    EffectOn {
        /// Id in the list.
        id: String,
        /// Parameters by name; the others keep their defaults.
        values: Vec<(String, f64)>,
    },
    /// An effect of the list switches off.
    EffectOff(String),
    /// The board restarts: disarmed, its clock at zero, all intervals forgotten.
    BoardReboot,
    /// The mode switch of a remote control puts the board into this mode (its own number).
    BoardMode(u32),
    /// The way from the companion to the board only.
    ToBoard(FaultKind),
}

/// Voltage that a broken cell takes away, V. Half of a loaded pack of two.
const CELL_LOSS_V: f64 = 3.5;
/// Voltage that an ageing pack loses, V.
const WEAK_BATTERY_V: f64 = 0.6;
/// Share of thrust that a torn wing keeps.
const TORN_WING: f64 = 0.85;

/// Kinds of failure that the simulator knows.
const KINDS: [(FailureType, FaultKind); 7] = [
    (FailureType::FAILURE_TYPE_OK, FaultKind::Healthy),
    (FailureType::FAILURE_TYPE_OFF, FaultKind::Off),
    (FailureType::FAILURE_TYPE_STUCK, FaultKind::Stuck),
    (FailureType::FAILURE_TYPE_GARBAGE, FaultKind::Garbage),
    (FailureType::FAILURE_TYPE_WRONG, FaultKind::Wrong),
    (FailureType::FAILURE_TYPE_INTERMITTENT, FaultKind::Intermittent),
    (FailureType::FAILURE_TYPE_DRIFT, FaultKind::Drift),
];
/// Units that the simulator can break.
const UNITS: [FailureUnit; 9] = [
    FailureUnit::FAILURE_UNIT_SENSOR_ACCEL,
    FailureUnit::FAILURE_UNIT_SENSOR_GYRO,
    FailureUnit::FAILURE_UNIT_SENSOR_BARO,
    FailureUnit::FAILURE_UNIT_SENSOR_VIO,
    FailureUnit::FAILURE_UNIT_SYSTEM_BATTERY,
    FailureUnit::FAILURE_UNIT_SYSTEM_MOTOR,
    FailureUnit::FAILURE_UNIT_SYSTEM_ESC,
    FailureUnit::FAILURE_UNIT_SYSTEM_SERVO,
    FailureUnit::FAILURE_UNIT_SYSTEM_MAVLINK_SIGNAL,
];

impl Fault {
    /// What `MAV_CMD_INJECT_FAILURE` asks for; `None` when this board cannot fail that way.
    /// Positioning (`VIO`) stands for the tag. `instance`: 0 all, motors 1 left and 2 right.
    pub fn from_command(unit: u32, kind: u32, instance: u8) -> Option<Self> {
        let (_, fault) = KINDS.into_iter().find(|(wire, _)| *wire as u32 == kind)?;
        let unit = UNITS.into_iter().find(|u| *u as u32 == unit)?;
        match unit {
            FailureUnit::FAILURE_UNIT_SENSOR_ACCEL => Some(Fault::Accelerometer(fault)),
            FailureUnit::FAILURE_UNIT_SENSOR_GYRO => Some(Fault::Gyroscope(fault)),
            FailureUnit::FAILURE_UNIT_SENSOR_BARO => Some(Fault::Barometer(fault)),
            FailureUnit::FAILURE_UNIT_SYSTEM_BATTERY => Some(Fault::BatteryDrop(match fault {
                FaultKind::Healthy => 0.0,
                FaultKind::Off => CELL_LOSS_V,
                _ => WEAK_BATTERY_V,
            })),
            FailureUnit::FAILURE_UNIT_SYSTEM_MOTOR | FailureUnit::FAILURE_UNIT_SYSTEM_ESC => {
                let wing = match instance {
                    0 => None,
                    1 | 2 => Some(usize::from(instance - 1)),
                    _ => return None,
                };
                let gain = match fault {
                    FaultKind::Healthy => 1.0,
                    FaultKind::Off => 0.0,
                    _ => TORN_WING,
                };
                Some(Fault::WingThrust { wing, gain })
            }
            FailureUnit::FAILURE_UNIT_SYSTEM_SERVO => Some(Fault::Servos(fault)),
            FailureUnit::FAILURE_UNIT_SYSTEM_MAVLINK_SIGNAL => Some(Fault::BoardLink(fault)),
            FailureUnit::FAILURE_UNIT_SENSOR_VIO => {
                Some(Fault::TagSilent(fault != FaultKind::Healthy))
            }
            _ => None,
        }
    }
}

/// A sensor of up to three axes that may be broken.
#[derive(Debug, Clone)]
pub struct SensorFault {
    kind: FaultKind,
    since_s: f64,
    held: Vector3<f64>,
    /// Size of a typical error, unit of the sensor.
    scale: f64,
    rng: Stream,
}

impl SensorFault {
    /// Sound. `scale`: size of a typical error in the sensor's unit.
    pub fn new(scale: f64, seed: u64, name: &str) -> Self {
        Self {
            kind: FaultKind::Healthy,
            since_s: 0.0,
            held: Vector3::zeros(),
            scale,
            rng: Stream::new(seed, name),
        }
    }

    /// Breaks or heals it at time `t_s`.
    pub fn set(&mut self, kind: FaultKind, t_s: f64) {
        self.kind = kind;
        self.since_s = t_s;
    }

    /// What it reads for the value `y`; `false`: nothing new.
    #[inline]
    pub fn apply(&mut self, t_s: f64, y: &mut Vector3<f64>) -> bool {
        let age_s = t_s - self.since_s;
        match self.kind {
            FaultKind::Healthy => {
                self.held = *y;
                return true;
            }
            FaultKind::Off => {
                *y = Vector3::zeros();
                return false;
            }
            FaultKind::Stuck => *y = self.held,
            FaultKind::Garbage => {
                *y = Vector3::from_fn(|_, _| 5.0 * self.scale * self.rng.normal())
            }
            FaultKind::Wrong => y.iter_mut().for_each(|c| *c += self.scale),
            FaultKind::Intermittent => {
                if off_phase(age_s) {
                    *y = self.held;
                    return false;
                }
                self.held = *y;
            }
            FaultKind::Drift => y.iter_mut().for_each(|c| *c += 0.1 * self.scale * age_s),
        }
        true
    }
}

/// Whether an intermittent fault is in its bad second.
pub fn off_phase(age_s: f64) -> bool {
    age_s.rem_euclid(2.0) < 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_sensors_break_and_heal() {
        let mut sensor = SensorFault::new(2.0, 1, "test");
        let mut read = |kind, t_s| {
            sensor.set(kind, 10.0);
            let mut y = Vector3::new(1.0, 0.0, -9.8);
            (sensor.apply(t_s, &mut y), y)
        };
        assert_eq!(read(FaultKind::Healthy, 10.0), (true, Vector3::new(1.0, 0.0, -9.8)));
        assert_eq!(read(FaultKind::Off, 11.0), (false, Vector3::zeros()));
        assert_eq!(read(FaultKind::Wrong, 11.0).1.x, 3.0);
        assert_eq!(read(FaultKind::Drift, 20.0).1.x, 3.0);
        assert!(!read(FaultKind::Intermittent, 10.5).0 && read(FaultKind::Intermittent, 11.5).0);
        assert_eq!(read(FaultKind::Healthy, 30.0).1.z, -9.8);
    }

    #[test]
    fn prop_commands_map_or_are_refused() {
        let (motor, gps, off) = (101, 4, 1); // numbers of MAVLink's `common`
        let right = Some(Fault::WingThrust { wing: Some(1), gain: 0.0 });
        assert_eq!(Fault::from_command(motor, off, 2), right);
        assert_eq!(Fault::from_command(motor, off, 3), None);
        assert_eq!(Fault::from_command(gps, off, 0), None);
        assert_eq!(Fault::from_command(motor, 99, 0), None);
    }
}
