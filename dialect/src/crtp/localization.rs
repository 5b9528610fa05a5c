//! Port 6: positions from outside, words to the anchors, and the oldest way to cut the motors.
//!
//! Positions are in the board's world, z up. Source: `src/modules/interface/crtp_localization_service.h` and
//! `src/modules/src/crtp_localization_service.c` (crazyflie-firmware 2a18fc29); what an anchor is told,
//! `src/deck/drivers/interface/locodeck.h`.

use super::packet::{CrtpError, Place};
use super::wire::{Reader, Writer};

// `crtp_localization_service.h`, `locsrv_t`.
const LPP_SHORT: u8 = 2;
const EMERGENCY_STOP: u8 = 3;
const POSE: u8 = 8;

/// `locodeck.h`, `LPP_SHORT_ANCHORPOS`.
const ANCHOR_POSITION: u8 = 1;

/// What is told to the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Localization<'a> {
    /// Where it is, m.
    Position([f32; 3]),
    /// Where it is, m, and how it is turned: a quaternion in the order x, y, z, w.
    Pose([f32; 3], [f32; 4]),
    /// A short packet for an anchor, from its type on, such as [`anchor_position`] makes.
    LppShort(u8, &'a [u8]),
    /// To cut the motors until it is restarted. Every release knows it here; the supervisor's port is younger.
    EmergencyStop,
}

/// Whether a short packet waits to be sent to its anchor: all that is ever answered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LppShortAnswer {
    /// The anchor.
    pub anchor: u8,
    /// The deck has taken it.
    pub taken: bool,
}

/// The short packet that tells an anchor where it is, m.
pub fn anchor_position([x, y, z]: [f32; 3]) -> [u8; 13] {
    let mut bytes = [ANCHOR_POSITION; 13];
    for (to, from) in bytes.iter_mut().skip(1).zip([x, y, z].into_iter().flat_map(f32::to_le_bytes))
    {
        *to = from;
    }
    bytes
}

impl<'a> Localization<'a> {
    pub(super) fn write(&self) -> Writer {
        let writer = Writer::to(Place::Localization);
        match *self {
            Self::Position(position_m) => Writer::to(Place::ExternalPosition).f32s(&position_m),
            Self::Pose(position_m, quaternion) => {
                writer.u8(POSE).f32s(&position_m).f32s(&quaternion)
            }
            Self::LppShort(anchor, bytes) => writer.u8(LPP_SHORT).u8(anchor).bytes(bytes),
            Self::EmergencyStop => writer.u8(EMERGENCY_STOP),
        }
    }

    pub(super) fn read(reader: &mut Reader<'a>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            POSE => Ok(Self::Pose(reader.f32s()?, reader.f32s()?)),
            LPP_SHORT => Ok(Self::LppShort(reader.u8()?, reader.rest())),
            EMERGENCY_STOP => Ok(Self::EmergencyStop),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }
}

impl LppShortAnswer {
    pub(super) fn write(&self) -> Writer {
        Writer::to(Place::Localization).bytes(&[LPP_SHORT, self.anchor, self.taken.into()])
    }

    pub(super) fn read(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            LPP_SHORT => Ok(Self { anchor: reader.u8()?, taken: reader.flag()? }),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }
}
