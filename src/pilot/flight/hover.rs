//! The thrust that hovers, learned in flight.
//!
//! The configuration knows the base thrust over the voltage; a board's thrust scale, a heavier vehicle or
//! worn wings make it another one. Followed is the factor between the two.
//!
//! **Law.** Vertical balance over a window of 1 s, near hover where thrust is proportional to its command:
//!
//! ```text
//! dv/dt = g (1 − u/k) − d v        u = thrust · cos φ cos θ / (base(V) · ground factor)
//! k     = g ū / (g − Δv/T − d v̄)
//! ```
//! v downward velocity of the estimate, m/s; T the window, s; d vertical drag, 1/s; bars are means over
//! the window. k goes through a low-pass. Over a second the thrust's own lag and the noise of a
//! differentiated velocity do not matter (0.05 m/s of noise are 0.7 % of k).
//!
//! **Source.** The balance is the plain one of a rotor in hover; d is 0.65 to 1 1/s for this vehicle
//! (VEHICLE.md). **Validity.** Slow and nearly level flight away from the floor under our own control:
//! anything else is not looked at and k stays.
//!
//! The loops do not use it: their integrators hold what they need. It scales what is flown without a
//! loop: spool-up, blind descent, and the first moment after control is regained.

use std::collections::VecDeque;

use haltere_core::frames::G_MPS2;
use haltere_core::time::HostTime;

use crate::navigation::scale::DRAG_PER_S;
use crate::view::HOVER_BOUNDS;

/// Length of the window, s.
const WINDOW_S: f64 = 1.0;
/// Most steps in it: 100 Hz, and a step that came early.
const MOST: usize = 128;
/// Time constant of the low-pass, s: four windows.
const TIME_CONSTANT_S: f64 = 4.0;
/// Faster vertical flight is not looked at, m/s: the drag's error would be 1 % of gravity.
pub(crate) const SLOW_MPS: f64 = 0.5;
/// More tilt is not looked at, as its cosine (15 degrees).
pub(crate) const LEVEL_COS: f64 = 0.966;
/// Nor is flight below this height, m: the ground effect is a correction, not a measurement.
pub(crate) const CLEAR_M: f64 = 0.7;

/// One step of flight that can be looked at.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub at: HostTime,
    /// Downward velocity, m/s.
    pub vel_down_mps: f64,
    /// Vertical part of the thrust over the base thrust.
    pub share: f64,
}

/// Follows the factor.
#[derive(Debug)]
pub(crate) struct HoverThrust {
    factor: f64,
    window: VecDeque<Step>,
    share_sum: f64,
    vel_sum: f64,
}

impl Default for HoverThrust {
    fn default() -> Self {
        Self { factor: 1.0, window: VecDeque::with_capacity(MOST), share_sum: 0.0, vel_sum: 0.0 }
    }
}

impl HoverThrust {
    /// Hover thrust over the configured base thrust.
    pub fn factor(&self) -> f64 {
        self.factor
    }

    /// A control step; `None`: nothing can be learned from it, and what came before is cut off.
    pub fn step(&mut self, step: Option<Step>, dt_s: f64) {
        let good = step.filter(|s| s.vel_down_mps.is_finite() && s.share.is_finite());
        let Some(step) = good else {
            self.window.clear();
            (self.share_sum, self.vel_sum) = (0.0, 0.0);
            return;
        };
        self.window.push_back(step);
        self.share_sum += step.share;
        self.vel_sum += step.vel_down_mps;
        while self.window.len() > MOST
            || self.window.front().is_some_and(|s| step.at.seconds_since(s.at) > WINDOW_S)
        {
            let Some(old) = self.window.pop_front() else { break };
            self.share_sum -= old.share;
            self.vel_sum -= old.vel_down_mps;
        }
        let Some(first) = self.window.front().copied() else { return };
        let span_s = step.at.seconds_since(first.at);
        if span_s < 0.95 * WINDOW_S {
            return;
        }
        let n = self.window.len() as f64;
        let (share, vel_mps) = (self.share_sum / n, self.vel_sum / n);
        let acc_mps2 = (step.vel_down_mps - first.vel_down_mps) / span_s;
        let carried_mps2 = G_MPS2 - acc_mps2 - DRAG_PER_S * vel_mps;
        // In free fall nothing is carried: such a window tells nothing.
        if carried_mps2 < 0.3 * G_MPS2 {
            return;
        }
        let [low, high] = HOVER_BOUNDS;
        let measured = (G_MPS2 * share / carried_mps2).clamp(low, high);
        self.factor += (measured - self.factor) * (dt_s / TIME_CONSTANT_S).clamp(0.0, 1.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Flies `seconds` with thrust shares and true factor; vertical drag of the plant `d`.
    fn fly(hover: &mut HoverThrust, k: f64, d: f64, seconds: f64, u: impl Fn(f64) -> f64) {
        let mut v = 0.0;
        for i in 0..(seconds * 100.0) as u64 {
            let t = i as f64 * 0.01;
            let share = u(t);
            v += 0.01 * (G_MPS2 * (1.0 - share / k) - d * v);
            let at = HostTime::from_us(1_000_000 + i * 10_000);
            hover.step(Some(Step { at, vel_down_mps: v, share }), 0.01);
        }
    }

    #[test]
    fn prop_converges_whatever_the_vehicle_does_meanwhile() {
        for k in [0.7, 0.85, 1.0, 1.18, 1.4] {
            for d in [0.65, 0.8, 1.0] {
                let mut hover = HoverThrust::default();
                // Thrust moves by 4 % and the vehicle with it.
                fly(&mut hover, k, d, 25.0, |t| k * (1.0 + 0.04 * (1.3 * t).sin()));
                assert!((hover.factor() / k - 1.0).abs() < 0.01, "{k} {d}: {}", hover.factor());
            }
        }
    }

    #[test]
    fn prop_stays_within_its_bounds_and_survives_nonsense() {
        let mut hover = HoverThrust::default();
        let at = |ms: u64| HostTime::from_us(1_000_000 + ms * 1000);
        for ms in (0..60_000).step_by(10) {
            let share = if ms % 70 == 0 { f64::NAN } else { 9.0 };
            hover.step(Some(Step { at: at(ms), vel_down_mps: 0.0, share }), 0.01);
            assert!((HOVER_BOUNDS[0]..=HOVER_BOUNDS[1]).contains(&hover.factor()));
        }
        assert_eq!(hover.factor(), 1.0, "windows with nonsense in them count for nothing");
        fly(&mut hover, 9.0, 0.8, 60.0, |_| 9.0);
        assert!((hover.factor() - HOVER_BOUNDS[1]).abs() < 1e-3);
    }

    #[test]
    fn prop_a_pause_freezes_it() {
        let mut hover = HoverThrust::default();
        fly(&mut hover, 1.2, 0.8, 20.0, |_| 1.2);
        let before = hover.factor();
        hover.step(None, 0.01);
        // Half a second of something else does not fill a window.
        for ms in 0..50 {
            let at = HostTime::from_us(90_000_000 + ms * 10_000);
            hover.step(Some(Step { at, vel_down_mps: 0.0, share: 0.1 }), 0.01);
        }
        assert_eq!(hover.factor(), before);
    }
}
