//! CRTP, the language of the Crazyflie and of the Flapper's own board.
//!
//! A [`Packet`](packet::Packet) is read as [`ToBoard`] or as [`FromBoard`], by who sent it, and made of one. What is
//! here is what it takes to fly by attitude and thrust and to log, both ways, so that a board can be played as well.
//! Not here: the planner on the board (port 8), setpoints of position and velocity, memories written, and what the
//! radios say to each other.
//!
//! Facts are from the firmware's documents and headers as each file names them (release 2026.08, protocol 12), and
//! from recordings of that firmware with Bitcraze's own client.

pub mod half;
pub mod link;
pub mod localization;
pub mod loco;
pub mod log;
pub mod memory;
pub mod packet;
pub mod parameter;
pub mod platform;
pub mod quaternion;
pub mod refusal;
pub mod setpoint;
pub mod supervisor;
pub mod toc;
pub mod value;
mod wire;

use link::Link;
use localization::{Localization, LppShortAnswer};
use log::{LogControl, LogOutcome, LogRow};
use memory::{MemoryAnswer, MemoryRequest};
use packet::{CrtpError, Packet, Place};
use parameter::{ParameterAnswer, ParameterRequest};
use platform::{PlatformAnswer, PlatformRequest};
use setpoint::Setpoint;
use supervisor::{SupervisorAnswer, SupervisorRequest};
use toc::{Table, TocAnswer, TocRequest};
use wire::{Reader, Writer};

/// What a client says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ToBoard<'a> {
    /// To the link.
    Link(Link<'a>),
    /// To a table of names.
    Toc(Table, TocRequest),
    /// To log blocks.
    Log(LogControl),
    /// To parameters.
    Parameter(ParameterRequest<'a>),
    /// To the motors.
    Setpoint(Setpoint),
    /// To the estimator, or the anchors.
    Localization(Localization<'a>),
    /// To memories.
    Memory(MemoryRequest),
    /// To the supervisor.
    Supervisor(SupervisorRequest),
    /// To the platform.
    Platform(PlatformRequest),
}

/// What the board says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FromBoard<'a> {
    /// A piece of text for people. Lines end where they end, packets anywhere.
    Console(&'a [u8]),
    /// The link.
    Link(Link<'a>),
    /// A table of names.
    Toc(Table, TocAnswer<'a>),
    /// Log blocks, of what was done to them.
    Log(LogOutcome),
    /// A log block, of the vehicle.
    Row(LogRow<'a>),
    /// Parameters.
    Parameter(ParameterAnswer<'a>),
    /// The way to the anchors.
    Localization(LppShortAnswer),
    /// Memories.
    Memory(MemoryAnswer<'a>),
    /// The supervisor.
    Supervisor(SupervisorAnswer),
    /// The platform.
    Platform(PlatformAnswer<'a>),
}

impl<'a> ToBoard<'a> {
    /// The packet; `None`: a text or a list in it is too long, or a value beyond its type.
    pub fn encode(&self) -> Option<Packet> {
        match self {
            Self::Link(link) => link.write(),
            Self::Toc(table, request) => request.write(*table),
            Self::Log(control) => control.write(),
            Self::Parameter(request) => request.write()?,
            Self::Setpoint(setpoint) => setpoint.write(),
            Self::Localization(localization) => localization.write(),
            Self::Memory(request) => request.write(),
            Self::Supervisor(request) => request.write(),
            Self::Platform(request) => request.write(),
        }
        .done()
    }

    /// What a packet to the board says.
    pub fn decode(packet: &'a Packet) -> Result<Self, CrtpError> {
        let place = packet.place()?;
        let mut reader = Reader(packet.payload());
        let rest = &mut reader;
        let message = match place {
            Place::ParameterToc => Self::Toc(Table::Parameters, TocRequest::read(rest)?),
            Place::ParameterRead => Self::Parameter(ParameterRequest::Read(rest.u16()?)),
            Place::ParameterWrite => {
                Self::Parameter(ParameterRequest::Write(rest.u16()?, rest.rest()))
            }
            Place::ParameterMisc => Self::Parameter(ParameterRequest::read_misc(rest)?),
            Place::Attitude => Self::Setpoint(Setpoint::read_attitude(rest)?),
            Place::MemoryInfo => Self::Memory(MemoryRequest::read_info(rest)?),
            Place::MemoryRead => Self::Memory(MemoryRequest::read_read(rest)?),
            Place::LogToc => Self::Toc(Table::Log, TocRequest::read(rest)?),
            Place::LogControl => Self::Log(LogControl::read(rest)?),
            Place::ExternalPosition => Self::Localization(Localization::Position(rest.f32s()?)),
            Place::Localization => Self::Localization(Localization::read(rest)?),
            Place::Setpoint => Self::Setpoint(Setpoint::read_typed(rest)?),
            Place::SetpointMeta => Self::Setpoint(Setpoint::read_meta(rest)?),
            Place::SupervisorInfo => Self::Supervisor(SupervisorRequest::read_info(rest)?),
            Place::SupervisorCommand => Self::Supervisor(SupervisorRequest::read_command(rest)?),
            Place::PlatformCommand => Self::Platform(PlatformRequest::read_command(rest)?),
            Place::PlatformVersion => Self::Platform(PlatformRequest::read_version(rest)?),
            _ => Self::Link(Link::read(place, rest).ok_or(CrtpError::UnknownPlace)?),
        };
        reader.end().map(|()| message)
    }
}

impl<'a> FromBoard<'a> {
    /// The packet; `None`: a text or a list in it is too long.
    pub fn encode(&self) -> Option<Packet> {
        match self {
            Self::Console(text) => Writer::to(Place::Console).bytes(text),
            Self::Link(link) => link.write(),
            Self::Toc(table, answer) => answer.write(*table),
            Self::Log(outcome) => outcome.write(),
            Self::Row(row) => row.write(),
            Self::Parameter(answer) => answer.write(),
            Self::Localization(answer) => answer.write(),
            Self::Memory(answer) => answer.write(),
            Self::Supervisor(answer) => answer.write(),
            Self::Platform(answer) => answer.write(),
        }
        .done()
    }

    /// What a packet of the board says.
    pub fn decode(packet: &'a Packet) -> Result<Self, CrtpError> {
        let place = packet.place()?;
        let mut reader = Reader(packet.payload());
        let rest = &mut reader;
        let message = match place {
            Place::Console => Self::Console(rest.rest()),
            Place::ParameterToc => Self::Toc(Table::Parameters, TocAnswer::read(rest)?),
            Place::ParameterRead => Self::Parameter(ParameterAnswer::read_value(rest)?),
            Place::ParameterWrite => {
                Self::Parameter(ParameterAnswer::Written(rest.u16()?, rest.rest()))
            }
            Place::ParameterMisc => Self::Parameter(ParameterAnswer::read_misc(rest)?),
            Place::MemoryInfo => Self::Memory(MemoryAnswer::read_info(rest)?),
            Place::MemoryRead => Self::Memory(MemoryAnswer::read_read(rest)?),
            Place::LogToc => Self::Toc(Table::Log, TocAnswer::read(rest)?),
            Place::LogControl => Self::Log(LogOutcome::read(rest)?),
            Place::LogData => Self::Row(LogRow::read(rest)?),
            Place::Localization => Self::Localization(LppShortAnswer::read(rest)?),
            Place::SupervisorInfo => Self::Supervisor(SupervisorAnswer::read_info(rest)?),
            Place::SupervisorCommand => Self::Supervisor(SupervisorAnswer::read_command(rest)?),
            Place::PlatformCommand => Self::Platform(PlatformAnswer::read_command(rest)?),
            Place::PlatformVersion => Self::Platform(PlatformAnswer::read_version(rest)?),
            _ => Self::Link(Link::read(place, rest).ok_or(CrtpError::UnknownPlace)?),
        };
        reader.end().map(|()| message)
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod tests_recorded;
