//! Vertical velocity of the estimate against its own height (`navigation/slip` is the law).

use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::navigation::slip::{OFF_MPS2, SLIP_MPS};
use crate::out::voice::Severity;

/// The velocity is not that of the height.
pub(super) const SLIP: Condition = Condition {
    name: "climb_differs",
    seen_by: "UWB and barometer pull the height one way and the accelerometer the other: averaged over 1.5 s, the \
              estimated height changes by 0.6 m/s faster or slower than the estimated vertical velocity says, and for \
              0.8 s the specific force, averaged as long, differs from that of the thrust by more than 1 m/s² in the \
              direction that explains it. Gusts do the first without the second. Until 1.5 s after the take-off began \
              both are averaged over the time since, and 0.1 s is enough.",
    numbers: &[
        Number {
            key: "",
            value: |_| SLIP_MPS,
            unit: "m/s",
            origin: "nearly three times the largest in 160 flights over the shapes of the source (0.22 m/s)",
        },
        Number {
            key: "",
            value: |_| OFF_MPS2,
            unit: "m/s²",
            origin: "half of what a drift of 0.3 m/s² per second reaches before it is found; gusts stay below it, or for a moment only",
        },
    ],
    latched: true,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: vertical velocity is not that of the height",
    over: "",
    health: haltere_dialect::mav::haltere::MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_3D_ACCEL,
    severity: Severity::Emergency,
    is_seen: |sight| sight.navigation.slip.is_wrong(),
    words: |sight| {
        let slip_mps = -sight.navigation.slip.mps;
        format!("height climbs {slip_mps:+.1} m/s faster than the vertical velocity says")
    },
    ..ROW
};
