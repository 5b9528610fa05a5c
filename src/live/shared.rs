//! What all threads share: whether to end, what waits for each link, and what got lost around the core.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering::Relaxed};

use haltere_core::drops::DropReason;
use haltere_pilot::{LinkId, MOST_GROUND_LINKS};

/// Chunks that may wait for a link: half a second of setpoints, several of telemetry.
pub(super) const OUTPUT_QUEUE_CHUNKS: usize = 64;
/// With more than this waiting a link counts as full: what can wait is then not put in, and 24 frames of
/// services and the telemetry of 0.2 s still find room.
const FULL_CHUNKS: usize = OUTPUT_QUEUE_CHUNKS / 4;

/// Reasons that occur outside of the core.
const REASONS: [DropReason; 15] = [
    DropReason::InputQueueFull,
    DropReason::OutputQueueFull,
    DropReason::LinkWriteFailed,
    DropReason::MavWrongPeer,
    DropReason::StationsFull,
    DropReason::MavGarbageByte,
    DropReason::MavBadChecksum,
    DropReason::MavUndecodable,
    DropReason::MavIncompatible,
    DropReason::MavUnsigned,
    DropReason::MavBadSignature,
    DropReason::MavReplayed,
    DropReason::MavStaleTime,
    DropReason::SigningSetup,
    DropReason::RateLimited,
];

/// Links that can exist: tag, board, and as many stations as the core takes.
pub(super) const MOST_LINKS: usize = 2 + MOST_GROUND_LINKS;

/// State that all threads share.
#[derive(Debug)]
pub(super) struct Shared {
    stop: AtomicBool,
    /// Rounds of the pilot's thread, each with a wake-up of the core.
    steps: AtomicU64,
    drops: [[AtomicU64; REASONS.len()]; MOST_LINKS],
    /// Pieces that wait for each link, in whatever queue.
    waiting: [AtomicUsize; MOST_LINKS],
}

impl Default for Shared {
    fn default() -> Self {
        Self {
            stop: AtomicBool::new(false),
            steps: AtomicU64::new(0),
            drops: [const { [const { AtomicU64::new(0) }; REASONS.len()] }; MOST_LINKS],
            waiting: [const { AtomicUsize::new(0) }; MOST_LINKS],
        }
    }
}

/// A piece's part of what waits for its link, given back when the piece has left or is lost.
#[derive(Debug)]
pub(super) struct Waits {
    shared: Arc<Shared>,
    link: LinkId,
}

impl Waits {
    pub(super) fn new(shared: &Arc<Shared>, link: LinkId) -> Self {
        if let Some(waiting) = shared.waiting.get(usize::from(link.number())) {
            waiting.fetch_add(1, Relaxed);
        }
        Self { shared: shared.clone(), link }
    }
}

impl Drop for Waits {
    fn drop(&mut self) {
        if let Some(waiting) = self.shared.waiting.get(usize::from(self.link.number())) {
            waiting.fetch_sub(1, Relaxed);
        }
    }
}

impl Shared {
    /// Whether more waits for a link than it takes.
    pub(super) fn is_full(&self, link: LinkId) -> bool {
        let waiting = self.waiting.get(usize::from(link.number()));
        waiting.is_some_and(|waiting| waiting.load(Relaxed) > FULL_CHUNKS)
    }

    /// Asks every thread to end.
    pub(super) fn stop(&self) {
        self.stop.store(true, Relaxed);
    }

    pub(super) fn stopped(&self) -> bool {
        self.stop.load(Relaxed)
    }

    /// The pilot's thread has made a round.
    pub(super) fn step(&self) {
        self.steps.fetch_add(1, Relaxed);
    }

    /// Rounds that the pilot's thread has made.
    pub(super) fn steps(&self) -> u64 {
        self.steps.load(Relaxed)
    }

    /// Counts losses.
    pub(super) fn lost_many(&self, link: LinkId, reason: DropReason, n: u64) {
        let slot = REASONS.iter().position(|r| *r == reason);
        let row = self.drops.get(usize::from(link.number()));
        if let Some(count) = slot.and_then(|slot| row?.get(slot)) {
            count.fetch_add(n, Relaxed);
        }
    }

    /// Counts one loss.
    pub(super) fn lost(&self, link: LinkId, reason: DropReason) {
        self.lost_many(link, reason, 1);
    }

    /// Every loss that occurred, with its count so far.
    pub(super) fn losses(&self) -> impl Iterator<Item = (LinkId, DropReason, u64)> + '_ {
        let of_row = |(link, row): (u8, &'_ [AtomicU64; REASONS.len()])| {
            let counts: [u64; REASONS.len()] = std::array::from_fn(|n| row[n].load(Relaxed));
            REASONS.into_iter().zip(counts).map(move |(r, n)| (LinkId::from_number(link), r, n))
        };
        (0..).zip(&self.drops).flat_map(of_row).filter(|(.., n)| *n > 0)
    }
}
