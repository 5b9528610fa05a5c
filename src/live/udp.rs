//! UDP links of stations that we send to, and what all UDP links share. Listening for stations is in
//! `stations`, the board in `datagrams`.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::net::{UdpSocket, lookup_host};

use super::clock;
use super::inbox::Inbox;
use super::mailbox::{Mailbox, Outgoing};
use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_pilot::settings::HostPort;

/// Largest datagram.
pub(super) const DATAGRAM_BYTES: usize = 65_536;
/// A network that takes nothing for so long loses the datagram: the next setpoint is due by then.
pub(super) const SEND_PATIENCE: Duration = Duration::from_millis(10);
/// Two who speak within this time speak at once, s: stations send their heartbeat every second.
const TOGETHER_S: f64 = 3.0;
/// Wait before a name is looked up again.
pub(super) const RETRY: Duration = Duration::from_secs(2);

/// Binds `udpin`.
pub(super) async fn bind(at: &HostPort) -> std::io::Result<UdpSocket> {
    UdpSocket::bind((at.host.as_str(), at.port)).await
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
    // Who answered last, and when.
    let mut last: Option<(SocketAddr, HostTime)> = None;
    let (mut told, mut stranger_told) = (false, false);
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
                    if let Some((other, heard)) = last.replace((from, at))
                        && other != from
                        && at.seconds_since(heard) < TOGETHER_S
                        && !std::mem::replace(&mut told, true)
                    {
                        tracing::warn!("udpout:{to}: {other} and {from} answer, two on one link: both may command");
                    }
                    inbox.bytes(at, buffer.get(..length).unwrap_or_default());
                } else {
                    inbox.lost(DropReason::MavWrongPeer);
                    if !std::mem::replace(&mut stranger_told, true) {
                        tell_stranger(&inbox, from, peer);
                    }
                }
            }
        }
    }
}

/// Said once of a link: somebody speaks there and is not heard.
pub(super) fn tell_stranger(inbox: &Inbox, from: SocketAddr, peer: SocketAddr) {
    tracing::warn!(
        "link {}: {from} speaks and is not heard: this link sends to {peer} and listens to {} alone; write the \
         address from which it answers, or udpin",
        inbox.link().number(),
        peer.ip()
    );
}

/// Whether it went out.
pub(super) async fn send(socket: &UdpSocket, bytes: &[u8], to: SocketAddr) -> bool {
    let sent = tokio::time::timeout(SEND_PATIENCE, socket.send_to(bytes, to)).await;
    matches!(sent, Ok(Ok(_)))
}

async fn open(to: &HostPort) -> std::io::Result<(UdpSocket, SocketAddr)> {
    let peer = lookup_host((to.host.as_str(), to.port)).await?.next().ok_or_else(no_address)?;
    let socket = UdpSocket::bind(any_for(peer)).await?;
    socket.set_broadcast(true)?;
    Ok((socket, peer))
}

pub(super) fn no_address() -> std::io::Error {
    std::io::Error::new(std::io::ErrorKind::NotFound, "the name has no address")
}

/// Any address of ours from which this peer can be reached.
pub(super) fn any_for(peer: SocketAddr) -> &'static str {
    if peer.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" }
}

/// Whether answers come from other addresses than the one we send to.
pub(super) fn is_for_many(peer: SocketAddr) -> bool {
    match peer {
        // Most networks of a lab have 256 addresses.
        SocketAddr::V4(v4) => v4.ip().is_multicast() || v4.ip().octets()[3] == 255,
        SocketAddr::V6(v6) => v6.ip().is_multicast(),
    }
}
