//! What the two real firmwares have in common: a mode, a land detector, a law for flying without
//! setpoints, words for people.

use haltere_dialect::mav::haltere::{EVENT_DATA, MavMessage, MavSeverity, STATUSTEXT_DATA};
use haltere_dialect::mav::types::CharArray;
use nalgebra::{UnitQuaternion, Vector3};

use crate::effects::{STEP_S, Setpoint, State};

/// Length of a STATUSTEXT, bytes: longer texts go in chunks.
const TEXT_BYTES: usize = 50;
/// A land detector needs this long on the floor without thrust to agree, s.
const LANDED_S: f64 = 1.0;
/// Thrust below which it counts as none.
const NO_THRUST_FRAC: f64 = 0.05;
/// Gain of the own height hold, 1/(m/s), and of its integral, 1/m.
const CLIMB_GAIN: f64 = 0.25;
const CLIMB_INTEGRAL: f64 = 0.15;
/// Height error to climb rate, 1/s.
const HEIGHT_GAIN: f64 = 0.8;

/// What is known in a step.
pub(super) struct Now<'a> {
    /// Since the board's boot, s.
    pub t_s: f64,
    pub state: &'a State,
    /// Heading as the board believes it, rad.
    pub yaw_rad: f64,
    pub armed: bool,
    /// The newest setpoint that was good, and its age, s.
    pub setpoint: Option<Setpoint>,
    pub age_s: f64,
}

/// What the board does in a step.
pub(super) enum Act {
    /// Flies to this.
    Fly(Setpoint),
    /// The same, but the motors still spool up.
    Wait(Setpoint),
    /// Motors off, armed.
    Stop,
    Disarm,
}

/// Own flight: level, at a climb rate or a height.
#[derive(Debug, Clone, Default)]
pub(super) struct OwnFlight {
    held: Option<(UnitQuaternion<f64>, f64)>,
    base_frac: f64,
}

impl OwnFlight {
    /// Somebody else flies, at this thrust.
    pub fn idle(&mut self, thrust_frac: f64) {
        self.held = None;
        // One-second mean: what hover takes.
        self.base_frac += STEP_S * (thrust_frac - self.base_frac);
    }

    /// Level with the heading of now; `climb_mps`: up, or `None` to hold the height.
    pub fn fly(&mut self, now: &Now<'_>, climb_mps: Option<f64>) -> Setpoint {
        let height_m = now.state.height_m;
        let (q, held_m) = *self.held.get_or_insert_with(|| {
            (UnitQuaternion::from_axis_angle(&Vector3::z_axis(), now.yaw_rad), height_m)
        });
        let wanted = climb_mps.unwrap_or((HEIGHT_GAIN * (held_m - height_m)).clamp(-1.0, 1.0));
        let error = wanted + now.state.vel_E_mps.z;
        self.base_frac = (self.base_frac + CLIMB_INTEGRAL * error * STEP_S).clamp(0.1, 0.9);
        let thrust_frac = (self.base_frac + CLIMB_GAIN * error).clamp(0.05, 1.0);
        Setpoint { q, thrust_frac }
    }
}

/// Says when it has landed.
#[derive(Debug, Clone)]
pub(super) struct LandDetector {
    still_s: f64,
}

impl Default for LandDetector {
    fn default() -> Self {
        Self { still_s: LANDED_S }
    }
}

impl LandDetector {
    /// After a step with this thrust.
    pub fn step(&mut self, state: &State, thrust_frac: f64, sinking: bool) {
        let still = state.on_ground && (thrust_frac < NO_THRUST_FRAC || sinking);
        self.still_s = if still { self.still_s + STEP_S } else { 0.0 };
    }

    /// Whether it agrees.
    pub fn has_landed(&self) -> bool {
        self.still_s >= LANDED_S
    }

    /// For how long it has agreed, s.
    pub fn since_s(&self) -> f64 {
        (self.still_s - LANDED_S).max(0.0)
    }
}

/// A text in as many chunks as it needs.
pub(super) fn texts(severity: MavSeverity, text: &str, id: u16, out: &mut Vec<MavMessage>) {
    let chunks: Vec<&[u8]> = text.as_bytes().chunks(TEXT_BYTES).collect();
    let full = text.len().is_multiple_of(TEXT_BYTES);
    let id = if chunks.len() == 1 && !full { 0 } else { id.max(1) };
    let tail: Option<&[u8]> = full.then_some(&[]);
    for (seq, chunk) in chunks.into_iter().chain(tail).enumerate() {
        let mut field = [0; TEXT_BYTES];
        for (to, from) in field.iter_mut().zip(chunk) {
            *to = *from;
        }
        out.push(MavMessage::STATUSTEXT(STATUSTEXT_DATA {
            severity: severity as u8,
            text: CharArray::new(field),
            id,
            chunk_seq: seq as u8,
        }));
    }
}

/// An event without words.
pub(super) fn event(id: u32, severity: u8, t_s: f64, sequence: u16) -> MavMessage {
    MavMessage::EVENT(EVENT_DATA {
        id,
        event_time_boot_ms: (t_s * 1e3) as u32,
        sequence,
        // Internal level in the upper half, for people in the lower.
        log_levels: severity << 4 | severity,
        ..EVENT_DATA::DEFAULT
    })
}
