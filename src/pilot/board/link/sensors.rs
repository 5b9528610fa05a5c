//! What the board says besides its heartbeat: messages into checked samples with their times.

use haltere_dialect::mav::haltere::{
    ATTITUDE_DATA, BATTERY_STATUS_DATA, HIGHRES_IMU_DATA, HighresImuUpdatedFlags as Fields,
    MavMessage, SERVO_OUTPUT_RAW_DATA,
};

use haltere_core::drops::{DropReason, Drops};
use haltere_core::frames::{B, E, G_MPS2, Rot, Vec3};
use haltere_core::measure::{
    BaroSample, BatterySample, BoardAttitude, ImuSample, MagSample, OtherBattery, ServoOutput,
};
use haltere_core::time::{FcTime, HostTime};

use super::BoardLink;
use super::instances::{Kind, battery_rank};
use super::news::BoardNews;
use super::profile::Firmware;
use crate::navigation::reference;
use crate::out::output::Outbox;

/// SYS_STATUS, and the messages that can carry an IMU.
const SYS_STATUS_ID: u32 = 1;
const SCALED_IMU_ID: u8 = 26;
const RAW_IMU_ID: u8 = 27;
const HIGHRES_IMU_ID: u8 = 105;
/// Sets of slow sensors that are told apart by their instance id.
pub(super) const SLOW_SETS: usize = 4;
/// Mapped stamps farther than this from the time of arrival are believed where they go on from the last one alone, s.
const STAMP_TRUST_S: f64 = 0.3;
/// Older than this none is, s: `supervisor.loop_gap_s` and every board's own time-out are over long before.
const STAMP_OLDEST_S: f64 = 2.0;
/// Specific force beyond any sensor of this class, m/s² (32 g range).
const ACC_LIMIT_MPS2: f64 = 320.0;
/// Rate beyond any sensor of this class, rad/s (4000 °/s range).
const RATE_LIMIT_RADPS: f64 = 70.0;
/// Packs outside of this are not ours, V.
pub(super) const SUPPLY_RANGE_V: std::ops::RangeInclusive<f64> = 1.0..=60.0;
/// What barometers can read, hPa.
pub(super) const PRESSURE_HPA: std::ops::RangeInclusive<f64> = 300.0..=1200.0;
/// Events that are less severe than a warning are not passed on.
const LAST_EVENT_SEVERITY: u8 = 4;
/// Accelerometer and gyroscope of HIGHRES_IMU are new in a sample that has all these bits.
const IMU_FIELDS: u16 = 0x3F;
/// The same of its magnetometer.
const MAG_FIELDS: u16 = 0x1C0;
/// The wire's unit is the gauss.
const TESLA_PER_GAUSS: f64 = 1e-4;
/// Seen with ArduCopter 4.6.3: it sends microgauss (220 000 where its RAW_IMU said 220 mG). No field that a drone
/// flies in is as strong as this, gauss.
const NO_FIELD_GAUSS: f64 = 1000.0;
const GAUSS_PER_MICROGAUSS: f64 = 1e-6;

impl BoardLink {
    pub(super) fn message(
        &mut self,
        at: HostTime,
        message: &MavMessage,
        out: &mut Outbox,
        drops: &mut Drops,
        news: &mut Vec<BoardNews>,
    ) {
        match message {
            MavMessage::HIGHRES_IMU(m) => self.highres_imu(at, m, drops, news),
            MavMessage::SCALED_IMU(m) if self.carries_imu(SCALED_IMU_ID, at, drops, news) => {
                let acc = [m.xacc, m.yacc, m.zacc].map(f64::from);
                let rate = [m.xgyro, m.ygyro, m.zgyro].map(f64::from);
                let stamp_us = u64::from(m.time_boot_ms) * 1000;
                self.integer_imu(at, 0, stamp_us, [acc, rate], drops, news);
                self.integer_mag(at, 0, stamp_us, [m.xmag, m.ymag, m.zmag], drops, news);
            }
            MavMessage::RAW_IMU(m) if self.carries_imu(RAW_IMU_ID, at, drops, news) => {
                let acc = [m.xacc, m.yacc, m.zacc].map(f64::from);
                let rate = [m.xgyro, m.ygyro, m.zgyro].map(f64::from);
                self.integer_imu(at, m.id, m.time_usec, [acc, rate], drops, news);
                self.integer_mag(at, m.id, m.time_usec, [m.xmag, m.ymag, m.zmag], drops, news);
            }
            MavMessage::SCALED_IMU(_) | MavMessage::RAW_IMU(_) => {} // another message carries it
            MavMessage::ATTITUDE_QUATERNION(m) => {
                self.note_age(u64::from(m.time_boot_ms) * 1000, at);
                let valid_at = self.stamp(u64::from(m.time_boot_ms) * 1000, at);
                match Rot::from_wxyz([m.q1, m.q2, m.q3, m.q4].map(f64::from)) {
                    Some(attitude) => self.attitude(at, valid_at, attitude, news),
                    None => drops.add(DropReason::BadValue, 1),
                }
            }
            MavMessage::ATTITUDE(m) => self.euler_attitude(at, m, drops, news),
            MavMessage::BATTERY_STATUS(m) => {
                // Unused cells read 65535; a pack that reports only its sum puts it first.
                let supply_mv: u32 =
                    m.voltages.iter().filter(|v| **v != u16::MAX).map(|v| u32::from(*v)).sum();
                let supply_v = f64::from(supply_mv) * 1e-3;
                match battery(at, supply_v, m.current_battery, m.battery_remaining) {
                    Some(sample) => self.pack(at, m, sample, news),
                    None => drops.add(DropReason::BadValue, 1),
                }
            }
            MavMessage::SYS_STATUS(m) if self.streams.is_ours(SYS_STATUS_ID) => {
                let supply_v = f64::from(m.voltage_battery) * 1e-3;
                match battery(at, supply_v, m.current_battery, m.battery_remaining) {
                    Some(sample) => news.push(BoardNews::Battery(sample)),
                    None => drops.add(DropReason::BadValue, 1),
                }
            }
            MavMessage::SERVO_OUTPUT_RAW(m) => {
                news.push(BoardNews::Servos(servo_output(at, m)));
            }
            MavMessage::ACTUATOR_OUTPUT_STATUS(m) => {
                let active = |n: usize| m.active.checked_shr(n as u32).unwrap_or(0) & 1 == 1;
                let told = m.actuator.iter().enumerate();
                let told = told.map(|(n, value)| if active(n) { *value } else { f32::NAN });
                news.push(BoardNews::Servos(ServoOutput::new(at, 0, told)));
            }
            MavMessage::TIMESYNC(m) => self.timesync(at, m, out, drops, news),
            MavMessage::COMMAND_ACK(m) => self.ack(at, m, news),
            MavMessage::STATUSTEXT(m) => {
                if let Some(text) = self.text.join(&*m.text, m.id, m.chunk_seq) {
                    news.push(BoardNews::Text { severity: m.severity, text });
                }
            }
            MavMessage::ATTITUDE_TARGET(m) => self.attitude_target(at, m.q, m.thrust),
            MavMessage::PARAM_VALUE(m) => {
                if !self.checks.take(at, m, news) {
                    drops.add(DropReason::MavIgnored, 1);
                }
            }
            MavMessage::AUTOPILOT_VERSION(m) => self.version(at, m),
            MavMessage::EVENT(m) => {
                // The low half is the level for people on the outside: MAV_SEVERITY.
                let severity = m.log_levels & 0x0F;
                if severity <= LAST_EVENT_SEVERITY
                    && let Some(text) = self.events.told(at, m.id)
                {
                    news.push(BoardNews::Text { severity, text });
                }
            }
            other => match reference::from_message(other) {
                Some(Ok(pose)) => {
                    let valid_at = self.stamp(pose.time_usec, at);
                    news.push(BoardNews::Reference(pose.stamped(valid_at, at)));
                }
                Some(Err(())) => drops.add(DropReason::BadValue, 1),
                None => drops.add(DropReason::MavIgnored, 1),
            },
        }
    }

    fn euler_attitude(
        &mut self,
        at: HostTime,
        m: &ATTITUDE_DATA,
        drops: &mut Drops,
        news: &mut Vec<BoardNews>,
    ) {
        let [roll_rad, pitch_rad, yaw_rad] = [m.roll, m.pitch, m.yaw].map(f64::from);
        if [roll_rad, pitch_rad, yaw_rad].iter().all(|a| a.is_finite()) {
            self.note_age(u64::from(m.time_boot_ms) * 1000, at);
            let valid_at = self.stamp(u64::from(m.time_boot_ms) * 1000, at);
            self.attitude(at, valid_at, Rot::from_euler_rad(roll_rad, pitch_rad, yaw_rad), news);
        } else {
            drops.add(DropReason::BadValue, 1);
        }
    }

    pub(super) fn attitude(
        &mut self,
        received_at: HostTime,
        valid_at: HostTime,
        attitude: Rot<E, B>,
        news: &mut Vec<BoardNews>,
    ) {
        self.response.seen(received_at, attitude);
        news.push(BoardNews::Attitude(BoardAttitude { valid_at, received_at, attitude }));
    }

    /// Host time of a board stamp; the time of arrival while the clock is not known or when the
    /// stamp is absurd against it. What waited while nobody read is old and goes on from what was read before: it is
    /// believed. With the oldest of it stamped as new, all the rest came out of order, and the filter took that one
    /// sample, wing beat and all, for the whole pause: 4.5 m/s in 0.3 s.
    fn stamp(&mut self, board_us: u64, received_at: HostTime) -> HostTime {
        if !self.clock.is_locked() {
            return received_at;
        }
        let mapped = self.clock.to_host(FcTime::from_us(board_us)).filter(|t| {
            let age_s = received_at.seconds_since(*t);
            let goes_on = t.seconds_since(self.newest.stamped_at) > -STAMP_TRUST_S;
            age_s.abs() < STAMP_TRUST_S || (goes_on && (0.0..STAMP_OLDEST_S).contains(&age_s))
        });
        let stamp = mapped.map_or(received_at, |t| t.min(received_at));
        self.newest.stamped_at = stamp;
        stamp
    }

    /// A sample tells by its stamp how late it is.
    fn note_age(&mut self, board_us: u64, received_at: HostTime) {
        let known = self.clock.is_locked().then(|| self.clock.to_host(FcTime::from_us(board_us)));
        if let Some(valid_at) = known.flatten() {
            self.lateness.sample(received_at, received_at.seconds_since(valid_at));
        }
    }

    /// Whether a sample is the last one once more, stamp and all: a board that hangs says nothing new, however often. A
    /// stamp that has grown too old to be believed would make it one of now.
    fn says_again(&mut self, stamp_us: u64, id: u8, said: [[f32; 3]; 2]) -> bool {
        self.newest.imu.replace((stamp_us, id, said)) == Some((stamp_us, id, said))
    }

    fn highres_imu(
        &mut self,
        at: HostTime,
        m: &HIGHRES_IMU_DATA,
        drops: &mut Drops,
        news: &mut Vec<BoardNews>,
    ) {
        if self.says_again(
            m.time_usec,
            m.id,
            [[m.xacc, m.yacc, m.zacc], [m.xgyro, m.ygyro, m.zgyro]],
        ) {
            drops.add(DropReason::ImuOutOfOrder, 1);
            return;
        }
        self.note_age(m.time_usec, at);
        let valid_at = self.stamp(m.time_usec, at);
        let fields = m.fields_updated.bits();
        if fields & IMU_FIELDS == IMU_FIELDS && self.carries_imu(HIGHRES_IMU_ID, at, drops, news) {
            let acc_B_mps2 = Vec3::<B>::from_array([m.xacc, m.yacc, m.zacc].map(f64::from));
            let rate_B_radps = Vec3::<B>::from_array([m.xgyro, m.ygyro, m.zgyro].map(f64::from));
            let sample = ImuSample { valid_at, received_at: at, acc_B_mps2, rate_B_radps };
            self.push_imu(m.id, sample, drops, news);
        }
        let slow = &mut self.slow[usize::from(m.id) % SLOW_SETS];
        let fields = fields & slow.really_new(self.firmware, m);
        if fields & Fields::HIGHRES_IMU_UPDATED_ABS_PRESSURE.bits() != 0 {
            // The field is in hPa. Some send pascal (seen with PX4 1.16.1), which nothing in hPa comes near.
            let raw = f64::from(m.abs_pressure);
            let hpa = if raw > *PRESSURE_HPA.end() { raw * 0.01 } else { raw };
            if PRESSURE_HPA.contains(&hpa) && !self.flies_on(Kind::Barometer, at, (m.id, 0), news) {
                drops.add(DropReason::OtherInstance, 1);
            } else if PRESSURE_HPA.contains(&hpa) {
                news.push(BoardNews::Baro(BaroSample {
                    valid_at,
                    received_at: at,
                    pressure_pa: hpa * 100.0,
                }));
            } else {
                self.newest.odd_pressure = Some((raw, at));
                drops.add(DropReason::BadValue, 1);
            }
        }
        if fields & MAG_FIELDS == MAG_FIELDS {
            let mut field_gauss = Vec3::<B>::from_array([m.xmag, m.ymag, m.zmag].map(f64::from));
            if self.firmware == Firmware::ArduPilot && field_gauss.norm() > NO_FIELD_GAUSS {
                field_gauss = field_gauss * GAUSS_PER_MICROGAUSS;
            }
            if field_gauss.is_finite() && !self.flies_on(Kind::Magnetometer, at, (m.id, 0), news) {
                drops.add(DropReason::OtherInstance, 1);
            } else if field_gauss.is_finite() {
                let field_B_tesla = field_gauss * TESLA_PER_GAUSS;
                news.push(BoardNews::Mag(MagSample { valid_at, received_at: at, field_B_tesla }));
            } else {
                drops.add(DropReason::BadValue, 1);
            }
        }
    }

    /// Magnetic field of SCALED_IMU and RAW_IMU, in milligauss. A board without magnetometer sends zeros.
    fn integer_mag(
        &mut self,
        at: HostTime,
        id: u8,
        stamp_us: u64,
        field_mgauss: [i16; 3],
        drops: &mut Drops,
        news: &mut Vec<BoardNews>,
    ) {
        if field_mgauss == [0; 3] {
        } else if !self.flies_on(Kind::Magnetometer, at, (id, 0), news) {
            drops.add(DropReason::OtherInstance, 1);
        } else {
            let valid_at = self.stamp(stamp_us, at);
            let field_B_tesla =
                Vec3::<B>::from_array(field_mgauss.map(f64::from)) * (1e-3 * TESLA_PER_GAUSS);
            news.push(BoardNews::Mag(MagSample { valid_at, received_at: at, field_B_tesla }));
        }
    }

    /// SCALED_IMU and RAW_IMU as both firmwares fill them: milli-g and milli-rad/s.
    fn integer_imu(
        &mut self,
        at: HostTime,
        id: u8,
        stamp_us: u64,
        [acc_mg, rate_mradps]: [[f64; 3]; 2],
        drops: &mut Drops,
        news: &mut Vec<BoardNews>,
    ) {
        if self.says_again(stamp_us, id, [acc_mg, rate_mradps].map(|v| v.map(|v| v as f32))) {
            drops.add(DropReason::ImuOutOfOrder, 1);
            return;
        }
        self.note_age(stamp_us, at);
        let valid_at = self.stamp(stamp_us, at);
        let acc_B_mps2 = Vec3::<B>::from_array(acc_mg) * (1e-3 * G_MPS2);
        let rate_B_radps = Vec3::<B>::from_array(rate_mradps) * 1e-3;
        let sample = ImuSample { valid_at, received_at: at, acc_B_mps2, rate_B_radps };
        self.push_imu(id, sample, drops, news);
    }

    pub(super) fn push_imu(
        &mut self,
        id: u8,
        sample: ImuSample,
        drops: &mut Drops,
        news: &mut Vec<BoardNews>,
    ) {
        let (acc, rate) = (sample.acc_B_mps2, sample.rate_B_radps);
        let sane = acc.is_finite()
            && rate.is_finite()
            && acc.norm() < ACC_LIMIT_MPS2
            && rate.norm() < RATE_LIMIT_RADPS;
        if !sane {
            drops.add(DropReason::BadValue, 1);
        } else if self.flies_on(Kind::Imu, sample.received_at, (id, 0), news) {
            news.push(BoardNews::Imu(sample));
        } else {
            drops.add(DropReason::OtherInstance, 1);
        }
    }

    /// Whether this is the message whose IMU is flown on, of those that can carry one: the one that was asked for. In
    /// flight it stays, whatever is asked for and refused then.
    fn carries_imu(
        &mut self,
        msg_id: u8,
        at: HostTime,
        drops: &mut Drops,
        news: &mut Vec<BoardNews>,
    ) -> bool {
        let rank = u8::from(!self.streams.is_ours(msg_id.into()));
        let flown = self.flies_on(Kind::ImuMessage, at, (msg_id, rank), news);
        if !flown {
            drops.add(DropReason::OtherInstance, 1);
        }
        flown
    }

    /// Whether a healthy sample of one of several devices, with its rank, is flown on.
    fn flies_on(
        &mut self,
        kind: Kind,
        at: HostTime,
        (id, rank): (u8, u8),
        news: &mut Vec<BoardNews>,
    ) -> bool {
        let may_change = !self.is_armed();
        let sensors = &mut self.instances[kind as usize];
        let what = sensors.hear(at, id, rank, may_change);
        if what.news {
            news.push(BoardNews::Notice { warning: false, text: sensors.words(kind.name()) });
        }
        what.flown
    }

    /// A healthy battery: the one that is flown on, or another one.
    fn pack(
        &mut self,
        at: HostTime,
        m: &BATTERY_STATUS_DATA,
        sample: BatterySample,
        news: &mut Vec<BoardNews>,
    ) {
        let rank = battery_rank(m.battery_function, m.id);
        // A board that does not send these as asked is flown on SYS_STATUS, which tells of its main pack.
        let flown = self.flies_on(Kind::Battery, at, (m.id, rank), news)
            && !self.streams.is_ours(SYS_STATUS_ID);
        news.push(if flown {
            BoardNews::Battery(sample)
        } else {
            let function = m.battery_function;
            BoardNews::OtherBattery(OtherBattery { id: m.id, function, sample })
        });
    }
}

/// An output that is not in use reads 0, or all ones.
fn servo_output(at: HostTime, m: &SERVO_OUTPUT_RAW_DATA) -> ServoOutput {
    let told = [
        m.servo1_raw,
        m.servo2_raw,
        m.servo3_raw,
        m.servo4_raw,
        m.servo5_raw,
        m.servo6_raw,
        m.servo7_raw,
        m.servo8_raw,
        m.servo9_raw,
        m.servo10_raw,
        m.servo11_raw,
        m.servo12_raw,
        m.servo13_raw,
        m.servo14_raw,
        m.servo15_raw,
        m.servo16_raw,
    ];
    let in_use = |pulse_us: u16| !matches!(pulse_us, 0 | u16::MAX);
    let told = told.map(|pulse| if in_use(pulse) { f32::from(pulse) } else { f32::NAN });
    ServoOutput::new(at, m.port, told)
}

/// A battery as the board tells it; `None`: that is no pack of ours.
fn battery(
    at: HostTime,
    supply_v: f64,
    current_10ma: i16,
    remaining_percent: i8,
) -> Option<BatterySample> {
    SUPPLY_RANGE_V.contains(&supply_v).then(|| BatterySample {
        received_at: at,
        supply_v,
        current_a: (current_10ma >= 0).then(|| f64::from(current_10ma) * 0.01),
        remaining_frac: (0..=100)
            .contains(&remaining_percent)
            .then(|| f64::from(remaining_percent) * 0.01),
    })
}

/// What the slow sensors in HIGHRES_IMU showed last.
#[derive(Debug, Default)]
pub(super) struct SlowFields {
    pressure: f32,
    field: [f32; 3],
}

impl SlowFields {
    /// Fields of a message that may be new. ArduPilot says of barometer and magnetometer each time that they are
    /// (seen with 4.6.3, and 4.8): what is the same to the last bit was not measured again.
    fn really_new(&mut self, firmware: Firmware, m: &HIGHRES_IMU_DATA) -> u16 {
        let (pressure, field) = (m.abs_pressure, [m.xmag, m.ymag, m.zmag]);
        let mut new = u16::MAX;
        if firmware == Firmware::ArduPilot {
            if pressure == self.pressure {
                new &= !Fields::HIGHRES_IMU_UPDATED_ABS_PRESSURE.bits();
            }
            if field == self.field {
                new &= !MAG_FIELDS;
            }
        }
        (self.pressure, self.field) = (pressure, field);
        new
    }
}

/// Joins STATUSTEXT chunks of one text.
#[derive(Debug, Default)]
pub(super) struct TextJoiner {
    id: u16,
    parts: String,
}

/// Longest text that is joined, bytes: bounds what a board can make us store.
const TEXT_LIMIT: usize = 400;

impl TextJoiner {
    pub fn join(&mut self, chunk: &[u8], id: u16, chunk_seq: u8) -> Option<String> {
        let end = chunk.iter().position(|c| *c == 0);
        let part = String::from_utf8_lossy(&chunk[..end.unwrap_or(chunk.len())]);
        if id == 0 {
            return Some(part.into_owned());
        }
        if id != self.id || chunk_seq == 0 {
            self.parts.clear();
            self.id = id;
        }
        self.parts.push_str(&part);
        // A chunk that is not full is the last one.
        (end.is_some() || self.parts.len() >= TEXT_LIMIT).then(|| std::mem::take(&mut self.parts))
    }
}
