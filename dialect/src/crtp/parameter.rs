//! Port 2: parameters read and written, by id or by name.
//!
//! Values are bytes here: only the table knows their types. A read-only parameter that is written is not answered at
//! all. Source: crazyflie-firmware 2a18fc29, `src/modules/src/param_logic.c` and `src/modules/interface/param.h`
//! (`MISC_…`); the page `crtp_parameters.md` still shows ids of 8 bits.

use super::packet::{CrtpError, Place};
use super::refusal::Refusal;
use super::value::{Kind, Value};
use super::wire::{Reader, Writer};

// `param.h`, `MISC_…`.
const SET_BY_NAME: u8 = 0;
const VALUE_UPDATED: u8 = 1;
/// Of its second version, from protocol 11 on; answers of the first cannot be told from a refusal.
const EXTENDED_TYPE: u8 = 7;

/// Extended type of a parameter that the board can keep over a restart (`param.h`, `PARAM_PERSISTENT`).
pub const PERSISTENT: u8 = 1;

/// What is asked of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ParameterRequest<'a> {
    /// Its value.
    Read(u16),
    /// To take this value.
    Write(u16, &'a [u8]),
    /// The same without the table.
    SetByName {
        /// First half of its name.
        group: &'a str,
        /// Second half of its name.
        name: &'a str,
        /// Must be the table's.
        kind: Kind,
        /// In range of the type.
        value: Value,
    },
    /// What its type's eight bits have no room for.
    ExtendedType(u16),
}

/// What is told about a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ParameterAnswer<'a> {
    /// Its value, as it was asked for.
    Read(u16, Result<&'a [u8], Refusal>),
    /// The value that was written, again. An id beyond the table is answered by the one byte 2, which is a value as
    /// well.
    Written(u16, &'a [u8]),
    /// It was set by name, or not.
    SetByName {
        /// As asked.
        group: &'a str,
        /// As asked.
        name: &'a str,
        /// Whether it was done.
        outcome: Result<(), Refusal>,
    },
    /// Somebody else has changed it.
    Updated(u16, &'a [u8]),
    /// Its extended type: [`PERSISTENT`] or 0.
    ExtendedType(u16, Result<u8, Refusal>),
}

impl<'a> ParameterRequest<'a> {
    pub(super) fn write(&self) -> Option<Writer> {
        Some(match *self {
            Self::Read(id) => Writer::to(Place::ParameterRead).u16(id),
            Self::Write(id, bytes) => Writer::to(Place::ParameterWrite).u16(id).bytes(bytes),
            Self::SetByName { group, name, kind, value } => {
                let names = Writer::to(Place::ParameterMisc).u8(SET_BY_NAME).name(group).name(name);
                let bytes = kind.write(value)?;
                names.u8(kind.parameter()).bytes(bytes.get(..kind.width())?)
            }
            Self::ExtendedType(id) => Writer::to(Place::ParameterMisc).u8(EXTENDED_TYPE).u16(id),
        })
    }

    pub(super) fn read_misc(reader: &mut Reader<'a>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            SET_BY_NAME => {
                let (group, name) = (reader.name()?, reader.name()?);
                let kind = Kind::of_parameter(reader.u8()?).ok_or(CrtpError::BadPayload)?;
                let value = kind.read(reader.rest()).ok_or(CrtpError::BadPayload)?;
                Ok(Self::SetByName { group, name, kind, value })
            }
            EXTENDED_TYPE => Ok(Self::ExtendedType(reader.u16()?)),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }
}

impl<'a> ParameterAnswer<'a> {
    pub(super) fn write(&self) -> Writer {
        let misc = Writer::to(Place::ParameterMisc);
        match *self {
            Self::Read(id, outcome) => {
                let writer = Writer::to(Place::ParameterRead).u16(id);
                writer.u8(Refusal::byte(outcome.map(|_| ()))).bytes(outcome.unwrap_or_default())
            }
            Self::Written(id, bytes) => Writer::to(Place::ParameterWrite).u16(id).bytes(bytes),
            Self::SetByName { group, name, outcome } => {
                misc.u8(SET_BY_NAME).name(group).name(name).u8(Refusal::byte(outcome))
            }
            Self::Updated(id, bytes) => misc.u8(VALUE_UPDATED).u16(id).bytes(bytes),
            Self::ExtendedType(id, outcome) => {
                let writer = misc.u8(EXTENDED_TYPE).u16(id).u8(Refusal::byte(outcome.map(|_| ())));
                writer.bytes(outcome.as_ref().map_or(&[], std::slice::from_ref))
            }
        }
    }

    pub(super) fn read_value(reader: &mut Reader<'a>) -> Result<Self, CrtpError> {
        let (id, outcome) = (reader.u16()?, Refusal::outcome(reader.u8()?));
        Ok(Self::Read(id, outcome.map(|()| reader.rest())))
    }

    pub(super) fn read_misc(reader: &mut Reader<'a>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            SET_BY_NAME => {
                let (group, name) = (reader.name()?, reader.name()?);
                Ok(Self::SetByName { group, name, outcome: Refusal::outcome(reader.u8()?) })
            }
            VALUE_UPDATED => Ok(Self::Updated(reader.u16()?, reader.rest())),
            EXTENDED_TYPE => {
                let (id, outcome) = (reader.u16()?, Refusal::outcome(reader.u8()?));
                Ok(Self::ExtendedType(
                    id,
                    match outcome {
                        Ok(()) => Ok(reader.u8()?),
                        Err(refusal) => Err(refusal),
                    },
                ))
            }
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }
}
