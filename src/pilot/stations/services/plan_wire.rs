//! Mission items with floats, which older clients send and want: to integers and back.

use haltere_dialect::mav::LOCAL_PER_M;
use haltere_dialect::mav::haltere::{MISSION_ITEM_DATA, MISSION_ITEM_INT_DATA};

use crate::flight::mission_items::is_global;
use crate::flight::place::LOCAL_SCALE;

/// Degrees of the globe on the wire.
const E7: f64 = 1e7;

/// A float item as the integer item that it means.
pub(crate) fn to_int(m: &MISSION_ITEM_DATA) -> MISSION_ITEM_INT_DATA {
    let scale = if is_global(m.frame) { E7 } else { LOCAL_PER_M };
    // Casts saturate; NaN becomes zero, "here".
    let [x, y] = [m.x, m.y].map(|v| (f64::from(v) * scale).round() as i32);
    MISSION_ITEM_INT_DATA {
        param1: m.param1,
        param2: m.param2,
        param3: m.param3,
        param4: m.param4,
        x,
        y,
        z: m.z,
        seq: m.seq,
        command: m.command,
        target_system: m.target_system,
        target_component: m.target_component,
        frame: m.frame,
        current: m.current,
        autocontinue: m.autocontinue,
        mission_type: m.mission_type,
    }
}

/// The integer item as the older message has it.
pub(crate) fn to_float(m: &MISSION_ITEM_INT_DATA) -> MISSION_ITEM_DATA {
    let scale = if is_global(m.frame) { E7.recip() } else { LOCAL_SCALE };
    let [x, y] = [m.x, m.y].map(|v| (f64::from(v) * scale) as f32);
    MISSION_ITEM_DATA {
        param1: m.param1,
        param2: m.param2,
        param3: m.param3,
        param4: m.param4,
        x,
        y,
        z: m.z,
        seq: m.seq,
        command: m.command,
        target_system: m.target_system,
        target_component: m.target_component,
        frame: m.frame,
        current: m.current,
        autocontinue: m.autocontinue,
        mission_type: m.mission_type,
    }
}
