//! Control: the cascade position → velocity → attitude that turns a command into a setpoint.
//!
//! Runs at 100 Hz. Time, estimate, command, voltage and height come in as arguments of
//! [`Controller::step`]; attitude, thrust and a record of the inside go out. No I/O, no clock, no
//! randomness, no allocation in a step, and no panic or NaN out whatever comes in.
//!
//! ```text
//! command ─► position loop ─► velocity setpoint ─┬─► velocity loop ─► + lean ─► limit ─► + trims ─► attitude
//!            (E, gains along    (E, limited)     └─► low-pass ─► drag ─┘
//!             the heading)
//!            voltage ─► base thrust ─► + climb feedback ─► × tilt ─► × ground ─► limit ─► thrust
//! ```

pub mod config;
mod controller;
pub mod drag;
pub mod filter;
pub mod gains;
pub mod ground;
pub mod margins;
pub mod trim;
pub mod voltage;

#[cfg(test)]
mod closed_loop;
#[cfg(test)]
mod tests;

pub use config::{ControlConfig, Enhancements, TiltCompensation, Version};
pub use controller::{Controller, within_lead_rad};
pub use gains::{ControlGains, Tunable};
pub use voltage::SupplyQuality;

use crate::estimate::Estimate;
use crate::frames::{B, E, Rot, Vec3};
use crate::time::HostTime;
use crate::topics::ControlRecord;

/// What one axis of the Earth frame is asked to do.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(non_camel_case_types)] // units keep their suffix
pub enum AxisCommand {
    /// Be there, m.
    Position_m(f64),
    /// Move like this, m/s.
    Velocity_mps(f64),
}

/// What the vehicle is asked to do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Command {
    /// Along x, y, z of the Earth frame; each may change its kind at any step.
    pub axes: [AxisCommand; 3],
    /// Velocity of the commanded position, Earth frame, m/s; used on position axes only.
    pub vel_ff_E_mps: Vec3<E>,
    /// Heading, rad from room north.
    pub yaw_rad: f64,
}

impl Command {
    /// Hold this position and heading.
    pub fn hold(pos_E_m: Vec3<E>, yaw_rad: f64) -> Self {
        Self {
            axes: pos_E_m.to_array().map(AxisCommand::Position_m),
            vel_ff_E_mps: Vec3::zero(),
            yaw_rad,
        }
    }
}

/// All that one control step depends on, besides the controller's own memory.
#[derive(Debug, Clone, Copy)]
pub struct ControlInput<'a> {
    /// Now.
    pub at: HostTime,
    /// Where we are.
    pub estimate: &'a Estimate,
    /// Where we should be.
    pub command: &'a Command,
    /// Battery voltage, if a fresh one is known, V.
    pub supply_v: Option<f64>,
    /// Landing gear to ground, m.
    pub height_above_ground_m: f64,
    /// Time since the last step, s; used up to 0.1 s.
    pub dt_s: f64,
    /// Keeps every integrator as it is: set while standing, so that nothing winds up against the
    /// ground.
    pub integrators_frozen: bool,
    /// Thrust may not exceed this, even below the least thrust of the configuration: 1 in flight,
    /// ramped by the pilot from 0 to spool up and back to 0 after touchdown.
    pub thrust_ceiling_frac: f64,
    /// Holds this tilt instead of what the law wants on its axis. Height stays closed, with thrust
    /// for the tilt in every version; the integrators of the velocity loop rest.
    pub held: Option<HeldTilt>,
}

/// Axis of a tilt.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TiltAxis {
    /// Right side down is positive.
    Roll,
    /// Nose up is positive.
    Pitch,
}

/// A tilt that is held, trims not counted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeldTilt {
    /// About which axis of the heading frame.
    pub axis: TiltAxis,
    /// rad; whoever asks has checked it.
    pub angle_rad: f64,
}

/// What the board did when the controller takes over: the first outputs continue from here.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Handover {
    /// Roll setpoint so far, rad.
    pub roll_rad: f64,
    /// Pitch setpoint so far, rad.
    pub pitch_rad: f64,
    /// Yaw setpoint so far, rad.
    pub yaw_rad: f64,
    /// Thrust so far, 0 to 1.
    pub thrust_frac: f64,
}

/// Setpoint for the board, in our own attitude frame, and the inside of the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControlOutput {
    /// Attitude setpoint: the three angles below as a rotation.
    pub R_EB: Rot<E, B>,
    /// Roll setpoint, trim included, rad.
    pub roll_rad: f64,
    /// Pitch setpoint, trim included, rad.
    pub pitch_rad: f64,
    /// Yaw setpoint, trim included, rad.
    pub yaw_rad: f64,
    /// Collective thrust, 0 to 1.
    pub thrust_frac: f64,
    /// Where the voltage behind the base thrust comes from.
    pub supply: SupplyQuality,
    /// The estimate held a NaN or infinity: lean and thrust are the held integrators alone.
    pub blind: bool,
    /// For the log.
    pub record: ControlRecord,
}
