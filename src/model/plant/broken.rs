//! What is broken of the plant, and how it is broken and mended.

use super::Plant;
use super::second_board::SecondBoard;
use crate::faults::{CrazyflieFault, Fault, FaultKind, LineId, Misreading, Sensor, SensorFault};
use crate::gust::Gust;
use crate::tag::MOST_REPLAY_S;
use haltere_core::checks::Problems;

/// Parts that may be broken.
pub(super) struct Broken {
    pub accelerometer: SensorFault,
    pub gyroscope: SensorFault,
    pub barometer: SensorFault,
    pub wing_gain: [f64; 2],
    pub servos: (FaultKind, f64),
    pub battery_drop_v: f64,
    /// What is said of voltage, V, and current, A.
    pub battery: Misreading,
    pub board_link: (FaultKind, f64),
    pub to_board: (FaultKind, f64),
    /// A gust and its begin, s.
    pub gust: Option<(Gust, f64)>,
    pub second_board: Option<Box<SecondBoard>>,
    /// A leg of the gear does not bear.
    pub gear_leg: bool,
}

impl Broken {
    /// All sound.
    pub fn new(seed: u64) -> Self {
        Self {
            accelerometer: SensorFault::new(3.0, seed, "fault-acc"), // m/s²
            gyroscope: SensorFault::new(0.3, seed, "fault-gyro"),    // rad/s
            barometer: SensorFault::new(20.0, seed, "fault-baro").of_one_axis(), // Pa
            wing_gain: [1.0; 2],
            servos: (FaultKind::Healthy, 0.0),
            battery_drop_v: 0.0,
            battery: Misreading::NONE,
            board_link: (FaultKind::Healthy, 0.0),
            to_board: (FaultKind::Healthy, 0.0),
            gust: None,
            second_board: None,
            gear_leg: false,
        }
    }
}

impl Plant {
    /// Breaks or heals something, now.
    pub fn inject(&mut self, fault: Fault) -> Result<(), Problems> {
        let t_s = self.state.t_s;
        let mut problems = Problems::new();
        match fault {
            Fault::Accelerometer(kind) => self.broken.accelerometer.set(kind, t_s),
            Fault::Gyroscope(kind) => self.broken.gyroscope.set(kind, t_s),
            Fault::Barometer(kind) => self.broken.barometer.set(kind, t_s),
            Fault::WingThrust { wing, gain } => {
                problems.range("fault.gain", gain, 0.0..=2.0, "");
                if problems.is_empty() {
                    let gains = self.broken.wing_gain.iter_mut().enumerate();
                    gains
                        .filter(|(i, _)| wing.is_none_or(|w| w == *i))
                        .for_each(|(_, g)| *g = gain);
                }
            }
            Fault::Servos(kind) => self.broken.servos = (kind, t_s),
            Fault::BatteryDrop(volt) => {
                problems.range("fault.volt", volt, 0.0..=30.0, "V");
                if problems.is_empty() {
                    self.broken.battery_drop_v = volt;
                }
            }
            Fault::BoardLink(kind) => self.broken.board_link = (kind, t_s),
            Fault::TagSilent(silent) if self.board.has_deck() => {
                self.board.inject(self.t_us(), &CrazyflieFault::ChipDead(silent));
            }
            Fault::TagSilent(silent) => self.port.silent = silent,
            Fault::AnchorSilent { anchor, silent } => {
                match self.ids.iter().position(|id| *id == anchor) {
                    Some(i) => self.anchors.silent[i] = silent,
                    None => problems.say(format!("fault: anchor {anchor} is not in the survey")),
                }
            }
            Fault::EffectOn { id, values } => {
                let values: Vec<_> = values.iter().map(|(k, v)| (k.as_str(), *v)).collect();
                let sites = &self.surveyed_E_m;
                self.bank.switch_on(&id, &values, &self.vehicle, &self.room, sites)?;
            }
            Fault::EffectOff(id) => self.bank.switch_off(&id),
            Fault::BoardReboot => self.board.reboot(self.t_us()),
            Fault::BoardMode(mode) => self.board.take_over(mode),
            Fault::ToBoard(kind) => self.broken.to_board = (kind, t_s),
            Fault::LineNoise { line, noise } => {
                noise.check("fault", &mut problems);
                if problems.is_empty() {
                    match line {
                        LineId::FromTag => self.from_tag.set(noise),
                        LineId::FromBoard => self.from_board.set(noise),
                        LineId::ToBoard => self.to_board.set(noise),
                    }
                }
            }
            Fault::Gust(gust) => {
                gust.check("fault", &mut problems);
                if problems.is_empty() {
                    self.broken.gust = Some((gust, t_s));
                }
            }
            Fault::Misread(sensor, misreading) => {
                misreading.check("fault", &mut problems);
                if problems.is_empty() {
                    self.misread(sensor, misreading);
                }
            }
            Fault::TagReplay(replay) => {
                let window_s = replay.map_or(1.0, |replay| replay.window_s);
                problems.range("fault.window_s", window_s, 0.1..=MOST_REPLAY_S, "s");
                if problems.is_empty() {
                    self.port.replay(replay);
                }
            }
            Fault::Crazyflie(fault) if self.board.inject(self.t_us(), &fault) => {}
            Fault::Crazyflie(_) => problems.say("fault: this board cannot have it"),
            Fault::SecondBoard(Some(_)) if self.board.has_deck() => {
                problems.say("fault: a second board speaks MAVLink, this one is a Crazyflie");
            }
            Fault::GearLeg(broken) => self.broken.gear_leg = broken,
            Fault::FalseBeats(beats) => self.board.lie_disarmed(beats),
            Fault::SecondBoard(voice) => {
                self.broken.second_board = voice.map(|voice| {
                    let ours = self.board.settings();
                    Box::new(SecondBoard::new(voice, ours, &self.vehicle, self.supply, self.seed))
                });
            }
            Fault::SecondPack(volt) => {
                problems.range("fault.volt", volt.unwrap_or_default(), 0.0..=60.0, "V");
                if problems.is_empty() {
                    self.board.tell_second_pack(volt);
                }
            }
            Fault::HeadingOff(angle_rad) => {
                problems.range("fault.angle", angle_rad, -7.0..=7.0, "rad");
                if problems.is_empty() {
                    self.board.turn_heading(angle_rad);
                }
            }
        }
        problems.into_result()
    }

    fn misread(&mut self, sensor: Sensor, misreading: Misreading) {
        let broken = &mut self.broken;
        match sensor {
            Sensor::Accelerometer => broken.accelerometer.misread(misreading),
            Sensor::Gyroscope => broken.gyroscope.misread(misreading),
            Sensor::Imu => {
                broken.accelerometer.misread(misreading);
                broken.gyroscope.misread(misreading);
            }
            Sensor::Barometer => broken.barometer.misread(misreading),
            Sensor::Battery => broken.battery = misreading,
            Sensor::Attitude => self.board.turn_attitude(&misreading.matrix),
        }
    }
}
