//! Port 15: what answers without meaning anything, the same both ways.
//!
//! Source: `docs/functional-areas/crtp/crtp_link.md`; its table names port 13, `crtp.h` and the packets on the air
//! 15.

use super::packet::Place;
use super::wire::{Reader, Writer};

/// What the board sends for any packet to [`Place::LinkSource`], so that a client knows that there is a version to
/// ask for.
pub const SOURCE: [u8; super::packet::MAX_PAYLOAD] = {
    let name = b"Bitcraze Crazyflie";
    let mut padded = [0; super::packet::MAX_PAYLOAD];
    let mut at = 0;
    while at < name.len() {
        padded[at] = name[at];
        at += 1;
    }
    padded
};

/// One packet of the port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Link<'a> {
    /// Comes back as it is.
    Echo(&'a [u8]),
    /// To the board: asks for [`SOURCE`]. From the board: is it.
    Source(&'a [u8]),
    /// Is heard and thrown away.
    Sink(&'a [u8]),
    /// Gives a radio that is polled its turn. Its bytes are the radios' own talk.
    Null(&'a [u8]),
}

impl<'a> Link<'a> {
    pub(super) fn write(&self) -> Writer {
        let (place, bytes) = match *self {
            Self::Echo(bytes) => (Place::LinkEcho, bytes),
            Self::Source(bytes) => (Place::LinkSource, bytes),
            Self::Sink(bytes) => (Place::LinkSink, bytes),
            Self::Null(bytes) => (Place::LinkNull, bytes),
        };
        Writer::to(place).bytes(bytes)
    }

    /// Of a packet of this place; `None`: it is another port's.
    pub(super) fn read(place: Place, reader: &mut Reader<'a>) -> Option<Self> {
        let kind = match place {
            Place::LinkEcho => Self::Echo,
            Place::LinkSource => Self::Source,
            Place::LinkSink => Self::Sink,
            Place::LinkNull => Self::Null,
            _ => return None,
        };
        Some(kind(reader.rest()))
    }
}
