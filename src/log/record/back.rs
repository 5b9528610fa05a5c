//! From the types on disk to those we compute with, as far as more than one reader of logs needs it.

use super::pb;
use haltere_core::frames::Vec3;
use haltere_core::time::HostTime;
use haltere_core::topics::{ControlRecord, Saturation};

/// A control step out of its disk form.
pub fn control(m: &pb::Control) -> ControlRecord {
    ControlRecord {
        at: HostTime::from_us(m.at_us),
        pos_setpoint_E_m: [m.pos_setpoint_north_m, m.pos_setpoint_east_m, m.pos_setpoint_down_m],
        vel_setpoint_E_mps: vec3(m.vel_setpoint_e_mps),
        roll_rad: m.roll_rad,
        pitch_rad: m.pitch_rad,
        yaw_rad: m.yaw_rad,
        roll_ff_rad: m.roll_ff_rad,
        pitch_ff_rad: m.pitch_ff_rad,
        thrust_frac: m.thrust_frac,
        thrust_base_frac: m.thrust_base_frac,
        thrust_feedback_frac: m.thrust_feedback_frac,
        ground_factor: m.ground_factor,
        hover_factor: m.hover_factor.unwrap_or(1.0),
        // Logs of older builds do not say.
        tilt_factor: m.tilt_factor.unwrap_or(f64::NAN),
        yaw_board_offset_rad: m.yaw_board_offset_rad,
        saturation: Saturation {
            velocity: m.velocity_cut,
            tilt: m.tilt_cut,
            thrust_high: m.thrust_cut_high,
            thrust_low: m.thrust_cut_low,
        },
    }
}

/// An absent vector is NaN: plots leave it out.
pub fn vec3<F>(v: Option<pb::Vec3>) -> Vec3<F> {
    v.map_or(Vec3::new(f64::NAN, f64::NAN, f64::NAN), |v| Vec3::new(v.x, v.y, v.z))
}
