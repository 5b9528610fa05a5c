//! The room: floor, walls and ceiling, in the Earth frame. The floor is z = 0.

use serde::{Deserialize, Serialize};

use haltere_core::checks::Problems;
use haltere_core::frames::{E, U, Vec3, earth_from_survey};
use haltere_core::measure::AnchorId;

/// Walls and ceiling.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Room {
    /// South and north wall, m north of the origin.
    pub north_m: [f64; 2],
    /// West and east wall, m east of the origin.
    pub east_m: [f64; 2],
    /// Height of the ceiling over the floor, m.
    pub ceiling_m: f64,
}

impl Default for Room {
    /// The hall of the source: 10 × 10 × 7 m.
    fn default() -> Self {
        Self { north_m: [0.0, 10.0], east_m: [0.0, 10.0], ceiling_m: 7.0 }
    }
}

impl Room {
    /// Eight anchors in the corners, Earth frame, m: bit 0 of the id north, bit 1 east, bit 2 up.
    pub fn corner_anchors(&self) -> Vec<(AnchorId, Vec3<E>)> {
        let pick = |id: u8, bit: u8, [low, high]: [f64; 2]| if id & bit != 0 { high } else { low };
        (0..8)
            .map(|id| {
                let up_m = pick(id, 4, [0.0, self.ceiling_m]);
                let down_m = earth_from_survey(Vec3::<U>::new(0.0, 0.0, up_m)).z();
                let (north, east) = (pick(id, 1, self.north_m), pick(id, 2, self.east_m));
                (AnchorId(id), Vec3::new(north, east, down_m))
            })
            .collect()
    }

    /// Refuses what cannot be a room.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        for (name, [low, high]) in [("north_m", self.north_m), ("east_m", self.east_m)] {
            problems.range(format_args!("{key}.{name}[0]"), low, -200.0..=200.0, "m");
            problems.range(format_args!("{key}.{name}[1]"), high, low + 0.5..=low + 200.0, "m");
        }
        problems.range(format_args!("{key}.ceiling_m"), self.ceiling_m, 1.0..=50.0, "m");
    }
}
