//! UWB: measurements that stay away, anchors that fall silent.

use haltere_dialect::mav::haltere::MavSysStatusSensor as S;

use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::out::voice::Severity;
use crate::view::Sight;
use haltere_core::measure::AnchorId;

/// Age of the newest fused measurement from which on the position is dead reckoning, s: the filter's
/// health calls itself degraded then.
const DEAD_RECKONING_S: f64 = 0.3;

impl Sight<'_> {
    /// Anchors that are needed: no more than there are.
    pub(crate) fn anchors_needed(&self) -> usize {
        usize::from(self.view.config.supervisor.anchors_least).min(self.view.survey.ids().len())
    }

    /// The larger horizontal sigma of the position, m.
    fn std_horizontal_m(&self) -> f64 {
        let std = self.view.estimate.std_pos_E_m;
        std.x().max(std.y())
    }
}

fn words_of_loss(sight: &Sight<'_>) -> String {
    let why = if sight.navigation.tag.engine.is_played_again()
        || sight.navigation.tag.mavlink.is_played_again()
    {
        "; what comes was heard before, or its time runs backwards: connect the tag anew"
    } else if sight.navigation.tag.engine.is_old() || sight.navigation.tag.mavlink.is_old() {
        "; what comes is old: connect the tag anew"
    } else {
        ""
    };
    format!(
        "no UWB for {:.1} s, position known to {:.2} m{why}",
        sight.navigation.uwb_age_s(sight.view.at).min(999.0),
        sight.std_horizontal_m()
    )
}

fn is_anchor_silent(sight: &Sight<'_>) -> bool {
    let limit_s = sight.view.config.supervisor.anchor_silent_s;
    let silent = |id: &AnchorId| {
        sight
            .navigation
            .anchors
            .silent_s(*id, sight.view.at)
            .is_some_and(|silent_s| silent_s > limit_s)
    };
    // If all are silent it is the tag.
    sight.navigation.uwb_age_s(sight.view.at) < limit_s
        && sight.view.survey.ids().iter().any(silent)
}

fn words_of_anchor(sight: &Sight<'_>) -> String {
    let limit_s = sight.view.config.supervisor.anchor_silent_s;
    let ids: Vec<String> = sight
        .view
        .survey
        .ids()
        .iter()
        .filter(|id| {
            sight.navigation.anchors.silent_s(**id, sight.view.at).is_some_and(|s| s > limit_s)
        })
        .map(ToString::to_string)
        .collect();
    format!(
        "anchor {} silent, {} of {} heard",
        ids.join(", "),
        sight.navigation.anchors_alive(&sight.view),
        sight.view.survey.ids().len()
    )
}

/// Measurements are late.
pub(super) const STALE: Condition = Condition {
    name: "uwb_stale",
    seen_by: "No UWB measurement was fused for a moment. The filter goes on by IMU, drag model and \
              barometer (dead reckoning).",
    numbers: &[Number {
        key: "",
        value: |_| DEAD_RECKONING_S,
        unit: "s",
        origin: "age at which the filter calls itself degraded",
    }],
    because: "UWB is late",
    over: "UWB measurements are back",
    health: S::MAV_SYS_STATUS_SENSOR_VISION_POSITION,
    severity: Severity::Warning,
    is_seen: |sight| sight.navigation.uwb_age_s(sight.view.at) > DEAD_RECKONING_S,
    words: words_of_loss,
    ..ROW
};

/// Measurements are gone.
pub(super) const LOST: Condition = Condition {
    name: "uwb_lost",
    seen_by: "No UWB measurement was fused for `limits.uwb_loss_land_s`; or for 0.3 s, and the \
              horizontal position has become less certain than `supervisor.uwb_loss_std_m`.",
    numbers: &[
        Number {
            key: "limits.uwb_loss_land_s",
            value: |c| c.limits.uwb_loss_land_s,
            unit: "s",
            origin: "tuned: half the age at which the filter gives itself up",
        },
        Number {
            key: "supervisor.uwb_loss_std_m",
            value: |c| c.supervisor.uwb_loss_std_m,
            unit: "m",
            origin: "between the filter's own 0.4 m (degraded) and 2 m (lost)",
        },
    ],
    wanted: |_| Reaction::Land,
    because: "no UWB measurements",
    over: "UWB measurements are back",
    health: S::MAV_SYS_STATUS_SENSOR_VISION_POSITION,
    severity: Severity::Critical,
    is_seen: |sight| {
        let age_s = sight.navigation.uwb_age_s(sight.view.at);
        let lost_m = sight.view.config.supervisor.uwb_loss_std_m;
        age_s > sight.view.config.limits.uwb_loss_land_s
            || (age_s > DEAD_RECKONING_S && sight.std_horizontal_m() > lost_m)
    },
    words: words_of_loss,
    ..ROW
};

/// An anchor that was heard is not heard any more.
pub(super) const ANCHOR: Condition = Condition {
    name: "anchor_silent",
    seen_by: "An anchor that was heard before has been silent for `supervisor.anchor_silent_s`, while \
              others speak.",
    numbers: &[Number {
        key: "supervisor.anchor_silent_s",
        value: |c| c.supervisor.anchor_silent_s,
        unit: "s",
        origin: "20 turns of the slowest anchor (20 Hz, TDoA3)",
    }],
    because: "an anchor is silent",
    over: "all anchors are heard again",
    severity: Severity::Warning,
    is_seen: is_anchor_silent,
    words: words_of_anchor,
    ..ROW
};

/// Too few anchors are left.
pub(super) const ANCHORS: Condition = Condition {
    name: "anchors_few",
    seen_by: "Fewer than `supervisor.anchors_least` anchors are heard (or fewer than there are, where \
              the survey has no more).",
    numbers: &[Number {
        key: "supervisor.anchors_least",
        value: |c| f64::from(c.supervisor.anchors_least),
        unit: "",
        origin: "derived: four determine a position by TDOA, with nothing left to check it by",
    }],
    lasts_s: |_| 0.5,
    wanted: |_| Reaction::Land,
    because: "too few anchors",
    over: "enough anchors are heard again",
    health: S::MAV_SYS_STATUS_SENSOR_VISION_POSITION,
    severity: Severity::Critical,
    watched: Watched::Flight,
    is_seen: |sight| sight.navigation.anchors_alive(&sight.view) < sight.anchors_needed(),
    words: |sight| {
        format!(
            "{} of {} anchors heard, {} needed",
            sight.navigation.anchors_alive(&sight.view),
            sight.view.survey.ids().len(),
            sight.anchors_needed()
        )
    },
    ..ROW
};
