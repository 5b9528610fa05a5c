//! What speaks for and against the estimate: its measurements, and sensors that do not enter it.

use nalgebra::{Matrix3, Rotation3, Vector3};

use haltere_core::estimate::Health;
use haltere_core::estimator::{LARGEST_BIAS_RADPS, standard_height_m};
use haltere_core::measure::{BaroSample, BoardAttitude};
use haltere_core::time::HostTime;
use haltere_core::topics::UwbRecord;

use super::slip::SLIP_MPS;
use super::{ATTITUDE_AGE_S, Navigation};
use crate::view::View;

/// Measurements over which the share beyond the gate is taken: 0.4 s of TDoA2.
const WINDOW: f64 = 200.0;
/// Time constant of the low-pass on both turns that are compared, s: it leaves nothing of the noise of an attitude that is
/// told 50 times a second.
const TURN_FILTER_S: f64 = 0.2;
/// A board's attitude that turns faster has jumped, rad/s: the yaw servo of this class follows 2.
const JUMP_RADPS: f64 = 10.0;
/// Samples over which the zero of the barometer is averaged on the floor.
const ZERO_SAMPLES: f64 = 50.0;
/// Time constant of the low-pass on barometric height, s.
const BARO_FILTER_S: f64 = 1.0;
/// A barometer that is silent for longer says nothing, s.
const BARO_AGE_S: f64 = 0.5;

/// So many remedies of the filter …
pub(crate) const MOST_REMEDIES: usize = 5;
/// … in this time show that they do not help, s.
pub(crate) const REMEDIES_S: f64 = 8.0;
/// Share beyond the gate with which a barometer that contradicts is believed.
pub(crate) const DOUBT_SHARE: f64 = 0.15;

/// What speaks for and against the estimate.
#[derive(Debug, Default)]
pub(crate) struct Evidence {
    /// Low-passed share of measurements beyond the gate.
    pub beyond_share: f64,
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

    /// When the filter did something about itself for the last time but [`MOST_REMEDIES`] less one.
    pub fn first_remedied_at(&self) -> Option<HostTime> {
        self.remedied_at[0]
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

impl Navigation {
    /// Holds the turn that the board's new attitude shows against the gyroscope's.
    pub(crate) fn watch_turn(&mut self, before: Option<BoardAttitude>, board: &BoardAttitude) {
        let (Some(before), Some(imu)) = (before, self.imu) else { return };
        let dt_s = board.valid_at.seconds_since(before.valid_at);
        let turned = board.attitude.matrix() * before.attitude.matrix().transpose();
        let theirs_radps = 0.5 * (turned[(1, 0)] - turned[(0, 1)]) / dt_s;
        if dt_s > 0.0 && dt_s < ATTITUDE_AGE_S && theirs_radps.abs() < JUMP_RADPS {
            let ours_radps = (board.attitude * imu.rate_B_radps).z();
            self.evidence.note_turns([ours_radps, theirs_radps], dt_s);
        }
    }

    /// Angle between our attitude and the board's, rad: of the verticals, or of headings that turn against one another;
    /// `None`: nothing fresh to compare with.
    pub(crate) fn attitude_difference_rad(&self, view: &View<'_>) -> Option<f64> {
        let turned_rad = self.evidence.turned_apart_rad;
        self.vertical_difference_rad(view).map(|rad| rad.max(turned_rad))
    }

    /// Angle between our vertical and the board's, rad; `None`: nothing fresh to compare with.
    fn vertical_difference_rad(&self, view: &View<'_>) -> Option<f64> {
        let board = view.board.attitude?;
        let usable = view.estimate.health != Health::NotAligned
            && view.at.seconds_since(board.received_at) < ATTITUDE_AGE_S;
        // Third rows: down seen from the body, ours as it was when the board's was true.
        let down_B = |m: Matrix3<f64>| m.row(2).transpose();
        let theirs_B = down_B(board.attitude.matrix());
        let since_s = view.estimate.at.seconds_since(board.valid_at).clamp(0.0, ATTITUDE_AGE_S);
        let turned_rad =
            Vector3::from(self.imu.map_or([0.0; 3], |i| i.rate_B_radps.to_array())) * since_s;
        let ours_B = Rotation3::new(turned_rad) * down_B(view.estimate.R_EB.matrix());
        usable.then(|| ours_B.angle(&theirs_B))
    }

    /// Height of the landing gear above the floor by the barometer, low-passed, m.
    pub(crate) fn baro_above_floor_m(&self, view: &View<'_>) -> Option<f64> {
        let ([baro_m, _], t) = self.evidence.baro?;
        let fresh = view.at.seconds_since(t) < BARO_AGE_S;
        fresh.then_some(baro_m - view.config.flight.gear_height_m)
    }

    /// Whether barometer or UWB speak against the estimate: nothing is learned from it then.
    pub(crate) fn estimate_is_contradicted(&self, view: &View<'_>) -> bool {
        let most_m = 0.5 * view.config.supervisor.height_difference_m;
        self.evidence.beyond_share > DOUBT_SHARE
            || self.height_difference_m(view.at).is_some_and(|m| m.abs() > most_m)
    }

    /// Whether something beside the barometer says that the height is not the estimate's: UWB itself, or the
    /// accelerometer, by the velocity that the estimate has from it.
    pub(crate) fn has_second_witness(&self, height_difference_m: f64) -> bool {
        // Where the estimate is above, its height climbs faster than its velocity.
        let slips = -self.slip.mps * height_difference_m.signum() > SLIP_MPS;
        slips || self.evidence.beyond_share > DOUBT_SHARE
    }

    /// Estimated minus barometric height, both of one time and low-passed alike: a climb is no difference, m.
    pub(crate) fn height_difference_m(&self, at: HostTime) -> Option<f64> {
        let ([baro_m, known_m], t) = self.evidence.baro?;
        (at.seconds_since(t) < BARO_AGE_S).then_some(known_m - baro_m)
    }
}
