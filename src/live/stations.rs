//! Endpoints that stations come to: each gets a link of its own in the core.

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::time::{Duration, Instant, interval};

use super::clock;
use super::frames::WholeFrames;
use super::inbox::{Inbox, OUTPUT_QUEUE_CHUNKS};
use super::mailbox::{Mailbox, Outgoing, Refused, Slot, mailbox};
use super::tcp::{ACCEPT_PAUSE, RETRY, accept_after, talk};
use super::udp::{DATAGRAM_BYTES, send};
use crate::neighbours::{self, Transport};
use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

/// A UDP station that was silent for so long is forgotten, s. Some scripts listen for a minute and say
/// nothing (GROUND.md).
const FORGET_S: f64 = 60.0;
/// When all places are taken, one that was silent for so long gives its place away, s: stations send
/// their heartbeat every second.
const GIVE_WAY_S: f64 = 10.0;
/// A connection that showed no signature where one is demanded is cut after this time.
const SHOW_WITHIN: Duration = Duration::from_millis(if cfg!(test) { 700 } else { 10_000 });
/// How often the silent ones are looked for.
const LOOK: Duration = Duration::from_secs(1);

/// The places of an endpoint, and who has them.
#[derive(Debug)]
struct Places(Vec<Option<(SocketAddr, HostTime)>>);

/// Where somebody who was heard belongs.
#[derive(Debug, PartialEq, Eq)]
enum Seat {
    /// They have this place.
    Known(usize),
    /// They took this free place.
    New(usize),
    /// They took it from somebody who was silent.
    Taken(usize),
    /// There is none.
    Full,
}

impl Places {
    fn new(stations: usize) -> Self {
        Self(vec![None; stations])
    }

    fn heard(&mut self, peer: SocketAddr, at: HostTime) -> Seat {
        for (n, place) in self.0.iter_mut().enumerate() {
            if let Some((known, last)) = place
                && *known == peer
            {
                *last = at;
                return Seat::Known(n);
            }
        }
        if let Some(n) = self.0.iter().position(Option::is_none) {
            self.0[n] = Some((peer, at));
            return Seat::New(n);
        }
        let since = |place: &Option<(SocketAddr, HostTime)>| place.map(|(_, last)| last);
        let oldest = (0..self.0.len()).min_by_key(|n| self.0.get(*n).and_then(since));
        match oldest.and_then(|n| Some((n, self.0.get(n).and_then(since)?))) {
            Some((n, last)) if at.seconds_since(last) > GIVE_WAY_S => {
                self.0[n] = Some((peer, at));
                Seat::Taken(n)
            }
            _ => Seat::Full,
        }
    }

    /// Frees the places of those who are silent.
    fn forget(&mut self, now: HostTime) -> Vec<usize> {
        let mut freed = Vec::new();
        for (n, place) in self.0.iter_mut().enumerate() {
            if place.is_some_and(|(_, last)| now.seconds_since(last) > FORGET_S) {
                *place = None;
                freed.push(n);
            }
        }
        freed
    }

    fn knows(&self, peer: SocketAddr) -> bool {
        self.0.iter().flatten().any(|(known, _)| *known == peer)
    }

    fn peer(&self, n: usize) -> Option<SocketAddr> {
        self.0.get(n).copied().flatten().map(|(peer, _)| peer)
    }
}

/// Serves a bound `udpin` socket until the output ends; one inbox per place.
pub(super) async fn listen(socket: UdpSocket, inboxes: Vec<Inbox>, mut output: Mailbox) {
    let Some(first) = inboxes.first().cloned() else { return };
    let mut places = Places::new(inboxes.len());
    let mut buffer = vec![0; DATAGRAM_BYTES];
    let mut look = interval(LOOK);
    loop {
        tokio::select! {
            // Ours first: it is never much, and a flood comes without end.
            biased;
            outgoing = output.recv() => {
                let Some(Outgoing { link, bytes, .. }) = outgoing else { return };
                let Some(n) = inboxes.iter().position(|i| i.link() == link) else { continue };
                // Somebody who left meanwhile misses nothing.
                let (Some(peer), Some(inbox)) = (places.peer(n), inboxes.get(n)) else { continue };
                if !send(&socket, &inbox.seal(bytes), peer).await {
                    inbox.lost(DropReason::LinkWriteFailed);
                }
            }
            _ = look.tick() => {
                for n in places.forget(clock::now()) {
                    if let Some(inbox) = inboxes.get(n) {
                        tracing::info!("link {} is silent, forgotten", inbox.link().number());
                        inbox.down();
                    }
                }
            }
            received = socket.recv_from(&mut buffer) => {
                let at = clock::now();
                // An error here is about an earlier datagram of ours that nobody took.
                let Ok((length, peer)) = received else { continue };
                let bytes = buffer.get(..length).unwrap_or_default();
                // Strangers without a signature do not take the place of those who have one.
                if !places.knows(peer) && !first.would_open(bytes) {
                    continue;
                }
                let seat = places.heard(peer, at);
                let n = match seat {
                    Seat::Known(n) | Seat::New(n) | Seat::Taken(n) => n,
                    Seat::Full => {
                        first.lost(DropReason::StationsFull);
                        continue;
                    }
                };
                let Some(inbox) = inboxes.get(n) else { continue };
                if seat == Seat::Taken(n) {
                    inbox.down();
                }
                if seat != Seat::Known(n) {
                    tell_who(Transport::Udp, peer, "joined", inbox);
                    inbox.up();
                }
                inbox.bytes(at, bytes);
            }
        }
    }
}

/// Serves all clients of a bound `tcpin` port until the output ends; one inbox per place.
pub(super) async fn serve(listener: TcpListener, inboxes: Vec<Inbox>, mut output: Mailbox) {
    let mut writers: Vec<Option<Slot>> = vec![None; inboxes.len()];
    let mut clients = tokio::task::JoinSet::new();
    let mut next = Instant::now();
    loop {
        tokio::select! {
            accepted = accept_after(&listener, next) => {
                next = Instant::now() + ACCEPT_PAUSE;
                let Ok((stream, peer)) = accepted else {
                    // Out of descriptors, most likely: do not spin.
                    tokio::time::sleep(RETRY).await;
                    continue;
                };
                let free = writers.iter().position(Option::is_none);
                let Some((n, inbox)) = free.and_then(|n| Some((n, inboxes.get(n)?.clone()))) else {
                    tracing::warn!("{peer} refused: {} stations are connected", inboxes.len());
                    if let Some(first) = inboxes.first() {
                        first.lost(DropReason::StationsFull);
                    }
                    continue;
                };
                let Ok((writer, mut own_output)) = mailbox(OUTPUT_QUEUE_CHUNKS) else {
                    tracing::warn!("{peer} refused: no more descriptors; raise the limit (ulimit -n)");
                    inbox.lost(DropReason::StationsFull);
                    continue;
                };
                tell_who(Transport::Tcp, peer, "connected", &inbox);
                writers[n] = Some(writer);
                clients.spawn(async move {
                    inbox.up();
                    serve_one(stream, &inbox, &mut own_output).await;
                    inbox.down();
                    tracing::info!("{peer} disconnected");
                    n
                });
            }
            outgoing = output.recv() => {
                let Some(outgoing) = outgoing else { return };
                let Some(n) = inboxes.iter().position(|i| i.link() == outgoing.link) else { continue };
                let (Some(inbox), Some(Some(writer))) = (inboxes.get(n), writers.get(n)) else {
                    continue;
                };
                if writer.put(outgoing) == Err(Refused::Full) {
                    inbox.lost(DropReason::OutputQueueFull);
                }
            }
            Some(ended) = clients.join_next() => {
                if let Ok(n) = ended
                    && let Some(writer) = writers.get_mut(n)
                {
                    *writer = None;
                }
            }
        }
    }
}

/// Tells people who has come. Looking for the program takes its time, and must not hold up the others.
fn tell_who(transport: Transport, peer: SocketAddr, how: &'static str, inbox: &Inbox) {
    let link = inbox.link().number();
    tokio::task::spawn_blocking(move || match neighbours::sender(transport, peer) {
        Some(who) => tracing::info!("{peer} {how} as link {link}: {who}"),
        None => tracing::info!("{peer} {how} as link {link}"),
    });
}

/// One client, until it leaves. Where signatures are demanded it must have shown one in time: places
/// are few, and holding one costs nothing.
async fn serve_one(stream: TcpStream, inbox: &Inbox, output: &mut Mailbox) {
    let mut frames = WholeFrames::default();
    let shown = AtomicBool::new(!inbox.is_shut());
    let talks = talk(stream, inbox, output, |inbox, at, bytes| {
        frames.push(bytes);
        while let Some(frame) = frames.next() {
            if inbox.bytes(at, &frame) {
                shown.store(true, Relaxed);
            }
        }
    });
    let stays_mute = async {
        tokio::time::sleep(SHOW_WITHIN).await;
        if shown.load(Relaxed) {
            std::future::pending::<()>().await;
        }
    };
    tokio::select! {
        _ = talks => {}
        () = stays_mute => {
            inbox.lost(DropReason::MavUnsigned);
            tracing::info!("link {} showed no signature", inbox.link().number());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn peer(n: u16) -> SocketAddr {
        SocketAddr::from(([127, 0, 0, 1], 1000 + n))
    }

    #[test]
    fn prop_places_are_bounded_kept_and_given_away() {
        let at = |s: u64| HostTime::from_us(s * 1_000_000);
        let mut places = Places::new(2);
        assert_eq!(places.heard(peer(1), at(0)), Seat::New(0));
        assert_eq!(places.heard(peer(2), at(1)), Seat::New(1));
        assert_eq!(places.heard(peer(1), at(5)), Seat::Known(0));
        assert_eq!(places.heard(peer(3), at(6)), Seat::Full);
        // The second has been silent for more than ten seconds: its place goes, the first keeps its own.
        assert_eq!(places.heard(peer(1), at(11)), Seat::Known(0));
        assert_eq!(places.heard(peer(3), at(12)), Seat::Taken(1));
        assert_eq!(places.heard(peer(2), at(13)), Seat::Full);
        assert_eq!(places.peer(1), Some(peer(3)));
        assert_eq!(places.forget(at(72)), [0]);
        assert_eq!(places.peer(0), None);
        assert_eq!(places.heard(peer(2), at(72)), Seat::New(0));
    }
}
