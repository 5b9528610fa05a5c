//! Whether the setpoint in force is ours: the board's ATTITUDE_TARGET against what was sent.
//!
//! It is the only sign of a board that takes setpoints and does something else with them: thrust of a
//! vehicle type that PX4 does not map (seen: zero for every thrust), setpoints that no longer arrive on
//! an ArduPilot, which then holds its height and says nothing (seen).

use std::collections::VecDeque;

use haltere_core::frames::{B, E, Rot};
use haltere_core::time::HostTime;

/// A target may stem from a setpoint that was sent within this time, s: link, loop, stream, link.
const WINDOW_S: f64 = 0.5;
/// Setpoints kept: the window at 100 Hz.
const KEPT: usize = 64;
/// Thrust may differ by so much: resolution, and limits that the board does not tell.
const THRUST_FRAC: f64 = 0.03;
/// The target's axis may differ by so much, rad (15 degrees): boards shape what they are told, and a
/// turn of the heading is shaped most.
const ANGLE_RAD: f64 = 0.26;
/// Without a target that fits for so long, s, setpoints are not in force.
const NOT_IN_FORCE_S: f64 = 0.6;
/// Targets that are older than this say nothing, s: the link is silent, which is told elsewhere.
const FRESH_S: f64 = 0.3;
/// A board that obeys tells thrusts that were sent, to the resolution of the float …
const EXACT_THRUST_FRAC: f64 = 0.0015;
/// … within this time, s.
const EXACT_S: f64 = 0.25;
/// A smaller share of the newest targets than this is chance, if there are so many.
const EXACT_SHARE: f64 = 0.6;
const EXACT_LEAST: usize = 6;
/// Below this thrust nothing can be told apart from a board that gives none.
const LEAST_THRUST_FRAC: f64 = 0.08;

/// What was sent.
#[derive(Debug, Clone, Copy)]
struct Sent {
    at: HostTime,
    attitude: Rot<E, B>,
    thrust_frac: f64,
}

/// Compares.
#[derive(Debug, Default)]
pub(crate) struct TargetWatch {
    sent: VecDeque<Sent>,
    /// When a target last fitted.
    fitted_at: Option<HostTime>,
    /// When thrust was last not yet sent, or too small to tell.
    idle_at: Option<HostTime>,
    heard_at: Option<HostTime>,
    /// Newest targets, and whether each is exactly one of what was sent a moment before.
    exact: VecDeque<(HostTime, bool)>,
    /// Newest thrust of the board, and of ours.
    pub board_thrust_frac: f64,
    /// Newest attitude that it tells.
    board_attitude: Option<Rot<E, B>>,
    is_ignored: bool,
}

impl TargetWatch {
    /// A setpoint was sent, in the board's frame.
    pub fn sent(&mut self, at: HostTime, attitude: Rot<E, B>, thrust_frac: f64) {
        if self.sent.len() == KEPT {
            self.sent.pop_front();
        }
        self.sent.push_back(Sent { at, attitude, thrust_frac });
        if thrust_frac < LEAST_THRUST_FRAC {
            self.idle_at = Some(at);
        }
    }

    /// What the board tells that it flies to, where it told it lately.
    pub fn in_force(&self, at: HostTime) -> Option<(Rot<E, B>, f64)> {
        let fresh = self.heard_at.is_some_and(|t| at.seconds_since(t) < FRESH_S);
        self.board_attitude.filter(|_| fresh).map(|attitude| (attitude, self.board_thrust_frac))
    }

    /// The thrust that was sent last.
    pub fn sent_thrust_frac(&self) -> f64 {
        self.sent.back().map_or(0.0, |s| s.thrust_frac)
    }

    /// The board tells what it flies to.
    pub fn heard(&mut self, at: HostTime, attitude: Rot<E, B>, thrust_frac: f64) {
        self.heard_at = Some(at);
        self.board_thrust_frac = thrust_frac;
        self.board_attitude = Some(attitude);
        let fits = self.sent.iter().any(|s| {
            at.seconds_since(s.at) <= WINDOW_S
                && s.thrust_frac >= LEAST_THRUST_FRAC
                && (s.thrust_frac - thrust_frac).abs() <= THRUST_FRAC
                && s.attitude.raw().angle_to(&attitude.raw()) <= ANGLE_RAD
        });
        if fits {
            if self.fitted_at.is_none() {
                // What it told while its motors stood says nothing about how it flies.
                self.exact.clear();
            }
            self.fitted_at = Some(at);
        }
        // The attitude is shaped, and in a step of 2 m lags by more than thrust does (seen with ArduCopter 4.6.3:
        // every thrust was ours, the axis up to 21 degrees from all that was sent for half a second).
        let thrust_is_ours = self.sent.iter().any(|s| {
            at.seconds_since(s.at) <= EXACT_S
                && (s.thrust_frac - thrust_frac).abs() <= EXACT_THRUST_FRAC
        });
        let axis_is_near = self.sent.iter().any(|s| {
            at.seconds_since(s.at) <= WINDOW_S
                && s.attitude.raw().angle_to(&attitude.raw()) <= ANGLE_RAD
        });
        let exact = thrust_is_ours && axis_is_near;
        if self.exact.len() == KEPT {
            self.exact.pop_front();
        }
        self.exact.push_back((at, exact));
    }

    /// Whether too few of the newest targets are ours. A board that holds by itself flies thrusts like
    /// ours, some of them equal by chance; one that obeys flies ours and no others.
    fn strays(&mut self, at: HostTime) -> bool {
        let old = |e: &(HostTime, bool)| at.seconds_since(e.0) > NOT_IN_FORCE_S;
        while self.exact.front().is_some_and(old) {
            self.exact.pop_front();
        }
        let ours = self.exact.iter().filter(|e| e.1).count();
        self.exact.len() >= EXACT_LEAST && (ours as f64) < EXACT_SHARE * self.exact.len() as f64
    }

    /// Whether our thrust has been seen at the board within the last moments.
    pub fn is_in_force(&self, at: HostTime) -> bool {
        self.fitted_at.is_some_and(|t| at.seconds_since(t) < NOT_IN_FORCE_S)
    }

    /// What time brings, with motors that take `patience_s` to spool up: `Some(true)` setpoints are not in force any more, `Some(false)` they are again.
    pub fn tick(&mut self, at: HostTime, patience_s: f64) -> Option<bool> {
        let fresh = self.heard_at.is_some_and(|t| at.seconds_since(t) < FRESH_S);
        let sending = self.sent.back().is_some_and(|s| at.seconds_since(s.at) < 0.1);
        // Motors that have just been told to turn spool up first.
        let since = if self.fitted_at > self.idle_at {
            self.fitted_at
        } else {
            self.idle_at.map(|t| t.offset_us((patience_s * 1e6) as i64))
        };
        // Compared closely only after thrust has been in force: in the spool-up boards add their own.
        let flown = self.fitted_at.is_some() && since == self.fitted_at;
        let settled = self.idle_at.is_none_or(|t| at.seconds_since(t) > 2.0 * NOT_IN_FORCE_S);
        let strays = self.strays(at) && flown && settled && sending;
        let ignored = strays
            || since.is_some_and(|since| {
                sending
                    && self.sent_thrust_frac() >= LEAST_THRUST_FRAC
                    && at.seconds_since(since) > NOT_IN_FORCE_S
            });
        if !fresh && !self.is_ignored {
            return None;
        }
        if ignored == self.is_ignored {
            return None;
        }
        self.is_ignored = ignored;
        Some(ignored)
    }

    /// Whether setpoints are known not to be in force.
    pub fn is_ignored(&self) -> bool {
        self.is_ignored
    }

    /// On the floor: nothing has been compared.
    pub fn reset(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> HostTime {
        HostTime::from_us(1_000_000 + ms * 1000)
    }

    fn level(yaw_rad: f64) -> Rot<E, B> {
        Rot::from_euler_rad(0.0, 0.0, yaw_rad)
    }

    /// 100 Hz out, 50 Hz back after 40 ms, `back` of what was sent; changes that were noticed.
    fn fly(
        watch: &mut TargetWatch,
        from_ms: u64,
        ms: u64,
        thrust: impl Fn(u64) -> f64,
        back: impl Fn(f64) -> f64,
    ) -> Vec<(u64, bool)> {
        let mut changes = Vec::new();
        for t in (from_ms..from_ms + ms).step_by(10) {
            watch.sent(at(t), level(0.1), thrust(t));
            if t % 20 == 0 && t >= from_ms + 40 {
                watch.heard(at(t), level(0.12), back(thrust(t - 40)));
            }
            changes.extend(watch.tick(at(t), 0.5).map(|c| (t, c)));
        }
        changes
    }

    #[test]
    fn prop_a_board_that_follows_is_in_force() {
        let mut watch = TargetWatch::default();
        let ramp = |t: u64| 0.6 * (t as f64 / 1000.0).min(1.0);
        assert_eq!(fly(&mut watch, 0, 4000, ramp, |t| t), []);
        assert!(watch.is_in_force(at(4000)));
    }

    /// ArduCopter 4.6.3 told 0 for 2.5 s after arming and then, at once, what it was sent.
    #[test]
    fn regress_thrust_that_comes_late_and_at_once_is_obedience() {
        let mut watch = TargetWatch::default();
        let ramp = |t: u64| 0.48 * (t as f64 / 1000.0).min(1.0);
        let mut changes = Vec::new();
        for t in (0..6000).step_by(10) {
            watch.sent(at(t), level(0.1), ramp(t));
            if t % 20 == 0 {
                let told = if t < 2500 { 0.0 } else { ramp(t - 40) };
                watch.heard(at(t), level(0.1), told);
            }
            changes.extend(watch.tick(at(t), 2.5).map(|c| (t, c)));
        }
        assert_eq!(changes, []);
    }

    /// Steps of 2 m: the axis swings from one limit to the other, and the board's follows in its own time.
    #[test]
    fn regress_an_axis_that_is_shaped_is_obedience() {
        let mut watch = TargetWatch::default();
        let lean = |t: u64| match t {
            0..2000 => 0.0,
            _ if (t / 700).is_multiple_of(2) => 0.24,
            _ => -0.24,
        };
        let thrust = |t: u64| 0.5 + 0.1 * (t as f64 * 0.004).sin();
        let axis = |lean_rad: f64| Rot::<E, B>::from_euler_rad(0.0, lean_rad, 0.1);
        let (mut told_rad, mut changes) = (0.0, Vec::new());
        for t in (0..8000).step_by(10) {
            watch.sent(at(t), axis(lean(t)), thrust(t));
            told_rad += (lean(t) - told_rad) * 10.0 / 300.0;
            if t % 20 == 0 && t >= 40 {
                watch.heard(at(t), axis(told_rad), thrust(t - 40));
            }
            changes.extend(watch.tick(at(t), 0.5).map(|c| (t, c)));
        }
        assert_eq!(changes, []);
    }

    #[test]
    fn prop_thrust_that_goes_nowhere_is_noticed_in_the_spool() {
        let mut watch = TargetWatch::default();
        let ramp = |t: u64| 0.6 * (t as f64 / 1000.0).min(1.0);
        let changes = fly(&mut watch, 0, 2000, ramp, |_| 0.0);
        assert_eq!(changes.len(), 1, "{changes:?}");
        assert!(changes[0].1 && (1100..1400).contains(&changes[0].0), "{changes:?}");
        assert!(!watch.is_in_force(at(2000)));
    }

    #[test]
    fn prop_setpoints_that_no_longer_arrive_are_noticed_and_so_is_their_return() {
        let mut watch = TargetWatch::default();
        let wave = |t: u64| 0.6 + 0.05 * (t as f64 * 0.002).sin();
        assert_eq!(fly(&mut watch, 0, 2000, wave, |t| t), []);
        let changes = fly(&mut watch, 2000, 3000, wave, |_| 0.45);
        assert!(matches!(changes[..], [(t, true)] if t < 3400), "{changes:?}");
        let changes = fly(&mut watch, 5000, 1000, wave, |t| t);
        // Not before most of the newest targets are ours.
        assert!(matches!(changes[..], [(t, false)] if t < 5500), "{changes:?}");
    }

    #[test]
    fn prop_a_silent_link_is_not_a_board_that_disobeys() {
        let mut watch = TargetWatch::default();
        fly(&mut watch, 0, 2000, |_| 0.6, |t| t);
        for t in (2000..6000).step_by(10) {
            watch.sent(at(t), level(0.1), 0.6);
            assert_eq!(watch.tick(at(t), 0.5), None);
        }
    }
}
