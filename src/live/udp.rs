//! UDP links: a socket that answers everyone it heard lately, or one that sends to a fixed place.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::net::{UdpSocket, lookup_host};

use super::clock;
use super::inbox::Inbox;
use super::mailbox::{Mailbox, Outgoing};
use crate::config::HostPort;
use crate::drops::DropReason;
use crate::time::HostTime;

/// A peer that was silent for so long is forgotten, s.
const PEER_SILENCE_S: f64 = 30.0;
/// Most peers of one socket: a stranger must not make us send without end.
const MOST_PEERS: usize = 16;
/// Largest datagram.
pub(super) const DATAGRAM_BYTES: usize = 65_536;
/// A network that takes nothing for so long loses the datagram: the next setpoint is due by then.
const SEND_PATIENCE: Duration = Duration::from_millis(10);
/// Wait before a name is looked up again.
const RETRY: Duration = Duration::from_secs(2);

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

    fn knows(&self, peer: SocketAddr) -> bool {
        self.0.iter().any(|(known, _)| *known == peer)
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

/// Binds `udpin`.
pub(super) async fn bind(at: &HostPort) -> std::io::Result<UdpSocket> {
    UdpSocket::bind((at.host.as_str(), at.port)).await
}

/// Serves a bound socket until the output ends.
pub(super) async fn listen(socket: UdpSocket, inbox: Inbox, mut output: Mailbox) {
    inbox.up();
    let mut peers = Peers::default();
    let mut buffer = vec![0; DATAGRAM_BYTES];
    loop {
        tokio::select! {
            // Ours first: it is never much, and a flood comes without end.
            biased;
            bytes = output.recv() => {
                let Some(Outgoing { bytes, .. }) = bytes else { return };
                let bytes = inbox.seal(bytes);
                peers.forget(clock::now());
                for (peer, _) in &peers.0 {
                    if !send(&socket, &bytes, *peer).await {
                        inbox.lost(DropReason::LinkWriteFailed);
                    }
                }
            }
            received = socket.recv_from(&mut buffer) => {
                let at = clock::now();
                // An error here is about an earlier datagram of ours that nobody took.
                let Ok((length, peer)) = received else { continue };
                let bytes = buffer.get(..length).unwrap_or_default();
                if !peers.knows(peer) && !inbox.would_open(bytes) {
                    continue;
                }
                if peers.heard(peer, at) {
                    inbox.bytes(at, bytes);
                } else {
                    inbox.lost(DropReason::MavWrongPeer);
                }
            }
        }
    }
}

/// Serves `udpout` until the output ends; looks the name up until that works.
pub(super) async fn send_to(to: HostPort, inbox: Inbox, mut output: Mailbox) {
    let mut told = false;
    let (socket, peer) = loop {
        match open(&to).await {
            Ok(opened) => break opened,
            Err(error) if !told => {
                tracing::warn!("udpout:{to}: {error}; trying again until it works");
                told = true;
            }
            Err(_) => {}
        }
        // What is due now is of no use later.
        let resume = tokio::time::sleep(RETRY);
        tokio::pin!(resume);
        loop {
            tokio::select! {
                () = &mut resume => break,
                bytes = output.recv() => match bytes {
                    Some(_) => inbox.lost(DropReason::LinkWriteFailed),
                    None => return,
                },
            }
        }
    };
    inbox.up();
    let everyone = is_for_many(peer);
    let mut buffer = vec![0; DATAGRAM_BYTES];
    loop {
        tokio::select! {
            biased;
            bytes = output.recv() => {
                let Some(Outgoing { bytes, .. }) = bytes else { return };
                if !send(&socket, &inbox.seal(bytes), peer).await {
                    inbox.lost(DropReason::LinkWriteFailed);
                }
            }
            received = socket.recv_from(&mut buffer) => {
                let at = clock::now();
                let Ok((length, from)) = received else { continue };
                if everyone || from.ip() == peer.ip() {
                    inbox.bytes(at, buffer.get(..length).unwrap_or_default());
                } else {
                    inbox.lost(DropReason::MavWrongPeer);
                }
            }
        }
    }
}

/// Whether it went out.
pub(super) async fn send(socket: &UdpSocket, bytes: &[u8], to: SocketAddr) -> bool {
    let sent = tokio::time::timeout(SEND_PATIENCE, socket.send_to(bytes, to)).await;
    matches!(sent, Ok(Ok(_)))
}

async fn open(to: &HostPort) -> std::io::Result<(UdpSocket, SocketAddr)> {
    let peer = lookup_host((to.host.as_str(), to.port)).await?.next().ok_or_else(|| {
        std::io::Error::new(std::io::ErrorKind::NotFound, "the name has no address")
    })?;
    let any = if peer.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
    let socket = UdpSocket::bind(any).await?;
    socket.set_broadcast(true)?;
    Ok((socket, peer))
}

/// Whether answers come from other addresses than the one we send to.
fn is_for_many(peer: SocketAddr) -> bool {
    match peer {
        // Most networks of a lab have 256 addresses.
        SocketAddr::V4(v4) => v4.ip().is_multicast() || v4.ip().octets()[3] == 255,
        SocketAddr::V6(v6) => v6.ip().is_multicast(),
    }
}

#[cfg(test)]
mod tests {
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
}
