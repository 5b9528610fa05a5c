//! A line of progress for tasks that say with every step how many there are.

use std::io::{IsTerminal as _, Write as _};
use std::time::Instant;

use super::plan;

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
        plan::begin(what);
        Self { what, started: Instant::now(), terminal }
    }

    /// Done, of how many.
    pub fn at(&self, done: usize, of: usize) {
        let elapsed_s = self.started.elapsed().as_secs_f64();
        let left_s = elapsed_s * of.saturating_sub(done) as f64 / done.max(1) as f64;
        let plan::Place { number, usual_s } = plan::place(self.what);
        let left = match usual_s {
            Some([usual_s, after_s]) => {
                let own_s = if done == 0 { usual_s } else { left_s };
                format!("{:.0} s left in all", own_s + after_s)
            }
            None => format!("{left_s:.0} s left"),
        };
        let line = format!("{number}{}: {done} of {of}, {left}", self.what);
        let mut err = std::io::stderr().lock();
        let step = (of / 10).max(1);
        if self.terminal {
            // Taken away when it is over: what follows begins on a line of its own.
            let shown = if done == of { String::new() } else { line };
            let _ = write!(err, "\r{shown}\x1b[K");
            let _ = err.flush();
        } else if done.is_multiple_of(step) || done == of {
            let _ = writeln!(err, "{line}");
        }
    }
}
