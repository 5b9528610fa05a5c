//! Who has which place of an endpoint, and who gives way when somebody new comes. Pure.
//!
//! A station is known by its address and port. A program that is started anew for every order comes from another
//! port each time: by its address, system and component it takes the place that it had.

use std::net::SocketAddr;

use haltere_core::time::HostTime;
use haltere_dialect::mav_stream::{MAX_FRAME, MavSplitter};

/// Who was silent for so long has left, s: stations send their heartbeat every second, and one may get lost.
pub(super) const LEFT_S: f64 = 2.5;
/// A station that was silent for so long is forgotten though nobody wants its place, s. Some scripts listen for a
/// minute and say nothing (STATIONS.md).
const FORGET_S: f64 = 60.0;

/// System and component.
pub(super) type Identity = (u8, u8);

/// Somebody who has a place.
#[derive(Debug, Clone, Copy)]
struct Holder {
    at: SocketAddr,
    /// As its first frame said; `None`: none came yet.
    who: Option<Identity>,
    heard: HostTime,
}

/// The places of an endpoint, and who has them.
#[derive(Debug)]
pub(super) struct Places(Vec<Option<Holder>>);

/// Where somebody who was heard belongs.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Seat {
    /// They have this place.
    Known(usize),
    /// They took this free place.
    New(usize),
    /// They took it from this one.
    Taken(usize, SocketAddr),
    /// There is none.
    Full,
}

impl Places {
    pub(super) fn new(stations: usize) -> Self {
        Self(vec![None; stations])
    }

    /// Somebody spoke; `bytes` are whole frames, if they are any.
    pub(super) fn heard(&mut self, peer: SocketAddr, at: HostTime, bytes: &[u8]) -> Seat {
        if let Some(n) = self.find(|holder| holder.at == peer) {
            if let Some(holder) = self.0.get_mut(n).and_then(Option::as_mut) {
                holder.heard = at;
                holder.who = holder.who.or_else(|| speaker(bytes));
            }
            return Seat::Known(n);
        }
        let who = speaker(bytes);
        let left = |holder: &Holder| at.seconds_since(holder.heard) >= LEFT_S;
        let was_theirs =
            |h: &Holder| who.is_some() && h.who == who && h.at.ip() == peer.ip() && left(h);
        let place = self
            .find(was_theirs)
            .or_else(|| self.0.iter().position(Option::is_none))
            // Noise moves nobody.
            .or_else(|| who.and_then(|_| self.gives_way(at)));
        let Some((n, place)) = place.and_then(|n| Some((n, self.0.get_mut(n)?))) else {
            return Seat::Full;
        };
        let before = place.replace(Holder { at: peer, who, heard: at });
        before.map_or(Seat::New(n), |before| Seat::Taken(n, before.at))
    }

    /// Who gives way to a station when all places are taken: who never sent a frame, of those who did the one
    /// that has left for longest.
    fn gives_way(&self, at: HostTime) -> Option<usize> {
        let holders = self.0.iter().enumerate().filter_map(|(n, place)| Some((n, (*place)?)));
        let may = |h: &Holder| h.who.is_none() || at.seconds_since(h.heard) >= LEFT_S;
        let first = holders.filter(|(_, h)| may(h)).min_by_key(|(_, h)| (h.who.is_some(), h.heard));
        first.map(|(n, _)| n)
    }

    /// Frees the places of those who are silent.
    pub(super) fn forget(&mut self, now: HostTime) -> Vec<usize> {
        let mut freed = Vec::new();
        for (n, place) in self.0.iter_mut().enumerate() {
            if place.is_some_and(|holder| now.seconds_since(holder.heard) > FORGET_S) {
                *place = None;
                freed.push(n);
            }
        }
        freed
    }

    pub(super) fn knows(&self, peer: SocketAddr) -> bool {
        self.find(|holder| holder.at == peer).is_some()
    }

    pub(super) fn peer(&self, n: usize) -> Option<SocketAddr> {
        self.0.get(n).copied().flatten().map(|holder| holder.at)
    }

    fn find(&self, is: impl Fn(&Holder) -> bool) -> Option<usize> {
        self.0.iter().position(|place| place.as_ref().is_some_and(&is))
    }
}

/// Who says the first frame whose checksum holds. Looked for in two frames' length: strangers must not cost much.
fn speaker(bytes: &[u8]) -> Option<Identity> {
    let mut splitter = MavSplitter::new();
    splitter.push(bytes.get(..2 * MAX_FRAME).unwrap_or(bytes));
    while let Some(next) = splitter.next() {
        if let Ok(frame) = next
            && frame.checked
        {
            return Some((frame.header.system_id, frame.header.component_id));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use haltere_dialect::mav::haltere::{HEARTBEAT_DATA, MavMessage};
    use haltere_dialect::mav_stream;

    use super::*;

    fn peer(n: u16) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], 1000 + n))
    }

    fn at(s: f64) -> HostTime {
        HostTime::from_us(1_000_000 + (s * 1e6) as u64)
    }

    fn beat(system: u8) -> Vec<u8> {
        let mut bytes = Vec::new();
        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        mav_stream::encode(&mut bytes, system, 190, 0, &message);
        bytes
    }

    #[test]
    fn prop_places_are_bounded_kept_and_given_away() {
        let mut places = Places::new(2);
        assert_eq!(places.heard(peer(1), at(0.0), &beat(1)), Seat::New(0));
        assert_eq!(places.heard(peer(2), at(1.0), &beat(2)), Seat::New(1));
        assert_eq!(places.heard(peer(1), at(2.0), &beat(1)), Seat::Known(0));
        assert_eq!(places.heard(peer(3), at(3.0), &beat(3)), Seat::Full);
        // The second has missed two heartbeats: its place goes, the first keeps its own.
        assert_eq!(places.heard(peer(1), at(3.0), &beat(1)), Seat::Known(0));
        assert_eq!(places.heard(peer(3), at(3.5), &beat(3)), Seat::Taken(1, peer(2)));
        assert_eq!(places.heard(peer(2), at(4.0), &beat(2)), Seat::Full);
        assert_eq!(places.peer(1), Some(peer(3)));
        assert_eq!(places.forget(at(63.2)), [0]);
        assert_eq!(places.peer(0), None);
        assert_eq!(places.heard(peer(2), at(63.3), &beat(2)), Seat::New(0));
    }

    #[test]
    fn regress_who_never_sent_a_frame_gives_way_first_and_noise_moves_nobody() {
        let mut places = Places::new(3);
        places.heard(peer(1), at(0.0), &beat(1));
        places.heard(peer(2), at(0.1), b"GET / HTTP/1.1");
        places.heard(peer(3), at(0.2), b"");
        // They speak without end, and say nothing.
        places.heard(peer(2), at(9.0), b"noise");
        assert_eq!(places.heard(peer(4), at(9.0), b"more noise"), Seat::Full);
        assert_eq!(places.heard(peer(4), at(9.1), &beat(4)), Seat::Taken(2, peer(3)));
        assert_eq!(places.heard(peer(5), at(9.2), &beat(5)), Seat::Taken(1, peer(2)));
        assert_eq!(places.heard(peer(6), at(9.3), &beat(6)), Seat::Taken(0, peer(1)));
        assert_eq!(places.heard(peer(1), at(9.4), &beat(1)), Seat::Full);
        // Who said nothing at first and then speaks has its place like any other.
        let mut places = Places::new(1);
        places.heard(peer(1), at(0.0), b"");
        places.heard(peer(1), at(0.5), &beat(1));
        assert_eq!(places.heard(peer(2), at(1.0), &beat(2)), Seat::Full);
    }

    #[test]
    fn regress_orders_of_one_host_take_over_their_former_places_and_never_a_station_that_beats() {
        let mut places = Places::new(8);
        let station = peer(0);
        let mut seats = std::collections::BTreeSet::new();
        // A station and orders of the same identity, one order each 0.3 s, from a new port each.
        for tenth in 0..1000_u16 {
            let now = at(f64::from(tenth) * 0.1);
            if tenth % 10 == 0 {
                let seat = places.heard(station, now, &beat(255));
                assert_eq!(seat, if tenth == 0 { Seat::New(0) } else { Seat::Known(0) });
            }
            if tenth % 3 == 2 {
                match places.heard(peer(tenth), now, &beat(255)) {
                    Seat::New(n) | Seat::Taken(n, _) => {
                        seats.insert(n);
                    }
                    // Seven orders within 2.5 s: the next waits for as long as that.
                    seat => assert!(matches!(seat, Seat::Full), "{seat:?}"),
                }
            }
        }
        assert!(!seats.contains(&0));
        // Orders that last half a second each do not use up the places, and are never refused.
        let mut places = Places::new(8);
        places.heard(station, at(0.0), &beat(255));
        for half in 1..100_u16 {
            let now = at(f64::from(half) * 0.5);
            places.heard(station, now, &beat(255));
            let seat = places.heard(peer(half), now, &beat(255));
            assert!(matches!(seat, Seat::New(_) | Seat::Taken(..)), "{half}: {seat:?}");
        }
        assert_eq!(places.peer(0), Some(station));
        assert_eq!(places.peer(7), None, "{places:?}");
        // From another host, or as another system, a free one is taken.
        let mut places = Places::new(8);
        places.heard(peer(1), at(0.0), &beat(255));
        let elsewhere = SocketAddr::from(([127, 0, 0, 2], 7));
        assert_eq!(places.heard(elsewhere, at(9.0), &beat(255)), Seat::New(1));
        assert_eq!(places.heard(peer(3), at(9.0), &beat(254)), Seat::New(2));
        assert_eq!(places.heard(peer(4), at(9.0), &beat(255)), Seat::Taken(0, peer(1)));
    }
}
