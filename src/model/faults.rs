//! Faults: things that break in flight, by call or by `MAV_CMD_INJECT_FAILURE`.

use haltere_core::checks::Problems;
use haltere_dialect::mav::haltere::{FailureType, FailureUnit};
use nalgebra::Vector3;

use crate::gust::Gust;
use crate::line_noise::LineNoise;
use crate::random::Stream;

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
    /// Single wild samples among good ones.
    Spike,
}

/// A one-way line of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineId {
    /// From the tag to the companion.
    FromTag,
    /// From the board to the companion.
    FromBoard,
    /// From the companion to the board.
    ToBoard,
}

/// What happens to a Crazyflie, its radio or its anchors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CrazyflieFault {
    /// Nothing passes by radio for so long, s.
    Fade {
        /// How long.
        for_s: f64,
    },
    /// The UWB chip does not answer.
    ChipDead(bool),
    /// The log blocks are gone.
    BlocksGone,
    /// The main processor restarts; the radio's goes on.
    MainReset,
    /// The radio's processor restarts; the main one goes on.
    RadioReset,
    /// The radio carries less than is sent.
    Congested(bool),
    /// It restarts with another firmware: other ids, other checksums.
    OtherTable,
    /// Somebody else connects and sends setpoints.
    SecondClient(bool),
    /// Somebody disarms it.
    Disarm,
    /// It takes itself for crashed.
    Crash,
    /// It is locked until it is restarted.
    Lock,
    /// A deck does not answer.
    DeckFault(bool),
    /// The anchors speak TDoA3.
    Tdoa3(bool),
    /// The anchors say that they stand so far from where they do, their own world, m.
    AnchorsOff([f64; 3]),
    /// The dongle is out.
    DongleOut(bool),
    /// Its firmware is older than the supervisor's port.
    NoPort9(bool),
}

impl CrazyflieFault {
    /// What mends it. `None`: it passes by itself, or has no state to go back to.
    pub fn mended(&self) -> Option<Self> {
        Some(match self {
            Self::ChipDead(_) => Self::ChipDead(false),
            Self::Congested(_) => Self::Congested(false),
            Self::SecondClient(_) => Self::SecondClient(false),
            Self::DeckFault(_) => Self::DeckFault(false),
            Self::Tdoa3(_) => Self::Tdoa3(false),
            Self::AnchorsOff(_) => Self::AnchorsOff([0.0; 3]),
            Self::DongleOut(_) => Self::DongleOut(false),
            Self::NoPort9(_) => Self::NoPort9(false),
            Self::Fade { .. }
            | Self::BlocksGone
            | Self::MainReset
            | Self::RadioReset
            | Self::OtherTable
            | Self::Disarm
            | Self::Crash
            | Self::Lock => return None,
        })
    }
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
    /// A line loses, delays, repeats, swaps or damages what it carries.
    LineNoise {
        /// Which.
        line: LineId,
        /// What it does.
        noise: LineNoise,
    },
    /// A gust begins.
    Gust(Gust),
    /// A sensor that works reads something else than what is: unit, scale, offset, sign, axes.
    Misread(Sensor, Misreading),
    /// The tag says what it heard in the last so many seconds again and again; `None`: what it hears.
    TagReplay(Option<TagReplay>),
    /// So many of the board's next heartbeats, the first of them at once, say that it is disarmed.
    FalseBeats(u32),
    /// A second board with the system id of ours is on the line: it stands on the floor, disarmed.
    SecondBoard(Option<SecondVoice>),
    /// The board tells a second pack of this voltage beside the one it flies on, V.
    SecondPack(Option<f64>),
    /// The board's heading is off by this angle, clockwise, and stays so, rad.
    HeadingOff(f64),
    /// Something that only a Crazyflie has.
    Crazyflie(CrazyflieFault),
    /// A leg of the gear is broken: where it stands on the floor, it falls over to its right.
    GearLeg(bool),
}

/// A sensor as the board reports it; it flies on others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sensor {
    /// Accelerometer, m/s², body axes.
    Accelerometer,
    /// Gyroscope, rad/s, body axes.
    Gyroscope,
    /// Both together: the IMU.
    Imu,
    /// Barometer, Pa, on the first axis.
    Barometer,
    /// Voltage and current of the pack, V and A, on the first two axes.
    Battery,
    /// The attitude that is said; of a misreading the rotation nearest to its matrix.
    Attitude,
}

/// What a sensor reads of the true value y: `M y + o`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Misreading {
    /// M, by rows.
    pub matrix: [[f64; 3]; 3],
    /// o, in the unit of the sensor.
    pub offset: [f64; 3],
}

impl Misreading {
    /// What is.
    pub const NONE: Self =
        Self { matrix: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], offset: [0.0; 3] };

    /// So many times what is, by axis.
    pub fn scale([x, y, z]: [f64; 3]) -> Self {
        Self { matrix: [[x, 0.0, 0.0], [0.0, y, 0.0], [0.0, 0.0, z]], ..Self::NONE }
    }

    /// The value read.
    pub fn of(&self, y: &Vector3<f64>) -> Vector3<f64> {
        let dot = |row: &[f64; 3]| row[0] * y.x + row[1] * y.y + row[2] * y.z;
        let [x, y, z] = &self.matrix;
        Vector3::new(dot(x), dot(y), dot(z)) + Vector3::from(self.offset)
    }

    /// Says what is out of range.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        for value in self.matrix.iter().flatten() {
            problems.range(format_args!("{key}.scale"), *value, -1000.0..=1000.0, "");
        }
        for value in self.offset {
            problems.range(format_args!("{key}.offset"), value, -2e5..=2e5, "");
        }
    }
}

/// What a tag says again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TagReplay {
    /// Length of the stretch, s.
    pub window_s: f64,
    /// Whether its receive times go on, or come again as well.
    pub times_go_on: bool,
}

/// How much a second board says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SecondVoice {
    /// Its heartbeat.
    Heartbeat,
    /// All that ours says.
    Everything,
}

/// Voltage that a broken cell takes away, V. Half of a loaded pack of two.
const CELL_LOSS_V: f64 = 3.5;
/// Voltage that an ageing pack loses, V.
const WEAK_BATTERY_V: f64 = 0.6;
/// Share of thrust that a torn wing keeps.
const TORN_WING: f64 = 0.85;

/// Share of wild samples: at 250 Hz two or three a second.
const SPIKE_SHARE: f64 = 0.01;
/// Size of one, typical errors: 60 m/s², 6 rad/s, 400 Pa.
const SPIKE_SIZE: f64 = 20.0;

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
    /// The accelerometer reads so many times what it should, by body axis.
    pub fn accelerometer_scale(scale: [f64; 3]) -> Self {
        Fault::Misread(Sensor::Accelerometer, Misreading::scale(scale))
    }

    /// What mends it. `None`: it passes by itself, or has no state to go back to.
    pub fn mended(&self) -> Option<Fault> {
        let healthy = FaultKind::Healthy;
        Some(match self {
            Fault::Accelerometer(_) => Fault::Accelerometer(healthy),
            Fault::Gyroscope(_) => Fault::Gyroscope(healthy),
            Fault::Barometer(_) => Fault::Barometer(healthy),
            Fault::WingThrust { wing, .. } => Fault::WingThrust { wing: *wing, gain: 1.0 },
            Fault::Servos(_) => Fault::Servos(healthy),
            Fault::BatteryDrop(_) => Fault::BatteryDrop(0.0),
            Fault::BoardLink(_) => Fault::BoardLink(healthy),
            Fault::TagSilent(_) => Fault::TagSilent(false),
            Fault::AnchorSilent { anchor, .. } => {
                Fault::AnchorSilent { anchor: *anchor, silent: false }
            }
            Fault::EffectOn { id, .. } => Fault::EffectOff(id.clone()),
            Fault::ToBoard(_) => Fault::ToBoard(healthy),
            Fault::LineNoise { line, .. } => {
                Fault::LineNoise { line: *line, noise: LineNoise::default() }
            }
            Fault::Misread(sensor, _) => Fault::Misread(*sensor, Misreading::NONE),
            Fault::TagReplay(_) => Fault::TagReplay(None),
            Fault::SecondBoard(_) => Fault::SecondBoard(None),
            Fault::SecondPack(_) => Fault::SecondPack(None),
            Fault::HeadingOff(_) => Fault::HeadingOff(0.0),
            Fault::Crazyflie(fault) => Fault::Crazyflie(fault.mended()?),
            Fault::GearLeg(_) => Fault::GearLeg(false),
            Fault::EffectOff(_)
            | Fault::BoardReboot
            | Fault::BoardMode(_)
            | Fault::FalseBeats(_)
            | Fault::Gust(_) => return None,
        })
    }

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
    /// What it makes of the true value, whatever else is wrong.
    misreading: Misreading,
    /// Size of a typical error, unit of the sensor.
    scale: f64,
    /// Axes that carry a value, the first ones.
    axes: usize,
    rng: Stream,
}

impl SensorFault {
    /// Sound. `scale`: size of a typical error in the sensor's unit.
    pub fn new(scale: f64, seed: u64, name: &str) -> Self {
        Self {
            kind: FaultKind::Healthy,
            since_s: 0.0,
            held: Vector3::zeros(),
            misreading: Misreading::NONE,
            scale,
            axes: 3,
            rng: Stream::new(seed, name),
        }
    }

    /// With a value on the first axis alone.
    pub fn of_one_axis(mut self) -> Self {
        self.axes = 1;
        self
    }

    /// Breaks or heals it at time `t_s`.
    pub fn set(&mut self, kind: FaultKind, t_s: f64) {
        self.kind = kind;
        self.since_s = t_s;
    }

    /// It makes this of the true value.
    pub fn misread(&mut self, misreading: Misreading) {
        self.misreading = misreading;
    }

    /// What it reads for the value `y`; `false`: nothing new.
    #[inline]
    pub fn apply(&mut self, t_s: f64, y: &mut Vector3<f64>) -> bool {
        let age_s = t_s - self.since_s;
        *y = self.misreading.of(y);
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
            FaultKind::Spike => {
                if self.rng.uniform() < SPIKE_SHARE {
                    let axis = (self.rng.uniform() * self.axes as f64) as usize;
                    let size = if self.rng.uniform() < 0.5 { SPIKE_SIZE } else { -SPIKE_SIZE };
                    y[axis] += size * self.scale;
                }
                self.held = *y;
            }
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
    fn prop_a_gain_acts_on_its_axis_whatever_else_is_wrong() {
        let mut sensor = SensorFault::new(2.0, 1, "test");
        sensor.misread(Misreading::scale([1.0, 1.0, 3.0]));
        let mut read = |kind| {
            sensor.set(kind, 0.0);
            let mut y = Vector3::new(1.0, 0.5, -9.8);
            sensor.apply(0.0, &mut y);
            y
        };
        assert_eq!(read(FaultKind::Healthy), Vector3::new(1.0, 0.5, -9.8 * 3.0));
        assert_eq!(read(FaultKind::Wrong).z, -9.8 * 3.0 + 2.0);
    }

    #[test]
    fn prop_spikes_are_rare_and_large() {
        let mut sensor = SensorFault::new(3.0, 1, "test");
        sensor.set(FaultKind::Spike, 0.0);
        let mut wild = 0;
        for _ in 0..10_000 {
            let mut y = Vector3::new(1.0, 0.0, -9.8);
            assert!(sensor.apply(1.0, &mut y), "every sample comes");
            let off = (y - Vector3::new(1.0, 0.0, -9.8)).norm();
            wild += u32::from(off > 0.0);
            assert!(off == 0.0 || (off - 60.0).abs() < 1e-9, "{off}");
        }
        assert!((60..140).contains(&wild), "{wild}");
        let mut barometer = SensorFault::new(20.0, 1, "test").of_one_axis();
        barometer.set(FaultKind::Spike, 0.0);
        (0..1000).for_each(|_| {
            let mut pressure = Vector3::new(101_325.0, 0.0, 0.0);
            barometer.apply(1.0, &mut pressure);
            assert_eq!((pressure.y, pressure.z), (0.0, 0.0), "a barometer has one axis");
        });
    }

    #[test]
    fn prop_what_is_mended_is_as_before() {
        let broken = Fault::WingThrust { wing: Some(1), gain: 0.3 };
        assert_eq!(broken.mended(), Some(Fault::WingThrust { wing: Some(1), gain: 1.0 }));
        let noise = LineNoise { lost: 0.1, ..LineNoise::default() };
        let noisy = Fault::LineNoise { line: LineId::ToBoard, noise };
        let quiet = Fault::LineNoise { line: LineId::ToBoard, noise: LineNoise::default() };
        assert_eq!(noisy.mended(), Some(quiet));
        assert_eq!(Fault::BoardReboot.mended(), None);
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
