//! A Crazyflie's line by UDP: a datagram is a packet, as its own clients have it (cflib 0.1.34, `crtp/udpdriver.py`).

use std::net::{SocketAddr, UdpSocket};

use anyhow::{Context as _, Result, bail};
use haltere_dialect::crtp::packet::MAX_PACKET;

/// Where such clients look for one.
const PORTS: std::ops::Range<u16> = 19_850..19_860;
/// With this header, but for the bits of the link, a packet says nothing.
const NULL: u8 = 0xF3;
/// What answers who looks for a board.
const HERE: [u8; 1] = [0xFF];

/// The socket. As by radio anybody is heard; who spoke last is answered.
#[derive(Debug)]
pub struct PacketWire {
    socket: UdpSocket,
    port: u16,
    client: Option<SocketAddr>,
    /// Bytes that could not be sent.
    pub dropped: u64,
}

impl PacketWire {
    /// Opens our end where no other simulator is.
    pub fn open_free() -> Result<Self> {
        for port in PORTS {
            let Ok(socket) = UdpSocket::bind(("127.0.0.1", port)) else { continue };
            socket.set_nonblocking(true).context("--board: no socket")?;
            return Ok(Self { socket, port, client: None, dropped: 0 });
        }
        bail!("no free port for a Crazyflie from {} to {}", PORTS.start, PORTS.end - 1)
    }

    /// Address to write into the companion's `board.address`.
    pub fn companion_address(&self) -> String {
        format!("crtpudp:127.0.0.1:{}", self.port)
    }

    /// The same as the clients of others have it.
    pub fn uri(&self) -> String {
        format!("udp://127.0.0.1:{}", self.port)
    }

    /// Reads what has come: packets, each behind its length.
    pub fn read(&mut self, into: &mut Vec<u8>) {
        let mut buffer = [0; 64];
        // So many that a flood does not hold the world up.
        for _ in 0..1000 {
            let (n, from) = match self.socket.recv_from(&mut buffer) {
                Ok(heard) => heard,
                // Refused: nobody listened when we last sent.
                Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => break,
                Err(_) => continue,
            };
            let Some(packet @ [header, ..]) = buffer.get(..n.min(MAX_PACKET + 1)) else { continue };
            if packet.len() > MAX_PACKET {
                continue;
            }
            if header & NULL == NULL {
                // Who looks is not yet who speaks.
                self.send(&HERE, from);
            } else {
                self.client = Some(from);
            }
            into.push(packet.len() as u8);
            into.extend_from_slice(packet);
        }
    }

    /// Sends packets, each behind its length.
    pub fn write(&mut self, bytes: &[u8]) {
        let Some(client) = self.client else { return };
        let mut rest = bytes;
        while let Some((len, later)) = rest.split_first() {
            let Some((packet, later)) = later.split_at_checked(usize::from(*len)) else { break };
            self.send(packet, client);
            rest = later;
        }
    }

    fn send(&mut self, packet: &[u8], to: SocketAddr) {
        if self.socket.send_to(packet, to).is_err() {
            self.dropped += packet.len() as u64;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_datagram_is_a_packet_and_who_looks_is_answered() {
        let mut wire = PacketWire::open_free().unwrap();
        let client = UdpSocket::bind("127.0.0.1:0").unwrap();
        client.set_read_timeout(Some(std::time::Duration::from_secs(5))).unwrap();
        client.connect(("127.0.0.1", wire.port)).unwrap();
        let heard = |wire: &mut PacketWire| {
            let mut bytes = Vec::new();
            while bytes.is_empty() {
                wire.read(&mut bytes);
            }
            bytes
        };
        client.send(&[0xFF]).unwrap();
        assert_eq!(heard(&mut wire), [1, 0xFF]);
        let mut buffer = [0; 64];
        assert_eq!(client.recv(&mut buffer).unwrap(), 1);
        wire.write(&[1, 0x0C]);
        client.send(&[0xDF, 0]).unwrap();
        assert_eq!(heard(&mut wire), [2, 0xDF, 0]);
        wire.write(&[2, 0xDF, 12, 1, 0x0C]);
        assert_eq!((client.recv(&mut buffer).unwrap(), buffer[1]), (2, 12));
        assert_eq!((client.recv(&mut buffer).unwrap(), buffer[0]), (1, 0x0C));
    }
}
