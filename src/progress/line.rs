//! A line of progress for tasks that say with every step how many there are.

use std::io::{IsTerminal as _, Write as _};
use std::time::Instant;

/// Progress on standard error: one line that is written over on a terminal, else a line each tenth.
pub struct Line {
    what: &'static str,
    started: Instant,
    terminal: bool,
}

impl Line {
    /// `what` stands before the figures.
    pub fn new(what: &'static str) -> Self {
        let terminal = std::io::stderr().is_terminal();
        Self { what, started: Instant::now(), terminal }
    }

    /// Done, of how many.
    pub fn at(&self, done: usize, of: usize) {
        let elapsed_s = self.started.elapsed().as_secs_f64();
        let left_s = elapsed_s * of.saturating_sub(done) as f64 / done.max(1) as f64;
        let mut err = std::io::stderr().lock();
        let step = (of / 10).max(1);
        if self.terminal {
            let end = if done == of { "\n" } else { "" };
            let _ = write!(err, "\r{}: {done} of {of}, {left_s:.0} s left   {end}", self.what);
        } else if done.is_multiple_of(step) || done == of {
            let _ = writeln!(err, "{}: {done} of {of}, {left_s:.0} s left", self.what);
        }
    }
}
