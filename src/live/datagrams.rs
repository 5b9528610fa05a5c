//! The board over UDP, on a thread that waits in the kernel: two calls for a datagram instead of the four
//! and the wakers of a runtime. Of all threads only the tag's wakes more often.

use std::io::ErrorKind;
use std::net::{SocketAddr, ToSocketAddrs as _, UdpSocket};
use std::os::fd::AsFd as _;
use std::time::Instant;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

use super::clock;
use super::inbox::Inbox;
use super::mailbox::{Mailbox, Outgoing};
use super::names::Names;
use super::packets;
use super::udp::{
    DATAGRAM_BYTES, RETRY, SEND_PATIENCE, any_for, is_for_many, no_address, tell_stranger,
};
use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_pilot::settings::HostPort;

/// A peer that was silent for so long is forgotten, s.
const PEER_SILENCE_S: f64 = 30.0;
/// Most peers of one socket: a stranger must not make us send without end.
const MOST_PEERS: usize = 16;

/// Those who were heard on a socket.
#[derive(Debug, Default)]
struct Peers(Vec<(SocketAddr, HostTime)>);

impl Peers {
    /// Whether there is room for this peer.
    fn heard(&mut self, peer: SocketAddr, at: HostTime) -> bool {
        if let Some((_, last)) = self.0.iter_mut().find(|(known, _)| *known == peer) {
            *last = at;
            return true;
        }
        self.forget(at);
        if self.0.len() >= MOST_PEERS {
            return false;
        }
        tracing::info!("{peer} joined");
        self.0.push((peer, at));
        true
    }

    fn forget(&mut self, now: HostTime) {
        self.0.retain(|(peer, last)| {
            let keep = now.seconds_since(*last) <= PEER_SILENCE_S;
            if !keep {
                tracing::info!("{peer} is silent, forgotten");
            }
            keep
        });
    }
}

/// Who is at the other end.
#[derive(Debug)]
enum Far {
    /// Whoever was heard lately.
    Heard(Peers),
    /// One place, which may stand for many.
    Fixed { peer: SocketAddr, many: bool, told: bool },
    /// A Crazyflie.
    Packets(SocketAddr, Names),
}

/// Serves a bound socket until the output or the companion ends; answers whom the core means, of those it heard
/// lately, and all of them while that knows none.
pub(super) fn listen(socket: &UdpSocket, inbox: &Inbox, output: Mailbox) {
    talk(socket, inbox, output, Far::Heard(Peers::default()));
}

/// Serves `udpout` until the output or the companion ends; looks the name up until that works.
pub(super) fn send_to(to: &HostPort, inbox: &Inbox, output: Mailbox) {
    open_and_talk(to, inbox, output, |peer| Far::Fixed {
        peer,
        many: is_for_many(peer),
        told: false,
    });
}

/// The same to a Crazyflie: a datagram is a packet, of which the core has the length before it.
pub(super) fn send_packets_to(to: &HostPort, inbox: &Inbox, output: Mailbox) {
    open_and_talk(to, inbox, output, |peer| Far::Packets(peer, Names::usual()));
}

fn open_and_talk(
    to: &HostPort,
    inbox: &Inbox,
    mut output: Mailbox,
    far: impl Fn(SocketAddr) -> Far,
) {
    let mut told = false;
    while !inbox.stopped() {
        match open(to) {
            Ok((socket, peer)) => {
                return talk(&socket, inbox, output, far(peer));
            }
            Err(error) if !told => {
                tracing::warn!("{to}: {error}; trying again until it works");
                told = true;
            }
            Err(_) => {}
        }
        if !output.lose(inbox, Instant::now() + RETRY) {
            return;
        }
    }
}

fn open(to: &HostPort) -> std::io::Result<(UdpSocket, SocketAddr)> {
    let peer = (to.host.as_str(), to.port).to_socket_addrs()?.next().ok_or_else(no_address)?;
    let socket = UdpSocket::bind(any_for(peer))?;
    socket.set_broadcast(true)?;
    Ok((socket, peer))
}

fn talk(socket: &UdpSocket, inbox: &Inbox, mut output: Mailbox, mut far: Far) {
    if let Err(error) = socket.set_nonblocking(true) {
        tracing::error!("link {}: {error}; it stays silent", inbox.link().number());
        return;
    }
    inbox.up();
    let mut buffer = vec![0; DATAGRAM_BYTES];
    while !inbox.stopped() {
        // Ours first: it is never much, and a flood comes without end.
        loop {
            match output.try_take() {
                Ok(Some(outgoing)) => far.send(socket, inbox, outgoing),
                Ok(None) => break,
                Err(_) => return,
            }
        }
        // An error here is about an earlier datagram of ours that nobody took.
        if output.wait_or(socket.as_fd())
            && let Ok((length, from)) = socket.recv_from(&mut buffer)
        {
            let at = clock::now();
            far.received(inbox, at, from, buffer.get(..length).unwrap_or_default());
        }
    }
}

impl Far {
    fn send(&mut self, socket: &UdpSocket, inbox: &Inbox, Outgoing { bytes, to, .. }: Outgoing) {
        let bytes = inbox.seal(bytes);
        let to_one = |peer| {
            if !send(socket, &bytes, peer) {
                inbox.lost(DropReason::LinkWriteFailed);
            }
        };
        match self {
            Self::Heard(peers) => {
                peers.forget(clock::now());
                let meant = |peer: &SocketAddr| to.is_none_or(|to| to == *peer);
                peers.0.iter().map(|(peer, _)| *peer).filter(meant).for_each(to_one);
            }
            // What stands for many is left as soon as the core knows whom it means.
            Self::Fixed { peer, many: true, .. } => to_one(to.unwrap_or(*peer)),
            Self::Fixed { peer, many: false, .. } => to_one(*peer),
            Self::Packets(peer, names) => packets::out(inbox, names, &bytes, |packet| {
                if !send(socket, packet, *peer) {
                    inbox.lost(DropReason::LinkWriteFailed);
                }
            }),
        }
    }

    fn received(&mut self, inbox: &Inbox, at: HostTime, from: SocketAddr, bytes: &[u8]) {
        let welcome = match self {
            Self::Heard(peers) => {
                let known = peers.0.iter().any(|(peer, _)| *peer == from);
                // Who may not open the link was counted there.
                if !known && !inbox.would_open(bytes) {
                    return;
                }
                peers.heard(from, at)
            }
            Self::Fixed { peer, many, told } => {
                let welcome = *many || from.ip() == peer.ip();
                if !welcome && !std::mem::replace(told, true) {
                    tell_stranger(inbox, from, *peer);
                }
                welcome
            }
            Self::Packets(peer, names) => {
                if from != *peer || !packets::hand_in(inbox, names, at, bytes) {
                    inbox.lost(DropReason::MavWrongPeer);
                }
                return;
            }
        };
        if welcome {
            inbox.bytes_from(at, Some(from), bytes);
        } else {
            inbox.lost(DropReason::MavWrongPeer);
        }
    }
}

/// Whether it went out.
fn send(socket: &UdpSocket, bytes: &[u8], to: SocketAddr) -> bool {
    match socket.send_to(bytes, to) {
        Err(error) if error.kind() == ErrorKind::WouldBlock => {
            let patience = Timespec::try_from(SEND_PATIENCE).unwrap_or_default();
            let _ = poll(&mut [PollFd::new(socket, PollFlags::OUT)], Some(&patience));
            socket.send_to(bytes, to).is_ok()
        }
        sent => sent.is_ok(),
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn prop_peers_are_bounded_and_forgotten() {
        let mut peers = Peers::default();
        let peer = |n: u16| SocketAddr::from(([127, 0, 0, 1], 1000 + n));
        let at = HostTime::from_us;
        for n in 0..16 {
            assert!(peers.heard(peer(n), at(0)));
        }
        assert!(!peers.heard(peer(16), at(1_000_000)), "full");
        assert!(peers.heard(peer(3), at(20_000_000)));
        assert!(peers.heard(peer(16), at(31_000_000)), "the silent ones made room");
        assert_eq!(peers.0.len(), 2);
    }

    #[test]
    fn regress_what_is_meant_for_one_board_reaches_no_other() {
        use super::super::inbox::input_queues;
        use super::super::pool::Pool;
        use super::super::shared::Shared;
        use haltere_pilot::LinkId;

        let (entrance, _arrivals) = input_queues();
        let inbox =
            Inbox::new(LinkId::Board, &entrance, None, std::sync::Arc::new(Shared::default()));
        let pool = Pool::new(8, 8, 4);
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let boards = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
        boards.iter().for_each(|board| board.set_nonblocking(true).unwrap());
        let addresses = [0, 1].map(|i: usize| boards[i].local_addr().unwrap());
        let mut heard = Peers::default();
        addresses.iter().for_each(|address| assert!(heard.heard(*address, clock::now())));
        let mut buffer = [0; 8];
        let mut got = |far: &mut Far, to| {
            let waits = super::super::shared::Waits::new(&Default::default(), LinkId::Board);
            let bytes = pool.lend(&[7]).unwrap();
            let outgoing = Outgoing { link: LinkId::Board, to, bytes, _waits: waits };
            far.send(&socket, &inbox, outgoing);
            std::thread::sleep(Duration::from_millis(20));
            [0, 1].map(|i: usize| boards[i].recv_from(&mut buffer).is_ok())
        };
        let mut far = Far::Heard(heard);
        assert_eq!(got(&mut far, None), [true, true]);
        assert_eq!(got(&mut far, Some(addresses[1])), [false, true]);
        // Of a broadcast or multicast address one is left.
        let mut far = Far::Fixed { peer: addresses[0], many: true, told: false };
        assert_eq!(got(&mut far, None), [true, false]);
        assert_eq!(got(&mut far, Some(addresses[1])), [false, true]);
        let mut far = Far::Fixed { peer: addresses[0], many: false, told: false };
        assert_eq!(got(&mut far, Some(addresses[1])), [true, false]);
    }
}
