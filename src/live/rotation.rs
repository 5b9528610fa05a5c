//! A long log is followed by another one in the same process, with a core that begins anew.
//!
//! ```text
//! pilot's thread                        thread of logs
//! log is long, nobody flies  ── ask ──► begins a log, makes a core
//! takes over, if still so   ◄── next ──
//!                            ── old ──► closes the log
//! ```
//! Every log replays by itself from its first byte, since nothing that came before it is needed. The pilot's
//! thread waits for neither disk; ports and stations stay.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;

use super::{begin_recording, clock};
use crate::sources::Loaded;
use crate::store::OwnLogs;
use haltere_core::time::HostTime;
use haltere_log::record::{Recorder, RecorderSummary};
use haltere_pilot::{Pilot, PilotConfig};

/// After an attempt that came to nothing it is not tried again for so long, µs: chosen, a minute more in a log of an hour.
const PATIENCE_US: i64 = 60_000_000;

/// A core with its log.
pub(super) struct Pair {
    pub pilot: Pilot,
    pub recorder: Recorder,
}

enum Task {
    /// A core with this configuration is wanted.
    Begin(Box<PilotConfig>),
    /// Its log ends.
    Close(Box<Pair>),
    /// It was not needed after all: nothing is in its log.
    Forget(Box<Pair>),
}

/// The pilot's end.
pub(super) struct Rotation {
    /// A longer log is followed by another one, bytes; `None`: never.
    length_B: Option<u64>,
    tasks: Sender<Task>,
    /// `None`: no log could be begun.
    answers: Receiver<Option<Box<Pair>>>,
    is_asked: bool,
    not_before: HostTime,
}

impl Rotation {
    /// One log, however long.
    pub(super) fn never() -> Self {
        let not_before = HostTime::from_us(0);
        let (tasks, answers) = (channel().0, channel().1);
        Self { length_B: None, tasks, answers, is_asked: false, not_before }
    }

    /// Whether it is time to look for somebody who goes on.
    pub(super) fn is_due(&self, size_B: u64, now: HostTime) -> bool {
        self.length_B.is_some_and(|length_B| size_B > length_B)
            && !self.is_asked
            && now >= self.not_before
    }

    /// Asks for a core with this configuration.
    pub(super) fn ask(&mut self, settings: PilotConfig) {
        self.is_asked = self.tasks.send(Task::Begin(Box::new(settings))).is_ok();
    }

    /// Who goes on, if somebody is there; never waits.
    pub(super) fn next(&mut self, now: HostTime) -> Option<Box<Pair>> {
        let answer = self.answers.try_recv().ok()?;
        self.is_asked = false;
        if answer.is_none() {
            self.not_before = now.offset_us(PATIENCE_US);
        }
        answer
    }

    /// Its place was taken.
    pub(super) fn close(&self, old: Box<Pair>) {
        // Without the thread it ends here.
        let _ = self.tasks.send(Task::Close(old));
    }

    /// Somebody came in between.
    pub(super) fn forget(&mut self, unused: Box<Pair>, now: HostTime) {
        self.not_before = now.offset_us(PATIENCE_US);
        let _ = self.tasks.send(Task::Forget(unused));
    }
}

/// Ends when the pilot's end is gone; what its logs came to, in order.
pub(super) type Thread = JoinHandle<Vec<RecorderSummary>>;

/// Starts the thread.
pub(super) fn start(loaded: &Loaded, own_logs: OwnLogs) -> std::io::Result<(Rotation, Thread)> {
    let (tasks, todo) = channel();
    let (done, answers) = channel();
    let record = &loaded.config.record;
    let length_B =
        (record.enabled && record.rotate_mb > 0.0).then_some(super::bytes(record.rotate_mb * 1e-3));
    let loaded = loaded.clone();
    let thread = std::thread::Builder::new().name("logs".into()).spawn(move || {
        let mut closed = Vec::new();
        for task in todo {
            match task {
                Task::Begin(settings) => {
                    // Nobody hears it: the pilot's thread has ended meanwhile, and so does the log.
                    let _ = done.send(begin(&loaded, *settings, &own_logs).map(Box::new));
                }
                Task::Close(pair) => {
                    let file = pair.recorder.file();
                    closed.push(pair.recorder.finish());
                    own_logs.remove(&file);
                }
                Task::Forget(pair) => {
                    let file = pair.recorder.file();
                    if let Some(log) = pair.recorder.finish().path {
                        let _ = std::fs::remove_file(log);
                    }
                    own_logs.remove(&file);
                }
            }
        }
        closed
    })?;
    let not_before = HostTime::from_us(0);
    Ok((Rotation { length_B, tasks, answers, is_asked: false, not_before }, thread))
}

fn begin(loaded: &Loaded, settings: PilotConfig, own_logs: &OwnLogs) -> Option<Pair> {
    let mut loaded = loaded.clone();
    loaded.config.ground.origin = settings.origin;
    loaded.config.take_over(settings);
    let started = clock::now();
    let recorder = match begin_recording(&loaded, started) {
        Ok(recorder) => recorder,
        Err(error) => {
            tracing::warn!("the log goes on, though it is long: {error}");
            return None;
        }
    };
    // Without room for another one the old one goes on, as far as there is any.
    recorder.path()?;
    own_logs.add(recorder.file());
    let pilot = Pilot::new(loaded.config.pilot(), loaded.survey, started);
    Some(Pair { pilot, recorder })
}
