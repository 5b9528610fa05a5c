//! The push of a take-off: before it is high, the vehicle leans for a moment along each axis without the position loop,
//! and UWB has to follow.
//!
//! A survey of the wrong hand and a heading that is not the room's fit every measurement while the vehicle stands;
//! they turn the position loop against itself as soon as it flies. So the climb waits at [`BELOW_M`], unless what was
//! seen on the way up has decided already. Each lean is held once forwards and once back, so that no speed is left.

use crate::control::{HeldTilt, TiltAxis};
use crate::time::HostTime;

use super::Pilot;
use super::supervisor::Verdict;

/// Height of the gear at which the climb waits, m: below half a metre, clear of the floor by more than UWB errs there.
const BELOW_M: f64 = 0.4;
/// So near to that height it has arrived, m …
const NEAR_M: f64 = 0.15;
/// … or after this time with at least half of it, s; after the longer one nothing lifts it.
const ARRIVED_S: f64 = 1.5;
const NOT_LIFTED_S: f64 = 4.0;
/// Lean, rad (10 degrees), and how long it is held to each side, s: 0.3 to 0.5 m/s, and 0.1 to 0.2 m of way that stay,
/// at a drag of 4 and 2 1/s.
const LEAN_RAD: f64 = 0.175;
const HALF_S: f64 = 0.4;
/// What the vehicle needs to come to rest after it, s.
const REST_S: f64 = 0.2;
/// Rounds along both axes before it is decided by what is more likely.
const MOST_ROUNDS: u8 = 3;

/// Time that a round takes, s.
pub(super) const PUSH_S: f64 = 2.0 * (2.0 * HALF_S + REST_S);

/// Where it stands.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
enum Stage {
    /// Climbing, or waiting at its height since then.
    #[default]
    Waits,
    Arriving(HostTime),
    /// Pushed along an axis since then.
    Leans(TiltAxis, HostTime),
    Over,
}

/// The push of the take-off that is under way.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TakeoffPush {
    stage: Stage,
    rounds: u8,
}

impl TakeoffPush {
    /// Height of the gear beyond which the climb does not go on yet, m.
    pub fn climb_to_m(&self) -> Option<f64> {
        (self.stage != Stage::Over).then_some(BELOW_M)
    }
}

impl Pilot {
    /// A control step of a take-off: the tilt that is held now, if any.
    pub(super) fn push_step(&mut self, at: HostTime) -> Option<HeldTilt> {
        let pos_E_m = self.estimate.pos_E_m;
        match self.push.stage {
            Stage::Over => None,
            Stage::Waits => {
                if self.guidance.takeoff_waits(self.config.flight.gear_height_m + BELOW_M) {
                    self.push.stage = Stage::Arriving(at);
                }
                None
            }
            Stage::Arriving(since) => {
                let to_m = BELOW_M.min(self.guidance.takeoff_height_m());
                let (height_m, waited_s) = (self.height_above_floor_m(), at.seconds_since(since));
                let arrived = (height_m - to_m).abs() < NEAR_M
                    || (waited_s > ARRIVED_S && height_m > 0.5 * to_m);
                let lead = &mut self.supervisor.lead;
                if lead.seen().is_some_and(|seen| seen.pushed() == Verdict::Right) {
                    lead.verdict = Verdict::Right;
                    self.push.stage = Stage::Over;
                } else if arrived {
                    lead.begin_push(pos_E_m);
                    self.push.stage = Stage::Leans(TiltAxis::Pitch, at);
                } else if waited_s > NOT_LIFTED_S {
                    self.push.stage = Stage::Over;
                }
                None
            }
            Stage::Leans(axis, since) => self.lean(at, axis, at.seconds_since(since)),
        }
    }

    fn lean(&mut self, at: HostTime, axis: TiltAxis, elapsed_s: f64) -> Option<HeldTilt> {
        let held = |angle_rad| Some(HeldTilt { axis, angle_rad });
        if elapsed_s < HALF_S {
            // Forwards is nose down.
            return held(if axis == TiltAxis::Pitch { -LEAN_RAD } else { LEAN_RAD });
        } else if elapsed_s < 2.0 * HALF_S {
            return held(if axis == TiltAxis::Pitch { LEAN_RAD } else { -LEAN_RAD });
        } else if elapsed_s < 2.0 * HALF_S + REST_S {
            return None;
        }
        let pos_E_m = self.estimate.pos_E_m;
        let lead = &mut self.supervisor.lead;
        if axis == TiltAxis::Pitch {
            lead.begin_push(pos_E_m);
            self.push.stage = Stage::Leans(TiltAxis::Roll, at);
            return None;
        }
        self.push.rounds += 1;
        let last = self.push.rounds >= MOST_ROUNDS;
        match lead.judge_push(pos_E_m, last) {
            Verdict::Open => {
                lead.begin_push(pos_E_m);
                self.push.stage = Stage::Leans(TiltAxis::Pitch, at);
            }
            Verdict::Right | Verdict::Wrong => self.push.stage = Stage::Over,
        }
        None
    }
}
