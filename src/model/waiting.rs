//! What waits for a number of steps of the simulation: setpoints before the loops, commands behind them.

use std::collections::VecDeque;

use crate::effects::STEP_S;

/// Longest wait, steps: a second.
const MOST_STEPS: f64 = 500.0;

/// Things that wait, oldest first.
pub(crate) struct Waiting<T> {
    steps: usize,
    things: VecDeque<T>,
}

impl<T: Copy> Waiting<T> {
    /// For so long, s, in whole steps.
    pub fn new(delay_s: f64) -> Self {
        let steps = (delay_s / STEP_S).round().clamp(0.0, MOST_STEPS) as usize;
        Self { steps, things: VecDeque::new() }
    }

    /// One goes in, and the one that has waited comes out; until then the first.
    pub fn pass(&mut self, thing: T) -> T {
        if self.steps == 0 {
            return thing;
        }
        self.things.push_back(thing);
        if self.things.len() > self.steps + 1 {
            self.things.pop_front();
        }
        self.things.front().copied().unwrap_or(thing)
    }

    /// Forgets what waits.
    pub fn clear(&mut self) {
        self.things.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_comes_out_after_the_delay_and_not_after_a_clearing() {
        let mut waiting = Waiting::new(0.03);
        for k in 0..40_i32 {
            assert_eq!(waiting.pass(k), (k - 15).max(0));
        }
        waiting.clear();
        assert_eq!(waiting.pass(99), 99);
        assert_eq!((0..3).map(|k| Waiting::new(0.0).pass(k)).collect::<Vec<_>>(), [0, 1, 2]);
    }
}
