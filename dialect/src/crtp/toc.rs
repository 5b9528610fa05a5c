//! The tables of names: one of log variables, one of parameters, asked item by item.
//!
//! Ids change with every build of the firmware; the checksum tells whether a table that was kept is still the
//! board's. This is version 2 of the requests, with ids of 16 bits. Source: crazyflie-firmware 2a18fc29, `log.c`
//! (`logTOCProcess`) and `param_logic.c` (`paramTOCProcess`).

use super::packet::{CrtpError, Place};
use super::value::Kind;
use super::wire::{Reader, Writer};

/// `CMD_GET_ITEM_V2` of both files.
const ITEM: u8 = 2;
/// `CMD_GET_INFO_V2` of both files.
const INFO: u8 = 3;

/// Flags beside a parameter's type (`param.h`): it has an extended type, is promised to stay, cannot be written.
const EXTENDED: u8 = 0x10;
const CORE: u8 = 0x20;
const READ_ONLY: u8 = 0x40;

/// Which of the two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Table {
    /// Of log variables.
    Log,
    /// Of parameters.
    Parameters,
}

impl Table {
    fn place(self) -> Place {
        match self {
            Self::Log => Place::LogToc,
            Self::Parameters => Place::ParameterToc,
        }
    }
}

/// What is asked of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TocRequest {
    /// How long it is, and its checksum.
    Info,
    /// One item by its id; they count from 0.
    Item(u16),
}

/// What it answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TocAnswer<'a> {
    /// Items in it, and its checksum.
    Info {
        /// Ids are below this.
        count: u16,
        /// Equal for equal tables.
        crc: u32,
        /// Of the log only: most blocks, and most variables in all of them.
        limits: Option<[u8; 2]>,
    },
    /// One item.
    Item(TocItem<'a>),
    /// The id is beyond the table.
    NoItem,
}

/// A variable or a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TocItem<'a> {
    /// What everything else calls it by.
    pub id: u16,
    /// Its type as the table says it; a parameter's with flags.
    pub code: u8,
    /// First half of its name.
    pub group: &'a str,
    /// Second half of its name.
    pub name: &'a str,
}

impl TocItem<'_> {
    /// Type of an item of this table, when we know it.
    pub fn kind(&self, table: Table) -> Option<Kind> {
        match table {
            Table::Log => Kind::of_log(self.code),
            Table::Parameters => Kind::of_parameter(self.code & !(EXTENDED | CORE | READ_ONLY)),
        }
    }

    /// Whether this parameter has an extended type to ask for.
    pub fn is_extended(&self) -> bool {
        self.code & EXTENDED != 0
    }

    /// Whether this parameter can only be read; a write would not even be answered.
    pub fn is_read_only(&self) -> bool {
        self.code & READ_ONLY != 0
    }
}

impl TocRequest {
    pub(super) fn write(&self, table: Table) -> Writer {
        let writer = Writer::to(table.place());
        match *self {
            Self::Info => writer.u8(INFO),
            Self::Item(id) => writer.u8(ITEM).u16(id),
        }
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            INFO => Ok(Self::Info),
            ITEM => Ok(Self::Item(reader.u16()?)),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }
}

impl<'a> TocAnswer<'a> {
    pub(super) fn write(&self, table: Table) -> Writer {
        let writer = Writer::to(table.place());
        match *self {
            Self::Info { count, crc, limits } => {
                let limits = limits.as_ref().map_or(&[][..], |limits| limits);
                writer.u8(INFO).u16(count).u32(crc).bytes(limits)
            }
            Self::Item(TocItem { id, code, group, name }) => {
                writer.u8(ITEM).u16(id).u8(code).name(group).name(name)
            }
            Self::NoItem => writer.u8(ITEM),
        }
    }

    pub(super) fn read(reader: &mut Reader<'a>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            INFO => {
                let (count, crc) = (reader.u16()?, reader.u32()?);
                let limits = if reader.0.is_empty() { None } else { Some(reader.array()?) };
                Ok(Self::Info { count, crc, limits })
            }
            ITEM if reader.0.is_empty() => Ok(Self::NoItem),
            ITEM => {
                let (id, code) = (reader.u16()?, reader.u8()?);
                Ok(Self::Item(TocItem { id, code, group: reader.name()?, name: reader.name()? }))
            }
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }
}
