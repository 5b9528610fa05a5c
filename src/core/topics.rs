//! What the pilot core tells about itself, decoded: one record type per topic of the flight log.

use std::sync::Arc;

use crate::drops::Drops;
use crate::estimate::Estimate;
use crate::frames::{B, E, Rot, Vec3};
use crate::measure::{
    BaroSample, BatterySample, BoardAttitude, ImuSample, MagSample, OtherBattery, ReferencePose,
    ServoOutput, Tdoa,
};
use crate::time::HostTime;

/// One decoded record.
#[derive(Debug, Clone, PartialEq)]
pub enum Topic {
    /// IMU as used.
    Imu(ImuSample),
    /// TDOA with what the filter made of it.
    Uwb(UwbRecord),
    /// State of the filter, once per control step.
    Estimate(Estimate),
    /// Inside of the control step.
    Control(ControlRecord),
    /// What a shadow would have sent.
    Shadow(ShadowRecord),
    /// Battery.
    Battery(BatterySample),
    /// A battery that is not flown on.
    OtherBattery(OtherBattery),
    /// What the board told motors and servos.
    Servos(ServoOutput),
    /// The board's own attitude.
    BoardAttitude(BoardAttitude),
    /// Air pressure.
    Baro(BaroSample),
    /// Magnetic field.
    Mag(MagSample),
    /// Motion capture.
    Reference(ReferencePose),
    /// Change of mode.
    Mode(ModeRecord),
    /// Text for people.
    Text(TextRecord),
    /// Losses and timing, once a second.
    Health(HealthRecord),
}

/// A TDOA and its fate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UwbRecord {
    /// The measurement.
    pub tdoa: Tdoa,
    /// Measured minus predicted, m.
    pub innovation_m: f64,
    /// Variance of the innovation, m².
    pub var_innovation_m2: f64,
    /// Innovation squared over gate squared times its variance; above 1 the gate rejects.
    pub test_ratio: f64,
    /// Whether it was fused.
    pub fused: bool,
}

/// Inside of one control step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ControlRecord {
    /// When.
    pub at: HostTime,
    /// Commanded position, Earth frame, m; `None` on an axis commanded in velocity.
    pub pos_setpoint_E_m: [Option<f64>; 3],
    /// Velocity setpoint after the position loop, Earth frame, m/s.
    pub vel_setpoint_E_mps: Vec3<E>,
    /// Roll setpoint in our own attitude frame, all parts, rad.
    pub roll_rad: f64,
    /// Pitch setpoint, all parts, rad.
    pub pitch_rad: f64,
    /// Yaw setpoint from room north, rad.
    pub yaw_rad: f64,
    /// Drag feed-forward in roll, rad.
    pub roll_ff_rad: f64,
    /// Drag feed-forward in pitch, rad.
    pub pitch_ff_rad: f64,
    /// Thrust sent, 0 to 1.
    pub thrust_frac: f64,
    /// Base thrust at this voltage, 0 to 1.
    pub thrust_base_frac: f64,
    /// Part of the vertical feedback, -1 to 1.
    pub thrust_feedback_frac: f64,
    /// Factor of the ground-effect correction.
    pub ground_factor: f64,
    /// Hover thrust learned in flight, over the base thrust.
    pub hover_factor: f64,
    /// Factor of the tilt compensation.
    pub tilt_factor: f64,
    /// Angle from room north to the board's north, rad.
    pub yaw_board_offset_rad: f64,
    /// Limits that were touched.
    pub saturation: Saturation,
}

/// What a shadow would have sent to the board in a control step, beside what the board says it flies to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShadowRecord {
    /// When.
    pub at: HostTime,
    /// The place that would have been held, Earth frame, m.
    pub place_E_m: Vec3<E>,
    /// Attitude setpoint in the board's own frame.
    pub attitude: Rot<E, B>,
    /// Thrust, 0 to 1.
    pub thrust_frac: f64,
    /// Attitude and thrust that the board flies to, sent by whoever flies; `None`: it does not tell.
    pub theirs: Option<(Rot<E, B>, f64)>,
}

/// Limits that were touched in a control step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Saturation {
    /// Velocity setpoint was cut.
    pub velocity: bool,
    /// Tilt was cut.
    pub tilt: bool,
    /// Thrust was cut from above.
    pub thrust_high: bool,
    /// Thrust was cut from below.
    pub thrust_low: bool,
}

/// A change of mode.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModeRecord {
    /// When.
    pub at: HostTime,
    /// Name of the mode that is now in force.
    pub mode: &'static str,
    /// Whether the board reports armed.
    pub armed: bool,
    /// Why.
    pub cause: String,
}

/// Text for people, as sent in STATUSTEXT.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TextRecord {
    /// When.
    pub at: HostTime,
    /// MAVLink severity, 0 emergency to 7 debug.
    pub severity: u8,
    /// The sentence.
    pub text: String,
}

/// Losses and timing since start.
#[derive(Debug, Clone, PartialEq)]
pub struct HealthRecord {
    /// When.
    pub at: HostTime,
    /// Losses on each link, by link number, and of the core itself.
    pub drops: Arc<Vec<(u8, Drops)>>,
    /// Control steps that began more than half a period late.
    pub deadline_misses: u64,
    /// Control steps so far.
    pub control_steps: u64,
    /// Age of the newest fused UWB measurement, s.
    pub uwb_age_s: Option<f64>,
    /// Age of the newest IMU sample, s.
    pub imu_age_s: Option<f64>,
    /// Offset of the board's clock is known with this uncertainty, s.
    pub std_board_clock_s: Option<f64>,
    /// Anchors that the filter leaves out because they do not fit the others: bit n is the n-th of the survey,
    /// ids ascending.
    pub left_out: u16,
}
