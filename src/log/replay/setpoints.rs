//! What the board was told to do beside what this build would have told it: SET_ATTITUDE_TARGET, step by step.
//!
//! Setpoints go out from arming to landing and at no other time. Both streams carry the time of their step, so a
//! step is compared with the same step, whatever else was sent around it.

use std::collections::VecDeque;

use haltere_dialect::mav::haltere::{MavMessage, SET_ATTITUDE_TARGET_DATA};
use haltere_dialect::mav_stream::MavSplitter;
use serde::Serialize;

use super::compare::{TOLERANCE, without_signatures};
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

fn target_of(link: LinkId, bytes: &[u8]) -> Option<SET_ATTITUDE_TARGET_DATA> {
    let mut frames = MavSplitter::new();
    frames.push(bytes);
    let frame = frames.next().filter(|_| link == LinkId::Board)?.ok()?;
    match frame.decode().ok()? {
        MavMessage::SET_ATTITUDE_TARGET(target) if frames.pending() == 0 => Some(target),
        _ => None,
    }
}

/// A step on its way to be compared.
#[derive(Debug)]
struct Step {
    sequence: u64,
    at: HostTime,
    target: SET_ATTITUDE_TARGET_DATA,
    bytes: Vec<u8>,
}

/// A difference: place in the log, time, words.
pub(super) type Odd = (u64, HostTime, String);

/// Steps of one stream that wait for the other: both lie within seconds of one another, at 100 Hz.
const MOST_WAITING: usize = 6_000;

/// Both streams.
#[derive(Debug)]
pub(super) struct Setpoints {
    start: HostTime,
    /// Numbers of two builds may be so far apart.
    tolerance: f64,
    recorded: VecDeque<Step>,
    replayed: VecDeque<Step>,
    /// Places and times of steps that the replay sends and that waited in vain: those behind the end do not count.
    in_vain: VecDeque<(u64, HostTime)>,
    pub report: SetpointReport,
    /// Steps in which the same bytes were sent.
    pub identical: u64,
    /// Largest difference of a number of those that agree.
    pub worst: f64,
    pub first: Option<Odd>,
}

impl Setpoints {
    pub fn new(start: HostTime, exact: bool) -> Self {
        Self {
            start,
            tolerance: if exact { 0.0 } else { TOLERANCE },
            recorded: VecDeque::new(),
            replayed: VecDeque::new(),
            in_vain: VecDeque::new(),
            report: SetpointReport::default(),
            identical: 0,
            worst: 0.0,
            first: None,
        }
    }

    /// Takes what went out; `false`: it is no setpoint.
    pub fn recorded(&mut self, sequence: u64, at: HostTime, link: LinkId, bytes: &[u8]) -> bool {
        let Some(target) = target_of(link, bytes) else { return false };
        self.recorded.push_back(Step { sequence, at, target, bytes: bytes.to_vec() });
        self.pair();
        if self.recorded.len() > MOST_WAITING
            && let Some(step) = self.recorded.pop_front()
        {
            self.missing(&step);
        }
        true
    }

    /// The same of the replay. `sequence`: of the input that it follows.
    pub fn replayed(&mut self, sequence: u64, at: HostTime, link: LinkId, bytes: &[u8]) -> bool {
        let Some(target) = target_of(link, bytes) else { return false };
        self.replayed.push_back(Step { sequence, at, target, bytes: bytes.to_vec() });
        self.pair();
        if self.replayed.len() > MOST_WAITING
            && let Some(step) = self.replayed.pop_front()
        {
            self.in_vain.push_back((step.sequence, step.at));
        }
        // So long before the end nothing is in doubt.
        if self.in_vain.len() > MOST_WAITING
            && let Some((sequence, at)) = self.in_vain.pop_front()
        {
            self.additional(sequence, at);
        }
        true
    }

    /// Nothing more will come. `until`: what the replay sends from then on was not recorded any more.
    pub fn end(&mut self, until: HostTime) {
        for (sequence, at) in std::mem::take(&mut self.in_vain) {
            if at < until {
                self.additional(sequence, at);
            }
        }
        while let Some(step) = self.recorded.pop_front() {
            self.missing(&step);
        }
        while let Some(step) = self.replayed.pop_front().filter(|step| step.at < until) {
            self.additional(step.sequence, step.at);
        }
    }

    fn missing(&mut self, step: &Step) {
        self.report.missing += 1;
        self.odd(step.sequence, step.at, "recorded, but the replay sends no setpoint");
    }

    fn additional(&mut self, sequence: u64, at: HostTime) {
        self.report.additional += 1;
        self.odd(sequence, at, "the replay sends a setpoint, none was recorded");
    }

    /// Each stream is in the order of its time, so the earlier of two steps has no counterpart.
    fn pair(&mut self) {
        while let (Some(recorded), Some(replayed)) = (self.recorded.front(), self.replayed.front())
        {
            // The stamp wraps after 49 days.
            let after_ms = recorded
                .target
                .time_boot_ms
                .wrapping_sub(replayed.target.time_boot_ms)
                .cast_signed();
            if after_ms > 0 {
                let Some(step) = self.replayed.pop_front() else { return };
                self.additional(step.sequence, step.at);
            } else if after_ms < 0 {
                let Some(step) = self.recorded.pop_front() else { return };
                self.missing(&step);
            } else if let (Some(recorded), Some(replayed)) =
                (self.recorded.pop_front(), self.replayed.pop_front())
            {
                self.compare(&recorded, &replayed);
            }
        }
    }

    fn compare(&mut self, recorded: &Step, replayed: &Step) {
        self.report.compared += 1;
        let (a, b) = (&recorded.target, &replayed.target);
        if without_signatures(&recorded.bytes) == without_signatures(&replayed.bytes) {
            self.identical += 1;
            return;
        }
        // A number that is none agrees with nothing.
        let apart =
            |x: f32, y: f32| Some(f64::from((x - y).abs())).filter(|d| !d.is_nan()).unwrap_or(1.0);
        let numbers = a.q.iter().zip(&b.q).map(|(x, y)| apart(*x, *y));
        let worst = numbers.fold(apart(a.thrust, b.thrust), f64::max);
        let rest = |t: &SET_ATTITUDE_TARGET_DATA| SET_ATTITUDE_TARGET_DATA {
            q: [0.0; 4],
            thrust: 0.0,
            ..t.clone()
        };
        let degrees = angle_deg(a.q, b.q);
        self.report.worst_deg = self.report.worst_deg.max(degrees);
        self.report.worst_thrust_frac =
            self.report.worst_thrust_frac.max(apart(a.thrust, b.thrust));
        if worst <= self.tolerance && rest(a) == rest(b) {
            self.worst = self.worst.max(worst);
        } else {
            self.report.differ += 1;
            let what = format!("recorded {a:?}, replayed {b:?}");
            self.odd(recorded.sequence, recorded.at, &what);
        }
    }

    fn odd(&mut self, sequence: u64, at: HostTime, what: &str) {
        self.report.first_s.get_or_insert(at.seconds_since(self.start));
        self.first.get_or_insert_with(|| (sequence, at, what.to_owned()));
    }
}

/// Angle of the turn from one attitude to another, deg; 180 where one of them is none.
fn angle_deg(a: [f32; 4], b: [f32; 4]) -> f64 {
    let attitude = |q: [f32; 4]| Rot::<E, B>::from_wxyz(q.map(f64::from));
    match (attitude(a), attitude(b)) {
        (Some(a), Some(b)) => a.raw().angle_to(&b.raw()).to_degrees(),
        _ => 180.0,
    }
}
