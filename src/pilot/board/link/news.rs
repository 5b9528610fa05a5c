//! What the board link has to tell the core.

use haltere_dialect::mav::haltere::MavResult;

use haltere_core::measure::{
    BaroSample, BatterySample, BoardAttitude, ImuSample, MagSample, OtherBattery, ReferencePose,
    ServoOutput, Tdoa,
};

use super::control::Change;
use super::profile::Firmware;

/// What the board link has to tell the core.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum BoardNews {
    Imu(ImuSample),
    Attitude(BoardAttitude),
    Battery(BatterySample),
    /// Of a pack that is not flown on.
    OtherBattery(OtherBattery),
    Servos(ServoOutput),
    Baro(BaroSample),
    Mag(MagSample),
    Reference(ReferencePose),
    /// Of a deck of the board, which is the tag.
    Tdoa(Tdoa),
    /// Where anchors 0 to 7 say they stand, in the world of the survey, m.
    Anchors([Option<[f32; 3]>; 8]),
    Found {
        system_id: u8,
        firmware: Firmware,
    },
    Armed(bool),
    /// It said for the first time that it is disarmed, which nobody asked for: one word may be wrong.
    Doubt,
    /// It says again that it is armed, after so many heartbeats that denied it.
    ArmedAgain {
        denials: u32,
    },
    /// The board's answer to our arm or disarm command.
    ArmAnswer {
        arm: bool,
        accepted: bool,
        why: String,
    },
    /// The board's answer to a command that was passed on.
    PassedOnAnswer(MavResult),
    Text {
        severity: u8,
        text: String,
    },
    /// Something that the link itself has to tell people.
    Notice {
        warning: bool,
        text: String,
    },
    /// The board left our mode, or came back to it.
    Mode(Change),
    /// It flies another setpoint than ours, or ours again.
    Ignored {
        ignored: bool,
        sent_frac: f64,
        board_frac: f64,
    },
    /// The board was silent for so long, s, and is back.
    Back {
        silent_s: f64,
    },
}
