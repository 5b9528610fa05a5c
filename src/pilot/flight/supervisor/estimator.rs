//! The estimate: lost by its own word, diverged from its measurements, or from sensors that do not enter it.

use haltere_dialect::mav::haltere::MavSysStatusSensor as S;

use super::condition::{Condition, Number, ROW, Watched};
use super::envelope::LEAP;
use super::reaction::Reaction;
use super::scale::SCALE;
use super::slip::SLIP;
use crate::navigation::evidence::{DOUBT_SHARE, MOST_REMEDIES, REMEDIES_S};
use crate::out::voice::Severity;
use crate::view::Sight;
use haltere_core::estimate::Health;

/// What a barometer may err by in a room, m.
const BARO_NOISE_M: f64 = 0.3;
/// The barometer alone ends a flight after this time, s.
const BARO_ALONE_S: f64 = 3.0;

impl Sight<'_> {
    /// Height above the floor, m, and sinking speed, m/s, with which a descent begins: the estimate's, or those of a
    /// moment ago where the estimate has followed an accelerometer that lies. The height is the barometer's where that is
    /// larger: taken too high it costs seconds, taken too low it ends in a fall.
    pub(crate) fn height_and_sink_to_descend_from(&self) -> (f64, f64) {
        let leapt = [SCALE, LEAP, SLIP].iter().any(|row| self.flight.supervisor.has(row.name));
        let before = self.navigation.before.carried_on().filter(|_| leapt);
        let sink_mps = if self.imu_is_alive() { self.flight.last_sink_mps } else { 0.0 };
        let (known_m, sink_mps) = before.unwrap_or((self.flight.last_height_m, sink_mps));
        let baro_m = self.navigation.baro_above_floor_m(&self.view);
        (baro_m.map_or(known_m, |baro_m| known_m.max(baro_m - BARO_NOISE_M)), sink_mps)
    }
}

const POSITION: S = S::MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL
    .union(S::MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL)
    .union(S::MAV_SYS_STATUS_AHRS);

/// The filter gave itself up.
pub(super) const LOST: Condition = Condition {
    name: "estimate_lost",
    seen_by: "The filter says that it is lost (no UWB fused for 2 s, or position sigma beyond 2 m) or \
              not aligned.",
    numbers: &[
        Number { key: "", value: |_| 2.0, unit: "s", origin: "the filter's own limit of age" },
        Number { key: "", value: |_| 2.0, unit: "m", origin: "the filter's own limit of sigma" },
    ],
    wanted: |_| Reaction::Descend,
    because: "no usable estimate",
    over: "estimate usable again",
    health: POSITION,
    severity: Severity::Emergency,
    is_seen: |sight| !matches!(sight.view.estimate.health, Health::Good | Health::Degraded),
    words: |sight| {
        let why = if sight.view.estimate.health == Health::Lost { "lost" } else { "not aligned" };
        format!("estimator {why}")
    },
    ..ROW
};

/// Our vertical is not the board's.
pub(super) const ATTITUDE: Condition = Condition {
    name: "attitude_differs",
    seen_by: "Our vertical and the board's, which has a filter of its own, differ by more than \
              `supervisor.attitude_difference_deg`, or gyroscope and board's attitude have turned about the vertical against \
              one another by as much.",
    numbers: &[Number {
        key: "supervisor.attitude_difference_deg",
        value: |c| c.supervisor.attitude_difference_deg,
        unit: "deg",
        origin: "tilt steps of 52 deg in the simulator stay below",
    }],
    lasts_s: |_| 0.3,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: attitude differs from the board's",
    over: "attitude is the board's again",
    health: POSITION,
    severity: Severity::Emergency,
    is_seen: |sight| {
        let most_rad = sight.view.config.supervisor.attitude_difference_deg.to_radians();
        sight.navigation.attitude_difference_rad(&sight.view).is_some_and(|rad| rad > most_rad)
    },
    words: |sight| {
        let deg =
            sight.navigation.attitude_difference_rad(&sight.view).unwrap_or_default().to_degrees();
        format!("attitude differs from the board's by {deg:.0} deg")
    },
    ..ROW
};

/// Most measurements do not fit.
pub(super) const DIVERGED: Condition = Condition {
    name: "estimate_diverged",
    seen_by: "More than `supervisor.divergence_share` of the UWB measurements lie beyond the gate \
              (innovation over its sigma), for `supervisor.divergence_s`: whatever the filter did to \
              recover has not helped. A landing would fly by what is in doubt.",
    numbers: &[
        Number {
            key: "supervisor.divergence_share",
            value: |c| c.supervisor.divergence_share,
            unit: "",
            origin: "twice the share at which the filter doubts itself and begins to recover",
        },
        Number {
            key: "supervisor.divergence_s",
            value: |c| c.supervisor.divergence_s,
            unit: "s",
            origin: "time for three remedies of the filter",
        },
    ],
    lasts_s: |c| c.supervisor.divergence_s,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "estimate does not fit UWB",
    over: "estimate fits UWB again",
    health: S::MAV_SYS_STATUS_AHRS,
    severity: Severity::Critical,
    is_seen: |sight| {
        sight.navigation.evidence.beyond_share > sight.view.config.supervisor.divergence_share
    },
    words: |sight| {
        let share = sight.navigation.evidence.beyond_share;
        format!("{:.0} % of UWB measurements do not fit the estimate", share * 100.0)
    },
    ..ROW
};

/// The filter does not heal.
pub(super) const UNHEALED: Condition = Condition {
    name: "estimate_unhealed",
    seen_by: "The filter has widened its covariance or sought its position anew five times within 8 s, \
              and doubts itself still.",
    numbers: &[Number {
        key: "",
        value: |_| REMEDIES_S,
        unit: "s",
        origin: "a remedy takes effect within half a second; three are all that it knows",
    }],
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "estimate does not recover",
    over: "estimate has recovered",
    health: S::MAV_SYS_STATUS_AHRS,
    severity: Severity::Critical,
    is_seen: |sight| {
        let first = sight.navigation.evidence.first_remedied_at();
        first.is_some_and(|t| sight.view.at.seconds_since(t) < REMEDIES_S)
    },
    words: |_| format!("estimator recovered {MOST_REMEDIES} times in {REMEDIES_S:.0} s"),
    ..ROW
};

const HEIGHT_MOST: Number = Number {
    key: "supervisor.height_difference_m",
    value: |c| c.supervisor.height_difference_m,
    unit: "m",
    origin: "three sigma of the barometer as the filter takes it",
};

/// Barometer and UWB both say that the estimate is elsewhere.
pub(super) const CONTRADICTED: Condition = Condition {
    name: "estimate_contradicted",
    seen_by: "Estimated and barometric height differ by more than `supervisor.height_difference_m`, and \
              a second witness agrees: more than 15 % of the UWB measurements lie beyond the gate, or the \
              height changes otherwise than the accelerometer's velocity, by 0.6 m/s and away from the barometer's. \
              The estimate is not taken back before the vehicle is disarmed: it would be climbed by again.",
    numbers: &[
        HEIGHT_MOST,
        Number {
            key: "",
            value: |_| DOUBT_SHARE,
            unit: "",
            origin: "chosen: of 76 437 measurements of a sound flight none lay beyond the gate \
                     (`haltere-sim demo --short`)",
        },
    ],
    lasts_s: |_| 0.3,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: barometer and another contradict it",
    over: "",
    latched: true,
    health: POSITION,
    severity: Severity::Emergency,
    is_seen: |sight| {
        let most_m = sight.view.config.supervisor.height_difference_m;
        let contradicts = |m: f64| m.abs() > most_m && sight.navigation.has_second_witness(m);
        sight.navigation.height_difference_m(sight.view.at).is_some_and(contradicts)
    },
    words: |sight| {
        let by_m = sight.navigation.height_difference_m(sight.view.at).unwrap_or_default();
        let share = sight.navigation.evidence.beyond_share;
        format!(
            "height {by_m:+.1} m against the barometer, {:.0} % of UWB do not fit",
            share * 100.0
        )
    },
    ..ROW
};

/// The barometer alone says another height, and goes on saying so.
pub(super) const BAROMETER: Condition = Condition {
    name: "height_contradicted",
    seen_by: "Estimated and barometric height differ by more than `supervisor.height_difference_m` for longer than a \
              door that opens moves the pressure of a room. The estimate is not taken back before the vehicle is \
              disarmed.",
    numbers: &[
        HEIGHT_MOST,
        Number {
            key: "",
            value: |_| BARO_ALONE_S,
            unit: "s",
            origin: "chosen: a door moves the pressure of a room for a moment",
        },
    ],
    lasts_s: |_| BARO_ALONE_S,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: barometer contradicts it",
    over: "",
    latched: true,
    health: POSITION,
    severity: Severity::Emergency,
    ..HEIGHT
};

/// The barometer says another height.
pub(super) const HEIGHT: Condition = Condition {
    name: "height_differs",
    seen_by: "Estimated and barometric height (both low-passed over 1 s, zero from the floor) differ by more \
              than `supervisor.height_difference_m`.",
    numbers: &[HEIGHT_MOST],
    lasts_s: |_| 2.0,
    watched: Watched::Air,
    because: "height differs from the barometer's",
    over: "height is the barometer's again",
    health: S::MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL,
    severity: Severity::Warning,
    is_seen: |sight| {
        let most_m = sight.view.config.supervisor.height_difference_m;
        sight.navigation.height_difference_m(sight.view.at).is_some_and(|m| m.abs() > most_m)
    },
    words: |sight| {
        let by_m = sight.navigation.height_difference_m(sight.view.at).unwrap_or_default();
        format!("estimated height is {by_m:+.1} m against the barometer's")
    },
    ..ROW
};
