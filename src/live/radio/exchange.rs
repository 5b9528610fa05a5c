//! What goes over the air next and what an answer means: setpoints, requests and polls on a link that loses a part.
//!
//! The dongle sends a packet, the vehicle's radio acknowledges it, and whatever the vehicle has to say comes with that. In
//! *safelink* each side has a counter of one bit for either direction: a packet that is repeated because its
//! acknowledgement was lost is taken once, and so is what came with it (crazyflie2-nrf-firmware 32b6ecb, `src/esb.c`). No
//! clock, no device.

use haltere_core::time::HostTime;
use haltere_dialect::crtp::packet::{MAX_PACKET, Packet, Place};

use crate::live::packets::{Next, Waiting, is_fresh};

/// Asks for safelink; comes back as it is where that is known.
const SAFELINK: [u8; 3] = [0xFF, 0x05, 0x01];
/// Acknowledged so often without coming back, it is not known.
const MOST_ASKED: u32 = 10;
/// Our counters in the header: of what we send, and of what we have received.
const UP: u8 = 0x08;
const DOWN: u8 = 0x04;
const COUNTERS: u8 = UP | DOWN;
/// A vehicle that was not heard for so long may have been restarted, s: safelink is asked for anew.
const SILENCE_S: f64 = 1.0;
/// Longest answer: its status and a packet of the air.
pub const MOST_ANSWER: usize = 33;

/// What the dongle says of a packet (crazyradio2-firmware c0d2c17, `docs/development/compatible-usb-protocol.md`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Answer<'a> {
    /// The vehicle's radio has acknowledged it.
    pub acknowledged: bool,
    /// How often the dongle has repeated it.
    pub repeated: u8,
    /// What came with that.
    pub packet: &'a [u8],
}

impl<'a> Answer<'a> {
    /// As it comes from the dongle.
    pub fn read(bytes: &'a [u8]) -> Self {
        let (status, packet) = bytes.split_first().map_or((0, &[][..]), |(s, rest)| (*s, rest));
        let acknowledged = status & 1 != 0;
        Self {
            acknowledged,
            repeated: status >> 4,
            packet: if acknowledged { packet } else { &[] },
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Link {
    /// It is asked whether it knows safelink, so often acknowledged already.
    Asked(u32),
    /// It does; our counters.
    Safe { up: u8, down: u8 },
    /// It does not.
    Plain,
}

/// What is on the air and not acknowledged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Flight {
    Nothing,
    Poll,
    Setpoint,
    Request(Packet),
}

/// What the link came to in a while.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Quality {
    /// Packets on the air, and those that were acknowledged.
    pub sent: u32,
    pub acknowledged: u32,
    /// Repetitions by the dongle.
    pub repeated: u32,
    /// Setpoints acknowledged.
    pub setpoints: u32,
}

/// One vehicle on the air.
#[derive(Debug)]
pub struct Exchange {
    pub waiting: Waiting,
    link: Link,
    flight: Flight,
    /// What is acknowledged now may be what was sent before: the vehicle takes a repeated packet for the same.
    is_doubtful: bool,
    /// The setpoint on the air, and when it was given to us.
    setpoint: Option<(Packet, HostTime)>,
    /// More waits at the vehicle.
    has_more: bool,
    heard_at: Option<HostTime>,
    quality: Quality,
}

impl Default for Exchange {
    fn default() -> Self {
        Self {
            waiting: Waiting::default(),
            link: Link::Asked(0),
            flight: Flight::Nothing,
            is_doubtful: false,
            setpoint: None,
            has_more: false,
            heard_at: None,
            quality: Quality::default(),
        }
    }
}

impl Exchange {
    /// Whether the next packet should go at once.
    pub fn is_busy(&self) -> bool {
        self.has_more || self.flight != Flight::Nothing || !self.waiting.is_empty()
    }

    /// Whether something of ours has not arrived yet.
    pub fn owes(&self) -> bool {
        !matches!(self.flight, Flight::Nothing | Flight::Poll) || !self.waiting.is_empty()
    }

    /// Whether it answers.
    pub fn is_heard(&self, now: HostTime) -> bool {
        self.heard_at.is_some_and(|at| now.seconds_since(at) < SILENCE_S)
    }

    /// What the link came to since this was asked last.
    pub fn quality(&mut self) -> Quality {
        std::mem::take(&mut self.quality)
    }

    /// The packet that goes on the air now.
    pub fn next(&mut self, now: HostTime) -> ([u8; MAX_PACKET], usize) {
        if self.link != Link::Plain && self.heard_at.is_some() && !self.is_heard(now) {
            (self.link, self.heard_at) = (Link::Asked(0), None);
        }
        self.quality.sent += 1;
        if let Link::Asked(_) = self.link {
            let mut bytes = [0; MAX_PACKET];
            bytes[..SAFELINK.len()].copy_from_slice(&SAFELINK);
            return (bytes, SAFELINK.len());
        }
        let packet = self.packet(now);
        let mut bytes = [0; MAX_PACKET];
        let whole = packet.bytes();
        if let Some(to) = bytes.get_mut(..whole.len()) {
            to.copy_from_slice(whole);
        }
        if let Link::Safe { up, down } = self.link {
            bytes[0] = (bytes[0] & !COUNTERS) | up | down;
        }
        (bytes, whole.len())
    }

    fn packet(&mut self, now: HostTime) -> Packet {
        if let Flight::Request(packet) = self.flight {
            return packet;
        }
        // A setpoint or a poll that was not acknowledged gives way to the newest setpoint; where that one is too old as
        // well, to a poll.
        if self.flight != Flight::Nothing {
            let given_at = self.waiting.setpoint_at();
            if let Some(newer) = self.waiting.setpoint(now) {
                self.is_doubtful = true;
                self.setpoint = given_at.map(|at| (newer, at));
                self.flight = Flight::Setpoint;
                return newer;
            }
            if let (Flight::Setpoint, Some((same, at))) = (self.flight, self.setpoint)
                && is_fresh(now, at)
            {
                return same;
            }
            self.is_doubtful |= self.flight == Flight::Setpoint;
            (self.flight, self.setpoint) = (Flight::Poll, None);
            return Packet::new(Place::LinkNull);
        }
        let given_at = self.waiting.setpoint_at();
        match self.waiting.next(now) {
            Some(Next::Setpoint(packet)) => {
                self.setpoint = given_at.map(|at| (packet, at));
                self.flight = Flight::Setpoint;
                packet
            }
            Some(Next::Request(packet)) => {
                self.flight = Flight::Request(packet);
                packet
            }
            None => {
                self.flight = Flight::Poll;
                Packet::new(Place::LinkNull)
            }
        }
    }

    /// What the dongle has answered; the packet of the vehicle, if one came.
    pub fn answered(&mut self, now: HostTime, answer: Answer<'_>) -> Option<Packet> {
        self.quality.repeated += u32::from(answer.repeated);
        self.has_more = false;
        if !answer.acknowledged {
            return None;
        }
        self.quality.acknowledged += 1;
        self.heard_at = Some(now);
        if let Link::Asked(times) = self.link {
            self.link = if answer.packet == SAFELINK {
                Link::Safe { up: 0, down: 0 }
            } else if times + 1 >= MOST_ASKED {
                Link::Plain
            } else {
                Link::Asked(times + 1)
            };
            // What was on the air is sent again, where it is not too old: better twice than never.
            return None;
        }
        self.landed();
        let is_new = match &mut self.link {
            Link::Safe { up, down } => {
                *up ^= UP;
                let is_new = answer.packet.first().is_some_and(|head| head & DOWN == *down);
                if is_new {
                    *down ^= DOWN;
                } else if !answer.packet.is_empty() {
                    // Its counter always is ours, be it a repetition or not: this radio has been restarted.
                    self.link = Link::Asked(0);
                }
                is_new
            }
            Link::Asked(_) | Link::Plain => true,
        };
        let packet = Packet::read(answer.packet).ok().filter(|_| is_new)?;
        let says_something = packet.place() != Ok(Place::LinkNull);
        self.has_more = says_something;
        says_something.then_some(packet)
    }

    /// What was on the air has been taken, or one of those in whose place it was.
    fn landed(&mut self) {
        let is_doubtful = std::mem::take(&mut self.is_doubtful) && self.link != Link::Plain;
        let flight = std::mem::replace(&mut self.flight, Flight::Nothing);
        let Some((packet, at)) = self.setpoint.take() else { return };
        if flight != Flight::Setpoint {
            return;
        }
        if is_doubtful && self.waiting.setpoint_at().is_none() {
            self.waiting.put(at, packet.bytes());
        } else {
            self.quality.setpoints += 1;
        }
    }
}
