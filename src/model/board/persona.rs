//! The board as one of the two real firmwares: where its ways meet loops, streams and commands.

use haltere_dialect::mav::haltere::{
    AUTOPILOT_VERSION_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MavAutopilot, MavMessage,
    MavModeFlag, MavProtocolCapability, MavResult, MavSeverity, MavState, MavType,
    SET_ATTITUDE_TARGET_DATA,
};
use nalgebra::UnitQuaternion;

use crate::board::ardupilot::{ArduPilot, READY_S, SHAPING_S};
use crate::board::firmware::Firmware;
use crate::board::parameters::Parameters;
use crate::board::px4::{OFFBOARD, Px4};
use crate::board::streams::Kind;
use crate::board::ways::{Act, Now, texts};
use crate::board::{Board, BoardSettings};
use crate::effects::{STEP_S, Setpoint, State};

/// Capability words as they were seen.
const CAPABILITIES_PX4: u64 = 0xe8ff;
const CAPABILITIES_ARDUPILOT: u64 = 0xfbef;
/// AUTOPILOT_VERSION.
const VERSION_ID: f32 = 148.0;
/// HEARTBEAT and RAW_IMU, which PX4 does not send at other rates or at all.
const HEARTBEAT_ID: u32 = 0;
const RAW_IMU_ID: u32 = 27;
/// Shortest interval of a 400 Hz loop, µs (seen: whole milliseconds, 4 at least).
const ARDUPILOT_LEAST_US: f64 = 4000.0;

/// Who the board is.
#[derive(Debug, Clone)]
pub(super) enum Persona {
    Generic,
    Px4(Px4),
    ArduPilot(ArduPilot),
}

impl Persona {
    pub fn new(settings: &BoardSettings, parameters: &Parameters) -> Self {
        match settings.firmware {
            // A Crazyflie has no MAVLink to be somebody in.
            Firmware::Generic | Firmware::Crazyflie => Persona::Generic,
            Firmware::Px4 => Persona::Px4(Px4::new(parameters)),
            Firmware::Ardupilot => Persona::ArduPilot(ArduPilot::new()),
        }
    }
}

impl Board {
    /// Time since its boot, s, at plant time `s.t_s`.
    fn since_boot_s(&self, s: &State) -> f64 {
        self.time_us((s.t_s * 1e6) as u64) as f64 * 1e-6
    }

    /// The mode that it is in; 0 for a board without modes.
    pub fn custom_mode(&self) -> u32 {
        match &self.persona {
            Persona::Generic => 0,
            Persona::Px4(p) => p.custom_mode,
            Persona::ArduPilot(a) => a.custom_mode,
        }
    }

    /// The mode switch of a remote control, or anything else that is not the companion.
    pub fn take_over(&mut self, mode: u32) {
        match &mut self.persona {
            Persona::Generic => {}
            Persona::Px4(p) => p.custom_mode = mode,
            Persona::ArduPilot(a) => a.custom_mode = mode,
        }
    }

    /// One step of a real firmware; `None`: motors off.
    pub(super) fn real_target(&mut self, s: &State) -> Option<Setpoint> {
        self.setpoint_age_s += STEP_S;
        let setpoint = self.setpoint.map(|set| {
            let keep = if self.settings.manners.no_thrust { 0.0 } else { 1.0 };
            Setpoint { thrust_frac: keep * set.thrust_frac, ..set }
        });
        let now = Now {
            t_s: self.since_boot_s(s),
            state: s,
            yaw_rad: self.believed.euler_angles().2,
            armed: self.armed,
            setpoint,
            age_s: self.setpoint_age_s,
        };
        let override_s = self.settings.manners.mode_override_s;
        let (parameters, says) = (&self.parameters, &mut self.says);
        let act = match &mut self.persona {
            Persona::Generic => Act::Stop,
            Persona::Px4(p) => p.step(&now, parameters, override_s, says),
            Persona::ArduPilot(a) => a.step(&now, parameters, override_s, says),
        };
        let level = UnitQuaternion::from_euler_angles(0.0, 0.0, now.yaw_rad);
        let (told, flown) = match act {
            Act::Fly(set) => (set, Some(set)),
            Act::Wait(set) => (set, None),
            Act::Stop => (Setpoint { q: level, thrust_frac: 0.0 }, None),
            Act::Disarm => {
                self.disarm();
                (Setpoint { q: level, thrust_frac: 0.0 }, None)
            }
        };
        self.tell_target(told);
        flown
    }

    /// Keeps what ATTITUDE_TARGET says: ArduPilot's is shaped.
    fn tell_target(&mut self, set: Setpoint) {
        if self.settings.firmware != Firmware::Ardupilot {
            self.told = set;
            return;
        }
        let share = (STEP_S / SHAPING_S).min(1.0);
        let q = self.told.q.try_slerp(&set.q, share, 1e-9).unwrap_or(set.q);
        self.told = Setpoint { q, thrust_frac: set.thrust_frac };
    }

    /// Whether a real firmware takes this setpoint, and what it learns from it.
    pub(super) fn real_takes(
        &mut self,
        m: &SET_ATTITUDE_TARGET_DATA,
        length: f32,
        t_s: f64,
    ) -> bool {
        match &mut self.persona {
            Persona::Generic => false,
            Persona::ArduPilot(a) => a.takes(m.type_mask.bits(), length),
            Persona::Px4(p) => {
                p.hears_setpoint(t_s);
                // Every setpoint is kept; it counts in OFFBOARD.
                m.type_mask.bits() == 7
            }
        }
    }

    pub(super) fn real_arm(&mut self, t_us: u64) -> MavResult {
        let t_s = self.time_us(t_us) as f64 * 1e-6;
        let settling_s = self.settings.manners.settling_s;
        let says = &mut self.says;
        let (refused, with) = match &mut self.persona {
            Persona::Generic => (false, MavResult::MAV_RESULT_FAILED),
            Persona::Px4(p) => {
                (p.refuses(t_s, settling_s, says), MavResult::MAV_RESULT_TEMPORARILY_REJECTED)
            }
            Persona::ArduPilot(a) => {
                (a.refuses(t_s, settling_s, says), MavResult::MAV_RESULT_FAILED)
            }
        };
        if refused {
            return with;
        }
        self.armed = true;
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// A plain disarm; the forced one asks nobody.
    pub(super) fn real_disarm(&mut self, forced: bool) -> MavResult {
        let (landed, refusal) = match &self.persona {
            Persona::Generic => (true, MavResult::MAV_RESULT_FAILED),
            Persona::Px4(p) => (p.landed.has_landed(), MavResult::MAV_RESULT_TEMPORARILY_REJECTED),
            Persona::ArduPilot(a) => (a.landed.has_landed(), MavResult::MAV_RESULT_FAILED),
        };
        if self.armed && !landed && !forced {
            return refusal;
        }
        self.disarm();
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// MAV_CMD_DO_SET_MODE.
    pub(super) fn set_mode(&mut self, m: &COMMAND_LONG_DATA, t_us: u64) -> MavResult {
        // The casts saturate; NaN is 0.
        if !matches!(self.persona, Persona::Generic) && m.param1 as u32 & 1 == 0 {
            return MavResult::MAV_RESULT_DENIED;
        }
        let t_s = self.time_us(t_us) as f64 * 1e-6;
        match &mut self.persona {
            Persona::Generic => MavResult::MAV_RESULT_UNSUPPORTED,
            Persona::ArduPilot(a) => a.set_mode(m.param2 as u32),
            Persona::Px4(p) => {
                let mode = (m.param2 as u32 & 0xFF) << 16 | (m.param3 as u32 & 0xFF) << 24;
                p.set_mode(t_s, self.armed, mode)
            }
        }
    }

    /// MAV_CMD_REQUEST_MESSAGE: the version, with the capability word.
    pub(super) fn request_message(&mut self, id: f32, out: &mut Vec<u8>) -> MavResult {
        let bits = match self.persona {
            Persona::Generic => return MavResult::MAV_RESULT_UNSUPPORTED,
            Persona::Px4(_) => CAPABILITIES_PX4,
            Persona::ArduPilot(_) => CAPABILITIES_ARDUPILOT,
        };
        if id != VERSION_ID {
            return MavResult::MAV_RESULT_UNSUPPORTED;
        }
        let message = MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
            capabilities: MavProtocolCapability::from_bits_retain(bits),
            ..AUTOPILOT_VERSION_DATA::DEFAULT
        });
        self.send_message(&message, out);
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// Why a real firmware does not stream this at that interval; `None`: it does.
    pub(super) fn interval_refusal(&mut self, id: u32, interval_us: f64) -> Option<MavResult> {
        let manners = &self.settings.manners;
        let least_us = if manners.fastest_hz > 0.0 { 1e6 / manners.fastest_hz } else { 0.0 };
        let no_highres = manners.no_highres_imu && id == 105;
        let known = Kind::of(self.settings.firmware, id).is_some() && !no_highres;
        let too_fast = |own_us: f64| interval_us > 0.0 && interval_us < own_us.max(least_us) - 0.5;
        match &self.persona {
            Persona::Generic => None,
            Persona::Px4(_) => {
                let refused = !known || id == HEARTBEAT_ID || id == RAW_IMU_ID || too_fast(0.0);
                refused.then_some(MavResult::MAV_RESULT_FAILED)
            }
            Persona::ArduPilot(_) => {
                let text = if !known {
                    format!("No ap_message for mavlink id ({id})")
                } else if too_fast(ARDUPILOT_LEAST_US) {
                    format!("Requested rate for message ID {id} too fast")
                } else {
                    return None;
                };
                texts(MavSeverity::MAV_SEVERITY_INFO, &text, 0, &mut self.says);
                Some(MavResult::MAV_RESULT_DENIED)
            }
        }
    }

    /// A heartbeat on its wire.
    pub(super) fn hears_heartbeat(&mut self, t_us: u64, system_id: u8) {
        let t_s = self.time_us(t_us) as f64 * 1e-6;
        if let Persona::ArduPilot(a) = &mut self.persona {
            a.heartbeat(t_s, system_id, &self.parameters);
        }
    }

    /// PARAM_SET: it takes effect, and is echoed, mostly.
    pub(super) fn set_parameter(&mut self, name: &[u8], value: f32, out: &mut Vec<u8>) {
        if !self.parameters.set(name, value) {
            return;
        }
        self.echoes += 1;
        if self.settings.manners.lost_echoes && self.echoes.is_multiple_of(3) {
            return;
        }
        self.tell_parameter(name, out);
    }

    pub(super) fn tell_parameter(&mut self, name: &[u8], out: &mut Vec<u8>) {
        if let Some(value) = self.parameters.tell(name) {
            self.send_message(&MavMessage::PARAM_VALUE(value), out);
        }
    }

    /// Its heartbeat; `None` for the generic board.
    pub(super) fn real_heartbeat(&self, t_us: u64) -> Option<HEARTBEAT_DATA> {
        let booting = self.time_us(t_us) as f64 * 1e-6 < READY_S;
        // PX4 has no word for its start; it says 0 as long as the checks of its mode fail, and those of a mode that
        // needs a position do (seen with 1.16.1).
        let unready = match &self.persona {
            Persona::Px4(p) => p.custom_mode != OFFBOARD,
            _ => false,
        };
        let (autopilot, mavtype, custom_mode) = match &self.persona {
            Persona::Generic => return None,
            Persona::Px4(p) => {
                let mavtype = if p.mavtype == 16 {
                    MavType::MAV_TYPE_FLAPPING_WING
                } else {
                    MavType::MAV_TYPE_QUADROTOR
                };
                (MavAutopilot::MAV_AUTOPILOT_PX4, mavtype, p.custom_mode)
            }
            Persona::ArduPilot(a) => (
                MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA,
                MavType::MAV_TYPE_QUADROTOR,
                a.custom_mode,
            ),
        };
        let mut base_mode = MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED;
        if self.armed {
            base_mode |= MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
        }
        let system_status = match (self.armed, booting) {
            (true, _) => MavState::MAV_STATE_ACTIVE,
            (false, _) if unready => MavState::MAV_STATE_UNINIT,
            (false, true) => MavState::MAV_STATE_BOOT,
            (false, false) => MavState::MAV_STATE_STANDBY,
        };
        Some(HEARTBEAT_DATA {
            custom_mode,
            mavtype: mavtype as u8,
            autopilot: autopilot as u8,
            base_mode,
            system_status: system_status as u8,
            mavlink_version: 3,
        })
    }

    /// Streams that run without being asked for: PX4's, as seen, those that matter here.
    pub(super) fn stream_defaults(&mut self) {
        if self.settings.firmware == Firmware::Px4 {
            for (kind, hz) in [
                (Kind::Imu, 50.0),
                (Kind::Attitude, 50.0),
                (Kind::Target, 10.0),
                (Kind::Battery, 0.5),
            ] {
                self.streams.set(kind, 1e6 / hz);
            }
        }
    }

    /// Streams what the companion asks of a board, at its rates: somebody has asked before.
    pub fn say_everything(&mut self) {
        for (kind, hz) in [(Kind::Imu, 250.0), (Kind::Attitude, 100.0), (Kind::Battery, 10.0)] {
            self.streams.set(kind, 1e6 / hz);
        }
    }
}
