//! MAVLink of the generator's board: heartbeat, intervals, streams, arming, time.

use haltere_dialect::mav::haltere::{
    ATTITUDE_QUATERNION_DATA, AttitudeTargetTypemask, BATTERY_STATUS_DATA, COMMAND_ACK_DATA,
    COMMAND_LONG_DATA, HEARTBEAT_DATA, HIGHRES_IMU_DATA, HighresImuUpdatedFlags, MavAutopilot,
    MavBatteryFunction, MavBatteryType, MavCmd, MavMessage, MavModeFlag, MavResult, MavState,
    MavType, SYSTEM_TIME_DATA, TIMESYNC_DATA,
};
use haltere_dialect::mav::known;
use haltere_dialect::mav_stream::{self, MavSplitter};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::board::{Pilotage, Setpoint};

/// System and component.
const SYSTEM: u8 = 1;
const COMPONENT: u8 = 1;
/// Disarms in the air.
const FORCE: f32 = 21196.0;
/// Time since its boot at the start, µs, and error of its clock.
const BOOT_US: f64 = 7_310_000.0;
const CLOCK_PPM: f64 = -17.0;
/// Messages on request: id and least interval, µs.
const STREAMS: [(u32, f64); 4] = [(105, 4000.0), (31, 2000.0), (147, 50_000.0), (2, 100_000.0)];
/// Unix time that SYSTEM_TIME tells at boot, µs.
const UNIX_US: u64 = 1_790_000_000_000_000;

/// What the board measures.
#[derive(Debug, Clone, Copy)]
pub struct Readings {
    /// Accelerometer, m/s².
    pub acc: Vector3<f64>,
    /// Gyroscope, rad/s.
    pub rate: Vector3<f64>,
    /// Pressure, Pa, when new.
    pub pressure_pa: Option<f64>,
    /// Attitude that it believes in.
    pub believed: UnitQuaternion<f64>,
    /// Supply, V.
    pub supply_v: f64,
    /// Current, A.
    pub current_a: f64,
    /// Charge as it counts it.
    pub charge_frac: f64,
}

/// The port.
#[derive(Debug, Default)]
pub struct Wire {
    splitter: MavSplitter,
    sequence: u8,
    /// Interval and time of the next, µs.
    streams: [(f64, f64); STREAMS.len()],
    heartbeat_us: f64,
}

/// What bytes can ask for.
pub enum Wish {
    /// A setpoint.
    Fly(Setpoint),
    /// Nothing that matters to the flight.
    Nothing,
}

impl Wire {
    /// Its clock, µs.
    pub fn clock_us(&self, t_s: f64, error_s: f64) -> u64 {
        (BOOT_US + (t_s * (1.0 + CLOCK_PPM * 1e-6) + error_s) * 1e6).max(0.0) as u64
    }

    fn send(&mut self, message: &MavMessage, out: &mut Vec<u8>) {
        mav_stream::encode(out, SYSTEM, COMPONENT, self.sequence, message);
        self.sequence = self.sequence.wrapping_add(1);
    }

    /// Takes bytes; answers go to `out`.
    pub fn receive(
        &mut self,
        bytes: &[u8],
        clock_us: u64,
        on_ground: bool,
        pilotage: &mut Pilotage,
        out: &mut Vec<u8>,
    ) -> Vec<Wish> {
        let mut wishes = Vec::new();
        self.splitter.push(bytes);
        let mut messages = Vec::new();
        while let Some(next) = self.splitter.next() {
            let Ok(frame) = next else { continue };
            if let Ok(message) = frame.decode() {
                messages.push((frame.header, message));
            }
        }
        for (from, message) in messages {
            match message {
                MavMessage::SET_ATTITUDE_TARGET(m) if m.target_system <= SYSTEM => {
                    let q = Quaternion::new(m.q[0], m.q[1], m.q[2], m.q[3]).cast::<f64>();
                    let ignores = AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
                        | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE;
                    let sane = (q.norm() - 1.0).abs() < 0.02 && (0.0..=1.0).contains(&m.thrust);
                    if sane && !m.type_mask.intersects(ignores) {
                        let q = UnitQuaternion::from_quaternion(q);
                        wishes.push(Wish::Fly(Setpoint { q, thrust: f64::from(m.thrust) }));
                    }
                }
                MavMessage::COMMAND_LONG(m) if m.target_system <= SYSTEM => {
                    let result = self.obey(&m, clock_us, on_ground, pilotage);
                    let ack = COMMAND_ACK_DATA {
                        command: m.command,
                        result: result as u8,
                        progress: 0,
                        result_param2: 0,
                        target_system: from.system_id,
                        target_component: from.component_id,
                    };
                    self.send(&MavMessage::COMMAND_ACK(ack), out);
                    wishes.push(Wish::Nothing);
                }
                MavMessage::TIMESYNC(m) if m.tc1 == 0 => {
                    let answer = TIMESYNC_DATA {
                        tc1: clock_us.cast_signed().saturating_mul(1000),
                        ts1: m.ts1,
                        target_system: from.system_id,
                        target_component: from.component_id,
                    };
                    self.send(&MavMessage::TIMESYNC(answer), out);
                }
                _ => {}
            }
        }
        wishes
    }

    fn obey(
        &mut self,
        m: &COMMAND_LONG_DATA,
        clock_us: u64,
        on_ground: bool,
        pilotage: &mut Pilotage,
    ) -> MavResult {
        match known(m.command) {
            Some(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM) if m.param1 == 1.0 => {
                pilotage.arm();
                MavResult::MAV_RESULT_ACCEPTED
            }
            Some(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM) => {
                let idle = pilotage.order.throttle.iter().all(|t| *t < 0.3);
                if pilotage.armed && !(on_ground && idle) && m.param2 != FORCE {
                    return MavResult::MAV_RESULT_FAILED;
                }
                pilotage.disarm();
                MavResult::MAV_RESULT_ACCEPTED
            }
            Some(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL) => {
                let stream = STREAMS.iter().position(|(id, _)| *id as f32 == m.param1);
                let (Some(i), true) = (stream, m.param2.is_finite()) else {
                    return MavResult::MAV_RESULT_DENIED;
                };
                let interval = f64::from(m.param2);
                let interval = if interval > 0.0 { interval.max(STREAMS[i].1) } else { 0.0 };
                self.streams[i] = (interval, clock_us as f64);
                MavResult::MAV_RESULT_ACCEPTED
            }
            _ => MavResult::MAV_RESULT_UNSUPPORTED,
        }
    }

    /// Sends what is due; called 250 times a second, after the IMU was read.
    pub fn stream(&mut self, clock_us: u64, r: &Readings, pilotage: &Pilotage, out: &mut Vec<u8>) {
        let now = clock_us as f64;
        if now >= self.heartbeat_us {
            self.heartbeat_us = now + 1e6;
            self.send(&heartbeat(pilotage), out);
        }
        for (i, (id, _)) in STREAMS.into_iter().enumerate() {
            let (interval, due) = self.streams[i];
            // Half a turn early is nearer than half a turn late.
            if interval <= 0.0 || now + 2000.0 < due {
                continue;
            }
            self.streams[i].1 = if now - due > interval { now + interval } else { due + interval };
            let message = match id {
                105 => imu(clock_us, r),
                31 => attitude(clock_us, r),
                147 => battery(r),
                _ => MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA {
                    time_unix_usec: UNIX_US + clock_us,
                    time_boot_ms: (clock_us / 1000) as u32,
                }),
            };
            self.send(&message, out);
        }
    }
}

fn heartbeat(pilotage: &Pilotage) -> MavMessage {
    let mut base_mode =
        MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED | MavModeFlag::MAV_MODE_FLAG_GUIDED_ENABLED;
    if pilotage.armed {
        base_mode |= MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
    }
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_FLAPPING_WING as u8,
        autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC as u8,
        base_mode,
        system_status: match (pilotage.armed, pilotage.alone()) {
            (false, _) => MavState::MAV_STATE_STANDBY as u8,
            (true, false) => MavState::MAV_STATE_ACTIVE as u8,
            (true, true) => MavState::MAV_STATE_CRITICAL as u8,
        },
        mavlink_version: 3,
    })
}

fn imu(clock_us: u64, r: &Readings) -> MavMessage {
    type Flags = HighresImuUpdatedFlags;
    let mut fields_updated = Flags::HIGHRES_IMU_UPDATED_XACC
        | Flags::HIGHRES_IMU_UPDATED_YACC
        | Flags::HIGHRES_IMU_UPDATED_ZACC
        | Flags::HIGHRES_IMU_UPDATED_XGYRO
        | Flags::HIGHRES_IMU_UPDATED_YGYRO
        | Flags::HIGHRES_IMU_UPDATED_ZGYRO;
    if r.pressure_pa.is_some() {
        fields_updated |= Flags::HIGHRES_IMU_UPDATED_ABS_PRESSURE;
    }
    MavMessage::HIGHRES_IMU(HIGHRES_IMU_DATA {
        time_usec: clock_us,
        xacc: r.acc.x as f32,
        yacc: r.acc.y as f32,
        zacc: r.acc.z as f32,
        xgyro: r.rate.x as f32,
        ygyro: r.rate.y as f32,
        zgyro: r.rate.z as f32,
        abs_pressure: (r.pressure_pa.unwrap_or(0.0) * 0.01) as f32,
        fields_updated,
        ..HIGHRES_IMU_DATA::DEFAULT
    })
}

fn attitude(clock_us: u64, r: &Readings) -> MavMessage {
    let q = r.believed;
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
        time_boot_ms: (clock_us / 1000) as u32,
        q1: (sign * q.w) as f32,
        q2: (sign * q.i) as f32,
        q3: (sign * q.j) as f32,
        q4: (sign * q.k) as f32,
        rollspeed: r.rate.x as f32,
        pitchspeed: r.rate.y as f32,
        yawspeed: r.rate.z as f32,
        repr_offset_q: [0.0; 4],
    })
}

fn battery(r: &Readings) -> MavMessage {
    let mut voltages = [u16::MAX; 10];
    voltages[0] = (r.supply_v * 500.0).clamp(0.0, 65534.0) as u16; // two cells, mV each
    voltages[1] = voltages[0];
    MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
        current_consumed: -1,
        energy_consumed: -1,
        temperature: i16::MAX,
        voltages,
        current_battery: (r.current_a * 100.0).clamp(0.0, 32767.0) as i16,
        id: 0,
        battery_function: MavBatteryFunction::MAV_BATTERY_FUNCTION_ALL as u8,
        mavtype: MavBatteryType::MAV_BATTERY_TYPE_LIPO as u8,
        battery_remaining: (r.charge_frac * 100.0).clamp(0.0, 100.0) as i8,
        ..BATTERY_STATUS_DATA::DEFAULT
    })
}
