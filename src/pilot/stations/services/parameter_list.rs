//! The entries of the parameter table: name, key, range, unit, meaning and accessors of each.

use haltere_core::control::config::{MAX_TRIM_DEG, MAX_YAW_TRIM_DEG, TiltCompensation, Version};
use haltere_core::control::drag::{DragReading, TESTED_LEAN_DEG};
use haltere_core::control::voltage::MOST_CELLS;
use haltere_core::estimator::{SpecificForce, Tail, UwbNoise};

use super::parameter_table::{Kind, Parameter, When};
use crate::flight::supervisor::Action;

/// `estimator.rest_height_m` that is not set, as a number, m: below its range.
pub const NOT_SET_M: f64 = -51.0;
const BY_VERSION: f64 = -1.0;

const SWITCH: Kind = Kind::Choice(&[(0, "off"), (1, "on")]);
const OVERRIDE: Kind = Kind::Choice(&[(-1, "as the version has it"), (0, "off"), (1, "on")]);

/// A plain number of the configuration.
macro_rules! number {
    ($name:literal, $($path:ident).+, $when:ident, $low:expr, $high:expr, $unit:literal, $doc:literal) => {
        Parameter {
            name: $name,
            key: stringify!($($path).+),
            kind: Kind::Number,
            when: When::$when,
            low: $low,
            high: $high,
            unit: $unit,
            doc: $doc,
            get: |c| c.$($path).+,
            set: |c, v| c.$($path).+ = v,
        }
    };
}

/// A boolean of the configuration.
macro_rules! switch {
    ($name:literal, $($path:ident).+, $when:ident, $doc:literal) => {
        Parameter {
            kind: SWITCH,
            get: |c| f64::from(u8::from(c.$($path).+)),
            set: |c, v| c.$($path).+ = v != 0.0,
            ..choice($name, stringify!($($path).+), When::$when, 0.0, 1.0, $doc)
        }
    };
}

/// A boolean that is left to the version where it is not set.
macro_rules! overriding {
    ($name:literal, $($path:ident).+, $when:ident, $doc:literal) => {
        Parameter {
            kind: OVERRIDE,
            get: |c| c.$($path).+.map_or(BY_VERSION, |on| f64::from(u8::from(on))),
            set: |c, v| c.$($path).+ = (v >= 0.0).then_some(v != 0.0),
            ..choice($name, stringify!($($path).+), When::$when, -1.0, 1.0, $doc)
        }
    };
}

/// What the supervisor does about something.
macro_rules! action {
    ($name:literal, $field:ident, $doc:literal) => {
        Parameter {
            kind: Kind::Choice(Action::CHOICES),
            get: |c| c.supervisor.$field.number(),
            set: |c, v| c.supervisor.$field = Action::from_number(v),
            ..choice(
                $name,
                concat!("supervisor.", stringify!($field)),
                When::AtOnce,
                0.0,
                3.0,
                $doc,
            )
        }
    };
}

/// One entry of an array of the configuration.
macro_rules! entry {
    ($name:literal, $($path:ident).+, $index:literal, $when:ident, $low:literal, $high:literal, $unit:literal, $doc:literal) => {
        Parameter {
            name: $name,
            key: concat!(stringify!($($path).+), "[", $index, "]"),
            kind: Kind::Number,
            when: When::$when,
            low: $low,
            high: $high,
            unit: $unit,
            doc: $doc,
            get: |c| c.$($path).+.get($index).copied().unwrap_or(0.0),
            set: |c, v| {
                if let Some(entry) = c.$($path).+.get_mut($index) {
                    *entry = v;
                }
            },
        }
    };
}

/// One end of the flight volume.
macro_rules! bound {
    ($name:literal, $axis:ident, $index:literal, $doc:literal) => {
        Parameter {
            name: $name,
            key: concat!("limits.", stringify!($axis), "[", $index, "]"),
            kind: Kind::Number,
            when: When::OnFloor,
            low: -100.0,
            high: 100.0,
            unit: "m",
            doc: $doc,
            get: |c| c.limits.$axis.map_or(0.0, |range| range[$index]),
            set: |c, v| {
                let mut range = c.limits.$axis.unwrap_or([v - 1.0, v + 1.0]);
                range[$index] = v;
                c.limits.$axis = Some(range);
            },
        }
    };
}

/// The frame of an entry whose accessors follow.
const fn choice(
    name: &'static str,
    key: &'static str,
    when: When,
    low: f64,
    high: f64,
    doc: &'static str,
) -> Parameter {
    Parameter {
        name,
        key,
        kind: SWITCH,
        when,
        low,
        high,
        unit: "",
        doc,
        get: |_| 0.0,
        set: |_, _| {},
    }
}

/// Another name of a parameter, for clients that know it under that one.
const fn alias(name: &'static str, of: &'static str, high: f64, unit: &'static str) -> Parameter {
    let doc = "Another name, for clients of PX4.";
    Parameter { kind: Kind::Alias(of), unit, ..choice(name, "", When::AtOnce, 0.0, high, doc) }
}

const fn fixed(name: &'static str, value: f32, doc: &'static str) -> Parameter {
    let v = value as f64;
    Parameter { kind: Kind::Fixed(value), ..choice(name, "", When::Restart, v, v, doc) }
}

/// What every client sees.
#[rustfmt::skip] // one line each
pub static COMMON: &[Parameter] = &[
    Parameter {
        kind: Kind::Whole,
        get: |c| f64::from(c.system_id),
        set: |c, v| c.system_id = v as u8,
        ..choice("MAV_SYS_ID", "ground.system_id", When::Restart, 1.0, 250.0, "System that the vehicle is; each of one station has its own.")
    },
    number!("FLT_TKO_HGT", flight.takeoff_height_m, AtOnce, 0.3, 20.0, "m", "Height of a take-off that names none."),
    number!("FLT_TKO_SPD", flight.takeoff_speed_mps, AtOnce, 0.1, 2.0, "m/s", "Speed of the height setpoint in a take-off."),
    number!("FLT_SPOOL_T", flight.spool_s, OnFloor, 0.2, 5.0, "s", "Time in which thrust rises from nothing to just below hover."),
    number!("FLT_CRUISE_SPD", flight.cruise_speed_mps, AtOnce, 0.05, 10.0, "m/s", "Speed along mission legs. At or above CLM_HOR_SPD the setpoint jumps."),
    number!("FLT_CRUISE_ACC", flight.cruise_acceleration_mps2, AtOnce, 0.05, 5.0, "m/s^2", "Change of the leg speed at the ends of a leg."),
    number!("FLT_LAND_SPD", flight.land_speed_mps, AtOnce, 0.1, 1.5, "m/s", "Sinking speed in a landing above FLT_LAND_SLWHGT."),
    number!("FLT_LAND_SLWSPD", flight.land_slow_speed_mps, AtOnce, 0.05, 1.0, "m/s", "Sinking speed near the floor."),
    number!("FLT_LAND_SLWHGT", flight.land_slow_height_m, AtOnce, 0.0, 5.0, "m", "Height below which a landing slows down."),
    number!("FLT_RTN_HGT", flight.return_height_m, AtOnce, 0.0, 20.0, "m", "Least height of a return. 0: it flies at the height it has."),
    number!("FLT_ACC_RAD", flight.acceptance_radius_m, AtOnce, 0.05, 5.0, "m", "Distance at which a waypoint counts as reached when it names none."),
    number!("FLT_GEAR_HGT", flight.gear_height_m, OnFloor, 0.0, 0.5, "m", "Height of the feet below the point that is tracked."),
    number!("FLT_IDLE_T", flight.idle_disarm_s, AtOnce, 2.0, 600.0, "s", "Time armed on the floor after which the vehicle disarms."),
    switch!("FLT_LOG_REQ", flight.log_required, AtOnce, "Whether nothing arms while flights are not recorded, as on a full disk."),
    bound!("LIM_NORTH_MIN", north_m, 0, "Lowest room-north coordinate of a setpoint."),
    bound!("LIM_NORTH_MAX", north_m, 1, "Highest room-north coordinate of a setpoint."),
    bound!("LIM_EAST_MIN", east_m, 0, "Lowest room-east coordinate of a setpoint."),
    bound!("LIM_EAST_MAX", east_m, 1, "Highest room-east coordinate of a setpoint."),
    Parameter {
        name: "LIM_HEIGHT_MAX",
        key: "limits.height_m",
        kind: Kind::Number,
        when: When::OnFloor,
        low: 0.3,
        high: 50.0,
        unit: "m",
        doc: "Highest height of a setpoint above the floor.",
        get: |c| c.limits.height_m.unwrap_or(0.0),
        set: |c, v| c.limits.height_m = Some(v),
    },
    number!("LIM_BAT_LOW", limits.battery_low_v, AtOnce, 3.0, 30.0, "V", "Voltage below which a warning is sent and arming refused."),
    number!("LIM_BAT_CRIT", limits.battery_critical_v, AtOnce, 3.0, 30.0, "V", "Voltage below which the vehicle lands. At most LIM_BAT_LOW."),
    number!("LIM_UWB_LOSS_T", limits.uwb_loss_land_s, AtOnce, 0.2, 10.0, "s", "Age of the newest UWB measurement after which the vehicle lands."),
    number!("LIM_BRD_LOSS_T", limits.board_loss_s, AtOnce, 0.2, 10.0, "s", "Silence of the board after which its link counts as lost."),
    number!("SUP_IMU_LOSS_T", supervisor.imu_loss_s, AtOnce, 0.05, 2.0, "s", "Silence of the IMU that ends position control."),
    number!("SUP_IMU_FRZ_T", supervisor.imu_frozen_s, AtOnce, 0.05, 2.0, "s", "Time for which an IMU may repeat itself to the last bit in flight."),
    number!("SUP_UWB_LOSS_STD", supervisor.uwb_loss_std_m, AtOnce, 0.1, 2.0, "m", "Horizontal position sigma at which UWB that is late counts as lost."),
    number!("SUP_ANC_MISFIT", supervisor.anchor_misfit_m, AtOnce, 0.3, 100.0, "m", "Misfit of an anchor on the floor with which nothing takes off; half of it is told."),
    number!("SUP_ANC_SIL_T", supervisor.anchor_silent_s, AtOnce, 0.2, 10.0, "s", "Silence after which an anchor counts as gone."),
    Parameter {
        kind: Kind::Whole,
        get: |c| f64::from(c.supervisor.anchors_least),
        set: |c, v| c.supervisor.anchors_least = v as u8,
        ..choice("SUP_ANC_LEAST", "supervisor.anchors_least", When::AtOnce, 4.0, 16.0, "Anchors that must be heard to arm and to fly on; never more than there are.")
    },
    number!("SUP_DIV_SHARE", supervisor.divergence_share, AtOnce, 0.3, 1.0, "", "Share of UWB measurements beyond the gate at which the estimate counts as diverged."),
    number!("SUP_DIV_T", supervisor.divergence_s, AtOnce, 0.1, 10.0, "s", "How long it must be so."),
    number!("SUP_ATT_DIFF", supervisor.attitude_difference_deg, AtOnce, 10.0, 90.0, "deg", "Angle between our vertical and the board's at which ours is not believed."),
    number!("SUP_HGT_DIFF", supervisor.height_difference_m, AtOnce, 0.5, 20.0, "m", "Difference between estimated and barometric height that people are told of."),
    number!("SUP_GND_LOSS_T", supervisor.ground_loss_s, AtOnce, 2.0, 120.0, "s", "Silence of all stations that have sent heartbeats."),
    action!("SUP_GND_LOSS", ground_loss, "What is then done."),
    Parameter {
        kind: Kind::Choice(&[(1, "hold"), (2, "return"), (3, "land")]),
        ..action!("SUP_OFB_LOSS", offboard_loss, "What is done when a client's velocity setpoints stop.")
    },
    action!("SUP_BAT_LOW", battery_low, "What is done below LIM_BAT_LOW."),
    action!("SUP_BAT_HOME", battery_home, "What is done when the time left is down to what it takes to get home and down."),
    number!("SUP_BAT_RESERVE", supervisor.battery_reserve_s, AtOnce, 0.0, 300.0, "s", "Time that is then still to be left on the floor."),
    number!("SUP_WALL_HARD", supervisor.wall_hard_m, AtOnce, 0.1, 10.0, "m", "How far beyond the volume or a fence the hard wall stands."),
    action!("SUP_WALL_ACT", wall_hard, "What is done there."),
    number!("SUP_TILT_MOST", supervisor.tilt_most_deg, AtOnce, 55.0, 90.0, "deg", "Largest tilt."),
    number!("SUP_SPD_MOST", supervisor.speed_most_mps, AtOnce, 2.0, 20.0, "m/s", "Largest speed."),
    number!("SUP_OFF_COURSE", supervisor.off_course_m, AtOnce, 0.5, 20.0, "m", "Largest distance from the point that is held or flown to."),
    number!("SUP_LOOP_GAP_T", supervisor.loop_gap_s, AtOnce, 0.1, 5.0, "s", "Longest pause of the control loop."),
    switch!("SUP_STICKS", supervisor.stick_takeover, AtOnce, "Whether a joystick that is moved takes over."),
    number!("LIM_OFB_LOSS_T", limits.offboard_loss_s, AtOnce, 0.1, 5.0, "s", "Silence of an offboard client after which a velocity setpoint ends in Hold."),
    Parameter {
        kind: Kind::Choice(&[(0, "raw"), (1, "modified")]),
        get: |c| f64::from(u8::from(c.control.version == Version::Modified)),
        set: |c, v| {
            c.control.version = if v == 0.0 { Version::Raw } else { Version::Modified };
        },
        ..choice(
            "CTL_VERSION",
            "control.version",
            When::Restart,
            0.0,
            1.0,
            "Controller and filter of the source, without or with its enhancements.",
        )
    },
    overriding!("CTL_DRAG_FF", control.drag_feed_forward, OnFloor, "Drag feed-forward."),
    overriding!("CTL_VOLT_BASE", control.voltage_base_thrust, OnFloor, "Base thrust over battery voltage."),
    overriding!("CTL_GND_CORR", control.ground_correction, OnFloor, "Ground-effect correction."),
    Parameter {
        kind: Kind::Choice(&[
            (-1, "as the version has it"),
            (0, "off"),
            (1, "geometric"),
            (2, "drag aware"),
        ]),
        get: |c| match c.control.tilt_compensation {
            None => BY_VERSION,
            Some(TiltCompensation::Off) => 0.0,
            Some(TiltCompensation::Geometric) => 1.0,
            Some(TiltCompensation::DragAware) => 2.0,
        },
        set: |c, v| {
            c.control.tilt_compensation = match v as i8 {
                0 => Some(TiltCompensation::Off),
                1 => Some(TiltCompensation::Geometric),
                2 => Some(TiltCompensation::DragAware),
                _ => None,
            };
        },
        ..choice(
            "CTL_TILT_COMP",
            "control.tilt_compensation",
            When::OnFloor,
            -1.0,
            2.0,
            "How thrust answers to tilt.",
        )
    },
    overriding!("CTL_FLT_DRAG", control.filter_drag, Restart, "Drag term in the filter's prediction."),
    overriding!("CTL_VAR_UWB", control.variable_uwb_noise, Restart, "UWB noise that depends on height."),
    overriding!("CTL_LEARN_UWB", control.learned_uwb_errors, Restart, "Errors of the UWB learned by anchor in flight."),
    number!("CTL_FADE_T", control.switch_fade_s, AtOnce, 0.0, 5.0, "s", "How fast an output fades to the law's own after a switch: time constant."),
    number!("CLM_HOR_SPD", control.limits.horizontal_mps, AtOnce, 0.1, 4.0, "m/s", "Horizontal speed setpoint, as a vector."),
    number!("CLM_VER_SPD", control.limits.vertical_mps, AtOnce, 0.1, 3.0, "m/s", "Vertical speed setpoint, up and down."),
    number!("CLM_TILT", control.limits.tilt_deg, OnFloor, 5.0, TESTED_LEAN_DEG, "deg", "Lean from the vertical, roll and pitch as a vector, trims not counted."),
    number!("CLM_LEAN_INT", control.limits.lean_integral_deg, OnFloor, 0.0, 45.0, "deg", "Largest lean the integrators may hold, per axis. At most CLM_TILT."),
    number!("CLM_THR_MIN", control.limits.thrust_min_frac, OnFloor, 0.0, 0.5, "", "Least thrust in flight, 0 to 1."),
    number!("CLM_THR_MAX", control.limits.thrust_max_frac, OnFloor, 0.5, 1.0, "", "Most thrust in flight, 0 to 1."),
    number!("CLM_THR_INT", control.limits.thrust_integral_frac, OnFloor, 0.0, 0.5, "", "Largest thrust the integrator may hold, either sign, 0 to 1."),
    number!("CLM_VER_INT", control.limits.vertical_integral_mps, OnFloor, 0.0, 1.0, "m/s", "Largest climb or sink rate the position integrator may hold."),
    number!("CLM_YAW_RATE", control.limits.yaw_rate_degps, AtOnce, 1.0, 360.0, "deg/s", "Rate at which the yaw setpoint follows the command."),
    number!("CLM_TILT_FACT", control.limits.tilt_compensation_max_frac, OnFloor, 1.0, 1.7, "", "Largest factor on thrust from tilt compensation; its inverse is the smallest."),
    number!("TRM_ROLL", control.trims.roll_deg, AtOnce, -MAX_TRIM_DEG, MAX_TRIM_DEG, "deg", "Added to the roll setpoint."),
    number!("TRM_PITCH", control.trims.pitch_deg, AtOnce, -MAX_TRIM_DEG, MAX_TRIM_DEG, "deg", "Added to the pitch setpoint."),
    number!("TRM_YAW", control.trims.yaw_deg, OnFloor, -MAX_YAW_TRIM_DEG, MAX_YAW_TRIM_DEG, "deg", "Added to the yaw setpoint."),
    number!("GAN_POS_X_P", control.gains.pos_x_p_per_s, AtOnce, 0.0, 6.0, "1/s", "Velocity setpoint per position error, forward."),
    number!("GAN_POS_Y_P", control.gains.pos_y_p_per_s, AtOnce, 0.0, 6.0, "1/s", "Velocity setpoint per position error, right."),
    number!("GAN_POS_Z_P", control.gains.pos_z_p_per_s, AtOnce, 0.0, 8.0, "1/s", "Velocity setpoint per position error, down."),
    number!("GAN_POS_Z_I", control.gains.pos_z_i_per_s2, AtOnce, 0.0, 2.0, "1/s^2", "Velocity setpoint per position error and second, down."),
    number!("GAN_POS_XY_D", control.gains.pos_xy_d_frac, AtOnce, 0.0, 0.8, "", "Velocity setpoint taken off per measured velocity, horizontal."),
    number!("GAN_POS_Z_D", control.gains.pos_z_d_frac, AtOnce, 0.0, 0.8, "", "Velocity setpoint taken off per measured velocity, vertical."),
    number!("GAN_VEL_X_P", control.gains.vel_x_p_rad_per_mps, AtOnce, 0.0, 1.0, "rad/(m/s)", "Lean per velocity error, forward."),
    number!("GAN_VEL_X_I", control.gains.vel_x_i_rad_per_m, AtOnce, 0.0, 3.0, "rad/m", "Lean per velocity error and second, forward."),
    number!("GAN_VEL_X_D", control.gains.vel_x_d_rad_per_mps2, AtOnce, 0.0, 0.1, "rad/(m/s^2)", "Lean taken off per measured acceleration, forward."),
    number!("GAN_VEL_Y_P", control.gains.vel_y_p_rad_per_mps, AtOnce, 0.0, 1.0, "rad/(m/s)", "Lean per velocity error, right."),
    number!("GAN_VEL_Y_I", control.gains.vel_y_i_rad_per_m, AtOnce, 0.0, 3.0, "rad/m", "Lean per velocity error and second, right."),
    number!("GAN_VEL_Y_D", control.gains.vel_y_d_rad_per_mps2, AtOnce, 0.0, 0.1, "rad/(m/s^2)", "Lean taken off per measured acceleration, right."),
    number!("GAN_VEL_Z_P", control.gains.vel_z_p_frac_per_mps, AtOnce, 0.0, 1.0, "1/(m/s)", "Thrust per velocity error, vertical."),
    number!("GAN_VEL_Z_I", control.gains.vel_z_i_frac_per_m, AtOnce, 0.0, 1.5, "1/m", "Thrust per velocity error and second, vertical."),
    number!("GAN_VEL_Z_D", control.gains.vel_z_d_frac_per_mps2, AtOnce, 0.0, 0.1, "1/(m/s^2)", "Thrust taken off per measured acceleration, vertical."),
    number!("GAN_VEL_D_T", control.gains.vel_d_filter_s, AtOnce, 0.0, 0.5, "s", "Time constant of the low-pass on the measured acceleration."),
    Parameter {
        kind: Kind::Choice(&[(0, "angle of velocity"), (1, "velocity of angle")]),
        get: |c| f64::from(u8::from(c.control.drag.reading == DragReading::VelocityOfAngle)),
        set: |c, v| {
            c.control.drag.reading =
                if v == 0.0 { DragReading::AngleOfVelocity } else { DragReading::VelocityOfAngle };
        },
        ..choice(
            "DRG_READING",
            "control.drag.reading",
            When::OnFloor,
            0.0,
            1.0,
            "Which of the two laws is used: DRG_PIT and DRG_ROL, or DRG_IPT and DRG_IRL.",
        )
    },
    number!("DRG_PIT_A", control.drag.pitch.a_deg, OnFloor, -180.0, 0.0, "deg", "Lean forward over speed v is a + b exp(-c v): a."),
    number!("DRG_PIT_B", control.drag.pitch.b_deg, OnFloor, 0.0, 180.0, "deg", "Lean forward over speed v is a + b exp(-c v): b."),
    number!("DRG_PIT_C", control.drag.pitch.c_s_per_m, OnFloor, 0.001, 5.0, "s/m", "Lean forward over speed v is a + b exp(-c v): c."),
    number!("DRG_ROL_A", control.drag.roll.a_deg, OnFloor, -180.0, 0.0, "deg", "Lean sideways over speed v is a + b exp(-c v): a."),
    number!("DRG_ROL_B", control.drag.roll.b_deg, OnFloor, 0.0, 180.0, "deg", "Lean sideways over speed v is a + b exp(-c v): b."),
    number!("DRG_ROL_C", control.drag.roll.c_s_per_m, OnFloor, 0.001, 5.0, "s/m", "Lean sideways over speed v is a + b exp(-c v): c."),
    number!("DRG_IPT_A", control.drag.pitch_inverse.a_mps, OnFloor, -100.0, 100.0, "m/s", "Speed forward over lean q is a + b exp(-c q): a."),
    number!("DRG_IPT_B", control.drag.pitch_inverse.b_mps, OnFloor, -100.0, 100.0, "m/s", "Speed forward over lean q is a + b exp(-c q): b."),
    number!("DRG_IPT_C", control.drag.pitch_inverse.c_per_deg, OnFloor, -1.0, 1.0, "1/deg", "Speed forward over lean q is a + b exp(-c q): c."),
    number!("DRG_IRL_A", control.drag.roll_inverse.a_mps, OnFloor, -100.0, 100.0, "m/s", "Speed sideways over lean q is a + b exp(-c q): a."),
    number!("DRG_IRL_B", control.drag.roll_inverse.b_mps, OnFloor, -100.0, 100.0, "m/s", "Speed sideways over lean q is a + b exp(-c q): b."),
    number!("DRG_IRL_C", control.drag.roll_inverse.c_per_deg, OnFloor, -1.0, 1.0, "1/deg", "Speed sideways over lean q is a + b exp(-c q): c."),
    number!("DRG_LIMIT", control.drag.limit_deg, OnFloor, 0.0, TESTED_LEAN_DEG, "deg", "Largest feed-forward angle per axis."),
    number!("DRG_FILTER_T", control.drag.filter_s, OnFloor, 0.0, 2.0, "s", "Time constant of the low-pass between velocity setpoint and feed-forward."),
    number!("DRG_INT_REF_T", control.drag.integral_reference_s, OnFloor, 0.0, 2.0, "s", "Time constant of the velocity that the integrators expect of the feed-forward."),
    entry!("VLT_BASE_0", control.voltage.base_coefficients_frac, 0, OnFloor, -5.0, 5.0, "", "Base thrust is a polynomial of (V - 3.7 a cell): the coefficient of this power."),
    entry!("VLT_BASE_1", control.voltage.base_coefficients_frac, 1, OnFloor, -5.0, 5.0, "", "Base thrust is a polynomial of (V - 3.7 a cell): the coefficient of this power."),
    entry!("VLT_BASE_2", control.voltage.base_coefficients_frac, 2, OnFloor, -5.0, 5.0, "", "Base thrust is a polynomial of (V - 3.7 a cell): the coefficient of this power."),
    entry!("VLT_BASE_3", control.voltage.base_coefficients_frac, 3, OnFloor, -5.0, 5.0, "", "Base thrust is a polynomial of (V - 3.7 a cell): the coefficient of this power."),
    Parameter {
        kind: Kind::Whole,
        get: |c| f64::from(c.control.voltage.cells),
        set: |c, v| c.control.voltage.cells = v as u8,
        ..choice("VLT_CELLS", "control.voltage.cells", When::OnFloor, 1.0, MOST_CELLS as f64, "Cells of the pack in series.")
    },
    number!("VLT_NOMINAL", control.voltage.nominal_v, OnFloor, 3.0, 4.2 * MOST_CELLS as f64, "V", "Voltage assumed until one is known. 3.0 to 4.2 a cell."),
    number!("VLT_FILTER_T", control.voltage.filter_s, OnFloor, 0.0, 60.0, "s", "Time constant of the low-pass on the measured voltage."),
    number!("GND_LAMBDA", control.ground.lambda_m2, OnFloor, -0.1, 0.1, "m^2", "Strength of the ground effect; below zero where the floor costs thrust."),
    number!("GND_POLE", control.ground.a_m, OnFloor, 0.0, 0.33, "m", "Height of the law's pole. Less than 0.33."),
    number!("GND_FILTER_T", control.ground.filter_s, OnFloor, 0.0, 5.0, "s", "Time constant of the low-pass on the height."),
    Parameter {
        kind: Kind::Choice(&[(0, "thrust axis"), (1, "accelerometer")]),
        get: |c| f64::from(u8::from(c.estimator.specific_force == SpecificForce::Accelerometer)),
        set: |c, v| {
            c.estimator.specific_force =
                if v == 0.0 { SpecificForce::ThrustAxis } else { SpecificForce::Accelerometer };
        },
        ..choice(
            "EST_FORCE",
            "estimator.specific_force",
            When::Restart,
            0.0,
            1.0,
            "Where the specific force comes from in flight.",
        )
    },
    switch!("EST_DRAG", estimator.drag, Restart, "Whether the drag model is used (with the thrust axis only)."),
    entry!("EST_DRAG_X", estimator.drag_per_s, 0, Restart, 0.0, 20.0, "1/s", "Drag along body x over mass."),
    entry!("EST_DRAG_Y", estimator.drag_per_s, 1, Restart, 0.0, 20.0, "1/s", "Drag along body y over mass."),
    entry!("EST_DRAG_Z", estimator.drag_per_s, 2, Restart, 0.0, 20.0, "1/s", "Drag along body z over mass."),
    number!("EST_COP_Z", estimator.cop_z_m, Restart, -0.5, 0.5, "m", "Centre of pressure above the centre of mass."),
    number!("EST_ACC_AVG_T", estimator.acc_average_s, Restart, 0.0, 0.2, "s", "Time constant of the low-pass on the accelerometer. 0: off."),
    Parameter {
        kind: Kind::Choice(&[(0, "constant"), (1, "height dependent")]),
        get: |c| f64::from(u8::from(c.estimator.uwb_noise == UwbNoise::HeightDependent)),
        set: |c, v| {
            c.estimator.uwb_noise =
                if v == 0.0 { UwbNoise::Constant } else { UwbNoise::HeightDependent };
        },
        ..choice(
            "EST_UWB_NOISE",
            "estimator.uwb_noise",
            When::Restart,
            0.0,
            1.0,
            "How the UWB variance depends on height.",
        )
    },
    number!("EST_UWB_STD", estimator.std_uwb_m, Restart, 0.01, 5.0, "m", "One sigma of a time difference near the floor."),
    number!("EST_UWB_CORR_T", estimator.uwb_correlation_s, Restart, 0.0, 10.0, "s", "Time over which the error of an anchor stays the same. 0: white noise."),
    entry!("EST_TAG_X", estimator.p_BT_B_m, 0, Restart, -1.0, 1.0, "m", "Tag antenna seen from the centre of mass, body x."),
    entry!("EST_TAG_Y", estimator.p_BT_B_m, 1, Restart, -1.0, 1.0, "m", "Tag antenna seen from the centre of mass, body y."),
    entry!("EST_TAG_Z", estimator.p_BT_B_m, 2, Restart, -1.0, 1.0, "m", "Tag antenna seen from the centre of mass, body z."),
    number!("EST_GATE", estimator.gate.sigma, Restart, 2.0, 100.0, "", "Innovations beyond this many sigma are rejected."),
    Parameter {
        kind: Kind::Choice(&[(0, "gaussian"), (1, "huber"), (2, "student t")]),
        get: |c| match c.estimator.gate.tail {
            Tail::Gaussian => 0.0,
            Tail::Huber => 1.0,
            Tail::StudentT => 2.0,
        },
        set: |c, v| {
            c.estimator.gate.tail = match v as i8 {
                0 => Tail::Gaussian,
                1 => Tail::Huber,
                _ => Tail::StudentT,
            };
        },
        ..choice(
            "EST_TAIL",
            "estimator.gate.tail",
            When::Restart,
            0.0,
            2.0,
            "Weighting inside the gate.",
        )
    },
    number!("EST_TAIL_SIGMA", estimator.gate.tail_sigma, Restart, 0.5, 100.0, "", "Where the tail begins, in sigma."),
    number!("EST_DOUBT", estimator.gate.doubt_frac, Restart, 0.1, 0.95, "", "Share of recent measurements beyond the gate at which the filter doubts itself."),
    switch!("EST_RECOVER", estimator.gate.recover, Restart, "Whether it then opens up and, failing that, finds its position anew."),
    number!("EST_STD_ACC_XY", estimator.process.std_acc_xy_mps2_rthz, Restart, 0.001, 20.0, "m/s^2/sqrt(Hz)", "Process noise of the specific force along body x and y."),
    number!("EST_STD_ACC_Z", estimator.process.std_acc_z_mps2_rthz, Restart, 0.001, 20.0, "m/s^2/sqrt(Hz)", "Process noise of the specific force along body z."),
    number!("EST_STD_RATE", estimator.process.std_rate_radps_rthz, Restart, 0.00001, 2.0, "rad/s/sqrt(Hz)", "Process noise of the angular rate."),
    number!("EST_STD_POS", estimator.process.std_pos_m_rts, Restart, 0.0, 2.0, "m/sqrt(s)", "Process noise of the position."),
    switch!("EST_BARO", estimator.baro.fuse, Restart, "Whether height from air pressure is fused."),
    number!("EST_BARO_STD", estimator.baro.std_m, Restart, 0.01, 20.0, "m", "One sigma of a height from air pressure."),
    number!("EST_BARO_CORR_T", estimator.baro.correlation_s, Restart, 0.0, 100.0, "s", "Time over which that error stays the same."),
    switch!("EST_MAG", estimator.magnetometer.fuse, Restart, "Whether the magnetic field tells the heading."),
    number!("EST_MAG_NORTH", estimator.magnetometer.north_deg, Restart, -180.0, 180.0, "deg", "Magnetic north from room north, positive clockwise."),
    number!("EST_MAG_FIELD", estimator.magnetometer.strength_ut, Restart, 15.0, 100.0, "uT", "Strength of the magnetic field in the room."),
    number!("EST_MAG_DIP", estimator.magnetometer.dip_deg, Restart, -80.0, 80.0, "deg", "How far it points below the horizontal."),
    number!("EST_MAG_STD", estimator.magnetometer.std_deg, Restart, 1.0, 60.0, "deg", "One sigma of a heading from an undisturbed field."),
    number!("EST_MAG_CORR_T", estimator.magnetometer.correlation_s, Restart, 0.0, 100.0, "s", "Time over which that error stays the same."),
    number!("EST_MAG_MOST", estimator.magnetometer.most_disturbance_frac, Restart, 0.02, 1.0, "", "A field is not used when it is this far from strength and dip, as a share."),
    switch!("EST_FUSE_REF", estimator.fuse_reference, Restart, "Whether motion capture is fused as a measurement."),
    number!("EST_REF_STD", estimator.std_reference_m, Restart, 0.0001, 1.0, "m", "One sigma of a motion-capture position."),
    number!("EST_ALIGN_T", estimator.align_s, Restart, 0.05, 30.0, "s", "Rest that is needed before a start from rest."),
    switch!("EST_REJECT", estimator.gate.reject, Restart, "Whether what is beyond the gate is thrown away; if not, its tail weighs it."),
    switch!("EST_COLD", estimator.cold_start, Restart, "Whether position and heading are found by motion when nobody tells them."),
    switch!("EST_BVT", estimator.board_vertical.fuse, Restart, "Whether the board's vertical is fused."),
    number!("EST_BVT_STD", estimator.board_vertical.std_deg, Restart, 0.1, 60.0, "deg", "One sigma of the board's vertical."),
    number!("EST_BVT_CORR_T", estimator.board_vertical.correlation_s, Restart, 0.0, 100.0, "s", "Time over which that error stays the same."),
    number!("EST_SLOW_F_T", estimator.slow_force_s, Restart, 0.0, 60.0, "s", "Time from which on the accelerometer shows forces beyond drag, such as wind. 0: off."),
    number!("EST_COV_STEP", estimator.covariance_step_s, Restart, 0.0, 0.02, "s", "Least step in which the covariance is predicted. 0: with each IMU sample."),
    number!("EST_UNA_ACC", estimator.unaided.std_acc_mps2_rthz, Restart, 0.001, 50.0, "m/s^2/sqrt(Hz)", "Random push of a vehicle without IMU."),
    number!("EST_UNA_DECAY", estimator.unaided.decay_per_s, Restart, 0.0, 20.0, "1/s", "Decay of the velocity of a vehicle without IMU."),
    switch!("EST_BIA", estimator.anchor_bias.estimate, Restart, "Whether the range bias of each anchor is estimated."),
    number!("EST_BIA_STD", estimator.anchor_bias.std_m, Restart, 0.0001, 5.0, "m", "One sigma of the part of that bias that wanders."),
    number!("EST_BIA_CORR_T", estimator.anchor_bias.correlation_s, Restart, 0.01, 100000.0, "s", "Time over which that part stays."),
    number!("EST_BIA_CORR_L", estimator.anchor_bias.correlation_m, Restart, 0.01, 100000.0, "m", "Distance flown over which that part stays."),
    number!("EST_BIA_LVL_T", estimator.anchor_bias.level_s, Restart, 0.0, 10000.0, "s", "Time in which it is learned how much each wanders; 0: as much as EST_BIA_STD says."),
    number!("EST_BIA_CONST", estimator.anchor_bias.constant_std_m, Restart, 0.0, 5.0, "m", "One sigma of the part of that bias that stays."),
    number!("EST_BIA_HID", estimator.anchor_bias.hidden_std_m, Restart, 0.0001, 10.0, "m", "One sigma of the bias of an anchor that the floor hides."),
    number!("EST_BIA_HID_T", estimator.anchor_bias.hidden_s, Restart, 0.01, 100.0, "s", "Time over which that stays."),
    number!("EST_BIA_HID_H", estimator.anchor_bias.hidden_below_m, Restart, -50.0, 5.0, "m", "The floor hides anchors from a tag below this height."),
    number!("EST_BIA_LOW", estimator.anchor_bias.low_anchor_m, Restart, -50.0, 5.0, "m", "It hides anchors that hang below this height."),
    switch!("EST_GB", estimator.gyro_bias.estimate, Restart, "Whether the gyroscope's bias is estimated in flight."),
    number!("EST_GB_STD", estimator.gyro_bias.std_radps, Restart, 0.000001, 0.5, "rad/s", "One sigma of what the gyroscope's bias has changed since the rest."),
    number!("EST_GB_WALK", estimator.gyro_bias.walk_radps_rts, Restart, 0.0, 0.1, "rad/s/√s", "Walk of the gyroscope's bias."),
    switch!("EST_QUA", estimator.quality.learn, Restart, "Whether the quality of each anchor is learned in flight."),
    number!("EST_QUA_T", estimator.quality.time_s, Restart, 0.05, 100.0, "s", "Time of that learning."),
    number!("EST_QUA_LEAST", estimator.quality.least, Restart, 0.01, 1.0, "", "Least factor on the variance of an anchor."),
    number!("EST_QUA_MOST", estimator.quality.most, Restart, 1.0, 10000.0, "", "Largest factor on the variance of an anchor."),
    switch!("EST_OUT", estimator.isolation.leave_out, Restart, "Whether an anchor that does not fit in flight is left out."),
    number!("EST_OUT_MEM", estimator.isolation.memory_s, Restart, 0.1, 60.0, "s", "Time over which residuals are remembered for that."),
    number!("EST_OUT_USUAL", estimator.isolation.std_bias_m, Restart, 0.01, 5.0, "m", "One sigma of the range bias of an anchor that is sound."),
    number!("EST_OUT_DOUBT", estimator.isolation.doubt, Restart, 0.5, 1000.0, "", "Doubt from which an anchor is suspected."),
    number!("EST_OUT_OTHERS", estimator.isolation.others_doubt, Restart, 0.1, 1000.0, "", "Doubt below which the others are sound without it."),
    number!("EST_OUT_LEAST", estimator.isolation.least_m, Restart, 0.05, 20.0, "m", "Least range error for which one is left out."),
    number!("EST_OUT_CONF_T", estimator.isolation.confirm_s, Restart, 0.0, 60.0, "s", "Time for which the suspicion must last."),
    number!("EST_OUT_BACK_T", estimator.isolation.return_s, Restart, 0.0, 600.0, "s", "Time for which one that is left out must fit before it is taken back."),
    Parameter {
        name: "EST_REST_HGT",
        key: "estimator.rest_height_m",
        kind: Kind::Number,
        when: When::Restart,
        low: NOT_SET_M,
        high: 50.0,
        unit: "m",
        doc: "Height of the centre of mass while standing. -51: not told.",
        get: |c| c.estimator.rest_height_m.unwrap_or(NOT_SET_M),
        set: |c, v| c.estimator.rest_height_m = (v > NOT_SET_M).then_some(v),
    },
    Parameter {
        kind: Kind::Whole,
        get: |c| f64::from(c.uwb.pairs_per_packet),
        set: |c, v| c.uwb.pairs_per_packet = v as u8,
        ..choice(
            "UWB_PAIRS",
            "uwb.pairs_per_packet",
            When::Restart,
            1.0,
            7.0,
            "Most time differences from one packet.",
        )
    },
    number!("UWB_MARGIN", uwb.impossible_margin_m, Restart, 0.1, 5.0, "m", "A time difference may exceed the distance between its anchors by this much."),
    number!("UWB_CLOCK_GATE", uwb.clock_gate_m, Restart, 0.5, 10.0, "m", "An arrival this far from where its anchor's clock predicts it is not used."),
    number!("UWB_LATENCY", uwb.tag_latency_s, Restart, 0.0, 0.1, "s", "Least time from the antenna to our read call."),
];

/// What clients of PX4 ask for beside that (GROUND.md section 3): two names that MAVSDK writes, and
/// values that keep QGroundControl's set-up pages from calling parameters missing.
#[rustfmt::skip] // one line each
pub static PX4_ONLY: &[Parameter] = &[
    alias("MIS_TAKEOFF_ALT", "FLT_TKO_HGT", 20.0, "m"),
    alias("RTL_RETURN_ALT", "FLT_RTN_HGT", 20.0, "m"),
    fixed("SYS_AUTOSTART", 1.0, "Airframe number of PX4: it has none for flapping wings."),
    fixed("CAL_GYRO0_ID", 1.0, "Tells clients of PX4 that the gyroscope needs no calibration."),
    fixed("CAL_ACC0_ID", 1.0, "Tells clients of PX4 that the accelerometer needs no calibration."),
    fixed("CAL_MAG0_ID", 1.0, "Tells clients of PX4 that no compass waits for calibration."),
    fixed("COM_RC_IN_MODE", 1.0, "Tells clients of PX4 that a joystick is the only manual control."),
];
