//! The recorder as the pilot's thread sees it: takes everything, never waits.
//!
//! Entries are gathered in a batch; [`Recorder::commit`] hands it to the recorder's thread through
//! a bounded queue. When that queue is full (the disk stalls) the batch is thrown away, counted,
//! and the hole is written into the log, so that a replay can say where it ends to be exact.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering::{Relaxed, SeqCst};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::channels::{Decoded, GlueState};
use super::pb;
use super::queue::{BATCH_ENTRIES, Batch, Item, QUEUE_BYTES, Queue, READY_BATCHES, widen};
use super::room::{Limits, Room};
use super::scribe::{Disk, Ended, write_all};
use super::session::Session;
use super::writer::{LogWriter, RecordError};
use crate::log_file::LogFile;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;
use haltere_pilot::{Input, LinkId, Recording};

/// Batches that may wait for the disk: one each 20 ms ([`BATCH_AGE_US`]), so that it may stall for 80 s.
const QUEUE_BATCHES: usize = 4096;

/// A batch that is not full is handed over when its first entry is this old, µs.
const BATCH_AGE_US: i64 = 20_000;

/// How long the beginning of a log is waited for.
const WAIT_FOR_BEGINNING: Duration = Duration::from_secs(1);
/// How long lockstep waits for the disk before it looks again.
const WAIT_FOR_ROOM: Duration = Duration::from_micros(200);

/// What a recording came to.
#[derive(Debug)]
pub struct RecorderSummary {
    /// The log; `None` when recording was off.
    pub path: Option<PathBuf>,
    /// Entries that are not in the log.
    pub lost_entries: u64,
    /// Why recording ended early.
    pub error: Option<RecordError>,
}

/// Takes everything, never waits.
#[derive(Debug)]
pub struct Recorder {
    file: Arc<LogFile>,
    queue: Option<Arc<Queue>>,
    thread: Option<JoinHandle<Ended>>,
    batch: Batch,
    hole: Option<pb::Hole>,
    sequence: u64,
    lost: u64,
    /// Whether a full queue is waited for instead of dropped into.
    waits: bool,
    /// How the recorder's thread says that the recording stands.
    stands: (Recording, String),
    /// Entries are lost because the disk is behind; until half of the queue is free again.
    is_behind: bool,
}

impl Recorder {
    /// Begins a log in `directory`.
    pub fn start(directory: &Path, session: &Session) -> Result<Self, RecordError> {
        Self::spawn(LogWriter::create(directory, session)?, QUEUE_BATCHES)
    }

    /// Begins a log that leaves room on the disk: where there is none it is begun later, and where there is no more it
    /// stops, until there is some ([`Self::news`] tells). A disk that takes its time is not waited for longer than
    /// people wait for a prompt.
    pub fn within(
        limits: Limits,
        directory: &Path,
        session: &Session,
    ) -> Result<Self, RecordError> {
        let (folder, head) = (directory.to_owned(), session.clone());
        let place = folder.clone();
        let disk = Disk {
            log: None,
            begin: Box::new(move || LogWriter::create(&folder, &head)),
            room: Box::new(move || Room::of(&place)),
            folder: directory.to_owned(),
            limits,
        };
        let recorder = Self::spawn_on(disk, QUEUE_BATCHES)?;
        if let Some(queue) = &recorder.queue {
            // Until somebody says that it is.
            queue.eventful.store(false, Relaxed);
            let began = Instant::now();
            while queue.news.is_empty() && began.elapsed() < WAIT_FOR_BEGINNING {
                std::thread::sleep(WAIT_FOR_ROOM);
            }
        }
        Ok(recorder)
    }

    /// Begins a log whose recorder waits for the disk instead of dropping: for lockstep, which runs
    /// faster than any disk queue and has no deadline to miss.
    pub fn start_waiting(directory: &Path, session: &Session) -> Result<Self, RecordError> {
        let mut recorder = Self::start(directory, session)?;
        recorder.waits = true;
        Ok(recorder)
    }

    /// A recorder that forgets everything.
    pub fn off() -> Self {
        Self {
            file: Arc::default(),
            queue: None,
            thread: None,
            batch: Batch::default(),
            hole: None,
            sequence: 0,
            lost: 0,
            waits: false,
            stands: (Recording::Off, String::new()),
            is_behind: false,
        }
    }

    pub(super) fn spawn<W: std::io::Write + std::io::Seek + Send + 'static>(
        log: LogWriter<W>,
        depth: usize,
    ) -> Result<Self, RecordError> {
        Self::spawn_on(Disk::of(log), depth)
    }

    pub(super) fn spawn_on<W: std::io::Write + std::io::Seek + Send + 'static>(
        disk: Disk<W>,
        depth: usize,
    ) -> Result<Self, RecordError> {
        let queue = Arc::new(Queue::new(depth));
        if let Some(log) = &disk.log {
            queue.file.begin(log.path());
        }
        let batches = queue.clone();
        let thread = std::thread::Builder::new()
            .name("recorder".into())
            .spawn(move || write_all(disk, &batches))
            .map_err(RecordError::Thread)?;
        let mut recorder = Self::off();
        recorder.file = queue.file.clone();
        recorder.queue = Some(queue);
        recorder.thread = Some(thread);
        recorder.batch = Batch::ready();
        Ok(recorder)
    }

    /// How the recording stands, with the reason if it does not run, once whenever that has changed; never waits.
    /// That the disk is behind is seen at this end: the recorder's thread hangs in the write that does not come back.
    pub fn news(&mut self) -> Option<(Recording, String)> {
        let queue = self.queue.as_ref()?;
        let told = queue.news.pop();
        let is_behind = self.hole.is_some() || (self.is_behind && queue.is_half_full());
        let has_turned = std::mem::replace(&mut self.is_behind, is_behind) != is_behind;
        if told.is_none() && !has_turned {
            return None;
        }
        let missing = self.lost.saturating_add(queue.unrecorded.load(Relaxed));
        self.stands = told.unwrap_or_else(|| self.stands.clone());
        Some(match &self.stands {
            _ if is_behind => (
                Recording::Stopped,
                match self.path() {
                    Some(path) => format!("{}: the disk does not keep up", path.display()),
                    None => "the disk does not begin one".to_owned(),
                },
            ),
            (Recording::Runs, _) if missing > 0 => {
                (Recording::Runs, format!("{missing} entries are missing"))
            }
            stands => stands.clone(),
        })
    }

    /// Whether somebody flies, or is about to: then the reserve is for him.
    pub fn set_armed(&self, armed: bool) {
        if let Some(queue) = &self.queue {
            queue.armed.store(armed, Relaxed);
            if armed {
                queue.eventful.store(true, Relaxed);
            }
        }
    }

    /// The log holds something that is wanted for good, a flight or a program.
    pub fn set_eventful(&self) {
        if let Some(queue) = &self.queue {
            queue.eventful.store(true, Relaxed);
        }
    }

    /// Entries that were left out because the recording had stopped, so far.
    pub fn unrecorded(&self) -> u64 {
        self.queue.as_ref().map_or(0, |queue| queue.unrecorded.load(Relaxed))
    }

    /// How long the log has become, bytes.
    pub fn size_B(&self) -> u64 {
        self.queue.as_ref().map_or(0, |queue| queue.size_B.load(Relaxed))
    }

    /// The log, for who asks later: it may be begun later.
    pub fn file(&self) -> Arc<LogFile> {
        self.file.clone()
    }

    /// The log that is being written.
    pub fn path(&self) -> Option<&Path> {
        self.file.path()
    }

    /// An event as handed to the core, in order.
    pub fn input(&mut self, at: HostTime, input: Input<'_>) {
        match input {
            Input::Bytes { link, bytes } => self.bytes(at, false, link, bytes),
            Input::LinkUp { link } => {
                self.raw(at, Item::Event { link, kind: pb::link_event::Kind::Up });
            }
            Input::LinkDown { link } => {
                self.raw(at, Item::Event { link, kind: pb::link_event::Kind::Down });
            }
            Input::Backlog { link, is_full } => {
                use pb::link_event::Kind;
                let kind = if is_full { Kind::Full } else { Kind::Room };
                self.raw(at, Item::Event { link, kind });
            }
            Input::Peer { link, address } => self.raw(at, Item::Peer { link, address }),
            Input::Lost { link, reason, count } => {
                self.raw(at, Item::Lost { link, reason, count });
            }
            Input::File { ticket, result, bytes } => {
                if self.queue.is_none() {
                    return;
                }
                let start = self.batch.bytes.len();
                self.batch.bytes.extend_from_slice(bytes);
                let end = self.batch.bytes.len();
                let fault = result.err().map_or(0, |fault| fault as u8);
                self.raw(at, Item::File { ticket, fault, start, end });
            }
            Input::Calendar { unix_us } => self.raw(at, Item::Calendar { unix_us }),
            Input::Recording { state, why } => {
                let start = self.batch.bytes.len();
                if self.queue.is_some() {
                    self.batch.bytes.extend_from_slice(why.as_bytes());
                }
                let end = self.batch.bytes.len();
                self.raw(at, Item::Recording { state, start, end });
            }
            Input::EndAsked => self.raw(at, Item::EndAsked),
            Input::Wake => self.raw(at, Item::Wake),
        }
    }

    /// Bytes that the core sent, in order.
    pub fn output(&mut self, at: HostTime, link: LinkId, bytes: &[u8]) {
        self.bytes(at, true, link, bytes);
    }

    /// A decoded record. `at` is the time of the wake-up that yielded it.
    pub fn topic(&mut self, at: HostTime, topic: Topic) {
        self.push(at, 0, Item::Topic(topic));
    }

    /// A record that is decoded already, of another log.
    pub fn decoded(&mut self, at: HostTime, decoded: Decoded) {
        self.push(at, 0, Item::Glue(decoded));
    }

    /// State of the glue.
    pub fn glue(&mut self, at: HostTime, state: &GlueState) {
        self.push(at, 0, Item::Glue(Decoded::from_glue(at, state)));
    }

    /// Waits until the recorder's thread has caught up, as it has between two control steps.
    pub fn settle(&self) {
        let Some(queue) = &self.queue else { return };
        let behind = || !queue.full.is_empty() || queue.empty.len() + 1 < READY_BATCHES;
        while behind() && !queue.deserted.load(SeqCst) {
            std::thread::sleep(WAIT_FOR_ROOM);
        }
    }

    /// Entries that the queue had no room for, so far.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Hands over what has gathered, if it is worth it.
    pub fn commit(&mut self, now: HostTime) {
        let Some((first, ..)) = self.batch.items.first() else { return };
        if self.batch.items.len() >= BATCH_ENTRIES || now >= first.offset_us(BATCH_AGE_US) {
            self.hand_over();
        }
    }

    /// Ends the recording and waits until it is on disk.
    pub fn finish(mut self) -> RecorderSummary {
        self.end()
    }

    fn end(&mut self) -> RecorderSummary {
        let queue = self.queue.take();
        if let Some(queue) = &queue {
            let mut last = std::mem::take(&mut self.batch);
            last.hole = self.hole.take();
            queue.waiting_B.fetch_add(last.size_B(), Relaxed);
            // Nothing is flying any more: waiting is right.
            let _ = self.put_waiting(queue, last);
            queue.closed.store(true, SeqCst);
            self.wake();
        }
        let ended = self.thread.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        let unrecorded = queue.map_or(0, |queue| queue.unrecorded.load(Relaxed));
        RecorderSummary {
            path: self.path().map(Path::to_owned),
            lost_entries: self.lost.saturating_add(unrecorded),
            error: ended.error,
        }
    }

    fn bytes(&mut self, at: HostTime, out: bool, link: LinkId, bytes: &[u8]) {
        if self.queue.is_none() {
            return;
        }
        let start = self.batch.bytes.len();
        self.batch.bytes.extend_from_slice(bytes);
        let end = self.batch.bytes.len();
        self.raw(at, Item::Bytes { out, link, start, end });
    }

    fn raw(&mut self, at: HostTime, item: Item) {
        self.sequence += 1;
        self.push(at, self.sequence, item);
    }

    fn push(&mut self, at: HostTime, sequence: u64, item: Item) {
        if self.queue.is_some() {
            self.batch.items.push((at, sequence, item));
        }
    }

    fn hand_over(&mut self) {
        let Some(queue) = self.queue.clone() else { return };
        let next = queue.empty.pop().unwrap_or_default();
        let mut batch = std::mem::replace(&mut self.batch, next);
        batch.hole = self.hole.take();
        let bytes = batch.size_B();
        let waiting_B = queue.waiting_B.fetch_add(bytes, Relaxed).saturating_add(bytes);
        let sent = if queue.deserted.load(SeqCst) || (!self.waits && waiting_B > QUEUE_BYTES) {
            Err(batch)
        } else if self.waits {
            self.put_waiting(&queue, batch)
        } else {
            queue.full.push(batch)
        };
        match sent {
            Ok(()) => self.wake(),
            Err(batch) => {
                queue.waiting_B.fetch_sub(bytes, Relaxed);
                self.hole = Some(widen(batch.hole, &batch.items));
                self.lost = self.lost.saturating_add(batch.items.len() as u64);
                // Its memory goes on being used.
                let mut spare = batch;
                spare.clear();
                if self.batch.items.capacity() == 0 {
                    self.batch = spare;
                } else {
                    let _ = queue.empty.push(spare);
                }
            }
        }
    }

    /// Waits for room. `Err`: nobody will make any.
    fn put_waiting(&self, queue: &Queue, mut batch: Batch) -> Result<(), Batch> {
        loop {
            batch = match queue.full.push(batch) {
                Ok(()) => return Ok(()),
                Err(batch) if queue.deserted.load(SeqCst) => return Err(batch),
                Err(batch) => batch,
            };
            self.wake();
            std::thread::sleep(WAIT_FOR_ROOM);
        }
    }

    /// A call of the kernel, no lock: the thread may be asleep.
    fn wake(&self) {
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        self.end();
    }
}
