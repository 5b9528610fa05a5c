//! What can happen to the core: its links by name, and the one type of all that comes in.

use core::net::SocketAddr;

use haltere_core::drops::DropReason;

use crate::out::recording::Recording;
use crate::stations::services::FileFault;

/// Most stations of one endpoint that is found by them (`udpin`, `tcpin`).
pub const MOST_STATIONS: u8 = 8;

/// Name of a link to the outside.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LinkId {
    /// The UWB tag.
    Tag,
    /// The inner-loop board.
    Board,
    /// A station, in the order of [`crate::config::PilotConfig::ground_links`].
    Ground(u8),
}

impl LinkId {
    /// Number in logs and messages: 0 tag, 1 board, 2 and up stations.
    pub fn number(self) -> u8 {
        match self {
            LinkId::Tag => 0,
            LinkId::Board => 1,
            LinkId::Ground(n) => n.saturating_add(2),
        }
    }

    /// The link with this number.
    pub fn from_number(number: u8) -> Self {
        match number {
            0 => LinkId::Tag,
            1 => LinkId::Board,
            n => LinkId::Ground(n - 2),
        }
    }
}

/// What can happen to the core.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Input<'a> {
    /// Bytes came in. The time of the call is when they were read.
    Bytes {
        /// From where.
        link: LinkId,
        /// In any chunking.
        bytes: &'a [u8],
    },
    /// What comes next on a link that many can speak on comes from this address, until another one is told.
    Peer {
        /// Which link.
        link: LinkId,
        /// Who speaks.
        address: SocketAddr,
    },
    /// A link was opened, or opened again.
    LinkUp {
        /// Which.
        link: LinkId,
    },
    /// A link was lost.
    LinkDown {
        /// Which.
        link: LinkId,
    },
    /// More waits for a link than it takes, or no longer: whoever can wait does, and nothing is thrown away.
    Backlog {
        /// On which link.
        link: LinkId,
        /// Whether it is so.
        is_full: bool,
    },
    /// The glue had to throw something away.
    Lost {
        /// On which link.
        link: LinkId,
        /// Why.
        reason: DropReason,
        /// How many bytes, frames or records.
        count: u64,
    },
    /// Glue has done, or failed to do, what a [`crate::stations::services::FileRequest`] asked for.
    File {
        /// The request's ticket.
        ticket: u32,
        /// Whether it was done.
        result: Result<(), FileFault>,
        /// What was asked for, or what is wrong.
        bytes: &'a [u8],
    },
    /// What the calendar says.
    Calendar {
        /// Since 1970-01-01 UTC, µs.
        unix_us: i64,
    },
    /// How the recording stands, whenever that changes. Without it nobody records.
    Recording {
        /// How.
        state: Recording,
        /// Why it does not run, for people.
        why: &'a str,
    },
    /// Whoever runs the program wants it to end. What flies is landed first: [`crate::Pilot::may_end`].
    EndAsked,
    /// The deadline came, or something wants the core to look at the time.
    Wake,
}
