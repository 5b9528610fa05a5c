//! What the board is told: arming, intervals, setpoints, time, failures.

use haltere_dialect::mav::haltere::{
    AttitudeTargetTypemask, COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult, MavSeverity,
    SET_ATTITUDE_TARGET_DATA, STATUSTEXT_DATA, TIMESYNC_DATA,
};
use haltere_dialect::mav::types::CharArray;
use haltere_dialect::mav::{command_ack, known};
use haltere_dialect::mav_stream::MavHeader;
use nalgebra::{Quaternion, UnitQuaternion};

use crate::board::streams::{COMPONENT, Kind};
use crate::board::{Board, BoardRequests, Firmware};
use crate::effects::{Bank, Cargo, Delivery, Setpoint, State};
use crate::faults::Fault;

/// `param2` of a disarm that is meant even in the air (MAVLink).
const FORCE: f32 = 21196.0;
/// Shortest interval it accepts, µs: 500 Hz.
const SHORTEST_INTERVAL_US: f32 = 2000.0;
/// A setpoint whose quaternion is off by more is dropped (one real board: 1e-3; text: none).
const LENGTH_TOLERANCE: f32 = 0.01;
/// Thrust below which a vehicle on the floor may be disarmed, share of its mean.
const IDLE_THRUST_FRAC: f64 = 0.3;

impl Board {
    /// Takes bytes from its serial port. Answers go to `out`, orders for the plant to `requests`.
    pub fn receive(
        &mut self,
        t_us: u64,
        bytes: &[u8],
        s: &State,
        bank: &mut Bank,
        out: &mut Vec<u8>,
        requests: &mut BoardRequests,
    ) {
        if bytes.is_empty() || self.receive_packets(t_us, bytes) {
            return;
        }
        // The splitter lends its buffer to the frame, and the answers need the rest of the board.
        let mut splitter = std::mem::take(&mut self.splitter);
        splitter.push(bytes);
        while let Some(found) = splitter.next() {
            let decoded = found.and_then(|frame| Ok((frame.header, frame.decode()?)));
            match decoded {
                Ok((from, message)) => self.obey(t_us, from, message, s, bank, out, requests),
                Err(_) => self.losses += 1,
            }
        }
        self.splitter = splitter;
    }

    #[allow(clippy::too_many_arguments)] // one private call, all of them its context
    fn obey(
        &mut self,
        t_us: u64,
        from: MavHeader,
        message: MavMessage,
        s: &State,
        bank: &mut Bank,
        out: &mut Vec<u8>,
        requests: &mut BoardRequests,
    ) {
        match message {
            MavMessage::SET_ATTITUDE_TARGET(m)
                if self.is_for_us(m.target_system, m.target_component) =>
            {
                self.take_setpoint(t_us, &m, s, bank);
            }
            MavMessage::COMMAND_LONG(m) if self.is_for_us(m.target_system, m.target_component) => {
                let result = self.command(t_us, &m, s, out, requests);
                self.acknowledge(m.command, result, from, out);
            }
            MavMessage::HEARTBEAT(_) => self.hears_heartbeat(t_us, from.system_id),
            MavMessage::PARAM_REQUEST_READ(m)
                if self.is_for_us(m.target_system, m.target_component) =>
            {
                self.tell_parameter(name_in(&*m.param_id), out);
            }
            MavMessage::PARAM_SET(m) if self.is_for_us(m.target_system, m.target_component) => {
                self.set_parameter(name_in(&*m.param_id), m.param_value, out);
            }
            MavMessage::TIMESYNC(m) if m.tc1 == 0 => {
                let now_ns = self.time_us(t_us).cast_signed().saturating_mul(1000);
                let reply = MavMessage::TIMESYNC(TIMESYNC_DATA {
                    tc1: now_ns,
                    ts1: m.ts1,
                    target_system: from.system_id,
                    target_component: from.component_id,
                });
                self.send_message(&reply, out);
            }
            _ => {}
        }
    }

    fn is_for_us(&self, system: u8, component: u8) -> bool {
        (system == 0 || system == self.settings.system_id) && (component <= COMPONENT)
    }

    fn take_setpoint(
        &mut self,
        t_us: u64,
        m: &SET_ATTITUDE_TARGET_DATA,
        s: &State,
        bank: &mut Bank,
    ) {
        let ignored = AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
            | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE
            | AttitudeTargetTypemask::ATTITUDE_TARGET_TYPEMASK_THRUST_BODY_SET;
        let [w, x, y, z] = m.q;
        let length = (w * w + x * x + y * y + z * z).sqrt();
        let mut good = (length - 1.0).abs() < LENGTH_TOLERANCE && (0.0..=1.0).contains(&m.thrust);
        if self.settings.firmware != Firmware::Generic {
            let t_s = self.time_us(t_us) as f64 * 1e-6;
            good &= self.real_takes(m, length, t_s);
        }
        if !good || m.type_mask.intersects(ignored) {
            self.losses += 1;
            return;
        }
        let mut door = Delivery { cargo: Cargo::Setpoint, delay_s: 0.0, lost: false };
        bank.link(s, &mut door);
        if door.lost {
            return;
        }
        let q = Quaternion::new(w.into(), x.into(), y.into(), z.into());
        let q = UnitQuaternion::from_quaternion(q);
        self.setpoint = Some(Setpoint { q, thrust_frac: m.thrust.into() });
        self.setpoint_age_s = 0.0;
    }

    fn command(
        &mut self,
        t_us: u64,
        m: &COMMAND_LONG_DATA,
        s: &State,
        out: &mut Vec<u8>,
        requests: &mut BoardRequests,
    ) -> MavResult {
        let Some(command) = known(m.command) else { return MavResult::MAV_RESULT_UNSUPPORTED };
        match command {
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM if m.param1 == 1.0 => self.arm(t_us, s, out),
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM
                if m.param1 == 0.0 && self.settings.firmware != Firmware::Generic =>
            {
                self.real_disarm(m.param2 == FORCE)
            }
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM if m.param1 == 0.0 => {
                let idle = self.output.flap_frac.iter().all(|f| *f < IDLE_THRUST_FRAC);
                let landed = s.on_ground && idle;
                if self.armed && !landed && m.param2 != FORCE {
                    return MavResult::MAV_RESULT_FAILED;
                }
                self.disarm();
                MavResult::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => self.set_interval(m.param1, m.param2),
            MavCmd::MAV_CMD_DO_SET_MODE => self.set_mode(m, t_us),
            MavCmd::MAV_CMD_REQUEST_MESSAGE => self.request_message(m.param1, out),
            MavCmd::MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN if m.param1 == 1.0 => {
                if self.armed {
                    return MavResult::MAV_RESULT_DENIED;
                }
                requests.faults.push(Fault::BoardReboot);
                MavResult::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_INJECT_FAILURE => {
                let fault = failure(m);
                let is_known = fault.is_some();
                requests.faults.extend(fault);
                if is_known {
                    MavResult::MAV_RESULT_ACCEPTED
                } else {
                    MavResult::MAV_RESULT_UNSUPPORTED
                }
            }
            _ => MavResult::MAV_RESULT_UNSUPPORTED,
        }
    }

    fn arm(&mut self, t_us: u64, s: &State, out: &mut Vec<u8>) -> MavResult {
        if self.armed {
            return MavResult::MAV_RESULT_ACCEPTED;
        }
        let tilt_deg = s.R_EB[(2, 2)].clamp(-1.0, 1.0).acos().to_degrees();
        let (limit_deg, least_v) = (self.settings.arming_tilt_deg, self.settings.arming_supply_v);
        let wait_s = self.settings.arming_delay_s - self.time_us(t_us) as f64 * 1e-6;
        let refusal = if wait_s > 0.0 {
            Some(format!("Arm: sensors settling, {wait_s:.0} s to go"))
        } else if tilt_deg > limit_deg {
            Some(format!("Arm: tilted {tilt_deg:.0} deg, at most {limit_deg:.0}"))
        } else if s.supply_v < least_v {
            Some(format!("Arm: battery {:.1} V, at least {least_v:.1}", s.supply_v))
        } else {
            None
        };
        if let Some(text) = refusal {
            let text = MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                severity: MavSeverity::MAV_SEVERITY_CRITICAL as u8,
                text: CharArray::from(text.as_str()),
                id: 0,
                chunk_seq: 0,
            });
            self.send_message(&text, out);
            return MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        }
        if self.settings.firmware != Firmware::Generic {
            return self.real_arm(t_us);
        }
        self.armed = true;
        self.setpoint = None;
        MavResult::MAV_RESULT_ACCEPTED
    }

    fn set_interval(&mut self, id: f32, interval_us: f32) -> MavResult {
        let number = whole(id);
        if let Some(id) = number
            && let Some(refusal) = self.interval_refusal(id, f64::from(interval_us))
        {
            return refusal;
        }
        let kind = number.and_then(|id| Kind::of(self.settings.firmware, id));
        let Some(kind) = kind.filter(|k| *k != Kind::MotionCapture || self.settings.motion_capture)
        else {
            return MavResult::MAV_RESULT_DENIED;
        };
        // 0 asks for the default rate, which is none; -1 switches off.
        if !interval_us.is_finite() || (interval_us > 0.0 && interval_us < SHORTEST_INTERVAL_US) {
            return MavResult::MAV_RESULT_DENIED;
        }
        let every = f64::from(self.settings.manners.decimation);
        self.streams.set(kind, every * f64::from(interval_us.max(0.0)));
        MavResult::MAV_RESULT_ACCEPTED
    }

    fn acknowledge(&mut self, command: u16, result: MavResult, to: MavHeader, out: &mut Vec<u8>) {
        let ack = command_ack((to.system_id, to.component_id), command, result);
        self.send_message(&ack, out);
    }
}

/// A name in a field: up to the first zero.
fn name_in(field: &[u8]) -> &[u8] {
    field.split(|c| *c == 0).next().unwrap_or_default()
}

/// The fault that the command names.
fn failure(m: &COMMAND_LONG_DATA) -> Option<Fault> {
    let instance = u8::try_from(whole(m.param3)?).ok()?;
    Fault::from_command(whole(m.param1)?, whole(m.param2)?, instance)
}

/// A whole number sent as a float.
fn whole(x: f32) -> Option<u32> {
    // Floats are exact on whole numbers up to 2^24, and no id is larger.
    ((0.0..=16_777_216.0).contains(&x) && x.fract() == 0.0).then_some(x as u32)
}
