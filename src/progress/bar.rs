//! How far a long task is: a bar on a terminal, a line a second where nobody sees it move.

use std::io::{IsTerminal as _, Write as _};
use std::time::{Duration, Instant};

/// Lines of a task without a terminal come this often.
const SAY_EVERY: Duration = Duration::from_secs(1);
/// The bar is drawn this often.
const DRAW_EVERY: Duration = Duration::from_millis(100);
/// Characters of the bar.
const WIDTH: usize = 24;

/// Says on standard error how far it is and what is left.
pub struct Bar {
    terminal: bool,
    drawn: bool,
    since: Option<(usize, Instant)>,
    said: Option<Instant>,
}

impl Default for Bar {
    fn default() -> Self {
        let terminal = std::io::stderr().is_terminal();
        Self { terminal, drawn: false, since: None, said: None }
    }
}

impl Bar {
    /// `done` of `of`, at `what`.
    pub fn tell(&mut self, done: usize, of: usize, what: &str) {
        let now = Instant::now();
        // A new task counts from nought again.
        if self.since.is_none_or(|(first, _)| done < first) || done == 0 {
            self.since = Some((done, now));
        }
        let every = if self.terminal { DRAW_EVERY } else { SAY_EVERY };
        // What is done within a second needs no line.
        if !self.terminal {
            self.said.get_or_insert(now);
        }
        if self.said.is_some_and(|said| now.duration_since(said) < every) {
            return;
        }
        self.said = Some(now);
        let Some((first, since)) = self.since else { return };
        let spent_s = now.duration_since(since).as_secs_f64();
        let left = match done.saturating_sub(first) {
            0 => String::new(),
            n => format!(", {:.0} s left", spent_s / n as f64 * of.saturating_sub(done) as f64),
        };
        if self.terminal {
            self.drawn = true;
            let full = (WIDTH * done.min(of)).checked_div(of).unwrap_or(0);
            let bar = format!("{}{}", "#".repeat(full), ".".repeat(WIDTH - full));
            let line: String = format!("{done} of {of}{left}: {what}").chars().take(52).collect();
            let mut err = std::io::stderr().lock();
            let _ = write!(err, "\r[{bar}] {line}\x1b[K");
            let _ = err.flush();
        } else {
            tracing::info!("{done} of {of}{left}: {what}");
        }
    }

    /// Takes the bar away, so that what follows begins on a line of its own.
    pub fn clear(&mut self) {
        if std::mem::take(&mut self.drawn) {
            let _ = write!(std::io::stderr().lock(), "\r\x1b[K");
        }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.clear();
    }
}
