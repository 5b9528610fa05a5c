//! Finds a Crazyflie, by cable or on the air, and asks it what it is and where its anchors are.

use std::net::UdpSocket;
use std::time::{Duration, Instant};

use haltere_dialect::crtp::link::Link;
use haltere_dialect::crtp::loco::{self, AnchorPosition};
use haltere_dialect::crtp::memory::{MemoryAnswer, MemoryRequest};
use haltere_dialect::crtp::packet::Packet;
use haltere_dialect::crtp::platform::{PlatformAnswer, PlatformRequest};
use haltere_dialect::crtp::{FromBoard, ToBoard};

use super::Finding;
use crate::live::{apart, cable, radio};
use haltere_core::time::HostTime;
use haltere_pilot::settings::{Address, RadioPlace};

/// A question is repeated after this, and given up after that.
const AGAIN: Duration = Duration::from_millis(100);
const PATIENCE: Duration = Duration::from_secs(1);
/// One look at the link.
const LOOK: Duration = Duration::from_millis(20);
/// A trip that is longer is a silence, s; one in twenty that is slower than this is told, s: a control loop stands six of its
/// periods (the link itself refuses to arm by the median of the newest).
const SILENT_S: f64 = 2.0;
const SLOW_S: f64 = 0.06;
/// Anchors of TDoA2.
const ANCHORS: u8 = 8;
/// Room for one packet of any link.
const MOST_BYTES: usize = 64;

/// What it told.
#[derive(Debug, Clone, PartialEq)]
pub struct Met {
    /// Tag of its firmware.
    pub firmware: String,
    /// Version of the protocol.
    pub protocol: u32,
    /// Anchors that say where they are: id and place, z up, m.
    pub anchors: Vec<(u8, [f32; 3])>,
}

impl std::fmt::Display for Met {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Crazyflie, firmware {}, protocol {}", self.firmware, self.protocol)
    }
}

/// A way for packets, without a core behind it.
enum Way {
    Udp(UdpSocket),
    Radio(Box<radio::Talk>),
    Cable(cable::Talk),
}

impl Way {
    fn open(address: &Address) -> Result<Self, String> {
        match address {
            Address::Radio(place) => {
                radio::Talk::open(place).map(|talk| Self::Radio(Box::new(talk)))
            }
            Address::CrtpUsb => cable::Talk::open().map(Self::Cable),
            Address::CrtpUdp(to) => {
                let open = || {
                    let socket = UdpSocket::bind("0.0.0.0:0")?;
                    socket.connect((to.host.as_str(), to.port))?;
                    socket.set_read_timeout(Some(LOOK))?;
                    Ok(Self::Udp(socket))
                };
                open().map_err(|error: std::io::Error| format!("{address}: {error}"))
            }
            _ => Err(format!("{address}: no way to a Crazyflie")),
        }
    }

    /// Sends a packet, where there is one, and looks whether one has come.
    fn turn(&mut self, packet: Option<&Packet>) -> Result<Option<Packet>, String> {
        match self {
            Self::Radio(talk) => talk.turn(packet),
            Self::Cable(talk) => talk.turn(packet, LOOK),
            Self::Udp(socket) => {
                if let Some(packet) = packet {
                    // Nobody listens yet: the next one may be heard.
                    let _ = socket.send(packet.bytes());
                }
                let mut bytes = [0; MOST_BYTES];
                let came = socket.recv(&mut bytes).ok();
                Ok(came.and_then(|len| Packet::read(bytes.get(..len)?).ok()))
            }
        }
    }

    /// Asks until it is answered; `None`: it is not.
    fn ask<T>(
        &mut self,
        question: ToBoard<'_>,
        answer: impl Fn(&FromBoard<'_>) -> Option<T>,
    ) -> Result<Option<T>, String> {
        let Some(question) = question.encode() else { return Ok(None) };
        let end = Instant::now() + PATIENCE;
        let mut again = Instant::now();
        while Instant::now() < end {
            let is_due = Instant::now() >= again;
            if is_due {
                again = Instant::now() + AGAIN;
            }
            let came = self.turn(is_due.then_some(&question))?;
            let told = came.as_ref().and_then(|packet| FromBoard::decode(packet).ok());
            if let Some(told) = told.as_ref().and_then(&answer) {
                return Ok(Some(told));
            }
        }
        Ok(None)
    }
}

/// Asks whoever is at `address`; `None`: nobody answers.
pub fn meet(address: &Address) -> Result<Option<Met>, String> {
    let mut way = Way::open(address)?;
    let protocol = way.ask(ToBoard::Platform(PlatformRequest::Protocol), |told| match told {
        FromBoard::Platform(PlatformAnswer::Protocol(number)) => Some(*number),
        _ => None,
    })?;
    let Some(protocol) = protocol else { return Ok(None) };
    let firmware = way.ask(ToBoard::Platform(PlatformRequest::Firmware), |told| match told {
        FromBoard::Platform(PlatformAnswer::Firmware(tag)) => Some((*tag).to_owned()),
        _ => None,
    })?;
    let mut met = Met { firmware: firmware.unwrap_or_default(), protocol, anchors: Vec::new() };
    let Some(memory) = loco_memory(&mut way)? else { return Ok(Some(met)) };
    for anchor in 0..ANCHORS {
        let address = loco::position(anchor);
        let request = MemoryRequest::Read { memory, address, len: loco::POSITION_LEN };
        let told = way.ask(ToBoard::Memory(request), |told| match told {
            FromBoard::Memory(MemoryAnswer::Read { memory: of, address: at, outcome })
                if (*of, *at) == (memory, address) =>
            {
                Some(outcome.ok().and_then(AnchorPosition::read))
            }
            _ => None,
        })?;
        if let Some(at) = told.flatten().filter(|at| at.valid) {
            met.anchors.push((anchor, at.position_m));
        }
    }
    Ok(Some(met))
}

/// Which of its memories is that of the Loco deck.
fn loco_memory(way: &mut Way) -> Result<Option<u8>, String> {
    let count = way.ask(ToBoard::Memory(MemoryRequest::Count), |told| match told {
        FromBoard::Memory(MemoryAnswer::Count(count)) => Some(*count),
        _ => None,
    })?;
    for memory in 0..count.unwrap_or(0) {
        let kind = way.ask(ToBoard::Memory(MemoryRequest::Info(memory)), |told| match told {
            FromBoard::Memory(MemoryAnswer::Info(of, info)) if *of == memory => {
                Some(info.map(|info| info.kind))
            }
            _ => None,
        })?;
        if kind.flatten() == Some(loco::TYPE) {
            return Ok(Some(memory));
        }
    }
    Ok(None)
}

/// Round trips of the echoes in what came at `at`, s: each has the time in it at which it was sent.
pub fn trips_s(at: HostTime, bytes: &[u8]) -> impl Iterator<Item = f64> {
    apart(bytes).filter_map(move |packet| {
        let packet = Packet::read(packet).ok()?;
        let Ok(FromBoard::Link(Link::Echo(sent))) = FromBoard::decode(&packet) else { return None };
        let sent = HostTime::from_us(u64::from_le_bytes(sent.try_into().ok()?));
        Some(at.seconds_since(sent)).filter(|trip_s| (0.0..SILENT_S).contains(trip_s))
    })
}

/// How long the vehicle takes to answer.
pub fn echo(trips_s: &[f64]) -> Finding {
    let what = "board: echo";
    let mut sorted = trips_s.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted.get(((sorted.len() as f64 - 1.0) * share).round() as usize);
    let (Some(median_s), Some(most_s)) = (at(0.5), at(0.95)) else {
        return Finding::problem(what, "none came back", "switch the vehicle on, go nearer");
    };
    let n = sorted.len();
    let text =
        format!("back after {:.0} ms, 95 % within {:.0} ms, of {n}", median_s * 1e3, most_s * 1e3);
    if *most_s > SLOW_S {
        let way_out =
            "go nearer with the dongle, take another channel, or 2M; flash the dongle anew";
        Finding::warning(what, text, way_out)
    } else {
        Finding::ok(what, text)
    }
}

/// Whether anything is plugged in that may lead to one.
pub fn may_be_there() -> bool {
    cable::find().is_ok() || radio::find().is_ok()
}

/// Looks at the cable, then on the air at the address that vehicles have from the factory, with every channel and rate;
/// `say` hears what is done, and of what is not found the way out.
pub fn look(mut say: impl FnMut(&str)) -> Option<Address> {
    if cable::find().is_ok() {
        say("board: a Crazyflie is on USB");
        return Some(Address::CrtpUsb);
    }
    // Of who has another board nobody should ask for a dongle: that is said where nothing else is found.
    let dongles = radio::find().ok()?;
    for (n, dongle) in (0..).zip(dongles) {
        let factory = RadioPlace { dongle: n, ..RadioPlace::FACTORY };
        say(&format!("board: {dongle}, listening on all channels (some seconds)"));
        let open = radio::Crazyradio::open(&factory);
        match open.and_then(|mut radio| radio.scan(factory.address)) {
            Ok(found) => {
                for (channel, rate) in &found {
                    let place = RadioPlace { channel: *channel, rate: *rate, ..factory };
                    say(&format!("board: somebody answers at radio:{place}"));
                }
                if let Some((channel, rate)) = found.first().copied() {
                    return Some(Address::Radio(RadioPlace { channel, rate, ..factory }));
                }
                let of: String = factory.address.iter().map(|byte| format!("{byte:02X}")).collect();
                say(&format!(
                    "board: no Crazyflie answers at address {of}: switch it on, go nearer; one with another address is \
                     named, --board radio:{n}/CHANNEL/RATE/ADDRESS (cfclient shows all three)"
                ));
            }
            Err(why) => say(&format!("board: {why}")),
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preflight::Status;

    #[test]
    fn prop_echoes_tell_how_slow_the_way_is() {
        let sent = HostTime::from_us(5_000_000);
        let echo_of = |us: u64| {
            let packet = ToBoard::Link(Link::Echo(&us.to_le_bytes())).encode().unwrap();
            [&[packet.bytes().len() as u8], packet.bytes()].concat()
        };
        let bytes = [echo_of(sent.as_us()), echo_of(sent.as_us() - 4_000), echo_of(1)].concat();
        let all: Vec<f64> = trips_s(sent.offset_us(3_000), &bytes).collect();
        assert_eq!(
            all,
            [3000.0 * 1e-6, 7000.0 * 1e-6],
            "an echo of a start before this one is none"
        );
        assert_eq!(echo(&all).status, Status::Ok);
        assert_eq!(echo(&[0.004, 0.1, 0.1]).status, Status::Warning);
        assert_eq!(echo(&[]).status, Status::Problem);
    }
}
