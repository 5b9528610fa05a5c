//! The companion's computer as the world sees it: how bytes come to it, and how long they lie there while it has other work.

use super::noise::Noise;

/// A computer, and what else it does in a session.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Computer {
    /// The host asks the tag's USB endpoint so often, s.
    pub poll_s: f64,
    /// Least delay and spread of the serial line to and from the board, s.
    pub line_s: [f64; 2],
    /// Other work: how often a second it keeps bytes waiting, and how long on average, s.
    pub busy_hz: f64,
    /// See `busy_hz`.
    pub busy_s: f64,
}

impl Default for Computer {
    /// An idle one.
    fn default() -> Self {
        Self { poll_s: 0.004, line_s: [0.0004, 0.0007], busy_hz: 0.0, busy_s: 0.0 }
    }
}

/// Longest time that other work keeps bytes waiting, in means of it.
const LONGEST: f64 = 4.0;

/// When it is busy.
#[derive(Debug, Default)]
pub(super) struct Busy {
    until_s: f64,
    next_s: Option<f64>,
}

impl Busy {
    /// Whether bytes wait at `t_s`; asked in rising order.
    pub fn waits(&mut self, t_s: f64, computer: &Computer, rng: &mut Noise) -> bool {
        if computer.busy_hz <= 0.0 {
            return false;
        }
        let next_s = *self.next_s.get_or_insert_with(|| rng.exponential() / computer.busy_hz);
        if t_s >= next_s {
            self.until_s = t_s + computer.busy_s * rng.exponential().min(LONGEST);
            self.next_s = Some(self.until_s + rng.exponential() / computer.busy_hz);
        }
        t_s < self.until_s
    }
}
