//! The way of bytes from the pilot's thread to a link.
//!
//! The pilot's end takes no lock and does not allocate: a ring of fixed length, and a pipe of the kernel
//! as the bell that wakes whoever writes the link, be that a thread or a task.

use std::net::SocketAddr;
use std::os::fd::{BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::time::{Duration, Instant};

use crossbeam_queue::ArrayQueue;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::pipe::{PipeFlags, pipe_with};
use tokio::net::unix::pipe;

use super::inbox::Inbox;
use super::pool::Chunk;
use super::shared::Waits;
use haltere_core::drops::DropReason;
use haltere_pilot::LinkId;

/// Bytes for a link.
#[derive(Debug)]
pub(super) struct Outgoing {
    pub link: LinkId,
    /// Who is meant, on a link of many ends. `None`: all of them.
    pub to: Option<SocketAddr>,
    pub bytes: Chunk,
    /// Counts it among what waits for the link.
    pub _waits: Waits,
}

/// Why a piece was not taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Refused {
    /// The link is slower than what is sent on it.
    Full,
    /// Nobody serves the link.
    Gone,
}

#[derive(Debug)]
struct Ring {
    queue: ArrayQueue<Outgoing>,
    bell: OwnedFd,
    /// One of the ends is gone.
    closed: AtomicBool,
}

impl Ring {
    fn ring(&self) {
        // A full pipe refuses: it has rung thousands of times unheard, once more says nothing new.
        let _ = rustix::io::write(&self.bell, &[0]);
    }
}

/// A ring for so many pieces.
pub(super) fn mailbox(capacity: usize) -> std::io::Result<(Slot, Mailbox)> {
    let (ear, bell) = pipe_with(PipeFlags::CLOEXEC | PipeFlags::NONBLOCK)?;
    let ring = Ring { queue: ArrayQueue::new(capacity.max(1)), bell, closed: false.into() };
    let ring = Arc::new(ring);
    let end = Arc::new(LastSlot(ring.clone()));
    Ok((Slot { ring: ring.clone(), _end: end }, Mailbox { ring, ear: Ear::Own(ear) }))
}

/// Where bytes are put in; never waits.
#[derive(Debug, Clone)]
pub(super) struct Slot {
    ring: Arc<Ring>,
    _end: Arc<LastSlot>,
}

/// Closes the ring when the last slot is gone.
#[derive(Debug)]
struct LastSlot(Arc<Ring>);

impl Drop for LastSlot {
    fn drop(&mut self) {
        self.0.closed.store(true, SeqCst);
        self.0.ring();
    }
}

impl Slot {
    /// Puts a piece in.
    pub(super) fn put(&self, outgoing: Outgoing) -> Result<(), Refused> {
        if self.ring.closed.load(SeqCst) {
            return Err(Refused::Gone);
        }
        self.ring.queue.push(outgoing).map_err(|_| Refused::Full)?;
        self.ring.ring();
        Ok(())
    }
}

/// Where they are taken out.
#[derive(Debug)]
pub(super) struct Mailbox {
    ring: Arc<Ring>,
    ear: Ear,
}

/// The end of the pipe that hears the bell.
#[derive(Debug)]
enum Ear {
    /// Of a thread that waits by itself.
    Own(OwnedFd),
    /// Of a runtime.
    Runtime(pipe::Receiver),
    /// The runtime did not take it.
    Deaf,
}

impl Mailbox {
    /// The next piece, if there is one. `None` in `Ok`: not yet.
    pub(super) fn try_take(&mut self) -> Result<Option<Outgoing>, Refused> {
        // Looked at first: what was put in before the end is still delivered.
        let closed = self.ring.closed.load(SeqCst);
        match self.ring.queue.pop() {
            None if closed => Err(Refused::Gone),
            piece => Ok(piece),
        }
    }

    /// The next piece; `None`: the last slot is gone. Nothing is lost when the future is dropped.
    pub(super) async fn recv(&mut self) -> Option<Outgoing> {
        loop {
            if let Some(piece) = self.try_take().ok()? {
                return Some(piece);
            }
            match std::mem::replace(&mut self.ear, Ear::Deaf) {
                Ear::Own(fd) => {
                    self.ear = pipe::Receiver::from_owned_fd(fd).map_or(Ear::Deaf, Ear::Runtime);
                }
                other => self.ear = other,
            }
            if let Ear::Runtime(bell) = &self.ear
                && bell.readable().await.is_ok()
            {
                let _ = bell.try_read(&mut [0; MOST_RINGS]);
            } else {
                tokio::time::sleep(LOOK).await;
            }
        }
    }

    /// Waits until a piece was put in or `other` can be read, but not for long; whether it can be read.
    pub(super) fn wait_or(&mut self, other: BorrowedFd<'_>) -> bool {
        let Ear::Own(bell) = &self.ear else {
            std::thread::sleep(LOOK);
            return true;
        };
        let patience = Timespec::try_from(PATIENCE).unwrap_or_default();
        let mut ends =
            [PollFd::from_borrowed_fd(other, PollFlags::IN), PollFd::new(bell, PollFlags::IN)];
        let _ = poll(&mut ends, Some(&patience));
        let [other, rung] = ends.map(|end| !end.revents().is_empty());
        if rung {
            let _ = rustix::io::read(bell, &mut [0; MOST_RINGS]);
        }
        other
    }

    /// What is due until then is of no use later. `false`: nothing comes any more, or the companion ends.
    pub(super) fn lose(&mut self, inbox: &Inbox, until: Instant) -> bool {
        while !inbox.stopped() && Instant::now() < until {
            match self.try_take() {
                Ok(Some(_)) => inbox.lost(DropReason::LinkWriteFailed),
                Ok(None) => {
                    self.wait_for(PATIENCE.min(until.saturating_duration_since(Instant::now())))
                }
                Err(_) => return false,
            }
        }
        !inbox.stopped()
    }

    /// Waits until a piece was put in, at most so long.
    pub(super) fn wait_for(&mut self, patience: Duration) {
        let Ear::Own(bell) = &self.ear else { return std::thread::sleep(patience) };
        let patience = Timespec::try_from(patience).unwrap_or_default();
        let _ = poll(&mut [PollFd::new(bell, PollFlags::IN)], Some(&patience));
        let _ = rustix::io::read(bell, &mut [0; MOST_RINGS]);
    }

    /// The next piece, for a thread that waits for nothing else; `None`: the last slot is gone.
    pub(super) fn wait(&mut self) -> Option<Outgoing> {
        loop {
            if let Some(piece) = self.try_take().ok()? {
                return Some(piece);
            }
            self.wait_for(if matches!(self.ear, Ear::Own(_)) { PATIENCE } else { LOOK });
        }
    }
}

impl Drop for Mailbox {
    fn drop(&mut self) {
        self.ring.closed.store(true, SeqCst);
    }
}

/// How often a ring is looked at that cannot be heard.
const LOOK: Duration = Duration::from_millis(1);
/// Longest wait without looking.
const PATIENCE: Duration = Duration::from_millis(100);

/// Rings that are heard at once.
const MOST_RINGS: usize = 256;

#[cfg(test)]
mod tests {
    use super::super::pool::Pool;
    use super::*;

    fn piece(pool: &Pool, n: u32) -> Outgoing {
        let bytes = pool.lend(&n.to_le_bytes()).unwrap();
        let waits = Waits::new(&Default::default(), LinkId::Board);
        Outgoing { link: LinkId::Board, to: None, bytes, _waits: waits }
    }

    fn number(piece: &Outgoing) -> u32 {
        u32::from_le_bytes((*piece.bytes).try_into().unwrap())
    }

    #[test]
    fn prop_a_thread_gets_everything_in_order_and_then_the_end() {
        let pool = Pool::new(64, 64, 4);
        let (slot, mut mailbox) = mailbox(8).unwrap();
        let reader = std::thread::spawn(move || {
            std::iter::from_fn(|| mailbox.wait()).map(|p| number(&p)).collect::<Vec<_>>()
        });
        for n in 0..10_000 {
            while slot.put(piece(&pool, n)) == Err(Refused::Full) {
                std::thread::yield_now();
            }
        }
        drop(slot);
        assert!(reader.join().unwrap().into_iter().eq(0..10_000));
    }

    #[test]
    fn prop_a_task_gets_everything_in_order_and_then_the_end() {
        let pool = Pool::new(64, 64, 4);
        let (slot, mut mailbox) = mailbox(8).unwrap();
        let writer = std::thread::spawn(move || {
            for n in 0..10_000 {
                while slot.put(piece(&pool, n)) == Err(Refused::Full) {
                    std::thread::yield_now();
                }
            }
        });
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let seen = runtime.block_on(async {
            let mut seen = Vec::new();
            // A future that is given up now and then loses nothing.
            loop {
                tokio::select! {
                    biased;
                    piece = mailbox.recv() => match piece {
                        Some(piece) => seen.push(number(&piece)),
                        None => return seen,
                    },
                    () = tokio::task::yield_now() => {}
                }
            }
        });
        writer.join().unwrap();
        assert!(seen.into_iter().eq(0..10_000));
    }

    #[test]
    fn prop_a_full_or_deserted_ring_refuses() {
        let pool = Pool::new(8, 8, 4);
        let (slot, mut mailbox) = mailbox(2).unwrap();
        assert!(matches!(mailbox.try_take(), Ok(None)));
        assert_eq!(slot.put(piece(&pool, 1)), Ok(()));
        assert_eq!(slot.clone().put(piece(&pool, 2)), Ok(()));
        assert_eq!(slot.put(piece(&pool, 3)), Err(Refused::Full));
        assert_eq!(mailbox.try_take().unwrap().map(|p| number(&p)), Some(1));
        drop(mailbox);
        assert_eq!(slot.put(piece(&pool, 4)), Err(Refused::Gone));
    }
}
