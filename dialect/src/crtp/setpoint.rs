//! Ports 3 and 7: where the vehicle shall go. Nothing of it is answered.
//!
//! Of the setpoints that name their type only the stop is here: no other takes an absolute yaw together with a
//! thrust, and one of a wrong length halts the board. Source: crazyflie-firmware 2a18fc29, `crtp_commander_rpyt.c`,
//! `crtp_commander_generic.c` and `crtp_commander.c`.

use super::packet::{CrtpError, Place};
use super::wire::{Reader, Writer};

/// `crtp_commander_generic.c`, `stopType`.
const STOP: u8 = 0;
/// `crtp_commander.c`, `metaNotifySetpointsStop`.
const YIELD: u8 = 0;

/// One of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Setpoint {
    /// Tilt, yaw and thrust. What roll, pitch and yaw mean is for the parameters `flightmode.*` to say; this is said
    /// of angles. The board's clients turn the sign of pitch, the wire does not.
    Attitude {
        /// Right wing down is positive, degrees.
        roll_deg: f32,
        /// Nose up is positive, degrees.
        pitch_deg: f32,
        /// With `stabModeYaw` 0 a rate, clockwise from above positive, degrees/s; with 1 an angle, counter-clockwise
        /// positive, degrees.
        yaw: f32,
        /// Of 65535; below 1000 is none. None must have come once before any is taken.
        thrust: u16,
    },
    /// Cuts the motors until the next setpoint.
    Stop,
    /// Lets the planner on the board act again. Its time, ms, has no effect in present firmware.
    Yield(u32),
}

impl Setpoint {
    pub(super) fn write(&self) -> Writer {
        match *self {
            Self::Attitude { roll_deg, pitch_deg, yaw, thrust } => {
                Writer::to(Place::Attitude).f32s(&[roll_deg, pitch_deg, yaw]).u16(thrust)
            }
            Self::Stop => Writer::to(Place::Setpoint).u8(STOP),
            Self::Yield(valid_ms) => Writer::to(Place::SetpointMeta).u8(YIELD).u32(valid_ms),
        }
    }

    pub(super) fn read_attitude(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        let [roll_deg, pitch_deg, yaw] = reader.f32s()?;
        Ok(Self::Attitude { roll_deg, pitch_deg, yaw, thrust: reader.u16()? })
    }

    pub(super) fn read_typed(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            STOP => Ok(Self::Stop),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }

    pub(super) fn read_meta(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            YIELD => Ok(Self::Yield(reader.u32()?)),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }
}
