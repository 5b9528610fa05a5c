//! Mean thrust of the last second, for the descent when setpoints stop.
//!
//! Of that second and no more: a low-pass of a second that begins at nothing still remembered the motors
//! standing when setpoints stopped early in the climb, and the board came down at 2.3 m/s.

use std::collections::VecDeque;

use crate::effects::STEP_S;

/// The second in steps.
const STEPS: usize = (1.0 / STEP_S) as usize;

/// Thrusts of the last second.
#[derive(Debug, Clone, Default)]
pub(super) struct LastSecond {
    thrusts_frac: VecDeque<f64>,
    sum_frac: f64,
}

impl LastSecond {
    /// Flown for a step.
    pub fn add(&mut self, thrust_frac: f64) {
        self.thrusts_frac.push_back(thrust_frac);
        self.sum_frac += thrust_frac;
        if self.thrusts_frac.len() > STEPS {
            self.sum_frac -= self.thrusts_frac.pop_front().unwrap_or_default();
        }
    }

    /// Their mean; 0 where nothing was flown.
    pub fn mean_frac(&self) -> f64 {
        (self.sum_frac / self.thrusts_frac.len().max(1) as f64).max(0.0)
    }

    /// Motors off.
    pub fn clear(&mut self) {
        self.thrusts_frac.clear();
        self.sum_frac = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_it_is_the_mean_of_the_last_second() {
        let mut last = LastSecond::default();
        assert_eq!(last.mean_frac(), 0.0);
        (0..900).for_each(|_| last.add(0.0));
        (0..250).for_each(|_| last.add(0.6));
        assert!((last.mean_frac() - 0.3).abs() < 1e-9);
        (0..250).for_each(|_| last.add(0.6));
        assert!((last.mean_frac() - 0.6).abs() < 1e-9);
        last.clear();
        last.add(0.4);
        assert!((last.mean_frac() - 0.4).abs() < 1e-12);
    }
}
