//! Tipped over on the floor, with motors that run (`navigation/lying` finds it).

use super::condition::{Condition, Number, ROW};
use super::reaction::Reaction;
use crate::navigation::lying::CARRIED_MPS2;
use crate::out::voice::Severity;

/// Lies on its side.
pub(super) const LIES: Condition = Condition {
    name: "tipped_over",
    seen_by: "The vehicle may lie on the floor: for 0.4 s it leans by 30 degrees by the board's attitude, its thrust \
              points as far from where it was told to, its specific force along the vertical is gravity's to within 2 \
              m/s², nothing pushes it aside by 4 m/s² or moves it by 0.3 m, and it is near the floor (below 0.8 m by \
              estimate or barometer) or at a height that does not fall. Fast flight looks like that too. Therefore the \
              thrust is taken away: in the air the force goes with it, and the flight goes on after a quarter of a \
              second. If the vehicle is still carried for 0.08 s when the wings stand, 0.16 s later, it lies on the \
              floor: the motors are cut, forced, and thrust is not tried again.",
    numbers: &[Number {
        key: "",
        value: |_| CARRIED_MPS2,
        unit: "m/s²",
        origin: "half of what drag leaves of the weight at the fastest lean that flies level, 60 degrees",
    }],
    gone_s: 0.0,
    latched: true,
    wanted: |_| Reaction::Disarm,
    because: "tipped over on the floor",
    severity: Severity::Emergency,
    is_seen: |sight| sight.navigation.lying.is_found(),
    words: |_| "lies on the floor: motors are cut".to_owned(),
    ..ROW
};
