//! What clients see: the messages that are streamed or asked for, one maker for each row of `streams`.

use haltere_dialect::mav::haltere::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, AVAILABLE_MODES_MONITOR_DATA, BATTERY_STATUS_DATA,
    EXTENDED_SYS_STATE_DATA, HALTERE_CONTROL_DATA, HALTERE_ESTIMATE_DATA, HEARTBEAT_DATA,
    LOCAL_POSITION_NED_DATA, MISSION_CURRENT_DATA, MavBatteryChargeState, MavBatteryFault,
    MavBatteryFunction, MavBatteryMode, MavBatteryType, MavLandedState, MavMessage, MavModeFlag,
    MavState, MavSysStatusSensor, MavSysStatusSensorExtended, MavVtolState, MissionState,
    NAMED_VALUE_FLOAT_DATA, SERVO_OUTPUT_RAW_DATA, SYS_STATUS_DATA, SYSTEM_TIME_DATA,
};

use haltere_core::estimate::Health;

use super::endpoint::GpsClaim;
use super::identity;
use super::services::fence_status;
use super::shown::{Shown, Turns};
use crate::flight::modes::Mode;
use crate::out::recording::Recording;

fn f32s(v: [f64; 3]) -> [f32; 3] {
    v.map(|c| c as f32)
}

/// SYSTEM_TIME. 0: nobody has told the core what the calendar says.
pub(crate) fn system_time(shown: &Shown<'_>) -> MavMessage {
    MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA {
        time_unix_usec: shown.clock.calendar.map_or(0, |c| c.unix_us(shown.at)),
        time_boot_ms: shown.boot_ms(),
    })
}

/// CURRENT_EVENT_SEQUENCE.
pub(crate) fn event_sequence(shown: &Shown<'_>, turns: &mut Turns) -> Option<MavMessage> {
    let is_known = std::mem::replace(&mut turns.event_sequence_told, true);
    Some(shown.out.event_sequence(is_known))
}

/// NAMED_VALUE_FLOAT: the thrust that hovers.
pub(crate) fn hover_thrust(shown: &Shown<'_>) -> Option<MavMessage> {
    (shown.flight.control.thrust_base_frac > 0.0).then(|| {
        MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA {
            time_boot_ms: shown.boot_ms(),
            value: shown.flight.hover_thrust_frac(shown.config) as f32,
            name: "HoverThr".into(),
        })
    })
}

/// ATTITUDE.
pub(crate) fn attitude(shown: &Shown<'_>) -> MavMessage {
    let [roll, pitch, yaw] = f32s(shown.estimate.R_EB.euler_rad());
    let [rollspeed, pitchspeed, yawspeed] = f32s(shown.estimate.rate_B_radps.to_array());
    MavMessage::ATTITUDE(ATTITUDE_DATA {
        time_boot_ms: shown.boot_ms(),
        roll,
        pitch,
        yaw,
        rollspeed,
        pitchspeed,
        yawspeed,
    })
}

/// ATTITUDE_QUATERNION.
pub(crate) fn attitude_quaternion(shown: &Shown<'_>) -> MavMessage {
    let [q1, q2, q3, q4] = shown.estimate.R_EB.to_wxyz().map(|c| c as f32);
    let [rollspeed, pitchspeed, yawspeed] = f32s(shown.estimate.rate_B_radps.to_array());
    MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
        time_boot_ms: shown.boot_ms(),
        q1,
        q2,
        q3,
        q4,
        rollspeed,
        pitchspeed,
        yawspeed,
        repr_offset_q: [0.0; 4],
    })
}

/// LOCAL_POSITION_NED.
pub(crate) fn local_position(shown: &Shown<'_>) -> MavMessage {
    let [x, y, z] = f32s(shown.estimate.pos_E_m.to_array());
    let [vx, vy, vz] = f32s(shown.estimate.vel_E_mps().to_array());
    let time_boot_ms = shown.boot_ms();
    MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA { time_boot_ms, x, y, z, vx, vy, vz })
}

/// EXTENDED_SYS_STATE.
pub(crate) fn extended_state(shown: &Shown<'_>) -> MavMessage {
    MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
        vtol_state: MavVtolState::MAV_VTOL_STATE_UNDEFINED as u8,
        landed_state: landed_state(shown) as u8,
    })
}

/// CURRENT_MODE.
pub(crate) fn current_mode(shown: &Shown<'_>) -> MavMessage {
    let mode = shown.flight.shown_mode().custom_mode();
    identity::current_mode(mode, shown.stations.intended_mode)
}

/// AVAILABLE_MODES_MONITOR: the list never changes.
pub(crate) fn modes_monitor(_: &Shown<'_>) -> MavMessage {
    MavMessage::AVAILABLE_MODES_MONITOR(AVAILABLE_MODES_MONITOR_DATA { seq: 0 })
}

/// AUTOPILOT_VERSION.
pub(crate) fn version(shown: &Shown<'_>) -> MavMessage {
    identity::autopilot_version(shown.endpoint.identity)
}

/// FENCE_STATUS.
pub(crate) fn fence(shown: &Shown<'_>) -> MavMessage {
    shown.stations.fence_status(shown.flight)
}

/// HALTERE_ESTIMATE.
pub(crate) fn estimate(shown: &Shown<'_>) -> MavMessage {
    let estimate = shown.estimate;
    MavMessage::HALTERE_ESTIMATE(HALTERE_ESTIMATE_DATA {
        time_usec: shown.at.as_us(),
        position: f32s(estimate.pos_E_m.to_array()),
        velocity_body: f32s(estimate.vel_B_mps.to_array()),
        q: estimate.R_EB.to_wxyz().map(|c| c as f32),
        position_std: f32s(estimate.std_pos_E_m.to_array()),
        velocity_std: f32s(estimate.std_vel_B_mps.to_array()),
        attitude_std: f32s(estimate.std_att_B_rad.to_array()),
        uwb_noise_factor: estimate.uwb_noise_factor as f32,
        uwb_age: shown.navigation.last_fused.map_or(f32::NAN, |t| shown.at.seconds_since(t) as f32),
        health: estimate.health as u8,
    })
}

/// HEARTBEAT.
pub(crate) fn heartbeat(shown: &Shown<'_>) -> MavMessage {
    let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        | MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED
        | MavModeFlag::MAV_MODE_FLAG_GUIDED_ENABLED
        | MavModeFlag::MAV_MODE_FLAG_AUTO_ENABLED;
    if shown.flight.mode == Mode::Manual {
        base_mode |= MavModeFlag::MAV_MODE_FLAG_MANUAL_INPUT_ENABLED;
    }
    if shown.board.link.is_armed() {
        base_mode |= MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
    }
    let system_status = match (shown.flight.mode, shown.estimate.health) {
        (Mode::Descend, _) => MavState::MAV_STATE_EMERGENCY,
        (_, Health::Lost) => MavState::MAV_STATE_CRITICAL,
        (_, Health::NotAligned) => MavState::MAV_STATE_BOOT,
        (mode, _) if mode.has_thrust() || shown.flight.shadow.is_airborne() => {
            MavState::MAV_STATE_ACTIVE
        }
        _ => MavState::MAV_STATE_STANDBY,
    };
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: shown.flight.shown_mode().custom_mode(),
        mavtype: shown.endpoint.vehicle_type,
        autopilot: identity::autopilot(shown.endpoint.identity) as u8,
        base_mode,
        system_status: system_status as u8,
        mavlink_version: 3,
    })
}

/// SYS_STATUS.
pub(crate) fn sys_status(shown: &Shown<'_>) -> MavMessage {
    use MavSysStatusSensor as S;
    let mut has = S::MAV_SYS_STATUS_SENSOR_3D_GYRO
        | S::MAV_SYS_STATUS_SENSOR_3D_ACCEL
        | S::MAV_SYS_STATUS_SENSOR_VISION_POSITION
        | S::MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
        | S::MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL
        | S::MAV_SYS_STATUS_SENSOR_BATTERY
        | S::MAV_SYS_STATUS_GEOFENCE
        | S::MAV_SYS_STATUS_AHRS
        | S::MAV_SYS_STATUS_PREARM_CHECK;
    has.set(S::MAV_SYS_STATUS_LOGGING, shown.out.recording.state != Recording::Off);
    has.set(S::MAV_SYS_STATUS_SENSOR_GPS, shown.endpoint.gps == GpsClaim::OriginGps);
    let mut health = S::empty();
    let usable = matches!(shown.estimate.health, Health::Good | Health::Degraded);
    health.set(
        S::MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL | S::MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL,
        usable,
    );
    health.set(S::MAV_SYS_STATUS_SENSOR_GPS, usable && shown.endpoint.gps == GpsClaim::OriginGps);
    health.set(
        S::MAV_SYS_STATUS_GEOFENCE,
        fence_status::breach(shown.flight, shown.estimate).is_none(),
    );
    let imu_fresh =
        shown.navigation.last_imu.is_some_and(|t| shown.clock.now.seconds_since(t) < 0.2);
    health.set(S::MAV_SYS_STATUS_SENSOR_3D_GYRO | S::MAV_SYS_STATUS_SENSOR_3D_ACCEL, imu_fresh);
    let uwb_fresh =
        shown.navigation.last_fused.is_some_and(|t| shown.clock.now.seconds_since(t) < 0.5);
    health.set(S::MAV_SYS_STATUS_SENSOR_VISION_POSITION, uwb_fresh);
    let charged =
        shown.board.battery.is_some_and(|b| b.supply_v >= shown.config.limits.battery_low_v);
    health.set(S::MAV_SYS_STATUS_SENSOR_BATTERY, charged);
    health.set(S::MAV_SYS_STATUS_AHRS, shown.estimate.health == Health::Good);
    health.set(S::MAV_SYS_STATUS_LOGGING, shown.out.recording.state == Recording::Runs);
    health.remove(shown.flight.supervisor.unhealthy);
    let ready = shown.flight.mode != Mode::Disarmed || (shown.may_arm)();
    health.set(S::MAV_SYS_STATUS_PREARM_CHECK, ready);
    MavMessage::SYS_STATUS(SYS_STATUS_DATA {
        onboard_control_sensors_present: has,
        onboard_control_sensors_enabled: has,
        onboard_control_sensors_health: health,
        load: 0,
        voltage_battery: shown
            .board
            .battery
            .map_or(u16::MAX, |b| (b.supply_v * 1e3).clamp(0.0, 65534.0) as u16),
        current_battery: shown
            .board
            .battery
            .and_then(|b| b.current_a)
            .map_or(-1, |a| (a * 100.0).clamp(0.0, 32767.0) as i16),
        drop_rate_comm: 0,
        errors_comm: 0,
        errors_count1: 0,
        errors_count2: 0,
        errors_count3: 0,
        errors_count4: 0,
        battery_remaining: remaining_percent(shown),
        onboard_control_sensors_present_extended: MavSysStatusSensorExtended::empty(),
        onboard_control_sensors_enabled_extended: MavSysStatusSensorExtended::empty(),
        onboard_control_sensors_health_extended: MavSysStatusSensorExtended::empty(),
    })
}

/// Time until the voltage is critical, s, once it can be told.
fn battery_left_s(shown: &Shown<'_>) -> Option<f64> {
    shown.flight.supervisor.discharge.time_to_s(shown.config.limits.battery_critical_v)
}

fn remaining_percent(shown: &Shown<'_>) -> i8 {
    shown.board.battery.and_then(|b| b.remaining_frac).map_or(-1, |f| (f * 100.0).round() as i8)
}

/// BATTERY_STATUS.
pub(crate) fn battery(shown: &Shown<'_>) -> Option<MavMessage> {
    let battery = shown.board.battery?;
    let mut voltages = [u16::MAX; 10];
    let charge_state = if battery.supply_v < shown.config.limits.battery_critical_v {
        MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_CRITICAL
    } else if battery.supply_v < shown.config.limits.battery_low_v {
        MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_LOW
    } else {
        MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_OK
    };
    voltages[0] = (battery.supply_v * 1e3).clamp(0.0, 65534.0) as u16;
    Some(MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
        current_consumed: -1,
        energy_consumed: -1,
        temperature: i16::MAX,
        voltages,
        current_battery: battery.current_a.map_or(-1, |a| (a * 100.0).clamp(0.0, 32767.0) as i16),
        id: 0,
        battery_function: MavBatteryFunction::MAV_BATTERY_FUNCTION_ALL as u8,
        mavtype: MavBatteryType::MAV_BATTERY_TYPE_LIPO as u8,
        battery_remaining: remaining_percent(shown),
        // 0: not known.
        time_remaining: battery_left_s(shown).map_or(0, |s| (s.min(86_400.0) as i32).max(1)),
        charge_state: charge_state as u8,
        voltages_ext: [0; 4],
        mode: MavBatteryMode::MAV_BATTERY_MODE_UNKNOWN as u8,
        fault_bitmask: MavBatteryFault::empty(),
    }))
}

/// SERVO_OUTPUT_RAW: what the board told motors and servos, where it is a pulse width.
pub(crate) fn servos(shown: &Shown<'_>) -> Option<MavMessage> {
    let servos = shown.board.servos?;
    // The casts saturate; NaN, an output that is not in use, is 0 as it should be.
    let told = |n: usize| servos.outputs().get(n).map_or(0, |value| *value as u16);
    Some(MavMessage::SERVO_OUTPUT_RAW(SERVO_OUTPUT_RAW_DATA {
        time_usec: servos.received_at.as_us() as u32, // the field is 32 bits wide
        servo1_raw: told(0),
        servo2_raw: told(1),
        servo3_raw: told(2),
        servo4_raw: told(3),
        servo5_raw: told(4),
        servo6_raw: told(5),
        servo7_raw: told(6),
        servo8_raw: told(7),
        port: servos.port,
        servo9_raw: told(8),
        servo10_raw: told(9),
        servo11_raw: told(10),
        servo12_raw: told(11),
        servo13_raw: told(12),
        servo14_raw: told(13),
        servo15_raw: told(14),
        servo16_raw: told(15),
    }))
}

fn landed_state(shown: &Shown<'_>) -> MavLandedState {
    match shown.flight.mode {
        Mode::Disarmed if shown.flight.shadow.is_airborne() => {
            MavLandedState::MAV_LANDED_STATE_IN_AIR
        }
        Mode::Disarmed | Mode::Arming | Mode::Idle | Mode::Disarming => {
            MavLandedState::MAV_LANDED_STATE_ON_GROUND
        }
        Mode::Spool | Mode::Takeoff => MavLandedState::MAV_LANDED_STATE_TAKEOFF,
        Mode::Land | Mode::Descend => MavLandedState::MAV_LANDED_STATE_LANDING,
        _ => MavLandedState::MAV_LANDED_STATE_IN_AIR,
    }
}

/// MISSION_CURRENT.
pub(crate) fn mission_current(shown: &Shown<'_>) -> MavMessage {
    let total = shown.flight.mission.items.len() as u16;
    let seq = shown.flight.guidance.current_item;
    // Its landing is a part of it.
    let flies = shown.flight.flies_mission() || shown.flight.guidance.landing;
    let mission_state = if total == 0 {
        MissionState::MISSION_STATE_NO_MISSION
    } else if seq >= total {
        MissionState::MISSION_STATE_COMPLETE
    } else if flies {
        MissionState::MISSION_STATE_ACTIVE
    } else if seq == 0 {
        MissionState::MISSION_STATE_NOT_STARTED
    } else {
        MissionState::MISSION_STATE_PAUSED
    };
    let (fence_id, rally_points_id) = shown.flight.plans.ids();
    MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA {
        seq: seq.min(total.saturating_sub(1)),
        // The protocol writes "no mission" as the largest number.
        total: if total == 0 { u16::MAX } else { total },
        mission_state,
        mission_mode: if flies { 1 } else { 2 },
        mission_id: shown.flight.mission.id,
        fence_id,
        rally_points_id,
    })
}

/// HALTERE_CONTROL.
pub(crate) fn control(shown: &Shown<'_>) -> Option<MavMessage> {
    if !shown.flight.mode.has_thrust() {
        return None;
    }
    let c = &shown.flight.control;
    Some(MavMessage::HALTERE_CONTROL(HALTERE_CONTROL_DATA {
        time_usec: c.at.as_us(),
        position_setpoint: c.pos_setpoint_E_m.map(|p| p.map_or(f32::NAN, |p| p as f32)),
        velocity_setpoint: f32s(c.vel_setpoint_E_mps.to_array()),
        roll: c.roll_rad as f32,
        pitch: c.pitch_rad as f32,
        yaw: c.yaw_rad as f32,
        roll_feed_forward: c.roll_ff_rad as f32,
        pitch_feed_forward: c.pitch_ff_rad as f32,
        thrust: c.thrust_frac as f32,
        thrust_base: c.thrust_base_frac as f32,
        thrust_feedback: c.thrust_feedback_frac as f32,
        ground_factor: c.ground_factor as f32,
        yaw_board_offset: c.yaw_board_offset_rad as f32,
        saturation: u8::from(c.saturation.velocity)
            | u8::from(c.saturation.tilt) << 1
            | u8::from(c.saturation.thrust_high) << 2
            | u8::from(c.saturation.thrust_low) << 3,
    }))
}
