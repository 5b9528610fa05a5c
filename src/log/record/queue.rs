//! What waits between the pilot's thread and the recorder's: batches of entries, and the queue that takes them there and
//! back.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed, Ordering::SeqCst};
use std::time::Duration;

use super::channels::Decoded;
use super::pb;
use crate::log_file::LogFile;
use crossbeam_queue::ArrayQueue;
use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;
use haltere_pilot::{LinkId, Recording};

/// Memory of what may wait for the disk, bytes: beyond, batches are lost as if the queue were full.
pub(super) const QUEUE_BYTES: usize = 64 << 20;
/// Batches that are there from the first, with room for what comes between two of them.
pub(super) const READY_BATCHES: usize = 8;
/// So many are kept for use again; what a stall has made beyond is given back.
const KEPT_BATCHES: usize = 64;
/// A batch is handed over when it holds this many entries …
pub(super) const BATCH_ENTRIES: usize = 64;
const READY_ENTRIES: usize = 4 * BATCH_ENTRIES;
const READY_BYTES: usize = 16 << 10;
/// A batch that once held more than this gives the memory back.
const KEPT_BYTES: usize = 64 << 10;

/// One thing to record.
#[derive(Debug)]
pub(super) enum Item {
    Bytes { out: bool, link: LinkId, start: usize, end: usize },
    Event { link: LinkId, kind: pb::link_event::Kind },
    Peer { link: LinkId, address: SocketAddr },
    Lost { link: LinkId, reason: DropReason, count: u64 },
    File { ticket: u32, fault: u8, start: usize, end: usize },
    Calendar { unix_us: i64 },
    EndAsked,
    Recording { state: Recording, start: usize, end: usize },
    Wake,
    Topic(Topic),
    Glue(Decoded),
}

#[derive(Debug, Default)]
pub(super) struct Batch {
    pub hole: Option<pb::Hole>,
    /// With time and sequence number; the latter is 0 for what is not replayed.
    pub items: Vec<(HostTime, u64, Item)>,
    pub bytes: Vec<u8>,
}

impl Batch {
    pub(super) fn ready() -> Self {
        Self {
            hole: None,
            items: Vec::with_capacity(READY_ENTRIES),
            bytes: Vec::with_capacity(READY_BYTES),
        }
    }

    /// Memory of what it holds.
    pub(super) fn size_B(&self) -> usize {
        self.bytes.len() + size_of_val(self.items.as_slice())
    }

    pub(super) fn clear(&mut self) {
        self.hole = None;
        self.items.clear();
        self.bytes.clear();
        self.bytes.shrink_to(KEPT_BYTES);
        self.items.shrink_to(READY_ENTRIES);
    }
}

/// Batches on their way to the recorder's thread and back. Neither end takes a lock, so the pilot's
/// thread is not held up by the other one; and empty batches come back with their memory.
#[derive(Debug)]
pub(super) struct Queue {
    pub full: ArrayQueue<Batch>,
    pub empty: ArrayQueue<Batch>,
    /// Bytes that wait for the disk.
    pub waiting_B: AtomicUsize,
    /// Nothing more will come.
    pub closed: AtomicBool,
    /// The recorder's thread has ended.
    pub deserted: AtomicBool,
    /// Somebody flies, or is about to.
    pub armed: AtomicBool,
    /// Somebody armed, or a station sent a mission or a program: the log is never removed.
    pub eventful: AtomicBool,
    /// How the recording stands, when that has changed.
    pub news: ArrayQueue<(Recording, String)>,
    /// What was written of the log, bytes.
    pub size_B: AtomicU64,
    /// Entries that were left out because the recording had stopped.
    pub unrecorded: AtomicU64,
    /// The log, once it is begun.
    pub file: Arc<LogFile>,
}

impl Queue {
    pub(super) fn new(depth: usize) -> Self {
        let empty = ArrayQueue::new(KEPT_BATCHES);
        for _ in 0..READY_BATCHES.min(depth) {
            let _ = empty.push(Batch::ready());
        }
        Self {
            full: ArrayQueue::new(depth),
            empty,
            waiting_B: AtomicUsize::new(0),
            closed: AtomicBool::new(false),
            deserted: AtomicBool::new(false),
            armed: AtomicBool::new(false),
            eventful: AtomicBool::new(true),
            news: ArrayQueue::new(1),
            size_B: AtomicU64::new(0),
            unrecorded: AtomicU64::new(0),
            file: Arc::default(),
        }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.full.is_empty()
    }

    /// Whether more than half of what may wait waits.
    pub(super) fn is_half_full(&self) -> bool {
        2 * self.full.len() > self.full.capacity() || 2 * self.waiting_B.load(Relaxed) > QUEUE_BYTES
    }

    /// Tells how the recording stands; only the newest counts.
    pub(super) fn tell(&self, state: Recording, why: String) {
        self.news.force_push((state, why));
    }

    /// The next full batch; `Err`: there will be none.
    pub(super) fn take(&self, patience: Duration) -> Result<Option<Batch>, Closed> {
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
pub(super) struct Closed;

/// The hole that swallows `items` too.
pub(super) fn widen(hole: Option<pb::Hole>, items: &[(HostTime, u64, Item)]) -> pb::Hole {
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
