//! A progress bar with the time left, on standard error.

use std::io::{IsTerminal as _, Write as _};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Width of the bar, characters.
const WIDTH: u64 = 30;

/// How far a job is. Any thread may advance it.
pub struct Progress {
    unit: &'static str,
    start: Instant,
    before: u64,
    due: u64,
    done: AtomicU64,
    shown: bool,
    /// Whether somebody sees the bar move; else a line a tenth is told.
    terminal: bool,
}

impl Progress {
    /// `before` is done already and `due` is left to do, both counted in `unit`.
    pub fn new(unit: &'static str, before: u64, due: u64) -> Self {
        let (start, terminal) = (Instant::now(), std::io::stderr().is_terminal());
        Self { unit, start, before, due, done: AtomicU64::new(0), shown: true, terminal }
    }

    /// The same without a line, for tests.
    pub fn silent(due: u64) -> Self {
        Self { shown: false, ..Self::new("", 0, due) }
    }

    /// So much more is done.
    pub fn advance(&self, amount: u64) {
        let done = self.done.fetch_add(amount, Ordering::Relaxed) + amount;
        if !self.shown {
            return;
        }
        let left = self.due.saturating_sub(done) as f64;
        let left_s = self.start.elapsed().as_secs_f64() / (done as f64).max(1.0) * left;
        let (now, total) = (self.before + done, self.before + self.due);
        let filled = (WIDTH * now / total.max(1)).min(WIDTH);
        if !self.terminal {
            let tenth = |done: u64| 10 * (self.before + done) / total.max(1);
            if tenth(done) != tenth(done - amount) {
                let line = format!("{now}/{total} {}, {left_s:.0} s left\n", self.unit);
                let _ = std::io::stderr().write_all(line.as_bytes());
            }
            return;
        }
        let bar = "#".repeat(filled as usize) + &".".repeat((WIDTH - filled) as usize);
        let line = format!(
            "\r[{bar}] {now}/{total} {}, {:.0}:{:02.0} left ",
            self.unit,
            (left_s / 60.0).floor(),
            (left_s % 60.0).floor()
        );
        let _ = std::io::stderr().write_all(line.as_bytes());
    }

    /// So much is done altogether.
    pub fn reach(&self, done: u64) {
        let more = done.saturating_sub(self.done.load(Ordering::Relaxed));
        if more > 0 {
            self.advance(more);
        }
    }

    /// What was done so far.
    pub fn done(&self) -> u64 {
        self.done.load(Ordering::Relaxed)
    }

    /// Ends the line.
    pub fn end(&self) {
        if self.due > 0 && self.shown && self.terminal {
            eprintln!();
        }
    }

    /// Time since the start, s.
    pub fn seconds(&self) -> f64 {
        self.start.elapsed().as_secs_f64()
    }
}
