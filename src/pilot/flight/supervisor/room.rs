//! The room: whether its axes and its heading are what UWB and lean together say (`rooms` is the law).

use haltere_dialect::mav::haltere::MavSysStatusSensor as S;

use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::navigation::rooms::AGAINST;
use crate::out::voice::Severity;

/// The axes or the heading are not the room's.
pub(super) const ROOM: Condition = Condition {
    name: "room_differs",
    seen_by: "UWB leads elsewhere than the vehicle leans. From the first 0.12 m of a flight on, the board's lean, \
              turned by our heading, is compared ten times a second with where UWB has the vehicle, for sound rooms \
              (turned by up to 40 degrees, or 0.6 to 1.6 times as large) and for fifteen wrong ones (turned by 90 \
              degrees and more, or mirror images). A wrong room is found when it is e^20 (half a billion) times as likely as \
              every sound one and has foreseen where UWB leads; after a gust, which none foresees, the comparison begins \
              anew. The text names the room.",
    numbers: &[Number {
        key: "",
        value: |_| AGAINST,
        unit: "",
        origin: "the exponent: a sound flight would have to last a year for each wrong room to meet it once by chance; e^15 \
                 was reached, in turbulence",
    }],
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: UWB does not lead where the vehicle leans",
    over: "",
    latched: true,
    health: S::MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL,
    severity: Severity::Emergency,
    is_seen: |sight| sight.navigation.rooms.is_wrong(),
    words: |sight| sight.navigation.rooms.words(),
    ..ROW
};
