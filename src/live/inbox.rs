//! The way of bytes from a link to the pilot's thread, and counters of what got lost around it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use super::clock;
use crate::drops::DropReason;
use crate::pilot::{LinkId, MOST_GROUND_LINKS};
use crate::time::HostTime;

/// Chunks of input that may wait for the pilot's thread: over a second of everything.
const INPUT_QUEUE_CHUNKS: usize = 4096;

/// Chunks that may wait for a link: half a second of setpoints, several of telemetry.
pub(super) const OUTPUT_QUEUE_CHUNKS: usize = 64;

/// Reasons that occur outside of the core.
const REASONS: [DropReason; 5] = [
    DropReason::InputQueueFull,
    DropReason::OutputQueueFull,
    DropReason::LinkWriteFailed,
    DropReason::MavWrongPeer,
    DropReason::StationsFull,
];

/// Links that can exist: tag, board, and as many stations as the core takes.
const MOST_LINKS: usize = 2 + MOST_GROUND_LINKS;

/// Bytes for a link.
#[derive(Debug)]
pub(super) struct Outgoing {
    pub link: LinkId,
    pub bytes: Vec<u8>,
}

/// State that all threads share.
#[derive(Debug)]
pub(super) struct Shared {
    stop: AtomicBool,
    drops: [[AtomicU64; REASONS.len()]; MOST_LINKS],
}

impl Default for Shared {
    fn default() -> Self {
        Self {
            stop: AtomicBool::new(false),
            drops: [const { [const { AtomicU64::new(0) }; REASONS.len()] }; MOST_LINKS],
        }
    }
}

impl Shared {
    /// Asks every thread to end.
    pub(super) fn stop(&self) {
        self.stop.store(true, Relaxed);
    }

    pub(super) fn stopped(&self) -> bool {
        self.stop.load(Relaxed)
    }

    /// Counts one loss.
    pub(super) fn lost(&self, link: LinkId, reason: DropReason) {
        let slot = REASONS.iter().position(|r| *r == reason);
        let row = self.drops.get(usize::from(link.number()));
        if let Some(count) = slot.and_then(|slot| row?.get(slot)) {
            count.fetch_add(1, Relaxed);
        }
    }

    /// Every loss that can occur, with its count so far.
    pub(super) fn losses(&self) -> impl Iterator<Item = (LinkId, DropReason, u64)> + '_ {
        (0..).zip(&self.drops).flat_map(|(link, row)| {
            REASONS
                .iter()
                .zip(row)
                .map(move |(reason, n)| (LinkId::from_number(link), *reason, n.load(Relaxed)))
        })
    }
}

/// Something that came from a link.
#[derive(Debug)]
pub(super) struct Arrival {
    pub at: HostTime,
    pub link: LinkId,
    pub what: What,
}

#[derive(Debug)]
pub(super) enum What {
    Bytes(Vec<u8>),
    Up,
    Down,
}

/// One link's entrance to the pilot's thread.
#[derive(Debug, Clone)]
pub(super) struct Inbox {
    link: LinkId,
    queue: SyncSender<Arrival>,
    shared: Arc<Shared>,
}

/// The queue to the pilot's thread.
pub(super) fn input_queue() -> (SyncSender<Arrival>, Receiver<Arrival>) {
    sync_channel(INPUT_QUEUE_CHUNKS)
}

impl Inbox {
    pub(super) fn new(link: LinkId, queue: SyncSender<Arrival>, shared: Arc<Shared>) -> Self {
        Self { link, queue, shared }
    }

    pub(super) fn link(&self) -> LinkId {
        self.link
    }

    pub(super) fn stopped(&self) -> bool {
        self.shared.stopped()
    }

    /// Bytes that were read at `at`. Newest lost when the queue is full.
    pub(super) fn bytes(&self, at: HostTime, bytes: &[u8]) {
        let arrival = Arrival { at, link: self.link, what: What::Bytes(bytes.to_vec()) };
        if let Err(TrySendError::Full(_)) = self.queue.try_send(arrival) {
            self.lost(DropReason::InputQueueFull);
        }
    }

    /// The link is open. Waits for room: this must not be lost.
    pub(super) fn up(&self) {
        let _ = self.queue.send(Arrival { at: clock::now(), link: self.link, what: What::Up });
    }

    /// The link is closed. Waits for room: this must not be lost.
    pub(super) fn down(&self) {
        let _ = self.queue.send(Arrival { at: clock::now(), link: self.link, what: What::Down });
    }

    pub(super) fn lost(&self, reason: DropReason) {
        self.shared.lost(self.link, reason);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_full_queue_is_counted_and_does_not_wait() {
        let shared = Arc::new(Shared::default());
        let (queue, arrivals) = sync_channel(2);
        let inbox = Inbox::new(LinkId::Ground(1), queue, shared.clone());
        for n in 0..5 {
            inbox.bytes(HostTime::from_us(n), &[n as u8]);
        }
        let losses: Vec<_> = shared.losses().filter(|(.., count)| *count > 0).collect();
        assert_eq!(losses, [(LinkId::Ground(1), DropReason::InputQueueFull, 3)]);
        let kept: Vec<_> = arrivals.try_iter().map(|a| a.at.as_us()).collect();
        assert_eq!(kept, [0, 1]);
    }
}
