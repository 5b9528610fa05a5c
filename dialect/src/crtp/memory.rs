//! Port 4: the board's memories, listed and read. Nothing is written.
//!
//! Source: `docs/functional-areas/crtp/crtp_mem.md` and `src/modules/src/crtp_mem.c` (crazyflie-firmware 2a18fc29).

use super::packet::{CrtpError, MAX_PAYLOAD, Place};
use super::refusal::Refusal;
use super::wire::{Reader, Writer};

/// Most bytes of one reading: what the answer's head leaves. The board does not check it, and would write behind its
/// packet: more is neither sent nor taken.
pub const MAX_READ: usize = MAX_PAYLOAD - 6;

// `crtp_mem.c`, `MEM_CMD_…`.
const COUNT: u8 = 1;
const INFO: u8 = 2;

/// What is asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MemoryRequest {
    /// How many there are.
    Count,
    /// What one is; they count from 0.
    Info(u8),
    /// Bytes of one.
    Read {
        /// Which.
        memory: u8,
        /// The first.
        address: u32,
        /// How many, at most [`MAX_READ`].
        len: u8,
    },
}

/// What it answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MemoryAnswer<'a> {
    /// How many there are.
    Count(u8),
    /// What one is; `None`: there is none of this number.
    Info(u8, Option<MemoryInfo<'a>>),
    /// Bytes of one.
    Read {
        /// Which.
        memory: u8,
        /// The first.
        address: u32,
        /// As many as were asked for.
        outcome: Result<&'a [u8], Refusal>,
    },
}

/// What a memory is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryInfo<'a> {
    /// Its type, such as [`loco::TYPE`](super::loco::TYPE).
    pub kind: u8,
    /// Its size, bytes.
    pub size: u32,
    /// Which one it is, where several of a type can be plugged in: 8 bytes, of some types more.
    pub serial: &'a [u8],
}

impl MemoryRequest {
    pub(super) fn write(&self) -> Writer {
        let writer = Writer::to(Place::MemoryInfo);
        match *self {
            Self::Count => writer.u8(COUNT),
            Self::Info(memory) => writer.u8(INFO).u8(memory),
            Self::Read { memory, address, len } => {
                let writer = Writer::to(Place::MemoryRead).u8(memory).u32(address).u8(len);
                writer.only_if(usize::from(len) <= MAX_READ)
            }
        }
    }

    pub(super) fn read_info(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            COUNT => Ok(Self::Count),
            INFO => Ok(Self::Info(reader.u8()?)),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }

    pub(super) fn read_read(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        let (memory, address, len) = (reader.u8()?, reader.u32()?, reader.u8()?);
        let fits = usize::from(len) <= MAX_READ;
        fits.then_some(Self::Read { memory, address, len }).ok_or(CrtpError::BadPayload)
    }
}

impl<'a> MemoryAnswer<'a> {
    pub(super) fn write(&self) -> Writer {
        let writer = Writer::to(Place::MemoryInfo);
        match *self {
            Self::Count(count) => writer.u8(COUNT).u8(count),
            Self::Info(memory, None) => writer.u8(INFO).u8(memory),
            Self::Info(memory, Some(MemoryInfo { kind, size, serial })) => {
                writer.u8(INFO).u8(memory).u8(kind).u32(size).bytes(serial)
            }
            Self::Read { memory, address, outcome } => {
                let head = Writer::to(Place::MemoryRead).u8(memory).u32(address);
                head.u8(Refusal::byte(outcome.map(|_| ()))).bytes(outcome.unwrap_or_default())
            }
        }
    }

    pub(super) fn read_info(reader: &mut Reader<'a>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            COUNT => Ok(Self::Count(reader.u8()?)),
            INFO => {
                let memory = reader.u8()?;
                if reader.0.is_empty() {
                    return Ok(Self::Info(memory, None));
                }
                let (kind, size, serial) = (reader.u8()?, reader.u32()?, reader.rest());
                Ok(Self::Info(memory, Some(MemoryInfo { kind, size, serial })))
            }
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }

    pub(super) fn read_read(reader: &mut Reader<'a>) -> Result<Self, CrtpError> {
        let (memory, address) = (reader.u8()?, reader.u32()?);
        let outcome = Refusal::outcome(reader.u8()?).map(|()| reader.rest());
        Ok(Self::Read { memory, address, outcome })
    }
}
