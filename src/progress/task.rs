//! How far one task is: a bar that is written over on a terminal, a line for each tenth where nobody sees a bar move.

use std::io::{IsTerminal as _, Write as _};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::plan;

/// Bar, then the words, as far as the terminal is wide.
const LOOK: &str = "[{bar:24}] {wide_msg}";

/// What is done within this time needs no line.
const SOON: Duration = Duration::from_secs(1);

/// Progress of a task, on standard error. Any thread may advance it; it is taken away when it is dropped, so that what
/// follows begins on a line of its own.
pub struct Progress {
    what: &'static str,
    started: Instant,
    /// What an earlier run had done: it says nothing of the speed.
    before: u64,
    total: AtomicU64,
    done: AtomicU64,
    /// Tenths that have been told where there is no terminal.
    told: AtomicU64,
    shown: Shown,
}

enum Shown {
    Bar(ProgressBar),
    Lines,
    Nothing,
}

impl Progress {
    /// A task that says with every step how many there are ([`Self::at`]). `what` stands before the figures, and names its
    /// stage in a plan.
    pub fn new(what: &'static str) -> Self {
        plan::begin(what);
        let shown = if std::io::stderr().is_terminal() {
            let bar = ProgressBar::new(0);
            if let Ok(style) = ProgressStyle::with_template(LOOK) {
                bar.set_style(style.progress_chars("##."));
            }
            Shown::Bar(bar)
        } else {
            Shown::Lines
        };
        Self::with(what, shown)
    }

    fn with(what: &'static str, shown: Shown) -> Self {
        let [total, done, told] = [0; 3].map(AtomicU64::new);
        Self { what, started: Instant::now(), before: 0, total, done, told, shown }
    }

    /// A task of which `before` steps are done already and `due` are left to do ([`Self::advance`]).
    pub fn counted(what: &'static str, before: u64, due: u64) -> Self {
        let mut progress = Self::new(what);
        progress.before = before;
        progress.total.store(before + due, Ordering::Relaxed);
        progress
    }

    /// The same without a word, for tests.
    pub fn silent() -> Self {
        Self::with("", Shown::Nothing)
    }

    /// Done, of how many.
    pub fn at(&self, done: usize, of: usize) {
        self.total.store(of as u64, Ordering::Relaxed);
        self.done.store(done as u64, Ordering::Relaxed);
        self.show("");
    }

    /// The same, and what is being done now.
    pub fn doing(&self, done: usize, of: usize, now: &str) {
        self.total.store(of as u64, Ordering::Relaxed);
        self.done.store(done as u64, Ordering::Relaxed);
        self.show(now);
    }

    /// So many steps more are done.
    pub fn advance(&self, steps: u64) {
        self.done.fetch_add(steps, Ordering::Relaxed);
        self.show("");
    }

    /// So many steps are done altogether in this run.
    pub fn reach(&self, done: u64) {
        if self.done.fetch_max(done, Ordering::Relaxed) < done {
            self.show("");
        }
    }

    /// Steps done in this run.
    pub fn done(&self) -> u64 {
        self.done.load(Ordering::Relaxed)
    }

    /// Time since the start, s.
    pub fn seconds(&self) -> f64 {
        self.started.elapsed().as_secs_f64()
    }

    /// Prints a line on standard output, above the bar.
    pub fn print(&self, line: &str) -> std::io::Result<()> {
        let print = || writeln!(std::io::stdout().lock(), "{line}");
        match &self.shown {
            Shown::Bar(bar) => bar.suspend(print),
            Shown::Lines | Shown::Nothing => print(),
        }
    }

    /// Takes the bar away.
    pub fn end(&self) {
        if let Shown::Bar(bar) = &self.shown {
            bar.finish_and_clear();
        }
    }

    fn show(&self, now: &str) {
        let (here, total) = (self.before + self.done(), self.total.load(Ordering::Relaxed));
        match &self.shown {
            Shown::Nothing => {}
            Shown::Bar(bar) => {
                bar.set_length(total);
                bar.set_position(here);
                bar.set_message(self.words(now));
            }
            Shown::Lines if self.started.elapsed() < SOON => {}
            Shown::Lines => {
                let tenth = 10 * here / total.max(1);
                if self.told.fetch_max(tenth, Ordering::Relaxed) < tenth {
                    let line = self.words(now) + "\n";
                    let _ = std::io::stderr().write_all(line.as_bytes());
                }
            }
        }
    }

    fn words(&self, now: &str) -> String {
        let (done, total) = (self.done(), self.total.load(Ordering::Relaxed));
        let here = self.before + done;
        let own_s =
            (done > 0).then(|| self.seconds() / done as f64 * total.saturating_sub(here) as f64);
        let share = here as f64 / total.max(1) as f64;
        let plan::Place { number, left_s, first } = plan::place(self.what, share);
        let left = match (left_s, own_s) {
            (Some(left_s), _) if first => {
                format!(", {left_s:.0} s left in all if nothing of it was done before")
            }
            (Some(left_s), _) => format!(", {left_s:.0} s left in all"),
            (None, Some(own_s)) => format!(", {own_s:.0} s left"),
            (None, None) => String::new(),
        };
        let now = if now.is_empty() { String::new() } else { format!(" ({now})") };
        format!("{number}{}: {here} of {total}{left}{now}", self.what)
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_the_words_count_what_an_earlier_run_has_done() {
        let mut task = Progress::with("flights", Shown::Nothing);
        task.before = 30;
        task.total.store(40, Ordering::Relaxed);
        assert_eq!(task.words(""), "flights: 30 of 40");
        task.advance(10);
        assert_eq!(task.words("the last"), "flights: 40 of 40, 0 s left (the last)");
        task.reach(5);
        assert_eq!(task.done(), 10, "never back");
    }
}
