//! The board's MAVLink line: one UDP socket that never waits, and one companion that is heard on it.

use std::io::ErrorKind;
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};

use anyhow::{Context, Result, bail};
use haltere_pilot::settings::{Address, HostPort};

/// Largest datagram that is sent: below the MTU of any network.
const DATAGRAM_BYTES: usize = 1400;
/// Port that the companion listens at where nobody asked for another, and how many are tried.
const PORT: u16 = 14_600;
const PORTS: u16 = 100;
/// We speak from a port so far above that one where nobody asked for it: so no second simulator speaks there.
const OWN_PORT_ABOVE: u16 = 1000;
/// A companion that was silent for so long may be followed by another one, µs: three of its heartbeats.
const SILENCE_US: u64 = 3_000_000;
/// People are told again that a second one speaks after this time, µs.
const TELL_AGAIN_US: u64 = 10_000_000;

/// The socket.
#[derive(Debug)]
pub struct BoardWire {
    socket: UdpSocket,
    /// Where we speak to before anybody has spoken to us.
    place: Option<SocketAddr>,
    companion: Companion,
    own: Address,
    /// What the companion has to be told.
    companion_address: Address,
    dropped: u64,
}

impl BoardWire {
    /// Opens our end as somebody asked for it.
    pub fn open(address: &Address) -> Result<Self> {
        let resolve = |at: &HostPort| {
            (at.host.as_str(), at.port)
                .to_socket_addrs()
                .ok()
                .and_then(|mut all| all.next())
                .with_context(|| format!("--board {address}: the host is not known"))
        };
        match address {
            Address::UdpIn(at) => {
                let place = resolve(at)?;
                let socket = UdpSocket::bind(place).map_err(|why| {
                    anyhow::anyhow!(
                        "--board {address}: cannot listen there: {why}; without --board a free port is taken"
                    )
                })?;
                Self::new(socket, None, address.clone(), Address::UdpOut(at.clone()))
            }
            Address::UdpOut(to) => {
                let place = resolve(to)?;
                let any = if place.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
                Self::to(to, place, UdpSocket::bind(any).context("--board: no socket")?)
            }
            other => bail!(
                "--board {other}: the simulated board speaks UDP, use udpin:HOST:PORT or \
                 udpout:HOST:PORT"
            ),
        }
    }

    /// Opens our end where no other simulator is: at the usual port, else at the next one that is free.
    pub fn open_free() -> Result<Self> {
        for port in PORT..PORT + PORTS {
            let Ok(socket) = UdpSocket::bind(("127.0.0.1", port + OWN_PORT_ABOVE)) else {
                continue;
            };
            let to = HostPort { host: "127.0.0.1".into(), port };
            return Self::to(&to, SocketAddr::from(([127, 0, 0, 1], port)), socket);
        }
        bail!("no free port for the board: name one with --board udpout:127.0.0.1:PORT")
    }

    fn to(to: &HostPort, place: SocketAddr, socket: UdpSocket) -> Result<Self> {
        let (own, companion) = (Address::UdpOut(to.clone()), Address::UdpIn(to.clone()));
        Self::new(socket, Some(place), own, companion)
    }

    fn new(
        socket: UdpSocket,
        place: Option<SocketAddr>,
        own: Address,
        companion_address: Address,
    ) -> Result<Self> {
        socket.set_nonblocking(true).context("--board: no socket")?;
        let companion = Companion::default();
        Ok(Self { socket, place, companion, own, companion_address, dropped: 0 })
    }

    /// Address of our own end.
    pub fn own_address(&self) -> &Address {
        &self.own
    }

    /// Address to write into the companion's `board.address`.
    pub fn companion_address(&self) -> &Address {
        &self.companion_address
    }

    /// Bytes that could not be sent.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Datagrams of others than the companion.
    pub fn refused(&self) -> u64 {
        self.companion.refused
    }

    /// Reads what has come of the one companion that is heard; of a second one it is told that it speaks.
    pub fn read(&mut self, now_us: u64, into: &mut Vec<u8>) {
        let mut buffer = [0; 2048];
        loop {
            match self.socket.recv_from(&mut buffer) {
                Ok((n, from)) => match self.companion.hear(from, now_us) {
                    Hearing::Heard => into.extend_from_slice(buffer.get(..n).unwrap_or_default()),
                    Hearing::Refused => {}
                    Hearing::RefusedAndTold(first) => {
                        tracing::warn!(
                            "a second companion speaks to this board: {from}, beside {first}; it is not heard, \
                             nothing is sent to it"
                        );
                    }
                },
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

    /// Sends whole frames. Before anybody has spoken to us there may be nobody to send to.
    pub fn write(&mut self, now_us: u64, bytes: &[u8]) {
        let Some(peer) = self.companion.heard(now_us).or(self.place) else { return };
        for datagram in bytes.chunks(DATAGRAM_BYTES) {
            if self.socket.send_to(datagram, peer).is_err() {
                self.dropped += datagram.len() as u64;
            }
        }
    }
}

/// Who commands the board: the first who speaks, until he falls silent. Two would fly one vehicle turn by turn.
#[derive(Debug, Default)]
struct Companion {
    /// And when it was heard last.
    first: Option<(SocketAddr, u64)>,
    told_us: Option<u64>,
    refused: u64,
}

/// What becomes of a datagram.
#[derive(Debug, PartialEq, Eq)]
enum Hearing {
    Heard,
    Refused,
    /// The same, and people are to know; beside whom.
    RefusedAndTold(SocketAddr),
}

impl Companion {
    fn heard(&self, now_us: u64) -> Option<SocketAddr> {
        let (first, last_us) = self.first?;
        (now_us.saturating_sub(last_us) < SILENCE_US).then_some(first)
    }

    fn hear(&mut self, from: SocketAddr, now_us: u64) -> Hearing {
        match self.heard(now_us) {
            Some(first) if first != from => {
                self.refused += 1;
                let again = |told_us| now_us.saturating_sub(told_us) >= TELL_AGAIN_US;
                if !self.told_us.is_none_or(again) {
                    return Hearing::Refused;
                }
                self.told_us = Some(now_us);
                Hearing::RefusedAndTold(first)
            }
            _ => {
                self.first = Some((from, now_us));
                Hearing::Heard
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_one_companion_is_heard_and_the_second_when_the_first_is_silent() {
        let at = |port: u16| SocketAddr::from(([127, 0, 0, 1], port));
        let s = |s: f64| (s * 1e6) as u64;
        let mut companion = Companion::default();
        assert_eq!(companion.heard(0), None);
        assert_eq!(companion.hear(at(1), s(1.0)), Hearing::Heard);
        assert_eq!(companion.hear(at(2), s(1.1)), Hearing::RefusedAndTold(at(1)));
        assert_eq!(companion.hear(at(2), s(2.0)), Hearing::Refused, "told already");
        assert_eq!(companion.hear(at(1), s(3.9)), Hearing::Heard);
        assert_eq!(companion.heard(s(4.0)), Some(at(1)));
        for n in 0..70 {
            companion.hear(at(1), s(4.0 + f64::from(n) * 0.1));
        }
        assert_eq!(companion.hear(at(2), s(11.1)), Hearing::RefusedAndTold(at(1)), "again");
        assert_eq!(companion.hear(at(2), s(14.0)), Hearing::Heard, "the first is gone");
        assert_eq!(companion.hear(at(1), s(14.1)), Hearing::Refused);
        assert_eq!((companion.heard(s(14.2)), companion.refused), (Some(at(2)), 4));
    }

    #[test]
    fn prop_two_boards_take_two_ports_and_one_that_is_taken_is_refused() {
        let first = BoardWire::open_free().unwrap();
        let second = BoardWire::open_free().unwrap();
        assert_ne!(first.companion_address(), second.companion_address());
        let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
        let asked = format!("udpin:{}", taken.local_addr().unwrap()).parse().unwrap();
        let error = BoardWire::open(&asked).unwrap_err().to_string();
        assert!(error.contains("cannot listen there"), "{error}");
    }
}
