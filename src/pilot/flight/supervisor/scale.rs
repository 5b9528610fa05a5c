//! The scale of the accelerometer (`navigation/scale` is the law).

use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::flight::modes::Mode;
use crate::navigation::scale::MOST_RATIO;
use crate::out::voice::Severity;

/// The accelerometer reads another scale.
pub(super) const SCALE: Condition = Condition {
    name: "force_scale",
    seen_by: "The accelerometer shows too much lift: its specific force along body z, over the one that the thrust \
              makes (with the lag of the wings and the drag of the fall that the thrust allows), is more than 1.33 \
              times (under a client or joystick 1.55 times) what is usual in this flight, or 1.33 (1.55) where the \
              usual is less than 1. Where the board's attitude follows later than 0.3 s, the thrust of 0.15 s before \
              may explain the force as well.\n\n\
              Where the floor may carry, the force must also exceed 1.3 g and what would stop the sinking that the \
              thrust allows. The floor may carry below 0.5 m by estimate or barometer (in landings once below 0.8 m, \
              in take-offs by the barometer) and while the floor is felt for. Where the vehicle stood at an estimated \
              height of more than 0.5 m, it may carry up to 0.5 m above that, and higher by what the thrust let the \
              vehicle sink within a second unseen by the estimate.\n\n\
              The condition is not looked at while the board's link is late, nor until 0.45 s after the vehicle leaned by more than 30 degrees or was kept down \
              near the floor. The descent begins with height and speed of half a second before, carried on by the \
              thrust.",
    numbers: &[Number {
        key: "",
        value: |_| MOST_RATIO,
        unit: "",
        origin: "geometric middle of what 24 healthy flights in lockstep have at most (1.18) and a sensor that reads half as \
                 much again; the flights of `haltere-lab paper` come to 1.29 in landings",
    }],
    lasts_s: |_| 0.06,
    watched: Watched::In(&[
        Mode::Takeoff,
        Mode::Hold,
        Mode::Goto,
        Mode::Mission,
        Mode::Return,
        Mode::Land,
        Mode::Offboard,
        Mode::Manual,
    ]),
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: accelerometer reads another scale",
    over: "",
    latched: true,
    health: haltere_dialect::mav::haltere::MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_ACCEL,
    severity: Severity::Emergency,
    is_seen: |sight| sight.navigation.scale.wrong,
    words: |sight| {
        format!(
            "accelerometer reads {:.1} times the force of the thrust",
            sight.navigation.scale.ratio
        )
    },
    ..ROW
};
