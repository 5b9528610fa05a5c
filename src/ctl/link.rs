//! The wire under a ground station: one UDP socket or TCP stream, read with a timeout.

use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs, UdpSocket};
use std::time::Duration;

use super::CtlError;
use haltere_pilot::settings::{Address, HostPort};

/// Longest wait for a TCP connection.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);
/// Larger than any datagram or burst that is worth one read.
pub(super) const READ_BYTES: usize = 4096;

/// An open wire.
#[derive(Debug)]
pub(super) enum Link {
    /// Peer is known from the start, or chosen among those who spoke.
    Udp { socket: UdpSocket, peer: Option<SocketAddr> },
    /// The port where the vehicle speaks is somebody else's, who may pass on what comes and what goes.
    Guest { socket: UdpSocket, port: SocketAddr },
    /// Connected.
    Tcp(TcpStream),
}

impl Link {
    /// Opens a `udpout:`, `udpin:` or `tcpout:` address.
    pub fn open(address: &str) -> Result<Self, CtlError> {
        let io = |error| CtlError::Io { address: address.into(), error };
        let resolve = |at: &HostPort| {
            let mut places = (at.host.as_str(), at.port).to_socket_addrs().map_err(io)?;
            places.next().ok_or_else(|| io(ErrorKind::NotFound.into()))
        };
        match address.parse::<Address>()? {
            Address::UdpOut(to) => {
                let place = resolve(&to)?;
                let any = if place.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
                let socket = UdpSocket::bind(any).map_err(io)?;
                Ok(Link::Udp { socket, peer: Some(place) })
            }
            Address::UdpIn(at) => {
                let port = resolve(&at)?;
                match UdpSocket::bind(port) {
                    Ok(socket) => Ok(Link::Udp { socket, peer: None }),
                    Err(why) if why.kind() == ErrorKind::AddrInUse && port.ip().is_loopback() => {
                        let socket = UdpSocket::bind((port.ip(), 0)).map_err(io)?;
                        Ok(Link::Guest { socket, port })
                    }
                    Err(why) => Err(CtlError::Listen { at, why }),
                }
            }
            Address::TcpOut(to) => {
                let stream =
                    TcpStream::connect_timeout(&resolve(&to)?, CONNECT_TIMEOUT).map_err(io)?;
                stream.set_nodelay(true).map_err(io)?;
                Ok(Link::Tcp(stream))
            }
            other => Err(CtlError::Kind { address: other }),
        }
    }

    /// From here on this one is spoken to.
    pub fn speak_to(&mut self, chosen: SocketAddr) {
        if let Link::Udp { peer, .. } = self {
            *peer = Some(chosen);
        }
    }

    /// Whether somebody else has our port.
    pub fn is_guest(&self) -> bool {
        matches!(self, Link::Guest { .. })
    }

    /// Takes the port of which we were a guest, once it is free. Who speaks there is to be heard anew.
    pub fn take_port(&mut self) -> bool {
        let Link::Guest { port, .. } = self else { return false };
        let Ok(socket) = UdpSocket::bind(*port) else { return false };
        *self = Link::Udp { socket, peer: None };
        true
    }

    /// Whether nobody is known yet who could be spoken to.
    pub fn lacks_peer(&self) -> bool {
        matches!(self, Link::Udp { peer: None, .. })
    }

    /// Passes bytes of the vehicle on to somebody else. Who left meanwhile misses nothing.
    pub fn pass_on(&self, bytes: &[u8], to: SocketAddr) {
        if let Link::Udp { socket, .. } = self {
            let _ = socket.send_to(bytes, to);
        }
    }

    /// Waits for bytes at most `timeout`; 0 bytes when none came. And where they came from, on a wire of many ends.
    pub fn receive(
        &mut self,
        buffer: &mut [u8; READ_BYTES],
        timeout: Duration,
    ) -> std::io::Result<(usize, Option<SocketAddr>)> {
        // A zero timeout would mean "for ever".
        let timeout = Some(timeout.max(Duration::from_millis(1)));
        let result = match self {
            Link::Udp { socket, .. } | Link::Guest { socket, .. } => {
                socket.set_read_timeout(timeout)?;
                socket.recv_from(buffer).map(|(n, from)| (n, Some(from)))
            }
            Link::Tcp(stream) => {
                stream.set_read_timeout(timeout)?;
                match stream.read(buffer) {
                    Ok(0) => Err(ErrorKind::ConnectionAborted.into()),
                    read => read.map(|n| (n, None)),
                }
            }
        };
        match result {
            // Refused: nobody listens at the peer's port yet.
            Err(e)
                if matches!(
                    e.kind(),
                    ErrorKind::WouldBlock
                        | ErrorKind::TimedOut
                        | ErrorKind::Interrupted
                        | ErrorKind::ConnectionRefused
                ) =>
            {
                Ok((0, None))
            }
            other => other,
        }
    }

    /// Sends one frame. Before a peer is known there is nobody to send to.
    pub fn send(&mut self, bytes: &[u8]) -> std::io::Result<()> {
        match self {
            Link::Udp { peer: None, .. } => Ok(()),
            Link::Udp { socket, peer: Some(peer) } | Link::Guest { socket, port: peer } => {
                match socket.send_to(bytes, *peer) {
                    Err(e) if e.kind() != ErrorKind::ConnectionRefused => Err(e),
                    _ => Ok(()),
                }
            }
            Link::Tcp(stream) => stream.write_all(bytes),
        }
    }
}
