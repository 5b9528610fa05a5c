//! Port 5: blocks of variables that the board sends at a period of their own.
//!
//! A block is made, filled, started; its rows come on a channel of their own and hold the last value of each
//! variable, which nothing queues. Source: crazyflie-firmware 2a18fc29, `src/modules/src/log.c`.

use super::packet::{CrtpError, Place};
use super::refusal::Refusal;
use super::value::{Kind, Value};
use super::wire::{Reader, Writer};

/// Bytes of values in a row (`log.c`, `LOG_MAX_LEN`).
pub const MAX_ROW: usize = 26;
/// Most variables in one packet: three bytes each behind the command and the block.
pub const MAX_VARIABLES: usize = 9;
/// The time of a row has this many bits: it wraps after 4 h 39 min.
pub const TIME_BITS: u32 = 24;

// `log.c`, `CONTROL_…`.
const DELETE: u8 = 2;
const START_10_MS: u8 = 3;
const STOP: u8 = 4;
const RESET: u8 = 5;
const CREATE: u8 = 6;
const APPEND: u8 = 7;
const START: u8 = 8;

/// A variable as a block has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Variable {
    /// From the table. 0xFFFF would be an address in memory, which we do not speak.
    pub id: u16,
    /// As what it is sent, whatever it is stored as.
    pub kind: Kind,
}

/// Those of one packet, without allocation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Variables {
    all: [Variable; MAX_VARIABLES],
    len: usize,
}

impl Default for Variables {
    fn default() -> Self {
        Self { all: [Variable { id: 0, kind: Kind::U8 }; MAX_VARIABLES], len: 0 }
    }
}

impl Variables {
    /// Adds one; `false` when the packet is full.
    pub fn push(&mut self, variable: Variable) -> bool {
        let Some(slot) = self.all.get_mut(self.len) else { return false };
        *slot = variable;
        self.len += 1;
        true
    }

    /// In the order of the row.
    pub fn as_slice(&self) -> &[Variable] {
        self.all.get(..self.len).unwrap_or_default()
    }

    /// The type twice: the high half is for addresses in memory and not looked at for the table's, but cflib fills
    /// it.
    fn write(&self, writer: Writer) -> Writer {
        self.as_slice().iter().fold(writer, |writer, variable| {
            writer.u8(variable.kind.log() << 4 | variable.kind.log()).u16(variable.id)
        })
    }

    /// As far as there are whole ones: cflib begins one that finds no room, and the board does not look at it.
    fn read(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        let mut variables = Self::default();
        let (whole, _) = reader.rest().as_chunks::<3>();
        for [kind, i0, i1] in whole {
            let kind = Kind::of_log(kind & 0x0F).ok_or(CrtpError::BadPayload)?;
            if !variables.push(Variable { id: u16::from_le_bytes([*i0, *i1]), kind }) {
                return Err(CrtpError::BadPayload);
            }
        }
        Ok(variables)
    }
}

/// What is done to blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogControl {
    /// Makes a block of these.
    Create(u8, Variables),
    /// Adds these to a block.
    Append(u8, Variables),
    /// Forgets a block.
    Delete(u8),
    /// Sends its rows with this period, ms; 0: one row.
    Start(u8, u16),
    /// The same, with a period in units of 10 ms.
    Start10Ms(u8, u8),
    /// Sends no more rows.
    Stop(u8),
    /// Forgets all blocks.
    Reset,
}

impl LogControl {
    pub(super) fn write(&self) -> Writer {
        let writer = Writer::to(Place::LogControl);
        match *self {
            Self::Create(block, variables) => variables.write(writer.u8(CREATE).u8(block)),
            Self::Append(block, variables) => variables.write(writer.u8(APPEND).u8(block)),
            Self::Delete(block) => writer.u8(DELETE).u8(block),
            Self::Start(block, period_ms) => writer.u8(START).u8(block).u16(period_ms),
            Self::Start10Ms(block, periods) => writer.u8(START_10_MS).u8(block).u8(periods),
            Self::Stop(block) => writer.u8(STOP).u8(block),
            Self::Reset => writer.u8(RESET),
        }
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        Ok(match reader.u8()? {
            CREATE => Self::Create(reader.u8()?, Variables::read(reader)?),
            APPEND => Self::Append(reader.u8()?, Variables::read(reader)?),
            DELETE => Self::Delete(reader.u8()?),
            START => Self::Start(reader.u8()?, reader.u16()?),
            START_10_MS => Self::Start10Ms(reader.u8()?, reader.u8()?),
            STOP => Self::Stop(reader.u8()?),
            RESET => Self::Reset,
            command => return Err(CrtpError::UnknownCommand(command)),
        })
    }

    /// The first byte of its packet, which the answer repeats.
    pub fn command(&self) -> u8 {
        match self {
            Self::Create(..) => CREATE,
            Self::Append(..) => APPEND,
            Self::Delete(_) => DELETE,
            Self::Start(..) => START,
            Self::Start10Ms(..) => START_10_MS,
            Self::Stop(_) => STOP,
            Self::Reset => RESET,
        }
    }
}

/// What became of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LogOutcome {
    /// [`LogControl::command`] of what was asked.
    pub command: u8,
    /// The block; of a reset any number.
    pub block: u8,
    /// Whether it was done.
    pub outcome: Result<(), Refusal>,
}

impl LogOutcome {
    pub(super) fn write(&self) -> Writer {
        let error = Refusal::byte(self.outcome);
        Writer::to(Place::LogControl).u8(self.command).u8(self.block).u8(error)
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        let (command, block) = (reader.u8()?, reader.u8()?);
        Ok(Self { command, block, outcome: Refusal::outcome(reader.u8()?) })
    }
}

/// One row of a block.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LogRow<'a> {
    /// Which block.
    pub block: u8,
    /// When it was taken, ms since the board started, the lowest [`TIME_BITS`].
    pub time_ms: u32,
    /// The values as they were sent; only who made the block knows their types.
    pub bytes: &'a [u8],
}

impl<'a> LogRow<'a> {
    /// The values of a block of these types, in their order; `None`: the row is not as long as they are.
    pub fn values<'k>(
        &self,
        kinds: &'k [Kind],
    ) -> Option<impl Iterator<Item = Value> + use<'a, 'k>> {
        let len: usize = kinds.iter().map(|kind| kind.width()).sum();
        let mut rest = self.bytes;
        (len == rest.len()).then(|| {
            kinds.iter().filter_map(move |kind| {
                let (value, later) = rest.split_at_checked(kind.width())?;
                rest = later;
                kind.read(value)
            })
        })
    }

    pub(super) fn write(&self) -> Writer {
        let [t0, t1, t2, _] = self.time_ms.to_le_bytes();
        Writer::to(Place::LogData).bytes(&[self.block, t0, t1, t2]).bytes(self.bytes)
    }

    pub(super) fn read(reader: &mut Reader<'a>) -> Result<Self, CrtpError> {
        let [block, t0, t1, t2] = reader.array()?;
        Ok(Self { block, time_ms: u32::from_le_bytes([t0, t1, t2, 0]), bytes: reader.rest() })
    }
}
