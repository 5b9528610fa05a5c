//! Who we say we are: type, autopilot, version, and the list of modes.

use haltere_dialect::mav::haltere::{
    AUTOPILOT_VERSION_DATA, AVAILABLE_MODES_DATA, CURRENT_MODE_DATA, MavAutopilot, MavMessage,
    MavProtocolCapability, MavStandardMode, MavType,
};

use super::endpoint::Identity;
use crate::flight::modes::Mode;
use crate::flight::shown_modes::SHOWN_MODES;

/// MAV_TYPE_FLAPPING_WING.
pub(crate) const FLAPPING_WING: u8 = MavType::MAV_TYPE_FLAPPING_WING as u8;
/// Version that is told with identity `px4`: QGroundControl asks for 1.4.1 at least and chooses its
/// translation of parameters by it (STATIONS.md). Major, minor, patch, and 255 for a release.
const PX4_VERSION: u32 = 1 << 24 | 14 << 16 | 0xFF;
/// The last byte of `flight_sw_version` for a development version (FIRMWARE_VERSION_TYPE_DEV).
const DEVELOPMENT: u32 = 0;

/// The mode that MAVLink's standard names so.
pub(crate) fn standard_mode(number: f64) -> Option<Mode> {
    SHOWN_MODES
        .iter()
        .find(|m| {
            m.standard != MavStandardMode::MAV_STANDARD_MODE_NON_STANDARD
                && f64::from(m.standard as u8) == number
        })
        .map(|m| m.mode)
}

/// AVAILABLE_MODES of a 1-based index.
pub(crate) fn available_mode(index: usize, identity: Identity) -> Option<MavMessage> {
    let shown = SHOWN_MODES.get(index.checked_sub(1)?)?;
    let name = match (shown.mode, identity) {
        // As the map has it by which pymavlink, MAVProxy and DroneKit know the mode.
        (Mode::Return, Identity::Generic) => "RTL",
        _ => shown.name,
    };
    Some(MavMessage::AVAILABLE_MODES(AVAILABLE_MODES_DATA {
        custom_mode: shown.mode.custom_mode(),
        properties: shown.properties,
        number_modes: SHOWN_MODES.len() as u8,
        mode_index: index as u8,
        standard_mode: shown.standard,
        mode_name: name.into(),
    }))
}

/// CURRENT_MODE for the mode shown and the one that was last asked for.
pub(crate) fn current_mode(custom_mode: u32, intended_custom_mode: u32) -> MavMessage {
    let standard_mode = SHOWN_MODES
        .iter()
        .find(|m| m.mode.custom_mode() == custom_mode)
        .map_or(MavStandardMode::MAV_STANDARD_MODE_NON_STANDARD, |m| m.standard);
    MavMessage::CURRENT_MODE(CURRENT_MODE_DATA { custom_mode, intended_custom_mode, standard_mode })
}

/// `MAV_AUTOPILOT` of an identity.
pub(crate) fn autopilot(identity: Identity) -> MavAutopilot {
    match identity {
        Identity::Generic => MavAutopilot::MAV_AUTOPILOT_GENERIC,
        Identity::Px4 => MavAutopilot::MAV_AUTOPILOT_PX4,
    }
}

/// What we can do, honestly: what AUTOPILOT_VERSION tells.
fn capabilities() -> MavProtocolCapability {
    use MavProtocolCapability as C;
    C::MAV_PROTOCOL_CAPABILITY_MISSION_FLOAT
        | C::MAV_PROTOCOL_CAPABILITY_MISSION_INT
        | C::MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
        | C::MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
        // All parameters are floats, so it is the same; the bits of the hash are bytewise.
        | C::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
        | C::MAV_PROTOCOL_CAPABILITY_FTP
        | C::MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | C::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
        | C::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
        | C::MAV_PROTOCOL_CAPABILITY_MAVLINK2
}

/// AUTOPILOT_VERSION.
pub(crate) fn autopilot_version(identity: Identity) -> MavMessage {
    let number = |text: &str| text.parse::<u32>().unwrap_or(0) & 0xFF;
    let own = [
        number(env!("CARGO_PKG_VERSION_MAJOR")),
        number(env!("CARGO_PKG_VERSION_MINOR")),
        number(env!("CARGO_PKG_VERSION_PATCH")),
    ];
    // PX4 lays out its vendor's version in the first three bytes, lowest last, and the hash behind.
    let mut flight_custom_version = [0; 8];
    let flight_sw_version = match identity {
        Identity::Generic => own[0] << 24 | own[1] << 16 | own[2] << 8 | DEVELOPMENT,
        Identity::Px4 => {
            for (byte, part) in flight_custom_version.iter_mut().rev().zip(own) {
                *byte = part as u8;
            }
            PX4_VERSION
        }
    };
    MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
        capabilities: capabilities(),
        uid: 0,
        flight_sw_version,
        middleware_sw_version: 0,
        os_sw_version: 0,
        board_version: 0,
        vendor_id: 0,
        product_id: 0,
        flight_custom_version,
        middleware_custom_version: [0; 8],
        os_custom_version: [0; 8],
        uid2: [0; 18],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_shipped_map_holds_every_mode() {
        // pymavlink, MAVProxy and DroneKit read it; a mode that is missing there ends DroneKit.
        let text = include_str!("../../../stations/custom_mode_map.json");
        for shown in &SHOWN_MODES {
            let entry = format!("\"{}\":", shown.mode.custom_mode());
            assert!(text.contains(&entry), "{} has no {entry}", shown.name);
        }
        assert!(text.contains(&format!("\"{FLAPPING_WING}\": {{")));
        assert_eq!(text.matches(':').count(), SHOWN_MODES.len() + 1);
    }

    /// Two vehicles of one station: each is spoken to by its own number, and answers with it.
    #[test]
    fn prop_the_system_id_is_the_one_that_is_configured() {
        use haltere_dialect::mav::haltere::{COMMAND_LONG_DATA, MavCmd};
        let config = crate::config::PilotConfig { system_id: 7, ..Default::default() };
        let mut bench = crate::bench::Bench::new(config);
        for (target_system, answers) in [(7, 1), (1, 0)] {
            let ask = COMMAND_LONG_DATA {
                command: MavCmd::MAV_CMD_NAV_LAND as u16,
                target_system,
                target_component: 1,
                ..Default::default()
            };
            let acks = |m: &MavMessage| matches!(m, MavMessage::COMMAND_ACK(_));
            let heard = bench.says(&MavMessage::COMMAND_LONG(ask));
            assert_eq!(heard.into_iter().filter(acks).count(), answers, "{target_system}");
        }
        bench.run(1.1);
        assert_eq!(bench.heard_from, [7].into());
    }

    #[test]
    fn prop_reserved_standard_modes_are_not_claimed() {
        // 1 position hold, 2 orbit, 3 cruise, 4 altitude hold.
        for number in 0..=4_u8 {
            assert_eq!(standard_mode(f64::from(number)), None);
        }
        assert_eq!(standard_mode(7.0), Some(Mode::Land));
        assert_eq!(standard_mode(f64::NAN), None);
        let none = |index| available_mode(index, Identity::Generic).is_none();
        assert!(none(0) && none(SHOWN_MODES.len() + 1));
    }
}
