//! Port 9, from protocol 12 on: what the board's supervisor thinks, and what it is ordered to do.
//!
//! The watchdog that the same port can start is left out: once fed, its next omission cuts the motors after 1 s, so
//! that a short loss of the link would end in a fall. Source: `docs/functional-areas/crtp/crtp_supervisor.md` and
//! `src/modules/src/crtp_supervisor.c` (crazyflie-firmware 2a18fc29).

use super::packet::{CrtpError, Place};
use super::wire::{Reader, Writer};

// Channel 1.
const ARM: u8 = 1;
const RECOVER: u8 = 2;
const EMERGENCY_STOP: u8 = 3;
/// Channel 0: all bits at once.
const BITS: u8 = 0x0C;
/// Set in the command that an answer repeats.
const ANSWER: u8 = 0x80;

bitflags::bitflags! {
    /// The bits, here and in the log variable `supervisor.info`. Test single ones: which stand beside them on the
    /// ground differs between releases and vehicles.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub struct SupervisorBits: u16 {
        /// It would let itself be armed.
        const CAN_BE_ARMED = 1;
        /// It is armed.
        const ARMED = 1 << 1;
        /// It arms by itself as soon as it can.
        const AUTO_ARM = 1 << 2;
        /// A setpoint with thrust would spin the motors.
        const CAN_FLY = 1 << 3;
        /// It thinks that it flies.
        const FLYING = 1 << 4;
        /// It lies on its side or back.
        const TUMBLED = 1 << 5;
        /// It will not fly before it is restarted.
        const LOCKED = 1 << 6;
        /// It has crashed, and may recover when it stands upright.
        const CRASHED = 1 << 7;
        /// The planner on the board flies it.
        const PLANNER_ACTIVE = 1 << 8;
        /// That planner has no way before it. From 2026.08 on this is set from the start.
        const PLANNER_FINISHED = 1 << 9;
        /// That planner is switched off.
        const PLANNER_DISABLED = 1 << 10;
        /// An expansion deck does not answer: in flight this ends in a cut of the motors. From 2026.06 on.
        const DECK_FAULT = 1 << 11;
    }
}

/// What is asked of it, or ordered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SupervisorRequest {
    /// Its bits.
    Bits,
    /// To arm or to disarm. Where it arms by itself, disarming in flight stops the motors for a moment only.
    Arm(bool),
    /// To leave the crashed state.
    Recover,
    /// To cut the motors until it is restarted. Not answered.
    EmergencyStop,
}

/// What it answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SupervisorAnswer {
    /// Its bits; those that we do not know are kept.
    Bits(SupervisorBits),
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

impl SupervisorRequest {
    pub(super) fn write(&self) -> Writer {
        let command = Writer::to(Place::SupervisorCommand);
        match *self {
            Self::Bits => Writer::to(Place::SupervisorInfo).u8(BITS),
            Self::Arm(arm) => command.u8(ARM).u8(arm.into()),
            Self::Recover => command.u8(RECOVER),
            Self::EmergencyStop => command.u8(EMERGENCY_STOP),
        }
    }

    pub(super) fn read_info(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            BITS => Ok(Self::Bits),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }

    pub(super) fn read_command(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        match reader.u8()? {
            ARM => Ok(Self::Arm(reader.flag()?)),
            RECOVER => Ok(Self::Recover),
            EMERGENCY_STOP => Ok(Self::EmergencyStop),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }
}

impl SupervisorAnswer {
    pub(super) fn write(&self) -> Writer {
        let command = Writer::to(Place::SupervisorCommand);
        match *self {
            Self::Bits(bits) => {
                Writer::to(Place::SupervisorInfo).u8(BITS | ANSWER).u16(bits.bits())
            }
            Self::Arm { done, armed } => command.bytes(&[ARM | ANSWER, done.into(), armed.into()]),
            Self::Recover { done, recovered } => {
                command.bytes(&[RECOVER | ANSWER, done.into(), recovered.into()])
            }
        }
    }

    pub(super) fn read_info(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        const BITS_ANSWER: u8 = BITS | ANSWER;
        match reader.u8()? {
            BITS_ANSWER => Ok(Self::Bits(SupervisorBits::from_bits_retain(reader.u16()?))),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }

    pub(super) fn read_command(reader: &mut Reader<'_>) -> Result<Self, CrtpError> {
        const ARM_ANSWER: u8 = ARM | ANSWER;
        const RECOVER_ANSWER: u8 = RECOVER | ANSWER;
        match reader.u8()? {
            ARM_ANSWER => Ok(Self::Arm { done: reader.flag()?, armed: reader.flag()? }),
            RECOVER_ANSWER => Ok(Self::Recover { done: reader.flag()?, recovered: reader.flag()? }),
            command => Err(CrtpError::UnknownCommand(command)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::SupervisorBits as Bits;

    #[test]
    fn val_bits_of_the_supervisor_as_they_were_seen() {
        let quiet = Bits::ARMED | Bits::AUTO_ARM | Bits::CAN_FLY | Bits::PLANNER_FINISHED;
        let dead_deck = Bits::AUTO_ARM | Bits::PLANNER_FINISHED | Bits::DECK_FAULT;
        let seen = [
            (0x20E, quiet),
            (0x21E, quiet | Bits::FLYING),
            (0x244, Bits::AUTO_ARM | Bits::PLANNER_FINISHED | Bits::LOCKED),
            (0xA04, dead_deck),
            (0xA44, dead_deck | Bits::LOCKED),
            (0x201, Bits::CAN_BE_ARMED | Bits::PLANNER_FINISHED),
            (0x00E, Bits::ARMED | Bits::AUTO_ARM | Bits::CAN_FLY),
        ];
        for (bits, meaning) in seen {
            assert_eq!(Bits::from_bits_retain(bits), meaning, "{bits:#x}");
        }
    }
}
