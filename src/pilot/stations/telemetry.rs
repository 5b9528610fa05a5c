//! What clients see: the messages that are streamed or asked for.

use haltere_dialect::mav::haltere::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, AVAILABLE_MODES_MONITOR_DATA, BATTERY_STATUS_DATA,
    EXTENDED_SYS_STATE_DATA, HALTERE_CONTROL_DATA, HALTERE_ESTIMATE_DATA, HEARTBEAT_DATA,
    LOCAL_POSITION_NED_DATA, MISSION_CURRENT_DATA, MISSION_ITEM_REACHED_DATA,
    MavBatteryChargeState, MavBatteryFault, MavBatteryFunction, MavBatteryMode, MavBatteryType,
    MavLandedState, MavMessage, MavModeFlag, MavState, MavSysStatusSensor,
    MavSysStatusSensorExtended, MavVtolState, MissionState, NAMED_VALUE_FLOAT_DATA,
    SERVO_OUTPUT_RAW_DATA, SYS_STATUS_DATA, SYSTEM_TIME_DATA,
};

use haltere_core::estimate::Health;
use haltere_core::time::HostTime;

use super::endpoint::{Endpoint, GpsClaim};
use super::identity;
use crate::Pilot;
use crate::flight::modes::Mode;
use crate::input::LinkId;
use crate::out::events::SEQUENCE_ID as EVENT_SEQUENCE_ID;
use crate::out::recording::Recording;

fn f32s(v: [f64; 3]) -> [f32; 3] {
    v.map(|c| c as f32)
}

impl Pilot {
    /// Sends one message of a stream.
    pub(crate) fn send_telemetry(&mut self, at: HostTime, link: LinkId, msg_id: u32) -> bool {
        match self.telemetry(at, link, msg_id) {
            Some(message) => {
                self.out.message(link, &message);
                true
            }
            None => false,
        }
    }

    pub(crate) fn tell_reached(&mut self, at: HostTime, seq: u16) {
        self.tell_program_progress(at, seq);
        self.out.tell_all(&MavMessage::MISSION_ITEM_REACHED(MISSION_ITEM_REACHED_DATA { seq }));
    }

    /// HEARTBEAT and CURRENT_MODE at once where the mode shown or the arming has changed: clients that
    /// asked for it give up soon (GROUND.md).
    pub(crate) fn tell_mode(&mut self, at: HostTime) {
        let shown = (self.flight.shown_mode().custom_mode(), self.board.link.is_armed());
        if self.out.told.mode == Some(shown) {
            return;
        }
        self.out.told.mode = Some(shown);
        for n in 0..self.stations.grounds.len() {
            let link = self.stations.grounds[n].link;
            if self.out.is_open(link) {
                self.send_telemetry(at, link, 0);
                self.send_telemetry(at, link, 436);
            }
        }
    }

    /// The present content of a message. `None`: not one of ours, or nothing to say yet.
    fn telemetry(&mut self, at: HostTime, link: LinkId, msg_id: u32) -> Option<MavMessage> {
        let time_boot_ms = (at.as_us() / 1000) as u32;
        let estimate = &self.estimate;
        let aligned = estimate.health != Health::NotAligned;
        let endpoint = self.stations.endpoint_on(link);
        let global = aligned && endpoint.gps != GpsClaim::None;
        let gps = endpoint.gps == GpsClaim::OriginGps;
        Some(match msg_id {
            0 => self.heartbeat(&endpoint),
            1 => self.sys_status(&endpoint),
            162 => self.stations.fence_status(),
            EVENT_SEQUENCE_ID => {
                let is_known = self
                    .stations
                    .ground_mut(link)
                    .is_some_and(|g| std::mem::replace(&mut g.event_sequence_told, true));
                self.out.event_sequence(is_known)
            }
            2 => MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA {
                // 0: nobody has told the core what the calendar says.
                time_unix_usec: self.clock.calendar.map_or(0, |c| c.unix_us(at)),
                time_boot_ms,
            }),
            24 if gps => self.gps_raw(at, aligned),
            251 if self.flight.control.thrust_base_frac > 0.0 => {
                MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA {
                    time_boot_ms,
                    value: self.flight.hover_thrust_frac(&self.config) as f32,
                    name: "HoverThr".into(),
                })
            }
            30 if aligned => {
                let [roll, pitch, yaw] = f32s(estimate.R_EB.euler_rad());
                let [rollspeed, pitchspeed, yawspeed] = f32s(estimate.rate_B_radps.to_array());
                MavMessage::ATTITUDE(ATTITUDE_DATA {
                    time_boot_ms,
                    roll,
                    pitch,
                    yaw,
                    rollspeed,
                    pitchspeed,
                    yawspeed,
                })
            }
            31 if aligned => {
                let [q1, q2, q3, q4] = estimate.R_EB.to_wxyz().map(|c| c as f32);
                let [rollspeed, pitchspeed, yawspeed] = f32s(estimate.rate_B_radps.to_array());
                MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
                    time_boot_ms,
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
            32 if aligned => {
                let [x, y, z] = f32s(estimate.pos_E_m.to_array());
                let [vx, vy, vz] = f32s(estimate.vel_E_mps().to_array());
                MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                    time_boot_ms,
                    x,
                    y,
                    z,
                    vx,
                    vy,
                    vz,
                })
            }
            33 if global => self.global_position(at),
            42 => self.mission_current(),
            49 if endpoint.gps != GpsClaim::None => self.origin_message(),
            64 if aligned => self.position_covariance(at),
            74 if aligned => self.vfr_hud(),
            85 if self.flight.mode.is_flying() => self.position_target(at),
            141 if aligned => self.altitude(at),
            147 => self.battery_status()?,
            26 => self.scaled_imu(time_boot_ms)?,
            36 => self.servo_output()?,
            105 => self.highres_imu()?,
            148 => identity::autopilot_version(endpoint.identity),
            193 if gps => self.ekf_status(endpoint.gps),
            230 if aligned => self.estimator_status(at, endpoint.gps),
            // Home is known from the first alignment: until a take-off or a client says otherwise it
            // is the room's origin.
            242 if global => self.home_message(),
            245 => MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
                vtol_state: MavVtolState::MAV_VTOL_STATE_UNDEFINED as u8,
                landed_state: self.landed_state() as u8,
            }),
            331 if aligned => self.odometry(at),
            436 => identity::current_mode(
                self.flight.shown_mode().custom_mode(),
                self.stations.intended_mode,
            ),
            437 => MavMessage::AVAILABLE_MODES_MONITOR(AVAILABLE_MODES_MONITOR_DATA { seq: 0 }),
            54101 if aligned => MavMessage::HALTERE_ESTIMATE(HALTERE_ESTIMATE_DATA {
                time_usec: at.as_us(),
                position: f32s(estimate.pos_E_m.to_array()),
                velocity_body: f32s(estimate.vel_B_mps.to_array()),
                q: estimate.R_EB.to_wxyz().map(|c| c as f32),
                position_std: f32s(estimate.std_pos_E_m.to_array()),
                velocity_std: f32s(estimate.std_vel_B_mps.to_array()),
                attitude_std: f32s(estimate.std_att_B_rad.to_array()),
                uwb_noise_factor: estimate.uwb_noise_factor as f32,
                uwb_age: self
                    .navigation
                    .last_fused
                    .map_or(f32::NAN, |t| at.seconds_since(t) as f32),
                health: estimate.health as u8,
            }),
            54102 if self.flight.mode.has_thrust() => self.control_message(),
            54103 => self.next_pair(at, link)?,
            54104 => self.next_drop(at, link)?,
            54105 => self.stations.next_link(at, link, &mut self.out)?,
            _ => return None,
        })
    }

    fn heartbeat(&self, endpoint: &Endpoint) -> MavMessage {
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED
            | MavModeFlag::MAV_MODE_FLAG_GUIDED_ENABLED
            | MavModeFlag::MAV_MODE_FLAG_AUTO_ENABLED;
        if self.flight.mode == Mode::Manual {
            base_mode |= MavModeFlag::MAV_MODE_FLAG_MANUAL_INPUT_ENABLED;
        }
        if self.board.link.is_armed() {
            base_mode |= MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
        }
        let system_status = match (self.flight.mode, self.estimate.health) {
            (Mode::Descend, _) => MavState::MAV_STATE_EMERGENCY,
            (_, Health::Lost) => MavState::MAV_STATE_CRITICAL,
            (_, Health::NotAligned) => MavState::MAV_STATE_BOOT,
            (mode, _) if mode.has_thrust() || self.flight.shadow.is_airborne() => {
                MavState::MAV_STATE_ACTIVE
            }
            _ => MavState::MAV_STATE_STANDBY,
        };
        MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            custom_mode: self.flight.shown_mode().custom_mode(),
            mavtype: endpoint.vehicle_type,
            autopilot: identity::autopilot(endpoint.identity) as u8,
            base_mode,
            system_status: system_status as u8,
            mavlink_version: 3,
        })
    }

    fn sys_status(&self, endpoint: &Endpoint) -> MavMessage {
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
        has.set(S::MAV_SYS_STATUS_LOGGING, self.out.recording.state != Recording::Off);
        has.set(S::MAV_SYS_STATUS_SENSOR_GPS, endpoint.gps == GpsClaim::OriginGps);
        let mut health = S::empty();
        let usable = matches!(self.estimate.health, Health::Good | Health::Degraded);
        health.set(
            S::MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
                | S::MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL,
            usable,
        );
        health.set(S::MAV_SYS_STATUS_SENSOR_GPS, usable && endpoint.gps == GpsClaim::OriginGps);
        health.set(S::MAV_SYS_STATUS_GEOFENCE, self.breach().is_none());
        let imu_fresh =
            self.navigation.last_imu.is_some_and(|t| self.clock.now.seconds_since(t) < 0.2);
        health.set(S::MAV_SYS_STATUS_SENSOR_3D_GYRO | S::MAV_SYS_STATUS_SENSOR_3D_ACCEL, imu_fresh);
        let uwb_fresh =
            self.navigation.last_fused.is_some_and(|t| self.clock.now.seconds_since(t) < 0.5);
        health.set(S::MAV_SYS_STATUS_SENSOR_VISION_POSITION, uwb_fresh);
        let charged =
            self.board.battery.is_some_and(|b| b.supply_v >= self.config.limits.battery_low_v);
        health.set(S::MAV_SYS_STATUS_SENSOR_BATTERY, charged);
        health.set(S::MAV_SYS_STATUS_AHRS, self.estimate.health == Health::Good);
        health.set(S::MAV_SYS_STATUS_LOGGING, self.out.recording.state == Recording::Runs);
        health.remove(self.flight.supervisor.unhealthy);
        let ready =
            self.flight.mode != Mode::Disarmed || self.sight(self.clock.now).may_arm().is_ok();
        health.set(S::MAV_SYS_STATUS_PREARM_CHECK, ready);
        MavMessage::SYS_STATUS(SYS_STATUS_DATA {
            onboard_control_sensors_present: has,
            onboard_control_sensors_enabled: has,
            onboard_control_sensors_health: health,
            load: 0,
            voltage_battery: self
                .board
                .battery
                .map_or(u16::MAX, |b| (b.supply_v * 1e3).clamp(0.0, 65534.0) as u16),
            current_battery: self
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
            battery_remaining: self.remaining_percent(),
            onboard_control_sensors_present_extended: MavSysStatusSensorExtended::empty(),
            onboard_control_sensors_enabled_extended: MavSysStatusSensorExtended::empty(),
            onboard_control_sensors_health_extended: MavSysStatusSensorExtended::empty(),
        })
    }

    fn remaining_percent(&self) -> i8 {
        self.board.battery.and_then(|b| b.remaining_frac).map_or(-1, |f| (f * 100.0).round() as i8)
    }

    fn battery_status(&self) -> Option<MavMessage> {
        let battery = self.board.battery?;
        let mut voltages = [u16::MAX; 10];
        let charge_state = if battery.supply_v < self.config.limits.battery_critical_v {
            MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_CRITICAL
        } else if battery.supply_v < self.config.limits.battery_low_v {
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
            current_battery: battery
                .current_a
                .map_or(-1, |a| (a * 100.0).clamp(0.0, 32767.0) as i16),
            id: 0,
            battery_function: MavBatteryFunction::MAV_BATTERY_FUNCTION_ALL as u8,
            mavtype: MavBatteryType::MAV_BATTERY_TYPE_LIPO as u8,
            battery_remaining: self.remaining_percent(),
            // 0: not known.
            time_remaining: self
                .sight(self.clock.now)
                .battery_left_s()
                .map_or(0, |s| (s.min(86_400.0) as i32).max(1)),
            charge_state: charge_state as u8,
            voltages_ext: [0; 4],
            mode: MavBatteryMode::MAV_BATTERY_MODE_UNKNOWN as u8,
            fault_bitmask: MavBatteryFault::empty(),
        }))
    }

    /// What the board told motors and servos, where it is a pulse width.
    fn servo_output(&self) -> Option<MavMessage> {
        let servos = self.board.servos?;
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

    fn landed_state(&self) -> MavLandedState {
        match self.flight.mode {
            Mode::Disarmed if self.flight.shadow.is_airborne() => {
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

    fn mission_current(&self) -> MavMessage {
        let total = self.flight.mission.items.len() as u16;
        let seq = self.flight.guidance.current_item;
        // Its landing is a part of it.
        let flies = self.flight.flies_mission() || self.flight.guidance.landing;
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
        let (fence_id, rally_points_id) = self.stations.services.plans.ids();
        MavMessage::MISSION_CURRENT(MISSION_CURRENT_DATA {
            seq: seq.min(total.saturating_sub(1)),
            // The protocol writes "no mission" as the largest number.
            total: if total == 0 { u16::MAX } else { total },
            mission_state,
            mission_mode: if flies { 1 } else { 2 },
            mission_id: self.flight.mission.id,
            fence_id,
            rally_points_id,
        })
    }

    fn control_message(&self) -> MavMessage {
        let c = &self.flight.control;
        MavMessage::HALTERE_CONTROL(HALTERE_CONTROL_DATA {
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
        })
    }
}
