//! Entries of a log, as they were recorded.

use std::net::SocketAddr;

use prost::Message as _;

use super::channels::{self, Decoded};
use super::messages::Message;
use super::pb;
use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_pilot::services::FileFault;
use haltere_pilot::{Input, LinkId, Recording};

/// An input of the core, as recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum RawInput {
    /// See [`Input::Bytes`].
    Bytes {
        /// From where.
        link: LinkId,
        /// As read.
        bytes: Vec<u8>,
    },
    /// See [`Input::LinkUp`].
    LinkUp {
        /// Which.
        link: LinkId,
    },
    /// See [`Input::LinkDown`].
    LinkDown {
        /// Which.
        link: LinkId,
    },
    /// See [`Input::Backlog`].
    Backlog {
        /// On which link.
        link: LinkId,
        /// Whether it is so.
        is_full: bool,
    },
    /// See [`Input::Peer`].
    Peer {
        /// Which link.
        link: LinkId,
        /// Who speaks.
        address: SocketAddr,
    },
    /// See [`Input::Lost`].
    Lost {
        /// On which link.
        link: LinkId,
        /// Why.
        reason: DropReason,
        /// How many.
        count: u64,
    },
    /// See [`Input::File`].
    File {
        /// Ticket of the request.
        ticket: u32,
        /// Why it was not done.
        fault: Option<FileFault>,
        /// What was asked for.
        bytes: Vec<u8>,
    },
    /// See [`Input::Calendar`].
    Calendar {
        /// Since 1970-01-01 UTC, µs.
        unix_us: i64,
    },
    /// See [`Input::Recording`].
    Recording {
        /// How it stands.
        state: Recording,
        /// Why.
        why: String,
    },
    /// See [`Input::EndAsked`].
    EndAsked,
    /// See [`Input::Wake`].
    Wake,
}

impl RawInput {
    /// As the core takes it.
    pub fn as_input(&self) -> Input<'_> {
        match self {
            RawInput::Bytes { link, bytes } => Input::Bytes { link: *link, bytes },
            RawInput::LinkUp { link } => Input::LinkUp { link: *link },
            RawInput::LinkDown { link } => Input::LinkDown { link: *link },
            RawInput::Backlog { link, is_full } => {
                Input::Backlog { link: *link, is_full: *is_full }
            }
            RawInput::Peer { link, address } => Input::Peer { link: *link, address: *address },
            RawInput::Lost { link, reason, count } => {
                Input::Lost { link: *link, reason: *reason, count: *count }
            }
            RawInput::File { ticket, fault, bytes } => {
                Input::File { ticket: *ticket, result: fault.map_or(Ok(()), Err), bytes }
            }
            RawInput::Calendar { unix_us } => Input::Calendar { unix_us: *unix_us },
            RawInput::Recording { state, why } => Input::Recording { state: *state, why },
            RawInput::EndAsked => Input::EndAsked,
            RawInput::Wake => Input::Wake,
        }
    }
}

/// One entry of a log, in the order of recording.
#[derive(Debug, Clone, PartialEq)]
// One at a time is alive: a box for the large ones would cost more than it saves.
#[allow(clippy::large_enum_variant)]
pub enum Entry {
    /// Handed to the core.
    Input {
        /// Place in the order of inputs and outputs, from 1.
        sequence: u64,
        /// Time that the core was told.
        at: HostTime,
        /// What.
        input: RawInput,
    },
    /// Sent by the core.
    Output {
        /// Place in the order of inputs and outputs, from 1.
        sequence: u64,
        /// Time of the wake-up.
        at: HostTime,
        /// Where to.
        link: LinkId,
        /// What.
        bytes: Vec<u8>,
    },
    /// A decoded topic.
    Decoded(Decoded),
    /// Entries are missing here.
    Hole(pb::Hole),
    /// The recorder closed the log.
    Closing(pb::Closing),
}

/// `None`: the head, or a channel that this version does not know.
pub(super) fn decode(message: &Message<'_>) -> Result<Option<Entry>, prost::DecodeError> {
    let channel = &*message.channel;
    let data = message.data;
    if let Some(decoded) = Decoded::decode(channel, data) {
        return decoded.map(|decoded| Some(Entry::Decoded(decoded)));
    }
    let raw_link = |prefix| channel.strip_prefix(prefix).and_then(channels::link_from_name);
    Ok(Some(if channel == channels::WAKE.0 {
        let wake = pb::Wake::decode(data)?;
        Entry::Input {
            sequence: wake.sequence,
            at: HostTime::from_us(wake.host_time_us),
            input: RawInput::Wake,
        }
    } else if channel == channels::FILE.0 {
        let answer = pb::FileAnswer::decode(data)?;
        // A fault of a newer build: it was not done, for some reason.
        let known = |number| u8::try_from(number).ok().and_then(FileFault::from_number);
        let fault = (answer.fault != 0).then(|| known(answer.fault).unwrap_or(FileFault::Failed));
        Entry::Input {
            sequence: answer.sequence,
            at: HostTime::from_us(answer.host_time_us),
            input: RawInput::File { ticket: answer.ticket, fault, bytes: answer.data },
        }
    } else if channel == channels::CALENDAR.0 {
        let calendar = pb::Calendar::decode(data)?;
        Entry::Input {
            sequence: calendar.sequence,
            at: HostTime::from_us(calendar.host_time_us),
            input: RawInput::Calendar { unix_us: calendar.unix_us },
        }
    } else if channel == channels::END_ASKED.0 {
        let asked = pb::EndAsked::decode(data)?;
        Entry::Input {
            sequence: asked.sequence,
            at: HostTime::from_us(asked.host_time_us),
            input: RawInput::EndAsked,
        }
    } else if channel == channels::RECORDING.0 {
        let told = pb::RecordingState::decode(data)?;
        // A state of a newer build.
        let state = u8::try_from(told.state).ok().and_then(Recording::from_number);
        let Some(state) = state else { return Ok(None) };
        Entry::Input {
            sequence: told.sequence,
            at: HostTime::from_us(told.host_time_us),
            input: RawInput::Recording { state, why: told.why },
        }
    } else if channel == channels::EVENT.0 {
        let event = pb::LinkEvent::decode(data)?;
        let Ok(number) = u8::try_from(event.link) else { return Ok(None) };
        let link = LinkId::from_number(number);
        let input = match event.kind() {
            pb::link_event::Kind::Up => RawInput::LinkUp { link },
            pb::link_event::Kind::Down => RawInput::LinkDown { link },
            pb::link_event::Kind::Full => RawInput::Backlog { link, is_full: true },
            pb::link_event::Kind::Room => RawInput::Backlog { link, is_full: false },
            pb::link_event::Kind::Unknown => return Ok(None),
        };
        Entry::Input { sequence: event.sequence, at: HostTime::from_us(event.host_time_us), input }
    } else if channel == channels::PEER.0 {
        let peer = pb::LinkPeer::decode(data)?;
        let (Ok(number), Ok(address)) = (u8::try_from(peer.link), peer.address.parse()) else {
            return Ok(None);
        };
        let input = RawInput::Peer { link: LinkId::from_number(number), address };
        Entry::Input { sequence: peer.sequence, at: HostTime::from_us(peer.host_time_us), input }
    } else if channel == channels::LOST.0 {
        let lost = pb::Lost::decode(data)?;
        let reason = DropReason::ALL.into_iter().find(|reason| reason.name() == lost.reason);
        let (Ok(number), Some(reason)) = (u8::try_from(lost.link), reason) else { return Ok(None) };
        let input = RawInput::Lost { link: LinkId::from_number(number), reason, count: lost.count };
        Entry::Input { sequence: lost.sequence, at: HostTime::from_us(lost.host_time_us), input }
    } else if let Some(link) = raw_link("/in/") {
        let raw = pb::RawBytes::decode(data)?;
        Entry::Input {
            sequence: raw.sequence,
            at: HostTime::from_us(raw.host_time_us),
            input: RawInput::Bytes { link, bytes: raw.data },
        }
    } else if let Some(link) = raw_link("/out/") {
        let raw = pb::RawBytes::decode(data)?;
        Entry::Output {
            sequence: raw.sequence,
            at: HostTime::from_us(raw.host_time_us),
            link,
            bytes: raw.data,
        }
    } else if channel == channels::HOLE.0 {
        Entry::Hole(pb::Hole::decode(data)?)
    } else if channel == channels::CLOSING.0 {
        Entry::Closing(pb::Closing::decode(data)?)
    } else {
        return Ok(None);
    }))
}
