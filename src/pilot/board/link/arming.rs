//! Arming and disarming: a sequence of stages, each ended by what the heartbeat says.
//!
//! ```text
//! stream ──► mode ──► arm ──► confirmed
//!              ▲        │ another mode in the heartbeat
//!              └────────┘
//! ```
//! PX4 wants setpoints before its mode, both real firmwares want their mode before arming, and refuse
//! to arm for as long as their sensors settle: such a refusal is asked again once a second. The generic
//! board has the last stage only, and its refusal is final.

use haltere_dialect::mav::haltere::MavResult;

use haltere_core::time::HostTime;

use super::profile::Firmware;

/// Magic number that forces a disarm in the air (common.xml, MAV_CMD_COMPONENT_ARM_DISARM).
const FORCE_DISARM: f32 = 21196.0;
/// An unanswered command is sent again after this time, µs, this many times.
const COMMAND_RETRY_US: i64 = 400_000;
const COMMAND_TRIES: u32 = 5;
/// After an accepted arm command the heartbeat must show it within this time, µs: it comes at 1 Hz.
const CONFIRM_US: i64 = 2_500_000;
/// A refused arm command is sent again after this time, µs (seen to work with ArduPilot).
const REFUSED_RETRY_US: i64 = 1_000_000;
/// A generic board that refused to disarm is asked again after this time, µs: its wings stand by then.
const REFUSED_DISARM_US: i64 = 100_000;
/// The mode must have been seen for so long before arming, s: a mode that was commanded while the
/// board booted is overridden a moment later.
const MODE_STANDS_S: f64 = 0.4;

/// What is done for a command now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Stream,
    Mode,
    Arm,
}

/// A command under way.
#[derive(Debug, Clone)]
struct Order {
    arm: bool,
    force: bool,
    stage: Stage,
    tries: u32,
    next_try: HostTime,
    /// Set once the board accepted: until when its heartbeat must agree.
    confirm_until: Option<HostTime>,
    /// When the attempt ends.
    give_up: HostTime,
    patient: bool,
    refusal: String,
}

/// What the sequence knows of the board.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seen {
    pub armed: bool,
    /// For how long setpoints have been streaming without a gap, s.
    pub streaming_s: f64,
    /// For how long the heartbeat has shown our mode, s. `None`: it does not.
    pub mode_s: Option<f64>,
    /// Whether the board has a mode to be in.
    pub has_mode: bool,
}

/// What is to be sent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Send {
    Nothing,
    /// Ask for the control mode.
    Mode,
    /// First two parameters and confirmation of the arm command.
    Arm([f32; 2], u8),
}

/// How a command ended, or went on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Outcome {
    pub arm: bool,
    pub accepted: bool,
    pub why: String,
}

/// The sequence.
#[derive(Debug, Default)]
pub(crate) struct Arming {
    order: Option<Order>,
}

impl Arming {
    /// Begins. `last_words`: what a refusal is told with.
    pub fn begin(&mut self, firmware: Firmware, arm: bool, force: bool, at: HostTime) {
        let patience_s = firmware.arming_patience_s();
        let patient = patience_s > 0.0;
        self.order = Some(Order {
            arm,
            force,
            stage: if arm && patient { Stage::Stream } else { Stage::Arm },
            tries: 0,
            next_try: at,
            confirm_until: None,
            give_up: at.offset_us((patience_s * 1e6) as i64),
            patient: arm && patient,
            refusal: String::new(),
        });
    }

    /// The same, but not before a while.
    pub fn begin_later(&mut self, firmware: Firmware, arm: bool, force: bool, at: HostTime) {
        self.begin(firmware, arm, force, at);
        if let Some(order) = &mut self.order {
            let real = firmware.control_mode().is_some();
            let wait_us = if real { COMMAND_RETRY_US } else { REFUSED_DISARM_US };
            order.next_try = at.offset_us(wait_us);
        }
    }

    /// Whether a command still waits for its answer or its confirmation.
    pub fn is_under_way(&self) -> bool {
        self.order.is_some()
    }

    /// Whether what waits for its answer is a disarm command.
    pub fn is_disarming(&self) -> bool {
        self.order.as_ref().is_some_and(|order| !order.arm)
    }

    /// The board's acknowledgement of an arm or disarm command.
    pub fn answer(&mut self, at: HostTime, result: MavResult, armed: bool) -> Option<Outcome> {
        let order = self.order.as_mut()?;
        if order.stage != Stage::Arm {
            return None;
        }
        match result {
            MavResult::MAV_RESULT_ACCEPTED => {
                let first = order.confirm_until.is_none();
                if first {
                    order.confirm_until = Some(at.offset_us(CONFIRM_US));
                }
                // A real board's word is not taken for it: the heartbeat answers.
                let told = first && !order.patient;
                let outcome = told.then(|| Outcome::good(order.arm));
                let late = self.confirm(at, armed);
                outcome.or(late)
            }
            MavResult::MAV_RESULT_IN_PROGRESS => None,
            refused if order.patient => {
                order.refusal = format!("board answered {refused:?}");
                order.tries = 0;
                order.confirm_until = None;
                order.next_try = at.offset_us(REFUSED_RETRY_US);
                None
            }
            refused => {
                let outcome = Outcome {
                    arm: order.arm,
                    accepted: false,
                    why: format!("board answered {refused:?}"),
                };
                self.order = None;
                Some(outcome)
            }
        }
    }

    /// The acknowledgement may be lost; a heartbeat that shows what was asked says as much.
    pub fn heartbeat(&mut self, at: HostTime, armed: bool) -> Option<Outcome> {
        let order = self.order.as_mut()?;
        if order.patient {
            return self.confirm(at, armed);
        }
        let mut outcome = None;
        if order.confirm_until.is_none() && order.tries > 0 && order.arm && armed {
            order.confirm_until = Some(at);
            outcome = Some(Outcome::good(true));
        }
        let late = self.confirm(at, armed);
        outcome.or(late)
    }

    /// An arm command is done when the heartbeat agrees, not when it was acknowledged.
    fn confirm(&mut self, at: HostTime, armed: bool) -> Option<Outcome> {
        let order = self.order.as_mut()?;
        if order.patient && armed && order.stage == Stage::Arm && order.tries > 0 {
            self.order = None;
            return Some(Outcome::good(true));
        }
        let until = order.confirm_until?;
        if armed == order.arm {
            self.order = None;
        } else if at > until {
            let why = "board accepted, but its heartbeat does not agree".to_owned();
            let outcome = Outcome { arm: order.arm, accepted: false, why };
            self.order = None;
            return Some(outcome);
        }
        None
    }

    /// Work that is due.
    pub fn tick(
        &mut self,
        at: HostTime,
        firmware: Firmware,
        seen: Seen,
    ) -> (Send, Option<Outcome>) {
        if let Some(outcome) = self.confirm(at, seen.armed) {
            return (Send::Nothing, Some(outcome));
        }
        let Some(order) = self.order.as_mut() else { return (Send::Nothing, None) };
        if order.patient && at > order.give_up {
            let why = match (order.stage, order.refusal.is_empty()) {
                (Stage::Stream, _) => "setpoints did not stream".to_owned(),
                (Stage::Mode, _) => {
                    let name = firmware.control_mode().map_or("", |m| m.name);
                    format!("board does not stay in {name}")
                }
                (Stage::Arm, true) => "board did not answer".to_owned(),
                (Stage::Arm, false) => order.refusal.clone(),
            };
            let why = format!("{why}, for {:.0} s", firmware.arming_patience_s());
            self.order = None;
            return (Send::Nothing, Some(Outcome { arm: true, accepted: false, why }));
        }
        if order.stage == Stage::Stream {
            if seen.streaming_s < firmware.stream_first_s() {
                return (Send::Nothing, None);
            }
            order.stage = Stage::Mode;
            order.next_try = at;
        }
        if order.stage == Stage::Mode {
            if !seen.has_mode || seen.mode_s.is_some_and(|s| s > MODE_STANDS_S) {
                order.stage = Stage::Arm;
                order.tries = 0;
                order.next_try = at;
            } else if seen.mode_s.is_none() && at >= order.next_try {
                let again_s = firmware.control_mode().map_or(1.0, |m| m.ask_again_s);
                order.next_try = at.offset_us((again_s * 1e6) as i64);
                return (Send::Mode, None);
            } else {
                return (Send::Nothing, None);
            }
        }
        if order.patient && seen.has_mode && seen.mode_s.is_none() {
            // It was overridden while arming was asked for.
            order.stage = Stage::Mode;
            order.next_try = at;
            order.confirm_until = None;
            return (Send::Nothing, None);
        }
        if order.confirm_until.is_some() || at < order.next_try {
            return (Send::Nothing, None);
        }
        if order.tries == COMMAND_TRIES {
            if order.patient {
                order.tries = 0;
            } else {
                let why = format!("board did not answer {COMMAND_TRIES} times");
                let outcome = Outcome { arm: order.arm, accepted: false, why };
                self.order = None;
                return (Send::Nothing, Some(outcome));
            }
        }
        let force = if order.force { FORCE_DISARM } else { 0.0 };
        let confirmation = order.tries as u8;
        order.tries += 1;
        order.next_try = at.offset_us(COMMAND_RETRY_US);
        (Send::Arm([f32::from(u8::from(order.arm)), force], confirmation), None)
    }
}

impl Outcome {
    fn good(arm: bool) -> Self {
        Self { arm, accepted: true, why: String::new() }
    }
}
