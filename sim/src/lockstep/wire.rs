//! Ground endpoints of a run in lockstep: UDP sockets that never wait. Each station gets a link of its own,
//! in the order in which they come, as with the companion.

use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};

use anyhow::{Context, Result, anyhow, bail};
use haltere_model::lockstep::Lockstep;
use haltere_pilot::settings::{Address, GroundConfig, HostPort};
use haltere_pilot::{Input, LinkId, PilotConfig};

/// Largest datagram that is sent: below the MTU of any network.
const DATAGRAM_BYTES: usize = 1400;
/// Most datagrams of an endpoint that are taken in at once.
const MOST_AT_ONCE: usize = 256;

/// One endpoint.
#[derive(Debug)]
struct Endpoint {
    address: Address,
    socket: UdpSocket,
    /// Number of its first link.
    first: u8,
    /// Who has its places.
    stations: Vec<Option<SocketAddr>>,
}

/// All of them.
#[derive(Debug)]
pub struct Wires {
    endpoints: Vec<Endpoint>,
}

fn resolve(address: &Address, at: &HostPort) -> Result<SocketAddr> {
    (at.host.as_str(), at.port)
        .to_socket_addrs()
        .ok()
        .and_then(|mut all| all.next())
        .with_context(|| format!("ground.endpoints: {address}: the host is not known"))
}

impl Wires {
    /// Opens the endpoints of a configuration.
    pub fn open(config: &GroundConfig, pilot: &PilotConfig) -> Result<Self> {
        let mut first = 0;
        let mut all = Vec::new();
        for (endpoint, told) in config.endpoints.iter().zip(&pilot.endpoints) {
            let seats = told.stations.max(1);
            let mut stations = vec![None; usize::from(seats)];
            let address = endpoint.address.clone();
            let socket = match &address {
                Address::UdpIn(at) => UdpSocket::bind(resolve(&address, at)?).map_err(|error| {
                    anyhow!(
                        "ground.endpoints: {address}: cannot listen there: {error}; name another port"
                    )
                })?,
                Address::UdpOut(to) => {
                    let peer = resolve(&address, to)?;
                    stations[0] = Some(peer);
                    UdpSocket::bind(if peer.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" })
                        .context("ground.endpoints: no socket")?
                }
                other => {
                    bail!("ground.endpoints: {other}: lockstep speaks UDP, use udpin or udpout")
                }
            };
            socket.set_nonblocking(true).context("ground.endpoints: no socket")?;
            all.push(Endpoint { address, socket, first, stations });
            first = first.saturating_add(seats);
        }
        Ok(Self { endpoints: all })
    }

    /// As clients write them.
    pub fn addresses(&self) -> Vec<String> {
        self.endpoints.iter().map(|endpoint| endpoint.address.for_client()).collect()
    }

    /// Whether somebody has this link from the start.
    pub fn is_open(&self, link: u8) -> bool {
        self.endpoints.iter().any(|endpoint| {
            let place = link.checked_sub(endpoint.first).map(usize::from);
            place.and_then(|n| endpoint.stations.get(n)).is_some_and(Option::is_some)
        })
    }

    /// Hands in what has come.
    pub fn receive(&mut self, lockstep: &mut Lockstep) {
        let mut buffer = [0; 4096];
        for endpoint in &mut self.endpoints {
            for _ in 0..MOST_AT_ONCE {
                // An error that is not `WouldBlock` is about an earlier datagram that nobody took.
                let (length, from) = match endpoint.socket.recv_from(&mut buffer) {
                    Ok(received) => received,
                    Err(error) if error.kind() == std::io::ErrorKind::ConnectionRefused => continue,
                    Err(_) => break,
                };
                let known = endpoint.stations.iter().position(|s| *s == Some(from));
                let place = known.or_else(|| endpoint.stations.iter().position(Option::is_none));
                let Some(place) = place else {
                    tracing::warn!(
                        "{from} refused: {} stations are connected",
                        endpoint.stations.len()
                    );
                    continue;
                };
                let link = endpoint.first.saturating_add(u8::try_from(place).unwrap_or(u8::MAX));
                if known.is_none() {
                    endpoint.stations[place] = Some(from);
                    lockstep.input(Input::LinkUp { link: LinkId::Ground(link) });
                }
                lockstep.ground_in_at(link, buffer.get(..length).unwrap_or_default());
            }
        }
    }

    /// Sends what is for the stations: whole frames, as many as a datagram holds.
    pub fn send(&mut self, lockstep: &mut Lockstep) {
        for endpoint in &self.endpoints {
            for (n, station) in (endpoint.first..).zip(&endpoint.stations) {
                let bytes = lockstep.ground_out_of(n);
                if let Some(peer) = station {
                    for datagram in datagrams(bytes) {
                        // Nobody there: as with any datagram.
                        let _ = endpoint.socket.send_to(datagram, peer);
                    }
                }
                lockstep.clear_ground_out_of(n);
            }
        }
    }
}

/// Cuts a stream of MAVLink 2 frames of our own at the ends of frames: clients take a datagram for a whole
/// number of them.
fn datagrams(bytes: &[u8]) -> impl Iterator<Item = &[u8]> {
    let mut rest = bytes;
    std::iter::from_fn(move || {
        let mut end = 0;
        while let Some(frame) = frame_length(rest.get(end..)?) {
            if end > 0 && end + frame > DATAGRAM_BYTES {
                break;
            }
            end += frame;
        }
        // What is no frame cannot come from us; it goes as it is.
        let (datagram, after) = rest.split_at_checked(if end == 0 { rest.len() } else { end })?;
        rest = after;
        (!datagram.is_empty()).then_some(datagram)
    })
}

fn frame_length(bytes: &[u8]) -> Option<usize> {
    let signed = bytes.get(2)? & 1 != 0;
    let length = 12 + usize::from(*bytes.get(1)?) + if signed { 13 } else { 0 };
    (bytes.len() >= length).then_some(length)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_datagrams_hold_whole_frames_and_all_of_them() {
        let frame = |payload: u8| {
            let mut frame = vec![0xfd, payload, 0];
            frame.resize(12 + usize::from(payload), 7);
            frame
        };
        let stream: Vec<u8> = (0..60).flat_map(|n| frame(n * 4)).collect();
        let cut: Vec<&[u8]> = datagrams(&stream).collect();
        assert_eq!(cut.concat(), stream);
        for datagram in &cut {
            assert!(datagram.len() <= DATAGRAM_BYTES && datagram[0] == 0xfd);
            let mut rest = *datagram;
            while !rest.is_empty() {
                rest = &rest[frame_length(rest).unwrap()..];
            }
        }
        assert_eq!(datagrams(&[]).count(), 0);
        assert_eq!(datagrams(&[1, 2]).collect::<Vec<_>>(), [&[1, 2]]);
    }
}
