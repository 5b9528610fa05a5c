//! PX4, as version 1.17 was seen on the wire.
//!
//! It obeys in OFFBOARD only, to which it goes when it is told and in which it arms only while setpoints
//! stream. When they stop it does what COM_OBL_RC_ACT says, and when they are back it is in OFFBOARD
//! again by itself. Refusals come as events without words. Thrust goes by the vehicle type.

use haltere_dialect::mav::haltere::{MavMessage, MavResult};

use crate::board::parameters::Parameters;
use crate::board::ways::{Act, LandDetector, Now, OwnFlight, event};
use crate::effects::Setpoint;

pub(super) const OFFBOARD: u32 = 6 << 16;
const HOLD: u32 = 4 << 16 | 3 << 24;
const RETURN: u32 = 4 << 16 | 5 << 24;
const LAND: u32 = 4 << 16 | 6 << 24;
/// Sinking speed of LAND, climbing speed of RETURN, m/s (seen: 0.6; it climbed).
const LAND_MPS: f64 = 0.6;
const RETURN_MPS: f64 = 1.0;
/// Setpoints must have come for so long, s, with no gap longer than 2 Hz.
const PROOF_S: f64 = 1.0;
const GAP_S: f64 = 0.5;
/// After touching down it disarms by itself after this time, s (COM_DISARM_LAND).
const DISARM_LAND_S: f64 = 2.0;
/// Events of this make: the numbers mean nothing outside.
const EVENT_SETTLING: u32 = 16_814_021;
const EVENT_NO_STREAM: u32 = 16_909_311;
const EVENT_FAILSAFE: u32 = 1_214_003;

/// Its state.
#[derive(Debug, Clone)]
pub(super) struct Px4 {
    pub custom_mode: u32,
    /// Vehicle type since its boot: a new parameter acts after the next.
    pub mavtype: u8,
    own: OwnFlight,
    pub landed: LandDetector,
    /// OFFBOARD was left because setpoints stopped.
    failsafe: bool,
    /// Since when setpoints stream, and the newest, s since boot.
    stream: Option<(f64, f64)>,
    armed_s: Option<f64>,
    flown: bool,
    overridden: bool,
    events: u16,
}

impl Px4 {
    pub fn new(parameters: &Parameters) -> Self {
        Self {
            custom_mode: HOLD,
            mavtype: parameters.get("MAV_TYPE") as u8,
            own: OwnFlight::default(),
            landed: LandDetector::default(),
            failsafe: false,
            stream: None,
            armed_s: None,
            flown: false,
            overridden: false,
            events: 0,
        }
    }

    fn tell(&mut self, id: u32, severity: u8, t_s: f64, says: &mut Vec<MavMessage>) {
        self.events = self.events.wrapping_add(1);
        says.push(event(id, severity, t_s, self.events));
    }

    /// A setpoint has come: proof of life, whatever the mode.
    pub fn hears_setpoint(&mut self, t_s: f64) {
        self.stream = match self.stream {
            Some((since, last)) if t_s - last < GAP_S => Some((since, t_s)),
            _ => Some((t_s, t_s)),
        };
    }

    fn streams_for_s(&self, t_s: f64) -> f64 {
        match self.stream {
            Some((since, last)) if t_s - last < GAP_S => t_s - since,
            _ => 0.0,
        }
    }

    pub fn set_mode(&mut self, now_s: f64, armed: bool, custom_mode: u32) -> MavResult {
        let offboard = custom_mode & 0x00FF_0000 == OFFBOARD;
        if offboard && armed && self.streams_for_s(now_s) < PROOF_S {
            return MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        }
        self.custom_mode = custom_mode;
        self.failsafe = false;
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// Why it does not arm: an event says so, without words.
    pub fn refuses(&mut self, t_s: f64, settling_s: f64, says: &mut Vec<MavMessage>) -> bool {
        let id = if t_s < settling_s {
            EVENT_SETTLING
        } else if self.custom_mode == OFFBOARD && self.streams_for_s(t_s) < PROOF_S {
            EVENT_NO_STREAM
        } else {
            return false;
        };
        self.tell(id, 3, t_s, says);
        true
    }

    /// Whether thrust of a setpoint reaches the motors.
    fn passes_thrust(&self) -> bool {
        matches!(self.mavtype, 2 | 3 | 4 | 13 | 14 | 15)
    }

    /// One step.
    pub fn step(
        &mut self,
        now: &Now<'_>,
        parameters: &Parameters,
        override_s: f64,
        says: &mut Vec<MavMessage>,
    ) -> Act {
        if override_s > 0.0 && now.t_s > override_s && !self.overridden {
            self.overridden = true;
            self.custom_mode = HOLD;
        }
        if !now.armed {
            self.own = OwnFlight::default();
            self.landed = LandDetector::default();
            (self.armed_s, self.flown, self.failsafe) = (None, false, false);
            return Act::Stop;
        }
        let armed_s = now.t_s - *self.armed_s.get_or_insert(now.t_s);
        let lost = now.setpoint.is_none() || now.age_s > parameters.get("COM_OF_LOSS_T");
        if self.custom_mode == OFFBOARD && lost {
            let action = parameters.get("COM_OBL_RC_ACT");
            self.failsafe = true;
            self.tell(EVENT_FAILSAFE, 4, now.t_s, says);
            self.custom_mode = match action as i32 {
                4 => LAND,
                // No position: position and altitude control fall back to it too (seen with 0).
                0 | 1 | 3 => RETURN,
                6 | 7 => return Act::Disarm,
                _ => HOLD,
            };
        } else if self.failsafe && !lost {
            // By itself, with no command (seen twice).
            self.failsafe = false;
            self.custom_mode = OFFBOARD;
        }
        let mut sinking = false;
        let setpoint = match self.custom_mode {
            OFFBOARD => {
                let thrust = now.setpoint.map_or(0.0, |s| s.thrust_frac);
                let passed = if self.passes_thrust() { thrust } else { 0.0 };
                self.own.idle(passed);
                now.setpoint.map(|s| Setpoint { thrust_frac: passed, ..s })
            }
            LAND => {
                sinking = true;
                Some(self.own.fly(now, Some(-LAND_MPS)))
            }
            RETURN => Some(self.own.fly(now, Some(RETURN_MPS))),
            _ if now.state.on_ground => None,
            _ => Some(self.own.fly(now, None)),
        };
        let thrust_frac = setpoint.map_or(0.0, |s| s.thrust_frac);
        self.landed.step(now.state, thrust_frac, sinking);
        self.flown |= !now.state.on_ground;
        let patience_s =
            if self.flown { DISARM_LAND_S } else { parameters.get("COM_DISARM_PRFLT") };
        let still = self.landed.has_landed() && self.landed.since_s() > patience_s;
        if still && (thrust_frac == 0.0 || sinking) && armed_s > patience_s {
            return Act::Disarm;
        }
        match setpoint {
            None => Act::Stop,
            Some(setpoint) if armed_s < parameters.get("COM_SPOOLUP_TIME") => Act::Wait(setpoint),
            Some(setpoint) => Act::Fly(setpoint),
        }
    }
}
