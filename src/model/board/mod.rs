//! The inner-loop board: attitude and rate loops at 500 Hz, MAVLink on its serial port, playing the
//! `generic` profile of INTERFACES.md section 2 or one of the two real firmwares, kindly or not.

mod ardupilot;
mod commands;
pub mod crazyflie;
mod deck;
mod firmware;
mod last_second;
mod lies;
mod line;
mod loops;
mod outside;
mod parameters;
mod persona;
mod px4;
mod streams;
mod ways;

pub use firmware::{Firmware, Manners, Overrides};
pub use line::SlowLine;
pub use loops::Loops;
pub use outside::Outside;

use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream::MavSplitter;
use nalgebra::{UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::effects::{AttitudeError, Bank, ImuReading, STEP_S, Setpoint, State, Supply};
use crate::faults::Fault;
use crate::magnetometer::MagnetometerSettings;
use crate::vehicle::Vehicle;
use crate::waiting::Waiting;
use crate::wings::ActuatorCommand;
use haltere_core::checks::Problems;

use crazyflie::{Crazyflie, CrazyflieSettings};
use last_second::LastSecond;
use outside::Outer;
use parameters::Parameters;
use persona::Persona;

/// Settings of the board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BoardSettings {
    /// What it plays.
    pub firmware: Firmware,
    /// Where it plays a Crazyflie, what is its own.
    pub crazyflie: CrazyflieSettings,
    /// Unkind manners; they are of the real firmwares, except the speed of the line.
    pub manners: Manners,
    /// Parameters that are not the firmware's.
    pub parameters: Overrides,
    /// MAVLink system id.
    pub system_id: u8,
    /// Time since its boot when the simulation starts, µs.
    pub boot_us: u64,
    /// Its clock runs fast by this much, ppm.
    pub clock_ppm: f64,
    /// Flap lag that the roll loop leads away, s, and what is left of it.
    pub lead_s: [f64; 2],
    /// Time from what it senses and is asked to what it tells the actuators, s: its filters and its own pace.
    pub loop_delay_s: f64,
    /// Share of a standing error that its integrator leaves, of what the vehicle file's would.
    pub kept: f64,
    /// Time to spin up from standstill, attitude relaxed, s.
    pub spool_up_s: f64,
    /// A setpoint is obeyed for this long, s (INTERFACES.md).
    pub setpoint_timeout_s: f64,
    /// Then the board levels and descends for this long, s (INTERFACES.md) …
    pub descend_s: f64,
    /// … at this share of the thrust it last flew with.
    pub descend_factor: f64,
    /// Largest tilt at which it arms, degrees.
    pub arming_tilt_deg: f64,
    /// It refuses to arm for this long after power-on, s: sensors settle.
    pub arming_delay_s: f64,
    /// Lowest supply at which it arms, V (firmware: 6.0 critical).
    pub arming_supply_v: f64,
    /// Its magnetometer, and the field in the room.
    pub magnetometer: MagnetometerSettings,
    /// Whether it passes on motion capture (the truth) as ATT_POS_MOCAP when asked.
    pub motion_capture: bool,
}

impl Default for BoardSettings {
    fn default() -> Self {
        Self {
            firmware: Firmware::Generic,
            crazyflie: CrazyflieSettings::default(),
            manners: Manners::default(),
            parameters: Overrides::new(),
            system_id: 1,
            boot_us: 4_321_000,
            clock_ppm: 12.0,
            lead_s: [0.08, 0.02],
            loop_delay_s: 0.0,
            kept: 1.0,
            spool_up_s: 0.0,
            setpoint_timeout_s: 0.5,
            descend_s: 3.0,
            descend_factor: 0.82,
            arming_tilt_deg: 30.0,
            arming_delay_s: 0.0,
            arming_supply_v: 6.0,
            magnetometer: MagnetometerSettings::default(),
            motion_capture: false,
        }
    }
}

impl BoardSettings {
    /// Refuses what no board does.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        let mut range = |name: &str, value: f64, low: f64, high: f64, unit: &str| {
            problems.range(format_args!("{key}.{name}"), value, low..=high, unit);
        };
        range("system_id", f64::from(self.system_id), 1.0, 250.0, "");
        range("boot_us", self.boot_us as f64, 0.0, 1e15, "µs");
        range("clock_ppm", self.clock_ppm, -200.0, 200.0, "ppm");
        range("lead_s[0]", self.lead_s[0], 0.0, 0.5, "s");
        range("lead_s[1]", self.lead_s[1], STEP_S, 0.5, "s");
        range("loop_delay_s", self.loop_delay_s, 0.0, 0.2, "s");
        range("kept", self.kept, 0.0, 1.0, "");
        range("spool_up_s", self.spool_up_s, 0.0, 5.0, "s");
        range("setpoint_timeout_s", self.setpoint_timeout_s, 0.05, 10.0, "s");
        range("descend_s", self.descend_s, 0.0, 60.0, "s");
        range("descend_factor", self.descend_factor, 0.0, 1.0, "");
        range("arming_tilt_deg", self.arming_tilt_deg, 5.0, 90.0, "deg");
        range("arming_delay_s", self.arming_delay_s, 0.0, 120.0, "s");
        range("arming_supply_v", self.arming_supply_v, 0.0, 30.0, "V");
        self.magnetometer.check(&format!("{key}.magnetometer"), problems);
        self.crazyflie.check(&format!("{key}.crazyflie"), problems);
        self.manners.check(&format!("{key}.manners"), problems);
        Parameters::check(&self.parameters, &format!("{key}.parameters"), problems);
    }
}

/// What the board wants of the plant around it.
#[derive(Debug, Default)]
pub struct BoardRequests {
    /// Faults that were ordered over MAVLink, a reboot among them.
    pub faults: Vec<Fault>,
}

/// The board.
pub struct Board {
    settings: BoardSettings,
    loops: Loops,
    splitter: MavSplitter,
    streams: streams::Streams,
    sequence: u8,
    armed: bool,
    error: AttitudeError,
    /// Room north to the board's north, and the lean of the estimate.
    north: UnitQuaternion<f64>,
    lean: UnitQuaternion<f64>,
    believed: UnitQuaternion<f64>,
    setpoint: Option<Setpoint>,
    setpoint_age_s: f64,
    /// Thrust it flew with, over the last second.
    flown: LastSecond,
    /// Level attitude with the heading that it had when setpoints stopped.
    hold: Option<UnitQuaternion<f64>>,
    spool_s: f64,
    output: ActuatorCommand,
    /// Commands of the last [`BoardSettings::loop_delay_s`].
    waiting: Waiting<ActuatorCommand>,
    losses: u64,
    /// Plant time of its last reboot, µs.
    rebooted_us: Option<u64>,
    persona: Persona,
    /// Its whole wire, where it plays one.
    crazyflie: Option<Box<Crazyflie>>,
    /// Another program in its place.
    outside: Option<Outer>,
    parameters: Parameters,
    /// What it has to say at the next opportunity.
    says: Vec<MavMessage>,
    /// What its ATTITUDE_TARGET tells.
    told: Setpoint,
    echoes: u32,
    line: Option<SlowLine>,
    lies: lies::Lies,
}

impl Board {
    /// A board that knows `vehicle` as its maker did, with the loops that stand there.
    pub fn new(mut settings: BoardSettings, vehicle: &Vehicle) -> Self {
        let parameters = Parameters::new(settings.firmware, &settings.parameters);
        if settings.firmware == Firmware::Ardupilot {
            // Its own, in which it does nothing.
            settings.spool_up_s = 0.0;
        }
        let mut board = Self {
            persona: Persona::new(&settings, &parameters),
            crazyflie: None,
            outside: None,
            parameters,
            says: Vec::new(),
            told: Setpoint { q: UnitQuaternion::identity(), thrust_frac: 0.0 },
            echoes: 0,
            line: SlowLine::new(settings.manners.baud),
            loops: Loops::new(&settings, vehicle),
            splitter: MavSplitter::new(),
            streams: streams::Streams::default(),
            sequence: 0,
            armed: false,
            error: AttitudeError::default(),
            north: UnitQuaternion::identity(),
            lean: UnitQuaternion::identity(),
            believed: UnitQuaternion::identity(),
            setpoint: None,
            setpoint_age_s: 0.0,
            flown: LastSecond::default(),
            hold: None,
            spool_s: 0.0,
            output: ActuatorCommand::default(),
            waiting: Waiting::new(settings.loop_delay_s),
            losses: 0,
            rebooted_us: None,
            lies: lies::Lies::default(),
            settings,
        };
        board.stream_defaults();
        board
    }

    /// Whether motors may run.
    pub fn armed(&self) -> bool {
        self.outside.as_ref().map_or(self.armed, Outer::lifts)
    }

    /// What it was built with.
    pub fn settings(&self) -> &BoardSettings {
        &self.settings
    }

    /// Cuts the motors: the airframe is broken.
    pub fn crash(&mut self) {
        if let Some(outer) = &mut self.outside {
            outer.wreck();
        }
        if let Some(crazyflie) = &mut self.crazyflie {
            crazyflie.crash();
        }
        self.disarm();
    }

    /// Angle from room north to its own north, rad.
    pub fn north_rad(&self) -> f64 {
        self.error.north_rad
    }

    /// Outputs m1 to m4 of a firmware in another program, 0 to 1.
    pub(crate) fn outputs_frac(&self) -> [f64; 4] {
        self.outside.as_ref().map_or([0.0; 4], Outer::outputs_frac)
    }

    /// What it last told the actuators.
    pub fn output(&self) -> &ActuatorCommand {
        &self.output
    }

    /// Frames, bytes and setpoints that it threw away so far.
    pub fn losses(&self) -> u64 {
        self.losses
    }

    /// Its clock at plant time `t_us`, µs.
    pub fn time_us(&self, t_us: u64) -> u64 {
        let (since_us, start_us) = match self.rebooted_us {
            Some(rebooted_us) => (t_us.saturating_sub(rebooted_us), 0),
            None => (t_us, self.settings.boot_us),
        };
        start_us + since_us + (since_us as f64 * self.settings.clock_ppm * 1e-6) as u64
    }

    /// Restarts at plant time `t_us`: disarmed, clock at zero, nothing streams.
    pub fn reboot(&mut self, t_us: u64) {
        self.disarm();
        let now_us = self.time_us(t_us);
        if let Some(crazyflie) = &mut self.crazyflie {
            return crazyflie.restart(now_us);
        }
        self.streams = streams::Streams::default();
        self.splitter = MavSplitter::new();
        self.sequence = 0;
        self.rebooted_us = Some(t_us);
        // Parameters are kept; whatever acts after a reboot acts now.
        self.persona = Persona::new(&self.settings, &self.parameters);
        self.says.clear();
        self.stream_defaults();
    }

    /// Takes the errors of its attitude estimate, 50 times a second.
    pub fn set_attitude_error(&mut self, error: AttitudeError) {
        self.error = error;
        self.error.north_rad += self.lies.heading_off_rad();
        self.north = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -self.error.north_rad);
        self.lean = UnitQuaternion::from_scaled_axis(error.tilt_B_rad);
    }

    /// One turn of the inner loops: what the actuators are told.
    #[inline]
    pub fn control(&mut self, s: &State, bank: &mut Bank) -> ActuatorCommand {
        if let Some(outer) = &self.outside {
            self.output = outer.wings(self.loops.limits_rad());
            return self.output;
        }
        self.believed = self.north * s.q_EB * self.lean;
        let target = match self.persona {
            // What it asked for when it last looked.
            Persona::Generic if self.crazyflie.is_some() => self.setpoint,
            Persona::Generic => self.target(),
            _ => self.real_target(s),
        };
        self.output = match target {
            Some(mut target) => {
                bank.setpoint(s, &mut target);
                self.fly(target, s)
            }
            None => self.stop(),
        };
        self.output
    }

    /// What it should fly now; `None`: motors off.
    fn target(&mut self) -> Option<Setpoint> {
        if !self.armed {
            return None;
        }
        let setpoint = self.setpoint?;
        self.setpoint_age_s += STEP_S;
        let late_s = self.setpoint_age_s - self.settings.setpoint_timeout_s;
        if late_s < 0.0 {
            self.hold = None;
            self.flown.add(setpoint.thrust_frac);
            return Some(setpoint);
        }
        if late_s > self.settings.descend_s {
            self.disarm();
            return None;
        }
        let believed = self.believed;
        let q = *self.hold.get_or_insert_with(|| {
            let yaw = believed.euler_angles().2;
            UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw)
        });
        let thrust_frac = if setpoint.thrust_frac > 0.0 {
            self.settings.descend_factor * self.flown.mean_frac()
        } else {
            0.0
        };
        Some(Setpoint { q, thrust_frac })
    }

    fn fly(&mut self, target: Setpoint, s: &State) -> ActuatorCommand {
        if target.thrust_frac <= 0.0 {
            return self.stop();
        }
        if self.spool_s < self.settings.spool_up_s {
            self.spool_s += STEP_S;
            let share = self.spool_s / self.settings.spool_up_s;
            self.loops.reset();
            return ActuatorCommand {
                flap_frac: [share * target.thrust_frac; 2],
                ..ActuatorCommand::default()
            };
        }
        let command = self.loops.step(&self.believed, &target, s.rate_B_radps, s.supply_v);
        self.waiting.pass(command)
    }

    fn stop(&mut self) -> ActuatorCommand {
        self.loops.reset();
        self.waiting.clear();
        self.spool_s = 0.0;
        ActuatorCommand::default()
    }

    fn disarm(&mut self) {
        self.armed = false;
        self.setpoint = None;
        self.hold = None;
        self.flown.clear();
    }
}

/// What the streams need to know of one step.
pub struct Readings<'a> {
    /// Plant time, µs.
    pub t_us: u64,
    /// Truth, for rates and motion capture.
    pub state: &'a State,
    /// Newest IMU reading.
    pub imu: &'a ImuReading,
    /// Whether accelerometer, gyroscope and barometer gave anything.
    pub imu_alive: [bool; 3],
    /// Magnetic field in body axes, µT, where the board has a magnetometer.
    pub field_B_ut: Option<Vector3<f64>>,
    /// Battery as measured by the board.
    pub supply: &'a Supply,
}

#[cfg(test)]
mod tests;
