//! Watch: what the companion knows about its flight, live, for a browser and for Foxglove-type viewers.
//!
//! ```text
//! pilot's thread ─ Feed ─► bounded queue ─► thread "watch": picture ─► WebSocket of pages
//!                                                             └──────► WebSocket of viewers
//! ```
//!
//! The pilot's thread only puts copies of its records into a queue of fixed size and never waits; what
//! finds no room is counted. It does not have to wake anybody either: the other thread looks by itself.
//! Nothing that a client sends changes anything here but what it is sent.

mod anchors;
mod dilution;
mod door;
mod foxglove;
mod http;
mod picture;
mod serve;
pub mod token;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread::JoinHandle;

use crossbeam_queue::ArrayQueue;
use thiserror::Error;
use tokio::net::TcpListener;

use crate::sources::Loaded;
use crate::watch::token::TokenError;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;
use haltere_log::record::GlueState;
use haltere_pilot::settings::Address;

use self::door::Door;
use self::picture::Picture;

/// Records that may wait: over a second of everything. The thread looks each 20 ms.
const QUEUE: usize = 4096;

/// Why the page is not served. The companion does not start then: it was asked for.
#[derive(Debug, Error)]
pub enum WatchError {
    /// Its port cannot be had.
    #[error(
        "watch.address = \"{address}\": cannot listen there: {why}; name another port, or \"\" for no page"
    )]
    Listen {
        /// Which.
        address: Address,
        /// Why.
        why: std::io::Error,
    },
    /// Everybody on the network could look.
    #[error(
        "watch.address = \"{0}\": others than this computer could look; name a file with a token of at least \
         16 characters in watch.token_file, or listen at tcpin:127.0.0.1:PORT"
    )]
    Open(Address),
    /// The token cannot be used.
    #[error("watch.token_file: {0}")]
    Token(#[from] TokenError),
    /// No thread.
    #[error("the system refuses a thread: {0}")]
    System(#[from] std::io::Error),
}

/// Something the pilot's thread tells.
#[derive(Debug)]
enum Item {
    Topic(Topic),
    Glue(GlueState),
    /// Items of the mission that are done, and all of them.
    Mission([u16; 2]),
}

type Told = (HostTime, Item);
/// Of fixed length and without a lock: a reader that is stopped in the middle holds nobody up.
type Queue = Arc<ArrayQueue<Told>>;

/// The pilot's end. Never waits, and asks for no memory but for texts and changes of mode.
#[derive(Debug, Default)]
pub struct Feed {
    queue: Option<Queue>,
    lost: Arc<AtomicU64>,
}

impl Feed {
    /// Nobody looks.
    pub fn off() -> Self {
        Self::default()
    }

    /// One whose queue nobody but [`Feed::forget`] empties: for measuring what it costs.
    pub fn unserved() -> Self {
        Self { queue: Some(Arc::new(ArrayQueue::new(QUEUE))), lost: Arc::default() }
    }

    /// Empties the queue.
    pub fn forget(&mut self) {
        while self.queue.as_ref().is_some_and(|queue| queue.pop().is_some()) {}
    }

    /// A record of the core.
    pub fn topic(&mut self, at: HostTime, topic: &Topic) {
        if self.queue.is_some() {
            self.put(at, Item::Topic(topic.clone()));
        }
    }

    /// State of the glue.
    pub fn glue(&mut self, at: HostTime, state: &GlueState) {
        if self.queue.is_some() {
            self.put(at, Item::Glue(*state));
        }
    }

    /// How far the mission is: items done, and all of them.
    pub fn mission(&mut self, at: HostTime, progress: [u16; 2]) {
        if self.queue.is_some() {
            self.put(at, Item::Mission(progress));
        }
    }

    /// Records that found no room, so far.
    pub fn lost(&self) -> u64 {
        self.lost.load(Relaxed)
    }

    fn put(&mut self, at: HostTime, item: Item) {
        let Some(queue) = &self.queue else { return };
        if queue.push((at, item)).is_err() {
            self.lost.fetch_add(1, Relaxed);
        }
    }
}

/// A page that is ready to be served.
#[derive(Debug)]
pub struct Watch {
    listener: TcpListener,
    told: Queue,
    door: Door,
    picture: Picture,
    lost: Arc<AtomicU64>,
    /// From host time to the calendar, µs.
    unix_from_host_us: i64,
}

impl Watch {
    /// Opens the port; `None` where the configuration wants no page. `unix_from_host_us` is added to a host
    /// time to give the time since 1970.
    pub async fn open(
        loaded: &Loaded,
        unix_from_host_us: i64,
    ) -> Result<Option<(Self, Feed)>, WatchError> {
        let config = &loaded.config.watch;
        let Some(address) = config.address.get() else { return Ok(None) };
        let Address::TcpIn(at) = address else { return Ok(None) };
        let token = token::token(config)?;
        let refused = |why: std::io::Error| WatchError::Listen { address: address.clone(), why };
        let listener = TcpListener::bind((at.host.as_str(), at.port)).await.map_err(refused)?;
        let bound = listener.local_addr().map_err(refused)?;
        if token.is_none() && !bound.ip().is_loopback() {
            return Err(WatchError::Open(address.clone()));
        }
        let door = Door::new(token, &config.origins);
        tracing::info!("watch the flight at http://{bound}/{}", door.hint());
        let told: Queue = Arc::new(ArrayQueue::new(QUEUE));
        let lost = Arc::<AtomicU64>::default();
        let picture = Picture::new(&loaded.config.pilot(), &loaded.survey);
        let queue = Some(told.clone());
        let watch = Self { listener, told, door, picture, lost: lost.clone(), unix_from_host_us };
        Ok(Some((watch, Feed { queue, lost })))
    }

    /// Serves on a thread of its own until the flag is set.
    pub fn start(self, ends: Arc<AtomicBool>) -> Result<JoinHandle<()>, WatchError> {
        // A socket belongs to the runtime that it was made in: it is handed over bare.
        let Self { listener, told, door, picture, lost, unix_from_host_us } = self;
        let listener = listener.into_std()?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let thread = std::thread::Builder::new().name("watch".into()).spawn(move || {
            let served = serve::Served { told, door, picture, lost, unix_from_host_us, ends };
            runtime.block_on(serve::serve(listener, served));
        })?;
        Ok(thread)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_the_feed_never_waits_and_counts_what_finds_no_room() {
        let mut feed = Feed::unserved();
        let topic = Topic::Estimate(picture::tests::blank());
        // Nobody takes anything out.
        for n in 0..QUEUE as u64 + 100 {
            feed.topic(HostTime::from_us(n), &topic);
        }
        assert_eq!(feed.lost(), 100);
        feed.forget();
        feed.topic(HostTime::from_us(0), &topic);
        assert_eq!(feed.lost(), 100);
        Feed::off().topic(HostTime::from_us(0), &topic);
    }
}
