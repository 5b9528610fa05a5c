//! ArduPilot's copter, as ArduCopter 4.6.3 and 4.8 were seen on the wire.
//!
//! It obeys in GUIDED_NOGPS only and says nothing about setpoints that it drops. Thrust is a climb
//! rate unless GUID_OPTIONS says otherwise. Without setpoints it levels and holds its height, in the same
//! mode, without a word. Only a lost heartbeat of the companion makes it land, and it stays in LAND.

use haltere_dialect::mav::haltere::{MavMessage, MavResult, MavSeverity};

use crate::board::parameters::Parameters;
use crate::board::ways::{Act, LandDetector, Now, OwnFlight, texts};
use crate::effects::{STEP_S, Setpoint};

pub(super) const STABILIZE: u32 = 0;
const LAND: u32 = 9;
pub(super) const GUIDED_NOGPS: u32 = 20;
/// Modes that it goes to when it is told.
const MODES: [u32; 6] = [STABILIZE, 2, 4, 5, LAND, GUIDED_NOGPS];
/// "ArduPilot Ready" so long after its start, s.
pub(super) const READY_S: f64 = 2.4;
/// A setpoint whose quaternion is off by more is dropped, and it holds.
const LENGTH_TOLERANCE: f32 = 1e-3;
/// Sinking speed of LAND near the floor, m/s.
const LAND_MPS: f64 = 0.5;
/// The target that it tells follows what it is told with this time constant, s (ATC_INPUT_TC).
pub(super) const SHAPING_S: f64 = 0.1;
/// Motors stay off for so long after arming, s (seen with 4.6.3: thrust in force 2.5 s after arming with a spool-up
/// of 0.5 s, in which there is none either).
const HELD_S: f64 = 2.0;
/// Bit of GUID_OPTIONS that makes thrust thrust.
const THRUST_AS_THRUST: u32 = 8;
const REASONS: [&str; 4] = [
    "Arm: Accels inconsistent",
    "Arm: Gyros inconsistent",
    "Arm: EKF attitude is bad",
    "Arm: Internal errors 0x1000 l:0 gyro calibration and EKF not settled yet",
];

/// Its state.
#[derive(Debug, Clone)]
pub(super) struct ArduPilot {
    pub custom_mode: u32,
    own: OwnFlight,
    pub landed: LandDetector,
    /// When the companion's heartbeat was last heard, s since boot.
    heard_s: Option<f64>,
    failsafe: bool,
    overridden: bool,
    ready_told: bool,
    refusals: usize,
    text_id: u16,
    /// Since arming, s, and how long the motors have spooled up since then.
    armed_for_s: f64,
    spooled_s: f64,
}

impl ArduPilot {
    pub fn new() -> Self {
        Self {
            custom_mode: STABILIZE,
            own: OwnFlight::default(),
            landed: LandDetector::default(),
            heard_s: None,
            failsafe: false,
            overridden: false,
            ready_told: false,
            refusals: 0,
            text_id: 0,
            armed_for_s: 0.0,
            spooled_s: 0.0,
        }
    }

    fn say(&mut self, severity: MavSeverity, text: &str, says: &mut Vec<MavMessage>) {
        self.text_id = self.text_id.wrapping_add(1).max(1);
        texts(severity, text, self.text_id, says);
    }

    pub fn heartbeat(&mut self, t_s: f64, system_id: u8, parameters: &Parameters) {
        if f64::from(system_id) == parameters.watched_system() {
            self.heard_s = Some(t_s);
        }
    }

    /// Whether a setpoint counts. The type mask must be 7, the quaternion of unit length.
    pub fn takes(&self, type_mask: u8, length: f32) -> bool {
        self.custom_mode == GUIDED_NOGPS
            && type_mask == 7
            && (length - 1.0).abs() < LENGTH_TOLERANCE
    }

    pub fn set_mode(&mut self, custom_mode: u32) -> MavResult {
        if !MODES.contains(&custom_mode) {
            return MavResult::MAV_RESULT_FAILED;
        }
        self.custom_mode = custom_mode;
        self.failsafe = false;
        MavResult::MAV_RESULT_ACCEPTED
    }

    /// Why it does not arm.
    pub fn refuses(&mut self, t_s: f64, settling_s: f64, says: &mut Vec<MavMessage>) -> bool {
        if t_s > settling_s.max(READY_S) {
            return false;
        }
        let reason = REASONS[self.refusals % REASONS.len()];
        self.refusals += 1;
        self.say(MavSeverity::MAV_SEVERITY_CRITICAL, reason, says);
        true
    }

    /// What time does to it.
    fn watch(
        &mut self,
        now: &Now<'_>,
        parameters: &Parameters,
        override_s: f64,
        says: &mut Vec<MavMessage>,
    ) {
        if now.t_s > READY_S && !self.ready_told {
            self.ready_told = true;
            self.say(MavSeverity::MAV_SEVERITY_INFO, "ArduPilot Ready", says);
        }
        if override_s > 0.0 && now.t_s > override_s && !self.overridden {
            self.overridden = true;
            self.custom_mode = STABILIZE;
        }
        let Some(heard_s) = self.heard_s else { return };
        let silent = now.t_s - heard_s > parameters.get("FS_GCS_TIMEOUT");
        if silent && !self.failsafe && now.armed && parameters.get("FS_GCS_ENABLE") == 5.0 {
            self.failsafe = true;
            self.custom_mode = LAND;
            self.say(MavSeverity::MAV_SEVERITY_WARNING, "GCS Failsafe", says);
        } else if !silent && self.failsafe {
            self.failsafe = false;
            self.say(MavSeverity::MAV_SEVERITY_WARNING, "GCS Failsafe Cleared", says);
        }
    }

    /// One step.
    pub fn step(
        &mut self,
        now: &Now<'_>,
        parameters: &Parameters,
        override_s: f64,
        says: &mut Vec<MavMessage>,
    ) -> Act {
        self.watch(now, parameters, override_s, says);
        if !now.armed {
            self.own = OwnFlight::default();
            self.landed = LandDetector::default();
            (self.armed_for_s, self.spooled_s) = (0.0, 0.0);
            return Act::Stop;
        }
        self.armed_for_s += STEP_S;
        let mut sinking = false;
        let setpoint = match self.custom_mode {
            GUIDED_NOGPS => self.guided(now, parameters),
            LAND => {
                sinking = true;
                Some(self.own.fly(now, Some(-LAND_MPS)))
            }
            // A pilot with a remote control, holding height; on the floor his throttle is down.
            _ if now.state.on_ground => None,
            _ => Some(self.own.fly(now, None)),
        };
        let thrust_frac = setpoint.map_or(0.0, |s| s.thrust_frac);
        self.landed.step(now.state, thrust_frac, sinking);
        let idle_s = parameters.get("DISARM_DELAY");
        let tired = idle_s > 0.0 && thrust_frac == 0.0 && self.landed.since_s() > idle_s;
        if (sinking && self.landed.has_landed()) || tired {
            return Act::Disarm;
        }
        let Some(setpoint) = setpoint else { return Act::Stop };
        if self.motors_wait(now.state.on_ground, setpoint.thrust_frac, parameters) {
            return Act::Wait(Setpoint { thrust_frac: 0.0, ..setpoint });
        }
        Act::Fly(setpoint)
    }

    /// Whether thrust does not act yet: on the floor, after arming and after each rest.
    fn motors_wait(&mut self, on_ground: bool, thrust_frac: f64, parameters: &Parameters) -> bool {
        let spool_s = parameters.get("MOT_SPOOL_TIME");
        if on_ground && thrust_frac <= 0.0 {
            self.spooled_s = 0.0;
            return true;
        }
        if self.spooled_s >= spool_s {
            return false;
        }
        if self.armed_for_s > HELD_S {
            self.spooled_s += STEP_S;
        }
        true
    }

    fn guided(&mut self, now: &Now<'_>, parameters: &Parameters) -> Option<Setpoint> {
        let fresh = now.setpoint.filter(|_| now.age_s < parameters.get("GUID_TIMEOUT"));
        let Some(setpoint) = fresh else {
            // Level, at this height, in this mode, without a word.
            return (!now.state.on_ground).then(|| self.own.fly(now, None));
        };
        if parameters.get("GUID_OPTIONS") as u32 & THRUST_AS_THRUST != 0 {
            self.own.idle(setpoint.thrust_frac);
            return (setpoint.thrust_frac > 0.0).then_some(setpoint);
        }
        let share = 2.0 * setpoint.thrust_frac - 1.0;
        let most = if share > 0.0 { "WP_SPD_UP" } else { "WP_SPD_DN" };
        if now.state.on_ground && share <= 0.0 {
            return None;
        }
        let climb_mps = share * parameters.get(most);
        let thrust_frac = self.own.fly(now, Some(climb_mps)).thrust_frac;
        Some(Setpoint { q: setpoint.q, thrust_frac })
    }
}
