//! Port 13: what the board is, and how firmware before protocol 12 is armed.
//!
//! Source: `docs/functional-areas/crtp/crtp_platform.md` and `src/modules/src/platformservice.c` (crazyflie-firmware
//! 2a18fc29).

use super::packet::{CrtpError, Place};
use super::wire::{Reader, Writer};

// Channel 1.
const PROTOCOL: u8 = 0;
const FIRMWARE: u8 = 1;
const DEVICE: u8 = 2;
// Channel 0. The supervisor's 3, emergency stop, is a play of lights here.
const ARM: u8 = 1;
const RECOVER: u8 = 2;

/// What is asked or ordered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlatformRequest {
    /// Version of the protocol.
    Protocol,
    /// Tag of the firmware.
    Firmware,
    /// Name of the kind of board.
    Device,
    /// To arm or to disarm; later firmware still does, and complains.
    Arm(bool),
    /// To leave the crashed state; likewise.
    Recover,
}

/// What it answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlatformAnswer<'a> {
    /// Version of the protocol.
    Protocol(u32),
    /// Tag of the firmware, such as `2025.12`.
    Firmware(&'a str),
    /// Name of the kind of board, such as `CB11`.
    Device(&'a str),
    /// Of an order to arm or disarm.
    Arm {
        /// It was done.
        done: bool,
        /// It is armed now.
        armed: bool,
    },
    /// Of an order to recover.
    Recover {
        /// It was done.
        done: bool,
        /// It is not crashed now.
        recovered: bool,
    },
}

impl PlatformRequest {
    pub(super) fn write(&self) -> Writer {
        let (version, command) =
            (Writer::to(Place::PlatformVersion), Writer::to(Place::PlatformCommand));
        match *self {
            Self::Protocol => version.u8(PROTOCOL),
            Self::Firmware => version.u8(FIRMWARE),
            Self::Device => version.u8(DEVICE),
            Self::Arm(arm) => command.u8(ARM).u8(arm.into()),
            Self::Recover => command.u8(RECOVER),
        }
    }

    pub(super) fn read_version(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            PROTOCOL => Ok(Self::Protocol),
            FIRMWARE => Ok(Self::Firmware),
            DEVICE => Ok(Self::Device),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }

    pub(super) fn read_command(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            ARM => Ok(Self::Arm(reader.flag()?)),
            RECOVER => Ok(Self::Recover),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }
}

impl<'a> PlatformAnswer<'a> {
    pub(super) fn write(&self) -> Writer {
        let (version, command) =
            (Writer::to(Place::PlatformVersion), Writer::to(Place::PlatformCommand));
        match *self {
            Self::Protocol(number) => version.u8(PROTOCOL).u32(number),
            Self::Firmware(tag) => version.u8(FIRMWARE).bytes(tag.as_bytes()),
            Self::Device(name) => version.u8(DEVICE).bytes(name.as_bytes()),
            Self::Arm { done, armed } => command.bytes(&[ARM, done.into(), armed.into()]),
            Self::Recover { done, recovered } => {
                command.bytes(&[RECOVER, done.into(), recovered.into()])
            }
        }
    }

    pub(super) fn read_version(reader: &mut Reader<'a>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            // The page says one byte, the firmware sends four.
            PROTOCOL if reader.0.len() == 1 => Ok(Self::Protocol(reader.u8()?.into())),
            PROTOCOL => Ok(Self::Protocol(reader.u32()?)),
            FIRMWARE => Ok(Self::Firmware(reader.text()?)),
            DEVICE => Ok(Self::Device(reader.text()?)),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }

    pub(super) fn read_command(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            ARM => Ok(Self::Arm { done: reader.flag()?, armed: reader.flag()? }),
            RECOVER => Ok(Self::Recover { done: reader.flag()?, recovered: reader.flag()? }),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }
}
