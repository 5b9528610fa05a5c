//! The generated MAVLink dialect: `common` and the messages of `xml/haltere.xml`.

pub use mavlink::*;

include!(concat!(env!("OUT_DIR"), "/generated/mod.rs"));

use std::fmt::Debug;

use num_traits::FromPrimitive;

use haltere::{
    COMMAND_ACK_DATA, COMMAND_INT_DATA, COMMAND_LONG_DATA, MavCmd, MavMessage, MavResult,
};

/// MISSION_ITEM_INT and COMMAND_INT count x and y of a local frame in 0.1 mm.
pub const LOCAL_PER_M: f64 = 1e4;

/// What a number of a received message means; `None`: the dialect has no name for it.
pub fn known<T: FromPrimitive>(number: impl Into<u64>) -> Option<T> {
    T::from_u64(number.into())
}

/// Its name for people, or the number itself.
pub fn name_of<T: FromPrimitive + Debug>(number: impl Into<u64> + Copy) -> String {
    known::<T>(number).map_or_else(|| number.into().to_string(), |value| format!("{value:?}"))
}

/// A command with its numbers, to a system and component; numbers that are not given are zero.
pub fn command_long(
    (target_system, target_component): (u8, u8),
    command: MavCmd,
    params: &[f32],
    confirmation: u8,
) -> MavMessage {
    let mut all = [0.0; 7];
    all.iter_mut().zip(params).for_each(|(slot, param)| *slot = *param);
    let [param1, param2, param3, param4, param5, param6, param7] = all;
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        param1,
        param2,
        param3,
        param4,
        param5,
        param6,
        param7,
        command: command as u16,
        target_system,
        target_component,
        confirmation,
    })
}

/// A command with a place in the room: x and y in 0.1 mm, z in m, down.
pub fn command_int(
    (target_system, target_component): (u8, u8),
    command: MavCmd,
    [param1, param2, param3, param4]: [f32; 4],
    (x, y, z): (i32, i32, f32),
) -> MavMessage {
    MavMessage::COMMAND_INT(COMMAND_INT_DATA {
        param1,
        param2,
        param3,
        param4,
        x,
        y,
        z,
        command: command as u16,
        target_system,
        target_component,
        frame: haltere::MavFrame::MAV_FRAME_LOCAL_NED as u8,
        current: 0,
        autocontinue: 0,
    })
}

/// The answer to a command, by its number.
pub fn command_ack(to: (u8, u8), command: u16, result: MavResult) -> MavMessage {
    MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
        command,
        result: result as u8,
        // 255: how far it is, nobody knows.
        progress: if result == MavResult::MAV_RESULT_IN_PROGRESS { u8::MAX } else { 0 },
        result_param2: 0,
        target_system: to.0,
        target_component: to.1,
    })
}
