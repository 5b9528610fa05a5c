//! Effects: what makes the vehicle and its sensors behave as they do, one physical effect per file.
//!
//! [`ALL`] is the one list of them. It drives simulation, fits, diagnosis and documentation; what is
//! said of an effect stands in its file. An effect is either part of the *nominal* vehicle or a *deviation*
//! from it. Effects act at [`Stage`]s of the simulation step; each is called at the stages it
//! names and at no other, so an effect that is off costs nothing. At one stage they act in the order
//! of the list: nominal first.
//!
//! A deviation that only changes a number of the vehicle or of the board edits it once, at the
//! start ([`Effect::vehicle`], [`Effect::board`]), before the nominal effects are built from it.

mod bank;
pub mod document;
mod list;
mod set;
mod spec;

pub use bank::Bank;
pub use list::ALL;
pub use set::{EffectConfig, EffectSet};
pub use spec::{
    Axis, Block, Build, Choice, Deviation, EffectSpec, Hidden, Kind, ParameterSpec, Role, Source,
};

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::board::BoardSettings;
use crate::tag::air::Packet;
use crate::vehicle::Vehicle;
use crate::wings::{Actuation, ActuatorCommand, Wrench};

/// Where in the step an effect acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum Stage {
    /// Air velocity at the vehicle.
    Wind,
    /// Setpoint as the board obeys it.
    Setpoint,
    /// Command to the actuators.
    Command,
    /// State of the actuators.
    Actuate,
    /// Thrust of each wing.
    Thrust,
    /// Force and moment.
    Wrench,
    /// Battery.
    Battery,
    /// Battery as the board reports it.
    BatteryReport,
    /// IMU reading.
    Imu,
    /// Attitude as the board believes it, 50 Hz.
    Attitude,
    /// Skews of the anchors' clocks, 10 Hz.
    Clocks,
    /// A UWB packet in the air.
    Air,
    /// Bytes or a message on a link.
    Link,
}

/// Number of stages.
pub const STAGES: usize = Stage::Link as usize + 1;

/// Period at which the stage [`Stage::Attitude`] is called, s.
pub const ATTITUDE_PERIOD_S: f64 = 0.02;
/// Period at which the stage [`Stage::Clocks`] is called, s.
pub const CLOCK_PERIOD_S: f64 = 0.1;
/// Period of the simulation step, s: the rate of the inner loops (paper).
pub const STEP_S: f64 = 0.002;

/// State of the vehicle that every effect may look at. Earth NED, body FRD.
#[derive(Debug, Clone)]
pub struct State {
    /// Time since the start, s.
    pub t_s: f64,
    /// Position of the centre of mass, m.
    pub pos_E_m: Vector3<f64>,
    /// Velocity, m/s.
    pub vel_E_mps: Vector3<f64>,
    /// Attitude.
    pub q_EB: UnitQuaternion<f64>,
    /// The same as a matrix.
    pub R_EB: Matrix3<f64>,
    /// Angular rate, rad/s.
    pub rate_B_radps: Vector3<f64>,
    /// Velocity of the centre of mass through the air, m/s.
    pub air_B_mps: Vector3<f64>,
    /// Specific force, m/s²: at rest (0, 0, -g).
    pub acc_B_mps2: Vector3<f64>,
    /// Flap rate of left and right wing, Hz.
    pub flap_hz: [f64; 2],
    /// Phase of the wing beat, cycles, integrated from the mean flap rate.
    pub flap_cycles: f64,
    /// Thrust of left and right wing, N.
    pub thrust_n: [f64; 2],
    /// Foot of the landing gear over the floor, m.
    pub height_m: f64,
    /// Supply voltage under load, V.
    pub supply_v: f64,
    /// Current from the battery, A.
    pub current_a: f64,
    /// Charge left, 0 to 1.
    pub charge_frac: f64,
    /// Whether the gear touches the floor.
    pub on_ground: bool,
    /// Yaw from room north, rad.
    pub yaw_rad: f64,
}

impl Default for State {
    fn default() -> Self {
        Self {
            t_s: 0.0,
            pos_E_m: Vector3::zeros(),
            vel_E_mps: Vector3::zeros(),
            q_EB: UnitQuaternion::identity(),
            R_EB: Matrix3::identity(),
            rate_B_radps: Vector3::zeros(),
            air_B_mps: Vector3::zeros(),
            acc_B_mps2: Vector3::zeros(),
            flap_hz: [0.0; 2],
            flap_cycles: 0.0,
            thrust_n: [0.0; 2],
            height_m: 0.0,
            supply_v: 0.0,
            current_a: 0.0,
            charge_frac: 1.0,
            on_ground: true,
            yaw_rad: 0.0,
        }
    }
}

/// Setpoint as the board obeys it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// Attitude from the board's north.
    pub q: UnitQuaternion<f64>,
    /// Collective throttle, 0 to 1.
    pub thrust_frac: f64,
}

/// Battery as seen at its plug.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Supply {
    /// Voltage, V.
    pub volt: f64,
    /// Current, A.
    pub current_a: f64,
    /// Charge left, 0 to 1.
    pub charge_frac: f64,
}

/// A reading of the IMU.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuReading {
    /// Specific force, m/s².
    pub acc_B_mps2: Vector3<f64>,
    /// Angular rate, rad/s.
    pub rate_B_radps: Vector3<f64>,
    /// Air pressure, Pa.
    pub pressure_pa: f64,
}

/// Errors of the attitude that the board believes in.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AttitudeError {
    /// Rotation vector from true to believed body axes, rad.
    pub tilt_B_rad: Vector3<f64>,
    /// Angle from room north to the board's north, rad, clockwise positive.
    pub north_rad: f64,
}

/// What travels on a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cargo {
    /// Bytes from the tag to the companion.
    FromTag,
    /// Bytes from the board to the companion.
    FromBoard,
    /// Bytes from the companion to the board.
    ToBoard,
    /// One SET_ATTITUDE_TARGET, at the board's door.
    Setpoint,
}

/// One delivery.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Delivery {
    /// What.
    pub cargo: Cargo,
    /// Time under way, s.
    pub delay_s: f64,
    /// Never arrives.
    pub lost: bool,
}

/// One physical effect. Every hook is the identity unless an effect overrides it and names its
/// stage in [`Effect::stages`].
pub trait Effect: Send {
    /// Stages at which it acts.
    fn stages(&self) -> &'static [Stage] {
        &[]
    }
    /// Edits the vehicle, once.
    fn vehicle(&mut self, _vehicle: &mut Vehicle) {}
    /// Edits the board, once.
    fn board(&mut self, _board: &mut BoardSettings) {}
    /// Moves anchors from where the survey says, once. By index, ascending id; Earth frame, m.
    fn sites(&mut self, _sites_E_m: &mut [Vector3<f64>]) {}
    /// [`Stage::Wind`]: air velocity at the vehicle, Earth frame, m/s.
    fn wind(&mut self, _s: &State, _wind_E_mps: &mut Vector3<f64>) {}
    /// [`Stage::Setpoint`].
    fn setpoint(&mut self, _s: &State, _setpoint: &mut Setpoint) {}
    /// [`Stage::Command`].
    fn command(&mut self, _s: &State, _command: &mut ActuatorCommand) {}
    /// [`Stage::Actuate`]: from where the actuators would settle to where they are.
    fn actuate(&mut self, _s: &State, _actuation: &mut Actuation) {}
    /// [`Stage::Thrust`]: left and right, N.
    fn thrust(&mut self, _s: &State, _thrust_n: &mut [f64; 2]) {}
    /// [`Stage::Wrench`].
    fn wrench(&mut self, _s: &State, _wrench: &mut Wrench) {}
    /// [`Stage::Battery`].
    fn battery(&mut self, _s: &State, _supply: &mut Supply) {}
    /// [`Stage::BatteryReport`].
    fn battery_report(&mut self, _s: &State, _supply: &mut Supply) {}
    /// [`Stage::Imu`].
    fn imu(&mut self, _s: &State, _reading: &mut ImuReading) {}
    /// [`Stage::Attitude`].
    fn attitude(&mut self, _s: &State, _error: &mut AttitudeError) {}
    /// [`Stage::Clocks`]: relative rate errors, by anchor index.
    fn clocks(&mut self, _s: &State, _skew: &mut [f64]) {}
    /// [`Stage::Air`].
    fn air(&mut self, _s: &State, _packet: &mut Packet) {}
    /// [`Stage::Link`].
    fn link(&mut self, _s: &State, _delivery: &mut Delivery) {}
}

#[cfg(test)]
pub(crate) mod probe;
#[cfg(test)]
mod tests;

// Nominal.
pub mod anchor_clocks;
pub mod attitude_error;
pub mod battery;
pub mod clutter;
pub mod drag;
pub mod drive_voltage;
pub mod flap_lag;
pub mod flap_vibration;
pub mod floor_multipath;
pub mod ground_effect;
pub mod heading_offset;
pub mod imu_bias;
pub mod imu_noise;
pub mod link_latency;
pub mod packet_loss;
pub mod passive_dihedral;
pub mod path_bias;
pub mod receive_noise;
pub mod rotational_damping;
pub mod servos;
pub mod thrust_curve;

// Deviations.
pub mod acc_bias;
pub mod acc_clipping;
pub mod acc_drift;
pub mod acc_misalignment;
pub mod acc_scale;
pub mod anchor_bias;
pub mod anchor_drift;
pub mod anchor_survey;
pub mod attitude_lag;
pub mod board_delay;
pub mod capacity;
pub mod ceiling;
pub mod cg_offset;
pub mod command_delay;
pub mod damping_scale;
pub mod dead_band;
pub mod distance_bias;
pub mod drag_saturation;
pub mod drag_scale;
pub mod draught;
pub mod gusts;
pub mod gyro_bias;
pub mod heading_drift;
pub mod heading_misalignment;
pub mod inertia_scale;
pub mod lever_arm;
pub mod loop_delay;
pub mod low_multipath;
pub mod mass_error;
pub mod motor_saturation;
pub mod near_ground;
pub mod nlos_zone;
pub mod noise_level;
pub mod outlier_bursts;
pub mod packet_drops;
pub mod pose_bias;
pub mod quadratic_drag;
pub mod rectification;
pub mod resistance;
pub mod roll_yaw_coupling;
pub mod sampling_jitter;
pub mod servo_trim;
pub mod setpoint_bursts;
pub mod speed_pitch;
pub mod steady_wind;
pub mod tag_latency;
pub mod thermal_droop;
pub mod thrust_expo;
pub mod thrust_lag;
pub mod thrust_loss;
pub mod tilt_saturation;
pub mod voltage_report;
pub mod wall;
pub mod wing_asymmetry;
