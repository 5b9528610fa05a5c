//! One link to a ground station: who is there, what it streams, its counters.

use haltere_dialect::mav_stream::MavSplitter;

use haltere_core::time::HostTime;

use super::endpoint::Endpoint;
use super::shown::Turns;
use super::streams::Streams;
use super::unheard::Addressees;
use crate::input::LinkId;
use crate::out::events::SEQUENCE_ID;

/// Peers on one link whose sequence numbers are followed.
const MOST_PEERS: usize = 16;

/// What went over a link since its station came.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct LinkCounts {
    pub received: u64,
    pub lost: u64,
    pub sent: u64,
    pub routed: u64,
    pub received_B: u64,
    pub sent_B: u64,
}

/// Somebody who was heard on a link.
#[derive(Debug, Clone, Copy)]
struct Peer {
    address: (u8, u8),
    sequence: u8,
}

/// State of a link.
#[derive(Debug)]
pub(crate) struct GroundLink {
    pub link: LinkId,
    /// What it was configured as, and its number in the configuration.
    pub endpoint: Endpoint,
    pub endpoint_number: u8,
    /// Whether more waits for it than it takes: what can wait does.
    pub is_full: bool,
    pub splitter: MavSplitter,
    pub streams: Streams,
    pub counts: LinkCounts,
    /// When bytes last came.
    pub heard_at: HostTime,
    /// Whose turn it is, and what the station was told.
    pub turns: Turns,
    /// Whom its stations speak to.
    pub addressees: Addressees,
    /// Who was heard, for loss accounting and routing. Bounded: the oldest is forgotten.
    peers: Vec<Peer>,
}

impl GroundLink {
    pub fn new(link: LinkId, endpoint: Endpoint, endpoint_number: u8, at: HostTime) -> Self {
        Self {
            link,
            endpoint,
            endpoint_number,
            is_full: false,
            splitter: MavSplitter::new(),
            streams: Streams::new(&endpoint, at),
            counts: LinkCounts::default(),
            heard_at: at,
            turns: Turns::default(),
            addressees: Addressees::default(),
            peers: Vec::new(),
        }
    }

    /// Whoever speaks from now on begins anew, with streams of its own.
    pub fn begin_anew(&mut self, at: HostTime) {
        *self = Self::new(self.link, self.endpoint, self.endpoint_number, at);
    }

    /// Whether the station there knows events.
    pub fn wants_events(&self) -> bool {
        self.streams.interval_us(SEQUENCE_ID) > 0
    }

    /// Whether this sender was heard here.
    pub fn has_heard(&self, system_id: u8, component_id: u8) -> bool {
        self.peers.iter().any(|p| p.address == (system_id, component_id))
    }

    /// Whether anybody of this system was heard here.
    pub fn has_heard_system(&self, system_id: u8) -> bool {
        self.peers.iter().any(|p| p.address.0 == system_id)
    }

    /// Takes note of a frame; the frames of its sender that never came.
    pub fn missing(&mut self, system_id: u8, component_id: u8, sequence: u8) -> u64 {
        let address = (system_id, component_id);
        self.counts.received = self.counts.received.saturating_add(1);
        let Some(index) = self.peers.iter().position(|p| p.address == address) else {
            if self.peers.len() == MOST_PEERS {
                self.peers.remove(0);
            }
            self.peers.push(Peer { address, sequence });
            return 0;
        };
        // The one heard last is forgotten last.
        let mut peer = self.peers.remove(index);
        let missing = sequence.wrapping_sub(peer.sequence).wrapping_sub(1);
        peer.sequence = sequence;
        self.peers.push(peer);
        // Half the ring or more is a restart, a repeated or a reordered frame, not a loss.
        let missing = if missing < 128 { u64::from(missing) } else { 0 };
        self.counts.lost = self.counts.lost.saturating_add(missing);
        missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ground() -> GroundLink {
        GroundLink::new(LinkId::Ground(0), Endpoint::default(), 0, HostTime::from_us(0))
    }

    #[test]
    fn prop_gaps_are_counted_per_peer() {
        let mut ground = ground();
        assert_eq!(ground.missing(255, 190, 250), 0);
        assert_eq!(ground.missing(255, 190, 252), 1);
        assert_eq!(ground.missing(245, 190, 7), 0);
        assert_eq!(ground.missing(255, 190, 253), 0);
        assert_eq!(ground.missing(255, 190, 2), 4);
        // Repeated.
        assert_eq!(ground.missing(255, 190, 2), 0);
        assert_eq!((ground.counts.received, ground.counts.lost), (6, 5));
    }

    #[test]
    fn prop_peers_are_bounded_and_the_silent_one_is_forgotten() {
        let mut ground = ground();
        for n in 0..=255_u8 {
            ground.missing(255, 190, n);
            ground.missing(n, 1, 0);
        }
        assert_eq!(ground.peers.len(), MOST_PEERS);
        assert!(ground.has_heard(255, 190) && !ground.has_heard(3, 1));
        assert!(ground.has_heard_system(254) && !ground.has_heard_system(7));
    }
}
