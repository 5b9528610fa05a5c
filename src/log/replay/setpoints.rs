//! What the board was told to do beside what this build would have told it: SET_ATTITUDE_TARGET, step by step.
//!
//! Setpoints go out from arming to landing and at no other time.

use haltere_dialect::mav::haltere::{MavMessage, SET_ATTITUDE_TARGET_DATA};
use haltere_dialect::mav_stream::MavSplitter;
use serde::Serialize;

use haltere_core::frames::{B, E, Rot};
use haltere_core::time::HostTime;
use haltere_pilot::LinkId;

/// A setpoint as it went to the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setpoint {
    /// When.
    pub at: HostTime,
    /// Attitude in the board's own north-east-down frame.
    pub attitude: Rot<E, B>,
    /// Thrust, 0 to 1.
    pub thrust_frac: f64,
}

/// How the setpoints of a replay agree with those that were flown.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SetpointReport {
    /// Steps in which both send one.
    pub compared: u64,
    /// Of these, further apart than the demand allows.
    pub differ: u64,
    /// Recorded, and not sent by the replay.
    pub missing: u64,
    /// Sent by the replay alone.
    pub additional: u64,
    /// Largest angle between both attitudes, deg.
    pub worst_deg: f64,
    /// Largest difference of thrust, 0 to 1.
    pub worst_thrust_frac: f64,
    /// Time of the first step that does not agree, s since the start of the core.
    pub first_s: Option<f64>,
}

impl SetpointReport {
    /// Whether every step agrees.
    pub fn agree(&self) -> bool {
        self.differ == 0 && self.missing == 0 && self.additional == 0
    }
}

/// The only frame in `bytes`, if it is a setpoint for the board.
pub fn setpoint_of(at: HostTime, link: LinkId, bytes: &[u8]) -> Option<Setpoint> {
    let target = target_of(link, bytes)?;
    let attitude = Rot::from_wxyz(target.q.map(f64::from))?;
    let thrust_frac = f64::from(target.thrust);
    thrust_frac.is_finite().then_some(Setpoint { at, attitude, thrust_frac })
}

pub(super) fn target_of(link: LinkId, bytes: &[u8]) -> Option<SET_ATTITUDE_TARGET_DATA> {
    let mut frames = MavSplitter::new();
    frames.push(bytes);
    let frame = frames.next().filter(|_| link == LinkId::Board)?.ok()?;
    match frame.decode().ok()? {
        MavMessage::SET_ATTITUDE_TARGET(target) if frames.pending() == 0 => Some(target),
        _ => None,
    }
}

/// Two setpoints of one step, beside one another: the largest difference of a number, and whether they agree within
/// `tolerance`.
pub(super) fn beside(
    a: &SET_ATTITUDE_TARGET_DATA,
    b: &SET_ATTITUDE_TARGET_DATA,
    tolerance: f64,
    report: &mut SetpointReport,
) -> (f64, bool) {
    // A number that is none agrees with nothing.
    let apart =
        |x: f32, y: f32| Some(f64::from((x - y).abs())).filter(|d| !d.is_nan()).unwrap_or(1.0);
    let thrust_frac = apart(a.thrust, b.thrust);
    let worst = a.q.iter().zip(&b.q).map(|(x, y)| apart(*x, *y)).fold(thrust_frac, f64::max);
    report.worst_deg = report.worst_deg.max(angle_deg(a.q, b.q));
    report.worst_thrust_frac = report.worst_thrust_frac.max(thrust_frac);
    let rest = |t: &SET_ATTITUDE_TARGET_DATA| SET_ATTITUDE_TARGET_DATA {
        q: [0.0; 4],
        thrust: 0.0,
        ..t.clone()
    };
    (worst, worst <= tolerance && rest(a) == rest(b))
}

/// Angle of the turn from one attitude to another, deg; 180 where one of them is none.
fn angle_deg(a: [f32; 4], b: [f32; 4]) -> f64 {
    let attitude = |q: [f32; 4]| Rot::<E, B>::from_wxyz(q.map(f64::from));
    match (attitude(a), attitude(b)) {
        (Some(a), Some(b)) => a.raw().angle_to(&b.raw()).to_degrees(),
        _ => 180.0,
    }
}
