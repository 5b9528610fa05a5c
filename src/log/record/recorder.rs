//! The recorder as the pilot's thread sees it: takes everything, never waits.
//!
//! Entries are gathered in a batch; [`Recorder::commit`] hands it to the recorder's thread through
//! a bounded queue. When that queue is full (the disk stalls) the batch is thrown away, counted,
//! and the hole is written into the log, so that a replay can say where it ends to be exact.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed, Ordering::SeqCst};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use crossbeam_queue::ArrayQueue;
use mcap::McapError;

use super::channels::{self, Decoded};
use super::convert::decoded_from_topic;
use super::pb;
use super::session::Session;
use super::writer::{LogWriter, RecordError};
use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;
use haltere_pilot::{Input, LinkId};

/// Batches that may wait for the disk. With [`BATCH_ENTRIES`] entries each and some 1500 entries/s
/// this rides out a stall of the disk of about 20 s, in about 5 MB.
const QUEUE_BATCHES: usize = 512;

/// Bytes of links that may wait for the disk, when a station sends as much as it may: beyond, batches are
/// lost as if the queue were full. A flight brings 100 kB/s.
const QUEUE_BYTES: usize = 64 << 20;
/// Batches that are there from the first, with room for what comes between two of them.
const READY_BATCHES: usize = 8;
const READY_ENTRIES: usize = 4 * BATCH_ENTRIES;
const READY_BYTES: usize = 16 << 10;
/// A batch that once held more than this gives the memory back.
const KEPT_BYTES: usize = 64 << 10;

/// A batch is handed over when it holds this many entries …
const BATCH_ENTRIES: usize = 64;
/// … or when its first entry is this old, µs.
const BATCH_AGE_US: i64 = 20_000;

/// How long lockstep waits for the disk before it looks again.
const WAIT_FOR_ROOM: Duration = Duration::from_micros(200);

/// Period of flush and sync: what a power cut may cost.
const PERSIST_PERIOD: Duration = Duration::from_secs(1);

/// One thing to record.
#[derive(Debug)]
enum Item {
    Bytes { out: bool, link: LinkId, start: usize, end: usize },
    Event { link: LinkId, kind: pb::link_event::Kind },
    Peer { link: LinkId, address: SocketAddr },
    Lost { link: LinkId, reason: DropReason, count: u64 },
    File { ticket: u32, fault: u8, start: usize, end: usize },
    Calendar { unix_us: i64 },
    EndAsked,
    Wake,
    Topic(Topic),
    Glue(Decoded),
}

#[derive(Debug, Default)]
struct Batch {
    hole: Option<pb::Hole>,
    /// With time and sequence number; the latter is 0 for what is not replayed.
    items: Vec<(HostTime, u64, Item)>,
    bytes: Vec<u8>,
}

impl Batch {
    fn ready() -> Self {
        Self {
            hole: None,
            items: Vec::with_capacity(READY_ENTRIES),
            bytes: Vec::with_capacity(READY_BYTES),
        }
    }

    fn clear(&mut self) {
        self.hole = None;
        self.items.clear();
        self.bytes.clear();
        self.bytes.shrink_to(KEPT_BYTES);
        self.items.shrink_to(READY_ENTRIES);
    }
}

/// State of the glue around the core, for the log.
#[derive(Debug, Clone, Copy, Default)]
pub struct GlueState {
    /// Wake-ups so far.
    pub wake_ups: u64,
    /// Wake-ups later than half a control period.
    pub late_wake_ups: u64,
    /// Largest lateness of a wake-up, s.
    pub worst_lateness_s: f64,
}

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
    path: Option<PathBuf>,
    queue: Option<Arc<Queue>>,
    thread: Option<JoinHandle<Ended>>,
    batch: Batch,
    hole: Option<pb::Hole>,
    sequence: u64,
    lost: u64,
    /// Whether a full queue is waited for instead of dropped into.
    waits: bool,
}

/// Batches on their way to the recorder's thread and back. Neither end takes a lock, so the pilot's
/// thread is not held up by the other one; and empty batches come back with their memory.
#[derive(Debug)]
struct Queue {
    full: ArrayQueue<Batch>,
    empty: ArrayQueue<Batch>,
    /// Bytes that wait for the disk.
    waiting_B: AtomicUsize,
    /// Nothing more will come.
    closed: AtomicBool,
    /// The recorder's thread has ended.
    deserted: AtomicBool,
}

impl Queue {
    fn new(depth: usize) -> Self {
        let empty = ArrayQueue::new(depth + 2);
        for _ in 0..READY_BATCHES.min(depth) {
            let _ = empty.push(Batch::ready());
        }
        Self {
            full: ArrayQueue::new(depth),
            empty,
            waiting_B: AtomicUsize::new(0),
            closed: AtomicBool::new(false),
            deserted: AtomicBool::new(false),
        }
    }

    /// The next full batch; `Err`: there will be none.
    fn take(&self, patience: Duration) -> Result<Option<Batch>, Closed> {
        // Looked at first: what was put in before the end is still written.
        let closed = self.closed.load(SeqCst);
        if let Some(batch) = self.full.pop() {
            return Ok(Some(batch));
        }
        if closed {
            return Err(Closed);
        }
        std::thread::park_timeout(patience);
        Ok(self.full.pop())
    }
}

/// The recording is over.
struct Closed;

/// Says so even when the thread ends by a panic.
struct Deserts<'a>(&'a Queue);

impl Drop for Deserts<'_> {
    fn drop(&mut self) {
        self.0.deserted.store(true, SeqCst);
    }
}

#[derive(Debug, Default)]
struct Ended {
    lost: u64,
    error: Option<RecordError>,
}

impl Recorder {
    /// Begins a log in `directory`.
    pub fn start(directory: &Path, session: &Session) -> Result<Self, RecordError> {
        Self::spawn(LogWriter::create(directory, session)?, QUEUE_BATCHES)
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
            path: None,
            queue: None,
            thread: None,
            batch: Batch::default(),
            hole: None,
            sequence: 0,
            lost: 0,
            waits: false,
        }
    }

    pub(super) fn spawn<W: std::io::Write + std::io::Seek + Send + 'static>(
        log: LogWriter<W>,
        depth: usize,
    ) -> Result<Self, RecordError> {
        let path = log.path().to_owned();
        let queue = Arc::new(Queue::new(depth));
        let batches = queue.clone();
        let thread = std::thread::Builder::new()
            .name("recorder".into())
            .spawn(move || write_all(log, &batches))
            .map_err(RecordError::Thread)?;
        let mut recorder = Self::off();
        recorder.path = Some(path);
        recorder.queue = Some(queue);
        recorder.thread = Some(thread);
        recorder.batch = Batch::ready();
        Ok(recorder)
    }

    /// The log that is being written.
    pub fn path(&self) -> Option<&Path> {
        self.path.as_deref()
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
        if let Some(queue) = self.queue.take() {
            let mut last = std::mem::take(&mut self.batch);
            last.hole = self.hole.take();
            queue.waiting_B.fetch_add(last.bytes.len(), Relaxed);
            // Nothing is flying any more: waiting is right.
            let _ = self.put_waiting(&queue, last);
            queue.closed.store(true, SeqCst);
            self.wake();
        }
        let ended = self.thread.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        RecorderSummary {
            path: self.path.take(),
            lost_entries: self.lost.saturating_add(ended.lost),
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
        let bytes = batch.bytes.len();
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

/// The hole that swallows `items` too.
fn widen(hole: Option<pb::Hole>, items: &[(HostTime, u64, Item)]) -> pb::Hole {
    let mut hole = hole.unwrap_or_else(|| pb::Hole {
        from_us: items.first().map_or(0, |(at, ..)| at.as_us()),
        ..pb::Hole::default()
    });
    for (at, sequence, _) in items {
        hole.to_us = hole.to_us.max(at.as_us());
        if *sequence == 0 {
            hole.lost_topics += 1;
        } else {
            if hole.first_sequence == 0 {
                hole.first_sequence = *sequence;
            }
            hole.last_sequence = *sequence;
            hole.lost_raw += 1;
        }
    }
    hole
}

/// Body of the recorder's thread. After a failure it goes on emptying the queue, and counts.
fn write_all<W: std::io::Write + std::io::Seek>(log: LogWriter<W>, queue: &Queue) -> Ended {
    let _deserts = Deserts(queue);
    let mut ended = Ended::default();
    let mut log = Some(log);
    let mut last = Tail::default();
    let mut persisted = Instant::now();
    loop {
        let wait = PERSIST_PERIOD.saturating_sub(persisted.elapsed());
        let Ok(batch) = queue.take(wait) else { break };
        let due = persisted.elapsed() >= PERSIST_PERIOD;
        if due {
            persisted = Instant::now();
        }
        if let Some(open) = &mut log {
            let written = match &batch {
                Some(batch) => write_batch(open, batch, &mut last),
                None => Ok(()),
            }
            .and_then(|()| if due { open.persist() } else { Ok(()) });
            if let Err(error) = written {
                let error = open.error(&error);
                tracing::error!("{error}");
                ended.error = Some(error);
                ended.lost = ended.lost.saturating_add(entries(batch.as_ref()));
                log = None;
            }
        } else {
            ended.lost = ended.lost.saturating_add(entries(batch.as_ref()));
        }
        if let Some(mut batch) = batch {
            queue.waiting_B.fetch_sub(batch.bytes.len(), Relaxed);
            batch.clear();
            let _ = queue.empty.push(batch);
        }
    }
    if let Some(mut open) = log {
        let path = open.path().to_owned();
        let closing = pb::Closing {
            host_time_us: last.at.as_us(),
            last_sequence: last.sequence,
            lost_entries: last.lost,
        };
        let closed = open.put(channels::CLOSING, last.at, 0, &closing).and_then(|()| open.finish());
        if let Err(error) = closed {
            let error = RecordError::Write { path, reason: error.to_string() };
            tracing::error!("{error}");
            ended.error = Some(error);
        }
    }
    ended
}

/// Where the log ends.
#[derive(Debug, Default)]
struct Tail {
    at: HostTime,
    sequence: u64,
    lost: u64,
}

fn entries(batch: Option<&Batch>) -> u64 {
    batch.map_or(0, |batch| batch.items.len() as u64)
}

fn write_batch<W: std::io::Write + std::io::Seek>(
    log: &mut LogWriter<W>,
    batch: &Batch,
    last: &mut Tail,
) -> Result<(), McapError> {
    if let Some(hole) = &batch.hole {
        last.lost += hole.lost_raw + hole.lost_topics;
        last.sequence = last.sequence.max(hole.last_sequence);
        last.at = last.at.max(HostTime::from_us(hole.to_us));
        log.put(channels::HOLE, HostTime::from_us(hole.to_us), 0, hole)?;
    }
    for (at, sequence, item) in &batch.items {
        let (at, sequence, host_time_us) = (*at, *sequence, at.as_us());
        last.at = last.at.max(at);
        last.sequence = last.sequence.max(sequence);
        match item {
            Item::Bytes { out, link, start, end } => {
                let bytes = batch.bytes.get(*start..*end).unwrap_or_default();
                log.raw(*out, *link, at, sequence, bytes)?;
            }
            Item::Event { link, kind } => {
                let message = pb::LinkEvent {
                    sequence,
                    host_time_us,
                    link: u32::from(link.number()),
                    kind: (*kind).into(),
                };
                log.put(channels::EVENT, at, sequence, &message)?;
            }
            Item::Peer { link, address } => {
                let message = pb::LinkPeer {
                    sequence,
                    host_time_us,
                    link: u32::from(link.number()),
                    address: address.to_string(),
                };
                log.put(channels::PEER, at, sequence, &message)?;
            }
            Item::Lost { link, reason, count } => {
                let message = pb::Lost {
                    sequence,
                    host_time_us,
                    link: u32::from(link.number()),
                    reason: reason.name().to_owned(),
                    count: *count,
                };
                log.put(channels::LOST, at, sequence, &message)?;
            }
            Item::File { ticket, fault, start, end } => {
                let data = batch.bytes.get(*start..*end).unwrap_or_default().to_vec();
                let message = pb::FileAnswer {
                    sequence,
                    host_time_us,
                    ticket: *ticket,
                    fault: u32::from(*fault),
                    data,
                };
                log.put(channels::FILE, at, sequence, &message)?;
            }
            Item::Calendar { unix_us } => {
                let message = pb::Calendar { sequence, host_time_us, unix_us: *unix_us };
                log.put(channels::CALENDAR, at, sequence, &message)?;
            }
            Item::EndAsked => {
                let message = pb::EndAsked { sequence, host_time_us };
                log.put(channels::END_ASKED, at, sequence, &message)?;
            }
            Item::Wake => {
                log.put(channels::WAKE, at, sequence, &pb::Wake { sequence, host_time_us })?;
            }
            Item::Topic(topic) => log.decoded(&decoded_from_topic(topic))?,
            Item::Glue(glue) => log.decoded(glue)?,
        }
    }
    Ok(())
}
