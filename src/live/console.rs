//! Lines for people on standard error, and the last words on standard output, without waiting for anybody.
//!
//! A terminal that was stopped (Ctrl-S), or a pipe that nobody reads, holds up whoever writes to it, and a
//! closed one is an error. So lines go through a queue of bounded length to a thread that does nothing but
//! write them; what finds no room is lost, counted, and told where the gap is as soon as somebody reads again.

use std::io::{IsTerminal as _, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::mpsc::sync_channel;
use std::time::Duration;

use tracing_appender::non_blocking::{ErrorCounter, NonBlockingBuilder, WorkerGuard};
use tracing_subscriber::filter::{LevelFilter, Targets};
use tracing_subscriber::fmt::MakeWriter;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

/// Lines that may wait: what is told in many flights, some 200 kB.
const WAITING_LINES: usize = 1024;
/// For the last words people are waited for no longer than this: the vehicle stands and the log is closed.
const PATIENCE: Duration = Duration::from_millis(700);

/// Lines that were lost.
#[derive(Debug)]
struct Losses {
    /// Those that found no room in the queue.
    no_room: OnceLock<ErrorCounter>,
    /// Others: no reader is left, or they did not come so far.
    others: AtomicUsize,
}

impl Losses {
    const fn none() -> Self {
        Self { no_room: OnceLock::new(), others: AtomicUsize::new(0) }
    }

    fn one_more(&self) {
        self.others.fetch_add(1, Relaxed);
    }

    fn count(&self) -> u64 {
        let no_room = self.no_room.get().map_or(0, ErrorCounter::dropped_lines);
        no_room.saturating_add(self.others.load(Relaxed)) as u64
    }
}

/// Of this program, which has one standard error.
static LOSSES: Losses = Losses::none();

/// Lines for people that were lost so far.
pub fn lost_lines() -> u64 {
    LOSSES.count()
}

/// A line was lost on its way here.
pub(super) fn lose_line() {
    LOSSES.one_more();
}

/// The thread that writes them, until it is dropped.
#[derive(Debug)]
pub struct Console(Option<WorkerGuard>);

impl Console {
    /// From now on log lines, and the words of a panic, go this way. `RUST_LOG` chooses what is logged,
    /// everything from `info` up by default.
    pub fn start() -> Self {
        let (lines, guard) = NonBlockingBuilder::default()
            .buffered_lines_limit(WAITING_LINES)
            .lossy(true)
            .thread_name("console")
            .finish(Teller { out: std::io::stderr(), told: 0, losses: &LOSSES });
        let _ = LOSSES.no_room.set(lines.error_counter());
        log_to(lines);
        std::panic::set_hook(Box::new(|panic| {
            let thread = std::thread::current();
            tracing::error!("thread '{}' {panic}", thread.name().unwrap_or("without a name"));
        }));
        Self(Some(guard))
    }
}

impl Drop for Console {
    /// The worker's own guard prints to standard output when it finds its queue full: not on this thread.
    fn drop(&mut self) {
        let guard = self.0.take();
        patiently(move || drop(guard));
    }
}

/// Log lines go there from now on. `RUST_LOG` chooses what is logged, by level and module (`warn,haltere_pilot=debug`).
pub fn log_to<W>(to: W)
where
    W: for<'a> MakeWriter<'a> + Send + Sync + 'static,
{
    let wanted = std::env::var("RUST_LOG").ok().and_then(|text| text.parse().ok());
    let everything = Targets::new().with_default(LevelFilter::INFO);
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(to)
        .with_ansi(std::io::stderr().is_terminal())
        .with_target(false)
        // A reader that went away ends nothing.
        .log_internal_errors(false);
    tracing_subscriber::registry().with(lines).with(wanted.unwrap_or(everything)).init();
}

/// Writes last words. What nobody takes within a moment is given up.
pub fn say_last(mut to: impl Write + Send + 'static, text: String) {
    patiently(move || {
        let _ = to.write_all(text.as_bytes()).and_then(|()| to.flush());
    });
}

/// Does what may be held up for ever, and waits for it for a moment.
fn patiently(job: impl FnOnce() + Send + 'static) {
    let (done, ended) = sync_channel::<()>(1);
    let job = move || {
        job();
        drop(done);
    };
    if std::thread::Builder::new().name("last-words".into()).spawn(job).is_ok() {
        // Disconnected: it is done, or has panicked.
        let _ = ended.recv_timeout(PATIENCE);
    }
}

/// Writes lines, never fails, and tells where some are missing.
struct Teller<W> {
    out: W,
    /// Lost lines that people were told of.
    told: u64,
    losses: &'static Losses,
}

impl<W: Write> Write for Teller<W> {
    fn write(&mut self, line: &[u8]) -> std::io::Result<usize> {
        let lost = self.losses.count();
        let missing = lost.saturating_sub(self.told);
        let gap = if missing > 0 {
            writeln!(self.out, "({missing} lines of this output were lost: nobody read it)")
        } else {
            Ok(())
        };
        match gap.and_then(|()| self.out.write_all(line)) {
            Ok(()) => self.told = lost,
            Err(_) => self.losses.one_more(),
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        let _ = self.out.flush();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;

    /// Takes what is written while it is open, and then fails.
    #[derive(Clone, Default)]
    struct Pipe(Arc<Mutex<(Vec<u8>, bool)>>);

    impl Write for Pipe {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            let mut pipe = self.0.lock().unwrap();
            if pipe.1 {
                return Err(std::io::ErrorKind::BrokenPipe.into());
            }
            pipe.0.extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn prop_a_closed_stream_is_survived_and_the_gap_is_told() {
        let pipe = Pipe::default();
        let losses: &'static Losses = Box::leak(Box::new(Losses::none()));
        let mut teller = Teller { out: pipe.clone(), told: 0, losses };
        teller.write_all(b"one\n").unwrap();
        pipe.0.lock().unwrap().1 = true;
        teller.write_all(b"two\n").unwrap();
        teller.write_all(b"three\n").unwrap();
        assert_eq!(losses.count(), 2);
        pipe.0.lock().unwrap().1 = false;
        teller.write_all(b"four\n").unwrap();
        teller.write_all(b"five\n").unwrap();
        let text = String::from_utf8(pipe.0.lock().unwrap().0.clone()).unwrap();
        let gap = "(2 lines of this output were lost: nobody read it)";
        assert_eq!(text, format!("one\n{gap}\nfour\nfive\n"));
    }

    #[test]
    fn prop_nobody_is_waited_for_for_ever() {
        let began = std::time::Instant::now();
        let (_keep, never) = sync_channel::<()>(0);
        patiently(move || {
            let _ = never.recv();
        });
        assert!((PATIENCE..PATIENCE * 3).contains(&began.elapsed()), "{:?}", began.elapsed());
        patiently(|| panic!("of a test"));
    }
}
