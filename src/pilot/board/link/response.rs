//! How long after a tilt was asked for the board's attitude shows it.
//!
//! TIMESYNC measures the line; a board that answers at once and obeys late, or a router that keeps setpoints
//! waiting, shows in nothing but this. Asked tilts u and seen ones y, each without its slow part, are compared at
//! every lag of a grid:
//!
//! ```text
//! S_k = min over g of low-pass |y(t) − g u(t − k h)|²        h = 20 ms, k = 0 … 35
//! lag = h argmin S_k
//! ```
//! with a gain, since a vehicle that tilts less than it was asked to is not late for that. As tilts the horizontal parts
//! of "down" seen from the body count, which no heading turns. The lag holds the inner loop's own (0.17 s) and both
//! ways of the link. It is told only where tilts move by several degrees, most of what is seen is what was asked for,
//! and other lags explain less: in a calm hover or a slow sweep nothing can be told, and need not be.

use std::collections::VecDeque;

use haltere_core::frames::{B, E, Rot};
use haltere_core::time::HostTime;

/// Step of the grid, µs, and its points.
const STEP_US: i64 = 20_000;
const LAGS: usize = 36;
/// Setpoints kept: the grid and what comes between at 100 Hz.
const KEPT: usize = 80;
/// Time constant of the comparison, s: the loops swing at half that or faster where they lose their phase.
const FILTER_S: f64 = 1.0;
/// Time constant of what is slow: trims, drag, a steady lean, s.
const SLOW_S: f64 = 2.0;
/// Least motion of what is asked for, as one sigma, rad (4 degrees): beyond what noise makes of a hover.
const LEAST_STD_RAD: f64 = 0.07;
/// Tilt from how it stood, with which a vehicle has left the floor, rad (2 degrees): half of the above, several times what
/// wings shake one that stands (0.4 degrees).
const STANDS_RAD: f64 = 0.035;
/// Share of what is seen that must be what was asked for.
const EXPLAINED: f64 = 0.6;
/// Lags that explain this share of what is seen less than the best are told apart from it, and no more than so many may not be: 0.2 s,
/// less than lies between a loop as ever and one that is too late. In a slow sweep nearly all lags explain alike, and nothing is told.
const TOLD_APART: f64 = 0.05;
const MOST_ALIKE: usize = 10;
/// A longer pause between two attitudes begins anew, s.
const PAUSE_S: f64 = 0.3;

/// Compares.
#[derive(Debug)]
pub(crate) struct Response {
    asked: VecDeque<(HostTime, [f64; 2])>,
    asked_slow: Option<[f64; 2]>,
    seen_slow: Option<[f64; 2]>,
    seen_at: Option<HostTime>,
    /// Whether it has not tilted since the thrust began; what is slow is the tilt in which it stands till then.
    stands: bool,
    /// Means, at each lag: of what was seen times what was asked, of the square of what was asked; and of the square of what was seen.
    cross: [f64; LAGS],
    asked_var: [f64; LAGS],
    seen_var: f64,
    /// For how long there has been something to compare, s.
    compared_s: f64,
    /// What all that comes to: asked for far more often than an attitude comes.
    lag_s: Option<f64>,
}

impl Default for Response {
    fn default() -> Self {
        Self {
            asked: VecDeque::with_capacity(KEPT),
            asked_slow: None,
            seen_slow: None,
            seen_at: None,
            stands: true,
            cross: [0.0; LAGS],
            asked_var: [0.0; LAGS],
            seen_var: 0.0,
            compared_s: 0.0,
            lag_s: None,
        }
    }
}

impl Response {
    /// A setpoint was sent. Without thrust the board lets nothing turn.
    pub fn asked(&mut self, at: HostTime, attitude: Rot<E, B>, thrust_frac: f64) {
        if thrust_frac <= 0.0 {
            self.asked.clear();
            (self.stands, self.asked_slow, self.seen_slow) = (true, None, None);
            self.begin_anew();
            return;
        }
        let last_at = self.asked.back().map_or(at, |(t, _)| *t);
        let tilt = tilt_of(attitude);
        let fast = without_slow(&mut self.asked_slow, tilt, at.seconds_since(last_at));
        if self.asked.len() == KEPT {
            self.asked.pop_front();
        }
        self.asked.push_back((at, fast));
    }

    /// The board's attitude came.
    pub fn seen(&mut self, at: HostTime, attitude: Rot<E, B>) {
        let dt_s = self.seen_at.replace(at).map_or(0.0, |t| at.seconds_since(t));
        let tilt = tilt_of(attitude);
        if self.stands {
            let stood = *self.seen_slow.get_or_insert(tilt);
            self.stands = square([tilt[0] - stood[0], tilt[1] - stood[1]]) < STANDS_RAD.powi(2);
            self.asked.clear();
            self.asked_slow = Some(stood);
            self.begin_anew();
            return;
        }
        let y = without_slow(&mut self.seen_slow, tilt, dt_s);
        let oldest = at.offset_us(-STEP_US * (LAGS as i64 - 1));
        if dt_s > PAUSE_S || self.asked.front().is_none_or(|(t, _)| *t > oldest) {
            self.begin_anew();
            return;
        }
        self.compared_s += dt_s;
        // A running mean until the filter is full.
        let weight = dt_s / (FILTER_S.min(self.compared_s) + dt_s).max(1e-6);
        let mut asked = self.asked.iter().rev().peekable();
        let means = self.cross.iter_mut().zip(&mut self.asked_var);
        for (k, (cross, asked_var)) in (0_i64..).zip(means) {
            let then = at.offset_us(-STEP_US * k);
            while asked.peek().is_some_and(|(t, _)| *t > then) {
                asked.next();
            }
            let u = asked.peek().map_or([0.0; 2], |(_, u)| *u);
            *cross += (y[0] * u[0] + y[1] * u[1] - *cross) * weight;
            *asked_var += (square(u) - *asked_var) * weight;
        }
        self.seen_var += (square(y) - self.seen_var) * weight;
        self.lag_s = self.told_s();
    }

    fn begin_anew(&mut self) {
        self.compared_s = 0.0;
        (self.cross, self.asked_var, self.seen_var) = ([0.0; LAGS], [0.0; LAGS], 0.0);
        self.lag_s = None;
    }

    /// The lag, s, where it can be told.
    pub fn lag_s(&self) -> Option<f64> {
        self.lag_s
    }

    fn told_s(&self) -> Option<f64> {
        let moves = self.asked_var[0].sqrt() > LEAST_STD_RAD && self.compared_s > FILTER_S;
        if !moves {
            return None;
        }
        let explains: [f64; LAGS] = std::array::from_fn(|k| {
            let cross = self.cross[k].max(0.0);
            cross * cross / self.asked_var[k].max(f64::MIN_POSITIVE)
        });
        let (lag, most) = (0_u8..).zip(explains).max_by(|a, b| a.1.total_cmp(&b.1))?;
        // As it was asked for, with no gain.
        let (asked_var, cross) = (self.asked_var[usize::from(lag)], self.cross[usize::from(lag)]);
        let differs = self.seen_var - 2.0 * cross + asked_var;
        let explained = differs < (1.0 - EXPLAINED) * self.seen_var;
        let alike_above = most - TOLD_APART * self.seen_var;
        let told_apart = explains.iter().filter(|e| **e > alike_above).count() <= MOST_ALIKE;
        (explained && told_apart).then(|| f64::from(lag) * STEP_US as f64 * 1e-6)
    }
}

/// Horizontal parts of "down" in body axes.
fn tilt_of(attitude: Rot<E, B>) -> [f64; 2] {
    let R = attitude.matrix();
    [R[(2, 0)], R[(2, 1)]]
}

fn without_slow(slow: &mut Option<[f64; 2]>, now: [f64; 2], dt_s: f64) -> [f64; 2] {
    let weight = (dt_s / (SLOW_S + dt_s)).clamp(0.0, 1.0);
    let mean = slow.get_or_insert(now);
    std::array::from_fn(|i| {
        mean[i] += (now[i] - mean[i]) * weight;
        now[i] - mean[i]
    })
}

fn square([a, b]: [f64; 2]) -> f64 {
    a * a + b * b
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> HostTime {
        HostTime::from_us(1_000_000 + ms * 1000)
    }

    /// The lag that is told of a roll of this size that swings once in `period_s` and is seen `late_ms` later,
    /// smaller by a factor, beside a trim and in another heading.
    fn lag_of(size_rad: f64, period_s: f64, late_ms: u64, factor: f64) -> Option<f64> {
        let mut response = Response::default();
        let roll = |ms: u64| size_rad * (std::f64::consts::TAU * ms as f64 * 1e-3 / period_s).sin();
        for ms in (0..8000).step_by(10) {
            response.asked(at(ms), Rot::from_euler_rad(roll(ms), 0.05, 1.0), 0.6);
            let then = ms.saturating_sub(late_ms);
            let seen = Rot::from_euler_rad(factor * roll(then) + 0.06, 0.0, -0.4);
            response.seen(at(ms), seen);
        }
        response.lag_s()
    }

    #[test]
    fn prop_the_lag_of_a_swing_is_told() {
        for late_ms in [40, 180, 300, 460, 600] {
            for period_s in [1.0, 1.6, 2.5] {
                for factor in [1.0, 0.7] {
                    let lag_s = lag_of(0.2, period_s, late_ms, factor).unwrap();
                    let off_s = lag_s - late_ms as f64 * 1e-3;
                    // Two steps of the grid and a half: near its best the misfit is flat.
                    assert!(off_s.abs() < 0.05, "{late_ms} ms {period_s} s {factor}: {lag_s}");
                }
            }
        }
    }

    #[test]
    fn prop_of_a_calm_hover_or_another_motion_nothing_is_told() {
        assert_eq!(lag_of(0.03, 1.5, 200, 1.0), None);
        let mut response = Response::default();
        for ms in (0..8000).step_by(10) {
            let t = ms as f64 * 1e-3;
            response.asked(at(ms), Rot::from_euler_rad(0.2 * (4.0 * t).sin(), 0.0, 0.0), 0.6);
            response.seen(at(ms), Rot::from_euler_rad(0.0, 0.2 * (2.3 * t).sin(), 0.0));
        }
        assert_eq!(response.lag_s(), None);
    }

    /// A light vehicle whose estimate is off at the take-off: the floor holds it level for 1.3 s while more and more tilt
    /// is asked for. 700 ms were told of a board that obeyed within 200 ms.
    #[test]
    fn regress_a_floor_that_holds_the_vehicle_is_no_delay() {
        let asked_rad = |t_s: f64| match t_s {
            t if t < 0.2 => 0.0,
            t if t < 1.1 => -0.33 * (t - 0.2) / 0.9,
            t if t < 1.4 => -0.33 + 0.3 * (t - 1.1),
            t if t < 1.7 => -0.24 + 1.4 * (t - 1.4),
            t => 0.2 * (3.0 * (t - 1.7)).sin() + 0.18 * (1.7 - t).exp(),
        };
        for late_s in [0.2, 0.56] {
            let mut response = Response::default();
            let mut told = Vec::new();
            for ms in (0..4000).step_by(10) {
                let t_s = ms as f64 * 1e-3;
                response.asked(at(ms), Rot::from_euler_rad(0.0, asked_rad(t_s), 0.0), 0.4);
                let pitch_rad = if t_s < 1.3 { 0.0 } else { asked_rad(t_s - late_s) };
                let shaken_rad = 0.003 * (90.0 * t_s).sin();
                response.seen(at(ms), Rot::from_euler_rad(shaken_rad, pitch_rad, 0.0));
                told.extend(response.lag_s());
            }
            assert!(!told.is_empty(), "a board that is {late_s} s late: nothing told in the air");
            assert!(told.iter().all(|s| (s - late_s).abs() < 0.05), "{late_s} s: {told:?}");
        }
    }

    /// Through long tilts the vehicle leaned two thirds as far as it was asked to, for want of thrust: 700 ms were told of a board
    /// that obeyed within 200 ms, and the vehicle descended.
    #[test]
    fn regress_a_vehicle_that_leans_less_in_slow_sweeps_is_not_late() {
        let asked_rad = |t_s: f64| 0.75 * (std::f64::consts::TAU * t_s / 9.0).sin();
        let mut response = Response::default();
        for ms in (0..30_000_u64).step_by(10) {
            response.asked(at(ms), Rot::from_euler_rad(asked_rad(ms as f64 * 1e-3), 0.0, 0.0), 0.6);
            let then_s = ms.saturating_sub(200) as f64 * 1e-3;
            let seen_rad = 0.65 * asked_rad(then_s) + 0.02 * (9.0 * then_s).sin();
            response.seen(at(ms), Rot::from_euler_rad(seen_rad, 0.0, 0.0));
            let lag_s = response.lag_s();
            assert!(lag_s.is_none_or(|s| s < 0.3), "{lag_s:?} at {ms} ms");
        }
    }

    #[test]
    fn prop_it_begins_anew_with_the_thrust() {
        let mut response = Response::default();
        for ms in (0..4000).step_by(10) {
            let roll = 0.3 * (4.0 * ms as f64 * 1e-3).sin();
            response.asked(at(ms), Rot::from_euler_rad(roll, 0.0, 0.0), 0.6);
            response.seen(at(ms), Rot::from_euler_rad(roll, 0.0, 0.0));
        }
        assert!(response.lag_s().is_some());
        response.asked(at(4000), Rot::from_euler_rad(0.0, 0.0, 0.0), 0.0);
        assert_eq!(response.lag_s(), None);
    }
}
