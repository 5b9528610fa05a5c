//! The estimate: lost by its own word, diverged from its measurements, or from sensors that do not enter it.

use haltere_dialect::mav::haltere::MavSysStatusSensor as S;
use nalgebra::{Matrix3, Rotation3, Vector3};

use super::condition::{Condition, Number, ROW, Watched};
use super::envelope::LEAP;
use super::reaction::Reaction;
use super::scale::SCALE;
use super::slip::{SLIP, SLIP_MPS};
use crate::Pilot;
use crate::out::voice::Severity;
use haltere_core::estimate::Health;
use haltere_core::estimator::{LARGEST_BIAS_RADPS, standard_height_m};
use haltere_core::measure::{BaroSample, BoardAttitude};
use haltere_core::time::HostTime;
use haltere_core::topics::UwbRecord;

/// Measurements over which the share beyond the gate is taken: 0.4 s of TDoA2.
const WINDOW: f64 = 200.0;
/// The board's attitude may be this old to be compared with ours, s.
const ATTITUDE_AGE_S: f64 = 0.2;
/// Time constant of the low-pass on both turns that are compared, s: it leaves nothing of the noise of an attitude that is
/// told 50 times a second.
const TURN_FILTER_S: f64 = 0.2;
/// A board's attitude that turns faster has jumped, rad/s: the yaw servo of this class follows 2.
const JUMP_RADPS: f64 = 10.0;
/// Samples over which the zero of the barometer is averaged on the floor.
const ZERO_SAMPLES: f64 = 50.0;
/// Time constant of the low-pass on barometric height, s.
const BARO_FILTER_S: f64 = 1.0;
/// What a barometer may err by in a room, m.
const BARO_NOISE_M: f64 = 0.3;
/// A barometer that is silent for longer says nothing, s.
const BARO_AGE_S: f64 = 0.5;

/// So many remedies of the filter …
const MOST_REMEDIES: usize = 5;
/// … in this time show that they do not help, s.
const REMEDIES_S: f64 = 8.0;
/// The barometer alone ends a flight after this time, s.
const BARO_ALONE_S: f64 = 3.0;
/// Share beyond the gate with which a barometer that contradicts is believed.
const DOUBT_SHARE: f64 = 0.15;

/// What speaks for and against the estimate.
#[derive(Debug, Default)]
pub(crate) struct Evidence {
    /// Low-passed share of measurements beyond the gate.
    beyond_share: f64,
    remedies: u64,
    /// When the filter last did something about itself, the oldest first.
    remedied_at: [Option<HostTime>; MOST_REMEDIES],
    baro_zero_m: f64,
    zero_samples: f64,
    /// Barometric height and the one that was estimated at its time, low-passed alike, m, and when they were last new.
    baro: Option<([f64; 2], HostTime)>,
    /// Turns about the vertical by the gyroscope and by the board's attitude, low-passed alike, rad/s.
    turns_radps: [f64; 2],
    /// How far the two have turned against one another, rad.
    turned_apart_rad: f64,
}

impl Evidence {
    /// Turns about the vertical by the gyroscope and by the board's attitude, rad/s, for `dt_s`. Only what both do counts,
    /// since a compass that drifts turns no gyroscope, and only what no bias of a gyroscope makes of a turn.
    fn note_turns(&mut self, now_radps: [f64; 2], dt_s: f64) {
        let weight = dt_s / (TURN_FILTER_S + dt_s);
        for (slow, now) in self.turns_radps.iter_mut().zip(now_radps) {
            *slow += (now - *slow) * weight;
        }
        let [ours, theirs] = self.turns_radps;
        let both_radps = ours.abs().min(theirs.abs());
        let apart_radps = if ours * theirs > 0.0 {
            -2.0 * both_radps
        } else {
            2.0 * (both_radps - LARGEST_BIAS_RADPS).max(0.0)
        };
        self.turned_apart_rad = (self.turned_apart_rad + apart_radps * dt_s).max(0.0);
    }

    /// The filter has done something about itself so often in all.
    pub fn note_remedies(&mut self, at: HostTime, remedies: u64) {
        let new = remedies.saturating_sub(std::mem::replace(&mut self.remedies, remedies));
        for _ in 0..new.min(MOST_REMEDIES as u64) {
            self.remedied_at.rotate_left(1);
            self.remedied_at[MOST_REMEDIES - 1] = Some(at);
        }
    }

    /// A measurement met its gate.
    pub fn note_uwb(&mut self, record: &UwbRecord) {
        let beyond = f64::from(u8::from(record.test_ratio > 1.0));
        self.beyond_share += (beyond - self.beyond_share) / WINDOW;
    }

    /// Air pressure, and the height that was estimated at its time, m; `on_floor`: it sets the zero to that height.
    pub fn note_baro(&mut self, sample: &BaroSample, known_m: f64, on_floor: bool) -> Option<f64> {
        let raw_m = standard_height_m(sample.pressure_pa)?;
        if on_floor {
            self.zero_samples = (self.zero_samples + 1.0).min(ZERO_SAMPLES);
            self.baro_zero_m += (raw_m - known_m - self.baro_zero_m) / self.zero_samples;
            self.baro = None;
            return None;
        }
        if self.zero_samples < 1.0 {
            return None;
        }
        let new_m = raw_m - self.baro_zero_m;
        let (was_m, t) = self.baro.unwrap_or(([new_m, known_m], sample.valid_at));
        let dt_s = sample.valid_at.seconds_since(t).max(0.0);
        let slow = |was_m: f64, m: f64| was_m + (m - was_m) * (dt_s / (BARO_FILTER_S + dt_s));
        self.baro = Some(([slow(was_m[0], new_m), slow(was_m[1], known_m)], sample.valid_at));
        Some(new_m)
    }
}

impl Pilot {
    /// Holds the turn that the board's new attitude shows against the gyroscope's.
    pub(crate) fn watch_turn(&mut self, board: &BoardAttitude) {
        let (Some(before), Some(imu)) = (self.board.attitude, self.navigation.imu) else { return };
        let dt_s = board.valid_at.seconds_since(before.valid_at);
        let turned = board.attitude.matrix() * before.attitude.matrix().transpose();
        let theirs_radps = 0.5 * (turned[(1, 0)] - turned[(0, 1)]) / dt_s;
        if dt_s > 0.0 && dt_s < ATTITUDE_AGE_S && theirs_radps.abs() < JUMP_RADPS {
            let ours_radps = (board.attitude * imu.rate_B_radps).z();
            self.flight.supervisor.evidence.note_turns([ours_radps, theirs_radps], dt_s);
        }
    }

    /// Angle between our attitude and the board's, rad: of the verticals, or of headings that turn against one another;
    /// `None`: nothing fresh to compare with.
    fn attitude_difference_rad(&self, at: HostTime) -> Option<f64> {
        let turned_rad = self.flight.supervisor.evidence.turned_apart_rad;
        self.vertical_difference_rad(at).map(|rad| rad.max(turned_rad))
    }

    /// Angle between our vertical and the board's, rad; `None`: nothing fresh to compare with.
    fn vertical_difference_rad(&self, at: HostTime) -> Option<f64> {
        let board = self.board.attitude?;
        let usable = self.estimate.health != Health::NotAligned
            && at.seconds_since(board.received_at) < ATTITUDE_AGE_S;
        // Third rows: down seen from the body, ours as it was when the board's was true.
        let down_B = |m: Matrix3<f64>| m.row(2).transpose();
        let theirs_B = down_B(board.attitude.matrix());
        let since_s = self.estimate.at.seconds_since(board.valid_at).clamp(0.0, ATTITUDE_AGE_S);
        let turned_rad =
            Vector3::from(self.navigation.imu.map_or([0.0; 3], |i| i.rate_B_radps.to_array()))
                * since_s;
        let ours_B = Rotation3::new(turned_rad) * down_B(self.estimate.R_EB.matrix());
        usable.then(|| ours_B.angle(&theirs_B))
    }

    /// Height above the floor, m, and sinking speed, m/s, with which a descent begins: the estimate's, or those of a
    /// moment ago where the estimate has followed an accelerometer that lies. The height is the barometer's where that is
    /// larger: taken too high it costs seconds, taken too low it ends in a fall.
    pub(crate) fn height_and_sink_to_descend_from(&self, at: HostTime) -> (f64, f64) {
        let leapt = [SCALE, LEAP, SLIP].iter().any(|row| self.flight.supervisor.has(row.name));
        let before = self.flight.supervisor.before.carried_on().filter(|_| leapt);
        let sink_mps = if self.imu_is_alive(at) { self.flight.last_sink_mps } else { 0.0 };
        let (known_m, sink_mps) = before.unwrap_or((self.flight.last_height_m, sink_mps));
        let baro_m = self.baro_above_floor_m(at);
        (baro_m.map_or(known_m, |baro_m| known_m.max(baro_m - BARO_NOISE_M)), sink_mps)
    }

    /// Height of the landing gear above the floor by the barometer, low-passed, m.
    pub(crate) fn baro_above_floor_m(&self, at: HostTime) -> Option<f64> {
        let ([baro_m, _], t) = self.flight.supervisor.evidence.baro?;
        let fresh = at.seconds_since(t) < BARO_AGE_S;
        fresh.then_some(baro_m - self.config.flight.gear_height_m)
    }

    /// Whether barometer or UWB speak against the estimate: nothing is learned from it then.
    pub(crate) fn estimate_is_contradicted(&self, at: HostTime) -> bool {
        let most_m = 0.5 * self.config.supervisor.height_difference_m;
        self.flight.supervisor.evidence.beyond_share > DOUBT_SHARE
            || self.height_difference_m(at).is_some_and(|m| m.abs() > most_m)
    }

    /// Whether something beside the barometer says that the height is not the estimate's: UWB itself, or the
    /// accelerometer, by the velocity that the estimate has from it.
    fn has_second_witness(&self, height_difference_m: f64) -> bool {
        // Where the estimate is above, its height climbs faster than its velocity.
        let slips = -self.flight.supervisor.slip.mps * height_difference_m.signum() > SLIP_MPS;
        slips || self.flight.supervisor.evidence.beyond_share > DOUBT_SHARE
    }

    /// Estimated minus barometric height, both of one time and low-passed alike: a climb is no difference, m.
    fn height_difference_m(&self, at: HostTime) -> Option<f64> {
        let ([baro_m, known_m], t) = self.flight.supervisor.evidence.baro?;
        (at.seconds_since(t) < BARO_AGE_S).then_some(known_m - baro_m)
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
    is_seen: |pilot, _| !matches!(pilot.estimate.health, Health::Good | Health::Degraded),
    words: |pilot, _| {
        let why = if pilot.estimate.health == Health::Lost { "lost" } else { "not aligned" };
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
    is_seen: |pilot, at| {
        let most_rad = pilot.config.supervisor.attitude_difference_deg.to_radians();
        pilot.attitude_difference_rad(at).is_some_and(|rad| rad > most_rad)
    },
    words: |pilot, at| {
        let deg = pilot.attitude_difference_rad(at).unwrap_or_default().to_degrees();
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
    is_seen: |pilot, _| {
        pilot.flight.supervisor.evidence.beyond_share > pilot.config.supervisor.divergence_share
    },
    words: |pilot, _| {
        let share = pilot.flight.supervisor.evidence.beyond_share;
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
    is_seen: |pilot, at| {
        let first = pilot.flight.supervisor.evidence.remedied_at[0];
        first.is_some_and(|t| at.seconds_since(t) < REMEDIES_S)
    },
    words: |_, _| format!("estimator recovered {MOST_REMEDIES} times in {REMEDIES_S:.0} s"),
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
    is_seen: |pilot, at| {
        let most_m = pilot.config.supervisor.height_difference_m;
        let contradicts = |m: f64| m.abs() > most_m && pilot.has_second_witness(m);
        pilot.height_difference_m(at).is_some_and(contradicts)
    },
    words: |pilot, at| {
        let by_m = pilot.height_difference_m(at).unwrap_or_default();
        let share = pilot.flight.supervisor.evidence.beyond_share;
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
    is_seen: |pilot, at| {
        let most_m = pilot.config.supervisor.height_difference_m;
        pilot.height_difference_m(at).is_some_and(|m| m.abs() > most_m)
    },
    words: |pilot, at| {
        let by_m = pilot.height_difference_m(at).unwrap_or_default();
        format!("estimated height is {by_m:+.1} m against the barometer's")
    },
    ..ROW
};
