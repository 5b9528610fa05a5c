//! Height and sinking speed of a moment ago, carried on by the thrust that was sent since.
//!
//! An accelerometer that lies is found a few tenths of a second after it began. By then the estimate has followed it: at
//! four times the force by metres per second, with the wrong sign, and what was sent because of it let the vehicle fall.
//! A descent that begins with such a speed takes seconds to unlearn it, and has met the floor before.
//!
//! **Law.** As in `descent`, from the estimate of [`AGO_S`] ago, with the lag T of the wings:
//!
//! ```text
//! du/dt = (s − u) / T               s thrust sent over the thrust that hovers
//! dw/dt = g (1 − u) − d w           w sinking speed, d vertical drag, 1/s
//! ```
//! **Validity.** Nearly level; a hover thrust that is off by 5 % is 0.25 m/s after that time.

use std::collections::VecDeque;

use super::scale::{DRAG_PER_S, WINGS_S};
use haltere_core::frames::G_MPS2;

/// How far it goes back, s: the scale of an accelerometer is found within 0.35 s.
const AGO_S: f64 = 0.5;
/// The same in control steps.
const STEPS: usize = (AGO_S * 100.0) as usize;

/// One control step.
#[derive(Debug, Clone, Copy)]
struct Step {
    height_m: f64,
    sink_mps: f64,
    share: f64,
    dt_s: f64,
}

/// The last steps of flight.
#[derive(Debug)]
pub(crate) struct Before {
    steps: VecDeque<Step>,
}

impl Default for Before {
    fn default() -> Self {
        // No memory is asked for in flight.
        Self { steps: VecDeque::with_capacity(STEPS) }
    }
}

impl Before {
    /// A control step: height above the floor, m, and sinking speed, m/s, of the estimate, and thrust over the one that
    /// hovers.
    pub fn note(&mut self, height_m: f64, sink_mps: f64, share: f64, dt_s: f64) {
        if self.steps.len() == STEPS {
            self.steps.pop_front();
        }
        self.steps.push_back(Step { height_m, sink_mps, share, dt_s });
    }

    /// Not under our control: what was before says nothing.
    pub fn forget(&mut self) {
        self.steps.clear();
    }

    /// Height above the floor, m, and sinking speed, m/s, now; `None`: nothing is known of a moment ago.
    pub fn carried_on(&self) -> Option<(f64, f64)> {
        let &Step { mut height_m, mut sink_mps, share: mut wings, .. } = self.steps.front()?;
        for step in &self.steps {
            wings += (step.share - wings) * (step.dt_s / (WINGS_S + step.dt_s));
            sink_mps += (G_MPS2 * (1.0 - wings) - DRAG_PER_S * sink_mps) * step.dt_s;
            height_m -= sink_mps * step.dt_s;
        }
        Some((height_m, sink_mps))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_velocity_that_was_made_up_since_does_not_count() {
        let mut before = Before::default();
        assert_eq!(before.carried_on(), None);
        for _ in 0..100 {
            before.note(1.5, 0.0, 1.0, 0.01);
        }
        // The estimate shoots up, and the loop cuts the thrust.
        for n in 1..=20 {
            before.note(1.5 + 0.01 * f64::from(n), -0.2 * f64::from(n), 0.4, 0.01);
        }
        let (height_m, sink_mps) = before.carried_on().unwrap();
        assert!((0.5..0.9).contains(&sink_mps), "{sink_mps}");
        assert!((1.4..1.5).contains(&height_m), "{height_m}");
        before.forget();
        assert_eq!(before.carried_on(), None);
    }
}
