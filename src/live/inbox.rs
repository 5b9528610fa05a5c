//! The way of bytes from a link to the pilot's thread, and counters of what got lost around it.
//!
//! Tag and board have a queue of their own: whatever stations send, it cannot take its room. And of
//! their queue each station has a share, so that one cannot take that of another.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

use super::clock;
use super::doors::Gate;
use super::pool::{Chunk, Pool};
use super::shared::{MOST_LINKS, Shared};
use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_pilot::{LinkId, MOST_GROUND_LINKS};

/// Chunks of tag and board that may wait for the pilot's thread: over a second of everything.
const DEVICE_CHUNKS: usize = 4096;
/// Of one of them, bytes: a hundred times what comes in a second.
const DEVICE_BYTES: usize = 4 << 20;
/// Chunks of one station that may wait, and their bytes: hundreds of commands.
const STATION_CHUNKS: usize = 128;
const STATION_BYTES: usize = 256 << 10;
/// Room for what is not bytes: links that open and close.
const EVENTS: usize = 512;
/// Buffers that are there from the first, and their bytes: more than come in a control period, each for
/// a read of a serial line.
const READY_CHUNKS: usize = 64;
const READY_BYTES: usize = 2048;

/// Something that came from a link.
#[derive(Debug)]
pub(super) struct Arrival {
    /// Address of the sender, on a link of many ends.
    pub from: Option<SocketAddr>,
    pub at: HostTime,
    pub link: LinkId,
    pub what: What,
}

#[derive(Debug)]
pub(super) enum What {
    Bytes(Chunk, Share),
    Up,
    Down,
}

/// What a link has in its queue.
#[derive(Debug, Default)]
struct Waiting {
    chunks: AtomicUsize,
    bytes: AtomicUsize,
}

/// A chunk's part of it, given back when the chunk is taken out.
#[derive(Debug)]
pub(super) struct Share {
    waiting: Arc<Waiting>,
    bytes: usize,
}

impl Share {
    /// `None`: this link has its share in the queue already.
    fn of(waiting: &Arc<Waiting>, most: (usize, usize), bytes: usize) -> Option<Self> {
        // One thread puts in for a link; another one takes out, which only makes room.
        let chunks = waiting.chunks.load(Relaxed);
        let held = waiting.bytes.load(Relaxed);
        if chunks >= most.0 || held.saturating_add(bytes) > most.1 {
            return None;
        }
        waiting.chunks.fetch_add(1, Relaxed);
        waiting.bytes.fetch_add(bytes, Relaxed);
        Some(Self { waiting: waiting.clone(), bytes })
    }
}

impl Drop for Share {
    fn drop(&mut self) {
        self.waiting.chunks.fetch_sub(1, Relaxed);
        self.waiting.bytes.fetch_sub(self.bytes, Relaxed);
    }
}

/// The ends of the queues where links put in.
#[derive(Debug, Clone)]
pub(super) struct Entrance {
    devices: SyncSender<Arrival>,
    stations: SyncSender<Arrival>,
    pool: Pool,
}

/// The ends where the pilot's thread takes out.
#[derive(Debug)]
pub(super) struct Arrivals {
    /// Of tag and board.
    pub devices: Receiver<Arrival>,
    /// Of stations.
    pub stations: Receiver<Arrival>,
}

/// The queues to the pilot's thread.
pub(super) fn input_queues() -> (Entrance, Arrivals) {
    let most = (2 * DEVICE_CHUNKS + EVENTS, STATION_CHUNKS * MOST_GROUND_LINKS + EVENTS);
    let (devices, from_devices) = sync_channel(most.0);
    let (stations, from_stations) = sync_channel(most.1);
    let pool = Pool::new(READY_CHUNKS, most.0 + most.1 + MOST_LINKS, READY_BYTES);
    let entrance = Entrance { devices, stations, pool };
    (entrance, Arrivals { devices: from_devices, stations: from_stations })
}

/// One link's entrance to the pilot's thread.
#[derive(Debug, Clone)]
pub(super) struct Inbox {
    link: LinkId,
    queue: SyncSender<Arrival>,
    pool: Pool,
    waiting: Arc<Waiting>,
    gate: Option<Arc<Gate>>,
    shared: Arc<Shared>,
}

impl Inbox {
    pub(super) fn new(
        link: LinkId,
        entrance: &Entrance,
        gate: Option<Arc<Gate>>,
        shared: Arc<Shared>,
    ) -> Self {
        let queue = match link {
            LinkId::Tag | LinkId::Board => entrance.devices.clone(),
            LinkId::Ground(_) => entrance.stations.clone(),
        };
        let pool = entrance.pool.clone();
        Self { link, queue, pool, waiting: Arc::default(), gate, shared }
    }

    pub(super) fn link(&self) -> LinkId {
        self.link
    }

    pub(super) fn stopped(&self) -> bool {
        self.shared.stopped()
    }

    /// Bytes that were read at `at`. What may not pass, or finds no room, is lost and counted.
    /// `false`: nothing passed.
    pub(super) fn bytes(&self, at: HostTime, bytes: &[u8]) -> bool {
        self.bytes_from(at, None, bytes)
    }

    /// The same from one of many ends.
    pub(super) fn bytes_from(&self, at: HostTime, from: Option<SocketAddr>, bytes: &[u8]) -> bool {
        let mut chunk = self.pool.make();
        match &self.gate {
            Some(gate) => gate.admit(self.link, at, bytes, chunk.buffer(), &self.shared),
            None => chunk.buffer().extend_from_slice(bytes),
        }
        if chunk.is_empty() {
            return false;
        }
        let most = match self.link {
            LinkId::Tag | LinkId::Board => (DEVICE_CHUNKS, DEVICE_BYTES),
            LinkId::Ground(_) => (STATION_CHUNKS, STATION_BYTES),
        };
        let Some(share) = Share::of(&self.waiting, most, chunk.len()) else {
            self.lost(DropReason::InputQueueFull);
            return true;
        };
        let arrival = Arrival { from, at, link: self.link, what: What::Bytes(chunk, share) };
        if let Err(TrySendError::Full(_)) = self.queue.try_send(arrival) {
            self.lost(DropReason::InputQueueFull);
        }
        true
    }

    /// Whether a stranger with these bytes may have this link. If not, that is counted.
    pub(super) fn would_open(&self, bytes: &[u8]) -> bool {
        let opens = self.gate.as_ref().map_or(Ok(()), |gate| gate.would_open(bytes));
        if let Err(reason) = opens {
            self.lost(reason);
        }
        opens.is_ok()
    }

    /// Whether nobody comes in without a signature.
    pub(super) fn is_shut(&self) -> bool {
        self.gate.as_ref().is_some_and(|gate| gate.is_shut())
    }

    /// A frame as it goes out on this link.
    pub(super) fn seal(&self, mut frame: Chunk) -> Chunk {
        if let Some(gate) = &self.gate {
            gate.seal(self.link, frame.buffer());
        }
        frame
    }

    /// The link is open. Waits for room: this must not be lost.
    pub(super) fn up(&self) {
        if let Some(gate) = &self.gate {
            gate.reopen();
        }
        self.event(What::Up);
    }

    /// The link is closed. Waits for room: this must not be lost.
    pub(super) fn down(&self) {
        self.event(What::Down);
    }

    fn event(&self, what: What) {
        let _ = self.queue.send(Arrival { from: None, at: clock::now(), link: self.link, what });
    }

    pub(super) fn lost(&self, reason: DropReason) {
        self.shared.lost(self.link, reason);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn inbox(link: LinkId, entrance: &Entrance, shared: &Arc<Shared>) -> Inbox {
        Inbox::new(link, entrance, None, shared.clone())
    }

    #[test]
    fn prop_one_station_cannot_take_the_room_of_others() {
        let shared = Arc::new(Shared::default());
        let (entrance, arrivals) = input_queues();
        let hostile = inbox(LinkId::Ground(1), &entrance, &shared);
        for n in 0..100_000 {
            hostile.bytes(HostTime::from_us(n), &[1]);
        }
        let quiet = inbox(LinkId::Ground(0), &entrance, &shared);
        let tag = inbox(LinkId::Tag, &entrance, &shared);
        assert!(quiet.bytes(HostTime::from_us(7), &[2]) && tag.bytes(HostTime::from_us(8), &[3]));
        let losses: Vec<_> = shared.losses().collect();
        let lost = 100_000 - STATION_CHUNKS as u64;
        assert_eq!(losses, [(LinkId::Ground(1), DropReason::InputQueueFull, lost)]);
        assert_eq!(arrivals.devices.try_iter().count(), 1);
        // What is taken out makes room again.
        assert_eq!(arrivals.stations.try_iter().count(), STATION_CHUNKS + 1);
        assert!(hostile.bytes(HostTime::from_us(9), &[4]));
        assert_eq!(arrivals.stations.try_iter().count(), 1);
    }

    #[test]
    fn prop_large_chunks_are_bounded_by_their_bytes() {
        let shared = Arc::new(Shared::default());
        let (entrance, arrivals) = input_queues();
        let hostile = inbox(LinkId::Ground(3), &entrance, &shared);
        for n in 0..100 {
            hostile.bytes(HostTime::from_us(n), &[0; 60_000]);
        }
        let held: usize = arrivals
            .stations
            .try_iter()
            .map(|arrival| match arrival.what {
                What::Bytes(bytes, _) => bytes.len(),
                What::Up | What::Down => 0,
            })
            .sum();
        assert!(held <= STATION_BYTES, "{held}");
    }

    #[test]
    fn prop_every_station_and_device_at_its_bound_fits_the_queues() {
        let shared = Arc::new(Shared::default());
        let (entrance, _arrivals) = input_queues();
        let links = (0..MOST_GROUND_LINKS as u8).map(LinkId::Ground);
        for link in links.chain([LinkId::Tag, LinkId::Board]) {
            let inbox = inbox(link, &entrance, &shared);
            for _ in 0..DEVICE_CHUNKS {
                inbox.bytes(HostTime::from_us(0), &[0]);
            }
            // Must not wait, nor be lost.
            inbox.up();
            inbox.down();
        }
        assert!(shared.losses().all(|(link, ..)| matches!(link, LinkId::Ground(_))));
    }
}
