//! The modes that clients may see and choose.

use haltere_dialect::mav::haltere::{MavModeProperty, MavStandardMode};

use super::modes::Mode;

/// A mode that clients may see, and its place in AVAILABLE_MODES.
pub(crate) struct ShownMode {
    /// The mode.
    pub mode: Mode,
    /// Name for people.
    pub name: &'static str,
    /// What MAVLink's standard reserves it as. Position hold and its like are not ours to use: the
    /// standard forbids them to types that are neither multicopter, VTOL nor plane (STATIONS.md).
    pub standard: MavStandardMode,
    /// Whether it flies by itself.
    pub properties: MavModeProperty,
}

const AUTO: MavModeProperty = MavModeProperty::MAV_MODE_PROPERTY_AUTO_MODE;

/// All of them. The index on the wire counts from 1.
pub(crate) static SHOWN_MODES: [ShownMode; 7] = [
    shown(Mode::Manual, "Position", MavStandardMode::MAV_STANDARD_MODE_NON_STANDARD, false),
    shown(Mode::Hold, "Hold", MavStandardMode::MAV_STANDARD_MODE_NON_STANDARD, true),
    shown(Mode::Mission, "Mission", MavStandardMode::MAV_STANDARD_MODE_MISSION, true),
    shown(Mode::Takeoff, "Takeoff", MavStandardMode::MAV_STANDARD_MODE_TAKEOFF, true),
    shown(Mode::Land, "Land", MavStandardMode::MAV_STANDARD_MODE_LAND, true),
    shown(Mode::Return, "Return", MavStandardMode::MAV_STANDARD_MODE_SAFE_RECOVERY, true),
    shown(Mode::Offboard, "Offboard", MavStandardMode::MAV_STANDARD_MODE_NON_STANDARD, true),
];

const fn shown(mode: Mode, name: &'static str, standard: MavStandardMode, auto: bool) -> ShownMode {
    let properties = if auto { AUTO } else { MavModeProperty::empty() };
    ShownMode { mode, name, standard, properties }
}
