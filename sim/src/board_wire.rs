//! The board's MAVLink line: one UDP socket that never waits.

use std::io::ErrorKind;
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};

use anyhow::{Context, Result, bail};
use haltere_pilot::settings::{Address, HostPort};

/// Largest datagram that is sent: below the MTU of any network.
const DATAGRAM_BYTES: usize = 1400;

/// The socket.
#[derive(Debug)]
pub struct BoardWire {
    socket: UdpSocket,
    peer: Option<SocketAddr>,
    /// What the companion has to be told.
    companion: Address,
    dropped: u64,
}

impl BoardWire {
    /// Opens our end.
    pub fn open(address: &Address) -> Result<Self> {
        let resolve = |at: &HostPort| {
            (at.host.as_str(), at.port)
                .to_socket_addrs()
                .ok()
                .and_then(|mut all| all.next())
                .with_context(|| format!("--board {address}: the host is not known"))
        };
        let (socket, peer, companion) = match address {
            Address::UdpIn(at) => {
                let socket = UdpSocket::bind(resolve(at)?)
                    .with_context(|| format!("--board {address}: cannot listen there"))?;
                (socket, None, Address::UdpOut(at.clone()))
            }
            Address::UdpOut(to) => {
                let place = resolve(to)?;
                let any = if place.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
                let socket = UdpSocket::bind(any).context("--board: no socket")?;
                (socket, Some(place), Address::UdpIn(to.clone()))
            }
            other => bail!(
                "--board {other}: the simulated board speaks UDP, use udpin:HOST:PORT or \
                 udpout:HOST:PORT"
            ),
        };
        socket.set_nonblocking(true).context("--board: no socket")?;
        Ok(Self { socket, peer, companion, dropped: 0 })
    }

    /// Address to write into the companion's `board.address`.
    pub fn companion_address(&self) -> &Address {
        &self.companion
    }

    /// Bytes that could not be sent.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Reads what has come.
    pub fn read(&mut self, into: &mut Vec<u8>) {
        let mut buffer = [0; 2048];
        loop {
            match self.socket.recv_from(&mut buffer) {
                Ok((n, from)) => {
                    self.peer = Some(from);
                    into.extend_from_slice(buffer.get(..n).unwrap_or_default());
                }
                // Refused: nobody listened when we last sent. The next one may get through.
                Err(e)
                    if matches!(
                        e.kind(),
                        ErrorKind::Interrupted | ErrorKind::ConnectionRefused
                    ) => {}
                Err(_) => break,
            }
        }
    }

    /// Sends whole frames. Before anybody has spoken to us there is nobody to send to.
    pub fn write(&mut self, bytes: &[u8]) {
        let Some(peer) = self.peer else { return };
        for datagram in bytes.chunks(DATAGRAM_BYTES) {
            if self.socket.send_to(datagram, peer).is_err() {
                self.dropped += datagram.len() as u64;
            }
        }
    }
}
