//! What the board sends: messages at the intervals that were asked for.

use haltere_dialect::mav::haltere::{
    ATT_POS_MOCAP_DATA, ATTITUDE_QUATERNION_DATA, ATTITUDE_TARGET_DATA, BATTERY_STATUS_DATA,
    HEARTBEAT_DATA, HIGHRES_IMU_DATA, HighresImuUpdatedFlags, MavAutopilot, MavBatteryFunction,
    MavBatteryType, MavMessage, MavModeFlag, MavState, MavType, RAW_IMU_DATA, SCALED_IMU_DATA,
    SERVO_OUTPUT_RAW_DATA,
};
use haltere_dialect::mav_stream;

use crate::board::{Board, Firmware, Readings};
use crate::effects::STEP_S;
use haltere_core::frames::G_MPS2;

/// MAVLink component of the board.
pub(super) const COMPONENT: u8 = 1;
/// Steps between heartbeats: 1 Hz.
const HEARTBEAT_STEPS: u32 = 500;
/// The barometer is read with every so many IMU samples.
const BARO_SAMPLES: u32 = 5;
/// The magnetometer is read with every so many IMU samples: 50 Hz.
const MAG_SAMPLES: u32 = 5;
/// Milligauss in a microtesla.
const MGAUSS_PER_UT: f64 = 10.0;
/// Version of MAVLink in the heartbeat.
const MAVLINK_VERSION: u8 = 3;
/// Servo pulses: middle and half travel, µs.
const PULSE_US: [f64; 2] = [1500.0, 500.0];

/// Messages that can be asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Imu,
    Attitude,
    Battery,
    Servos,
    MotionCapture,
    Target,
    RawImu,
    ScaledImu,
    /// Beside the one of 1 Hz, which goes on.
    Heartbeat,
}

const KINDS: [Kind; 9] = [
    Kind::Imu,
    Kind::Attitude,
    Kind::Battery,
    Kind::Servos,
    Kind::MotionCapture,
    Kind::Target,
    Kind::RawImu,
    Kind::ScaledImu,
    Kind::Heartbeat,
];

impl Kind {
    /// Sent in the steps in which the IMU is read. What motors are told goes with it, so that a flight in which it is
    /// asked for has no delivery more than one in which it is not, and the same noise.
    fn with_imu(self) -> bool {
        matches!(self, Kind::Imu | Kind::RawImu | Kind::ScaledImu | Kind::Servos)
    }

    /// By message id; what the generic board does not have is of the real ones.
    pub(super) fn of(firmware: Firmware, id: u32) -> Option<Self> {
        let real = firmware != Firmware::Generic;
        match id {
            105 => Some(Kind::Imu),
            31 => Some(Kind::Attitude),
            147 => Some(Kind::Battery),
            36 => Some(Kind::Servos),
            138 => Some(Kind::MotionCapture),
            83 if real => Some(Kind::Target),
            27 if real => Some(Kind::RawImu),
            26 if real => Some(Kind::ScaledImu),
            0 if real => Some(Kind::Heartbeat),
            _ => None,
        }
    }
}

/// Intervals in force.
#[derive(Debug, Clone, Default)]
pub(super) struct Streams {
    /// Period in steps, 0: off; and steps until the next.
    every: [(u32, u32); KINDS.len()],
    heartbeat_in: u32,
    baro_in: u32,
    mag_in: u32,
    /// What ArduPilot's barometer and magnetometer showed last, hPa and microgauss.
    shown_hpa: f32,
    shown_field: [f32; 3],
}

impl Streams {
    /// Sets an interval, µs; 0 or less: off.
    pub(super) fn set(&mut self, kind: Kind, interval_us: f64) {
        let mut steps = (interval_us * 1e-6 / STEP_S).round().clamp(0.0, 1e6) as u32;
        if kind.with_imu() {
            // The IMU is read at every second step: intervals are whole multiples of that.
            steps = (steps / 2) * 2;
            if steps == 0 && interval_us > 0.0 {
                steps = 2;
            }
        }
        self.every[kind as usize] = (steps, steps);
    }

    /// The next heartbeat comes in the next step.
    pub(super) fn beat_now(&mut self) {
        self.heartbeat_in = 0;
    }
}

impl Board {
    /// Appends what is due in this step to `out`. `imu_step`: the IMU was read in it.
    pub fn send(&mut self, r: &Readings<'_>, imu_step: bool, out: &mut Vec<u8>) {
        if self.send_packets(r, out) {
            return;
        }
        if self.streams.heartbeat_in == 0 {
            self.streams.heartbeat_in = HEARTBEAT_STEPS;
            let beat = self.heartbeat(r.t_us);
            let beat = MavMessage::HEARTBEAT(self.said_beat(beat));
            self.post(r.t_us, &beat, out);
        }
        self.streams.heartbeat_in -= 1;
        for message in std::mem::take(&mut self.says) {
            self.post(r.t_us, &message, out);
        }
        for kind in KINDS {
            let (period, wait) = &mut self.streams.every[kind as usize];
            if *period == 0 {
                continue;
            }
            *wait = wait.saturating_sub(1);
            if *wait > 0 || (kind.with_imu() && !imu_step) {
                continue;
            }
            *wait = *period;
            let message = match kind {
                Kind::Imu => self.imu(r),
                Kind::Attitude => self.attitude(r),
                Kind::Battery => battery(r),
                Kind::Servos => self.servos(r),
                Kind::MotionCapture => self.motion_capture(r),
                Kind::Target => self.attitude_target(r),
                Kind::RawImu => self.raw_imu(r),
                Kind::ScaledImu => self.scaled_imu(r),
                Kind::Heartbeat => MavMessage::HEARTBEAT(self.heartbeat(r.t_us)),
            };
            self.post(r.t_us, &message, out);
            if let Some(second) = self.second_pack(&message) {
                self.post(r.t_us, &second, out);
            }
        }
    }

    /// Sends what its line has room for.
    fn post(&mut self, t_us: u64, message: &MavMessage, out: &mut Vec<u8>) {
        let start = out.len();
        self.send_message(message, out);
        let bytes = out.len() - start;
        if let Some(line) = &mut self.line
            && !line.takes(t_us as f64 * 1e-6, bytes)
        {
            out.truncate(start);
            self.sequence = self.sequence.wrapping_sub(1);
        }
    }

    /// Answers are not left out: what waits before them on the line, and they themselves, take so long, s.
    pub fn line_delay_s(&mut self, t_us: u64, answer_B: usize) -> f64 {
        let Some(line) = &mut self.line else { return 0.0 };
        line.takes(t_us as f64 * 1e-6, answer_B);
        line.delay_s()
    }

    pub(super) fn send_message(&mut self, message: &MavMessage, out: &mut Vec<u8>) {
        mav_stream::encode(out, self.settings.system_id, COMPONENT, self.sequence, message);
        self.sequence = self.sequence.wrapping_add(1);
    }

    fn heartbeat(&self, t_us: u64) -> HEARTBEAT_DATA {
        if let Some(beat) = self.real_heartbeat(t_us) {
            return beat;
        }
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED
            | MavModeFlag::MAV_MODE_FLAG_GUIDED_ENABLED;
        if self.armed {
            base_mode |= MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
        }
        let system_status = match (self.armed, &self.hold) {
            (false, _) => MavState::MAV_STATE_STANDBY,
            (true, None) => MavState::MAV_STATE_ACTIVE,
            (true, Some(_)) => MavState::MAV_STATE_CRITICAL,
        };
        HEARTBEAT_DATA {
            custom_mode: 0,
            mavtype: MavType::MAV_TYPE_FLAPPING_WING as u8,
            autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC as u8,
            base_mode,
            system_status: system_status as u8,
            mavlink_version: MAVLINK_VERSION,
        }
    }

    fn imu(&mut self, r: &Readings<'_>) -> MavMessage {
        type Flags = HighresImuUpdatedFlags;
        let (a, w) = (r.imu.acc_B_mps2, r.imu.rate_B_radps);
        let mut fields_updated = Flags::empty();
        let [acc, gyro, baro] = r.imu_alive;
        if acc {
            fields_updated |= Flags::HIGHRES_IMU_UPDATED_XACC
                | Flags::HIGHRES_IMU_UPDATED_YACC
                | Flags::HIGHRES_IMU_UPDATED_ZACC;
        }
        if gyro {
            fields_updated |= Flags::HIGHRES_IMU_UPDATED_XGYRO
                | Flags::HIGHRES_IMU_UPDATED_YGYRO
                | Flags::HIGHRES_IMU_UPDATED_ZGYRO;
        }
        let streams = &mut self.streams;
        let (mut baro_hpa, mut field_gauss) = ((r.imu.pressure_pa * 0.01) as f32, [0.0f32; 3]);
        let read_baro = streams.baro_in == 0;
        if read_baro {
            streams.baro_in = BARO_SAMPLES;
        }
        streams.baro_in -= 1;
        let mut read_mag = false;
        if let Some(field_B_ut) = r.field_B_ut {
            let gauss = field_B_ut * (1e-3 * MGAUSS_PER_UT);
            field_gauss = [gauss.x as f32, gauss.y as f32, gauss.z as f32];
            read_mag = streams.mag_in == 0;
            if read_mag {
                streams.mag_in = MAG_SAMPLES;
            }
            streams.mag_in -= 1;
        }
        // PX4 sends pascal (seen with 1.16.1).
        if self.settings.firmware == Firmware::Px4 {
            baro_hpa *= 100.0;
        }
        // ArduPilot says each time that both are new, and sends microgauss (seen with 4.6.3).
        let ardupilot = self.settings.firmware == Firmware::Ardupilot;
        if ardupilot {
            if read_baro {
                streams.shown_hpa = baro_hpa;
            }
            if read_mag {
                streams.shown_field = field_gauss.map(|gauss| 1e6 * gauss);
            }
            (baro_hpa, field_gauss) = (streams.shown_hpa, streams.shown_field);
        }
        if baro && (read_baro || ardupilot) {
            fields_updated |= Flags::HIGHRES_IMU_UPDATED_ABS_PRESSURE;
        }
        if read_mag || (ardupilot && r.field_B_ut.is_some()) {
            fields_updated |= Flags::HIGHRES_IMU_UPDATED_XMAG
                | Flags::HIGHRES_IMU_UPDATED_YMAG
                | Flags::HIGHRES_IMU_UPDATED_ZMAG;
        }
        MavMessage::HIGHRES_IMU(HIGHRES_IMU_DATA {
            time_usec: self.time_us(r.t_us),
            xacc: a.x as f32,
            yacc: a.y as f32,
            zacc: a.z as f32,
            xgyro: w.x as f32,
            ygyro: w.y as f32,
            zgyro: w.z as f32,
            xmag: field_gauss[0],
            ymag: field_gauss[1],
            zmag: field_gauss[2],
            abs_pressure: baro_hpa,
            fields_updated,
            ..HIGHRES_IMU_DATA::DEFAULT
        })
    }

    /// Specific force in milli-g and rates in mrad/s, cut to whole numbers.
    fn integers(r: &Readings<'_>) -> ([i16; 3], [i16; 3]) {
        // The casts saturate.
        let whole = |v: f64| v.round() as i16;
        let a = r.imu.acc_B_mps2 * (1e3 / G_MPS2);
        let w = r.imu.rate_B_radps * 1e3;
        ([whole(a.x), whole(a.y), whole(a.z)], [whole(w.x), whole(w.y), whole(w.z)])
    }

    /// Magnetic field in milligauss; zeros without magnetometer.
    fn whole_field(r: &Readings<'_>) -> [i16; 3] {
        let field = r.field_B_ut.unwrap_or_default() * MGAUSS_PER_UT;
        [field.x, field.y, field.z].map(|v| v.round() as i16)
    }

    fn raw_imu(&self, r: &Readings<'_>) -> MavMessage {
        let ([xacc, yacc, zacc], [xgyro, ygyro, zgyro]) = Self::integers(r);
        let [xmag, ymag, zmag] = Self::whole_field(r);
        MavMessage::RAW_IMU(RAW_IMU_DATA {
            xmag,
            ymag,
            zmag,
            time_usec: self.time_us(r.t_us),
            xacc,
            yacc,
            zacc,
            xgyro,
            ygyro,
            zgyro,
            ..RAW_IMU_DATA::DEFAULT
        })
    }

    fn scaled_imu(&self, r: &Readings<'_>) -> MavMessage {
        let ([xacc, yacc, zacc], [xgyro, ygyro, zgyro]) = Self::integers(r);
        let [xmag, ymag, zmag] = Self::whole_field(r);
        MavMessage::SCALED_IMU(SCALED_IMU_DATA {
            xmag,
            ymag,
            zmag,
            time_boot_ms: (self.time_us(r.t_us) / 1000) as u32,
            xacc,
            yacc,
            zacc,
            xgyro,
            ygyro,
            zgyro,
            ..SCALED_IMU_DATA::DEFAULT
        })
    }

    fn attitude_target(&self, r: &Readings<'_>) -> MavMessage {
        let q = self.told.q;
        MavMessage::ATTITUDE_TARGET(ATTITUDE_TARGET_DATA {
            time_boot_ms: (self.time_us(r.t_us) / 1000) as u32,
            q: [q.w, q.i, q.j, q.k].map(|c| c as f32),
            thrust: self.told.thrust_frac as f32,
            ..ATTITUDE_TARGET_DATA::DEFAULT
        })
    }

    fn attitude(&self, r: &Readings<'_>) -> MavMessage {
        let q = self.said_attitude();
        let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
        let w = r.state.rate_B_radps;
        MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms: (self.time_us(r.t_us) / 1000) as u32, // wraps after 49 days, as it does
            q1: (sign * q.w) as f32,
            q2: (sign * q.i) as f32,
            q3: (sign * q.j) as f32,
            q4: (sign * q.k) as f32,
            rollspeed: w.x as f32,
            pitchspeed: w.y as f32,
            yawspeed: w.z as f32,
            repr_offset_q: [0.0; 4],
        })
    }

    fn servos(&self, r: &Readings<'_>) -> MavMessage {
        let pulse = |share: f64| (PULSE_US[0] + PULSE_US[1] * share.clamp(-1.0, 1.0)) as u16;
        let throttle = |share: f64| pulse(2.0 * share - 1.0);
        let c = &self.output;
        let [dihedral, yaw] = self.loops.travel(c);
        MavMessage::SERVO_OUTPUT_RAW(SERVO_OUTPUT_RAW_DATA {
            time_usec: self.time_us(r.t_us) as u32, // the field is 32 bits wide
            servo1_raw: pulse(dihedral),
            servo2_raw: throttle(c.flap_frac[0]),
            servo3_raw: pulse(yaw),
            servo4_raw: throttle(c.flap_frac[1]),
            ..SERVO_OUTPUT_RAW_DATA::DEFAULT
        })
    }

    fn motion_capture(&self, r: &Readings<'_>) -> MavMessage {
        let (q, p) = (r.state.q_EB, r.state.pos_E_m);
        let mut covariance = [0.0; 21];
        covariance[0] = f32::NAN; // unknown
        MavMessage::ATT_POS_MOCAP(ATT_POS_MOCAP_DATA {
            time_usec: self.time_us(r.t_us),
            q: [q.w as f32, q.i as f32, q.j as f32, q.k as f32],
            x: p.x as f32,
            y: p.y as f32,
            z: p.z as f32,
            covariance,
        })
    }
}

fn battery(r: &Readings<'_>) -> MavMessage {
    let mut voltages = [u16::MAX; 10];
    voltages[0] = (r.supply.volt * 1000.0).clamp(0.0, 65534.0) as u16; // whole pack, mV
    MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
        current_consumed: -1,
        energy_consumed: -1,
        temperature: i16::MAX,
        voltages,
        current_battery: (r.supply.current_a * 100.0).clamp(0.0, 32767.0) as i16, // 10 mA
        id: 0,
        battery_function: MavBatteryFunction::MAV_BATTERY_FUNCTION_ALL as u8,
        mavtype: MavBatteryType::MAV_BATTERY_TYPE_LIPO as u8,
        battery_remaining: (r.supply.charge_frac * 100.0).clamp(0.0, 100.0) as i8,
        ..BATTERY_STATUS_DATA::DEFAULT
    })
}
