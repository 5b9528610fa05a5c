//! Packets of a Crazyflie, of which the core has the length before each: apart on the way out, with it on the way in.
//!
//! Of what waits to go out the newest setpoint is kept and no older one: an old setpoint is worse than none.

use std::collections::VecDeque;

use super::clock;
use super::inbox::Inbox;
use super::mailbox::Mailbox;
use super::names::{Names, apart};
use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_dialect::crtp::packet::{MAX_PACKET, Packet, Place};

/// A setpoint is not sent when it is older than this, s: two of its periods.
const OLDEST_SETPOINT_S: f64 = 0.02;
/// Bytes handed to the core at once.
const PIECE: usize = 2048;
/// Requests that wait; the core has one of each port under way and repeats it after 100 ms.
const MOST_REQUESTS: usize = 16;

/// Each packet of a piece of the core that the vehicle has to answer; what is known of its names is answered here.
pub(super) fn out(inbox: &Inbox, names: &mut Names, bytes: &[u8], mut send: impl FnMut(&[u8])) {
    for packet in apart(bytes) {
        let bad_files = names.bad_files;
        match names.asked(packet) {
            Some(known) => {
                let at = clock::now();
                known.chunks(PIECE).for_each(|piece| {
                    inbox.bytes(at, piece);
                });
            }
            None => send(packet),
        }
        if names.bad_files > bad_files {
            inbox.lost(DropReason::MavUndecodable);
        }
    }
}

/// Hands a packet to the core. `false`: it is none.
pub(super) fn hand_in(inbox: &Inbox, names: &mut Names, at: HostTime, packet: &[u8]) -> bool {
    let mut bytes = [0; 1 + MAX_PACKET];
    let Some(place) = bytes.get_mut(1..=packet.len()).filter(|_| !packet.is_empty()) else {
        return false;
    };
    place.copy_from_slice(packet);
    bytes[0] = packet.len() as u8;
    names.heard(packet);
    // Without an address: nobody else can be the board here.
    inbox.bytes(at, bytes.get(..=packet.len()).unwrap_or_default());
    true
}

/// Whether a setpoint that was given to us at `at` may still be sent.
pub(super) fn is_fresh(now: HostTime, at: HostTime) -> bool {
    now.seconds_since(at) <= OLDEST_SETPOINT_S
}

/// What waits to go out.
#[derive(Debug, Default)]
pub(super) struct Waiting {
    setpoint: Option<(Packet, HostTime)>,
    requests: VecDeque<Packet>,
    /// A setpoint went last: two never go before a request that waits.
    was_setpoint: bool,
}

/// A packet that goes out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Next {
    /// May be lost: a newer one comes.
    Setpoint(Packet),
    /// In order, each once.
    Request(Packet),
}

impl Waiting {
    /// Takes a packet. `false`: too many wait, or it is none.
    pub(super) fn put(&mut self, at: HostTime, packet: &[u8]) -> bool {
        let Ok(packet) = Packet::read(packet) else { return false };
        if packet.place() == Ok(Place::Attitude) {
            self.setpoint = Some((packet, at));
            return true;
        }
        if packet.place() == Ok(Place::LinkEcho) {
            // The round trip of one that waited says how long it waited.
            self.requests.retain(|other| other.place() != Ok(Place::LinkEcho));
        }
        if self.requests.contains(&packet) {
            // Asked again while the first was waiting.
            return true;
        }
        let has_room = self.requests.len() < MOST_REQUESTS;
        if has_room {
            self.requests.push_back(packet);
        }
        has_room
    }

    /// Takes all that the core has for this link. `false`: nothing comes any more.
    pub(super) fn take_from(
        &mut self,
        output: &mut Mailbox,
        inbox: &Inbox,
        names: &mut Names,
        at: HostTime,
    ) -> bool {
        loop {
            match output.try_take() {
                Ok(Some(piece)) => out(inbox, names, &piece.bytes, |packet| {
                    if !self.put(at, packet) {
                        inbox.lost(DropReason::OutputQueueFull);
                    }
                }),
                Ok(None) => return true,
                Err(_) => return false,
            }
        }
    }

    /// The newest setpoint, if it is not too old.
    pub(super) fn setpoint(&mut self, now: HostTime) -> Option<Packet> {
        self.setpoint.take().filter(|(_, at)| is_fresh(now, *at)).map(|(packet, _)| packet)
    }

    /// When it was given to us.
    pub(super) fn setpoint_at(&self) -> Option<HostTime> {
        self.setpoint.map(|(_, at)| at)
    }

    /// The next packet.
    pub(super) fn next(&mut self, now: HostTime) -> Option<Next> {
        if std::mem::take(&mut self.was_setpoint)
            && let Some(request) = self.requests.pop_front()
        {
            return Some(Next::Request(request));
        }
        if let Some(setpoint) = self.setpoint(now) {
            self.was_setpoint = true;
            return Some(Next::Setpoint(setpoint));
        }
        self.requests.pop_front().map(Next::Request)
    }

    /// Whether nothing waits.
    pub(super) fn is_empty(&self) -> bool {
        self.setpoint.is_none() && self.requests.is_empty()
    }
}
