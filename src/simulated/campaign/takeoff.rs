//! The ways in which a station gets a vehicle off the floor.

use haltere_pilot::mission_file::MissionFile;

/// Height that all but the mission ask for, m.
pub const HEIGHT_M: f64 = 1.5;

/// One of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TakeOff {
    /// The mission's first item.
    Mission,
    /// `MAV_CMD_NAV_TAKEOFF`.
    Command,
    /// Setpoints of a place, and the mode offboard.
    Place,
    /// Setpoints of a rate upwards, and the mode offboard.
    Climb,
    /// The same, and `MAV_CMD_DO_REPOSITION` before it has left the floor.
    Point,
}

impl TakeOff {
    /// All of them.
    pub const ALL: [Self; 5] =
        [Self::Mission, Self::Command, Self::Place, Self::Climb, Self::Point];

    /// Name in rows.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mission => "mission",
            Self::Command => "command",
            Self::Place => "offboard place",
            Self::Climb => "offboard rate",
            Self::Point => "point",
        }
    }

    /// The greatest height that is asked for, m.
    pub fn highest_m(self, mission: &MissionFile) -> f64 {
        if self != Self::Mission {
            return HEIGHT_M;
        }
        let heights = mission
            .items
            .iter()
            .flat_map(|item| [item.height_m, item.position_m.map(|[_, _, height_m]| height_m)]);
        heights.flatten().fold(0.0, f64::max)
    }
}
