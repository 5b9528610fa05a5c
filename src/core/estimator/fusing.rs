//! The estimator's aids: what becomes of a measurement, and of a filter that does not fit them.

use nalgebra::Vector3;

use super::align::Kept;
use super::aligning::FIX_WINDOW_S;
use super::bias::FREE_M;
use super::bias::Pair;
use super::config::{BaroConfig, Motion, Tail};
use super::gate::{self, Remedy};
use super::height::standard_height_m;
use super::quality::Qualities;
use super::state::{POS, VEL};
use super::update::Observation;
use super::{
    Estimator, SUSPECT_SHARE, SUSPECT_STD_M, noise, reference, tdoa, update, zero_velocity,
};
use crate::drops::DropReason;
use crate::measure::{AnchorId, BaroSample, ReferencePose, Tdoa};
use crate::time::HostTime;
use crate::topics::UwbRecord;

/// A TDOA this much older than the state is not used, s.
const OLDEST_TDOA_S: f64 = 0.3;
/// A TDOA is extrapolated at most this far past the IMU, s.
const FARTHEST_AHEAD_S: f64 = 0.1;
/// A TDOA may exceed the separation of its anchors by noise and bias, m; beyond it is impossible.
const IMPOSSIBLE_MARGIN_M: f64 = 0.5;
/// Longest interval that counts, s: after a pause an anchor's error is new.
const LONGEST_INTERVAL_S: f64 = 0.5;
/// Weight of the newest interval in the mean.
const INTERVAL_WEIGHT: f64 = 0.05;
/// On and near the floor errors of the UWB stay the same for as long as the vehicle is there, s.
const REST_CORRELATION_S: f64 = 5.0;
/// The same with range biases that the floor hides, for what is left of it after them: chosen, what the recorded flights
/// were fused with everywhere before their white part was taken to be shorter.
const HIDDEN_CORRELATION_S: f64 = 0.1;
/// Near the floor is below this, m: the height of the low anchors, which it hides …
const FLOOR_M: f64 = 0.3;
/// … for at most this long in flight, s: an estimate that is too low must not hold itself there.
const NEAR_FLOOR_S: f64 = 3.0;
/// What of the sigma of hidden anchors counts for a vehicle that comes down: chosen on recorded
/// landings: with a fifth three of six end more than 2 m off, with all of it the height of a simulated landing is lost.
const COMING_DOWN_FRAC: f64 = 0.4;
/// And only below this height, m: from 0.2 m on the low anchors of the recordings read as elsewhere, and with all of 0.5 m a
/// hover at 0.45 m errs by 0.14 m in place of 0.05. With 0.3 m a recorded landing behind metal ends 6 m off.
const COMING_DOWN_BELOW_M: f64 = 0.4;
/// What the floor had hidden is left in the sigma for so many times `hidden_s`: the variance of a bias then has e^-4 of itself.
const SHOWN_AFTER: f64 = 2.0;
/// Standing vehicles have a constant height to this sigma, m.
const STD_REST_HEIGHT_M: f64 = 0.05;
/// A fix replaces the position when it explains the measurements this much better: the median
/// residual is at most this share of the present one.
const FIX_BETTER_FRAC: f64 = 0.6;
/// What the first remedy adds to the uncertainty of position, m, and velocity, m/s.
const STD_WIDEN: f64 = 0.5;
/// What the later ones add.
const STD_WIDEN_MORE: f64 = 1.5;
/// Position uncertainty beyond which linear updates are not trusted and a fix is sought, m.
const STD_SEEK_FIX_M: f64 = 3.0;
/// One sigma of the height from which a vehicle without IMU may have left the floor unnoticed, m: chosen, four times
/// what it has in the air …
const STD_FALSE_FLOOR_M: f64 = 0.4;
/// … and has when all anchors together have it so far above where the floor hides some, m: chosen.
const LEAST_RISE_M: f64 = 0.2;

impl Estimator {
    pub(super) fn standing_aids(&mut self) {
        let Some(state) = &mut self.state else { return };
        let due = self
            .aided
            .zero_velocity_at
            .is_none_or(|at| self.at.seconds_since(at) >= zero_velocity::INTERVAL_S);
        if !due {
            return;
        }
        self.aided.zero_velocity_at = Some(self.at);
        for axis in 0..3 {
            update::fuse(state, &zero_velocity::observe(state, axis));
        }
        if let Some(height_m) = self.config.rest_height_m {
            let var = STD_REST_HEIGHT_M * STD_REST_HEIGHT_M;
            update::fuse(state, &reference::observe(state, 2, -height_m, var));
        }
    }

    /// Takes a TDOA and says what became of it.
    pub fn tdoa(&mut self, tdoa: &Tdoa) -> UwbRecord {
        let mut record = UwbRecord {
            tdoa: *tdoa,
            innovation_m: 0.0,
            var_innovation_m2: 0.0,
            test_ratio: 0.0,
            fused: false,
        };
        let anchors = (
            self.anchors.survey.position_E_m(tdoa.anchor_a),
            self.anchors.survey.position_E_m(tdoa.anchor_b),
        );
        let (Some(a), Some(b)) = anchors else {
            self.drops.add(DropReason::UwbUnknownAnchor, 1);
            return record;
        };
        let arm_E = self.level_arm_E_m();
        let (a_E, b_E) = (a.raw() - arm_E, b.raw() - arm_E);
        let known_m = |id: AnchorId| self.anchors.range_bias_m(id);
        let measured = tdoa;
        let tdoa = &Tdoa {
            distance_diff_m: measured.distance_diff_m
                - (known_m(measured.anchor_b) - known_m(measured.anchor_a)),
            ..*measured
        };
        if !tdoa.distance_diff_m.is_finite() || tdoa.anchor_a == tdoa.anchor_b {
            self.drops.add(DropReason::BadValue, 1);
            return record;
        }
        let limit_m = (b_E - a_E).norm() + IMPOSSIBLE_MARGIN_M;
        if tdoa.distance_diff_m.abs() > limit_m {
            self.drops.add(DropReason::UwbImpossible, 1);
            return record;
        }
        if self.config.motion == Motion::Unaided {
            self.coast(tdoa.valid_at);
            if !self.airborne {
                self.standing_aids();
            }
        }
        let ahead_s = tdoa.valid_at.seconds_since(self.at);
        if ahead_s < -OLDEST_TDOA_S {
            self.drops.add(DropReason::UwbTooOld, 1);
            return record;
        }
        let low_m = self.config.anchor_bias.low_anchor_m;
        let is_low = |z_m: f64| f64::from(u8::from(-z_m < low_m));
        self.recent.push(Kept {
            at: tdoa.valid_at,
            a_E,
            b_E,
            distance_diff_m: tdoa.distance_diff_m,
            hidden: is_low(b.z()) - is_low(a.z()),
        });
        if self.state.is_some() {
            self.fuse_tdoa(tdoa, a_E, b_E, ahead_s.min(FARTHEST_AHEAD_S), &mut record);
            self.isolate();
            self.heal();
        } else if let Some(cold) = &mut self.cold {
            record = cold.tdoa(tdoa);
        } else if self.config.motion == Motion::Unaided {
            self.try_start_unaided(tdoa.valid_at);
        }
        record
    }

    /// Tag seen from the centre of mass without an IMU, m: nothing tells the attitude then, and a vehicle
    /// that flies is nearly level. Its horizontal part turns with a heading that nobody knows.
    fn level_arm_E_m(&self) -> Vector3<f64> {
        let above_m = match self.config.motion {
            Motion::Unaided => self.config.p_BT_B_m[2],
            Motion::Inertial => 0.0,
        };
        Vector3::new(0.0, 0.0, above_m)
    }

    /// Whether it is low enough for the floor to spoil measurements.
    #[inline]
    pub(super) fn is_near_floor(&self, below_m: f64) -> bool {
        let low_s = self.at.seconds_since(self.floor.above_at.max(self.floor.rested_at));
        // Without IMU nobody knows whether it stands: no limit of time then.
        let lasts = low_s < NEAR_FLOOR_S || self.config.motion == Motion::Unaided;
        !self.airborne || (self.height_m() < below_m && lasts)
    }

    /// One sigma of the bias of the low anchors, m, where the floor hides them. Who comes down knows his height and meets
    /// what the floor does from above: then it is believed to be less, and the height is held by them.
    #[inline]
    pub(super) fn hidden_std_m(&self) -> Option<f64> {
        let config = &self.config.anchor_bias;
        let comes_down = self.airborne
            && self.floor.above_at > self.floor.rested_at
            && self.config.motion == Motion::Inertial;
        let (below_m, frac) = if comes_down {
            (config.hidden_below_m.min(COMING_DOWN_BELOW_M), COMING_DOWN_FRAC)
        } else {
            (config.hidden_below_m, 1.0)
        };
        self.is_near_floor(below_m).then_some(config.hidden_std_m * frac)
    }

    /// The same for a step, which remembers it.
    #[inline]
    pub(super) fn note_hidden(&mut self) -> Option<f64> {
        let hidden_std_m = self.hidden_std_m();
        if hidden_std_m.is_some() {
            self.floor.hidden_at = self.at;
        }
        hidden_std_m
    }

    /// Whether the floor hides low anchors, or did until just now.
    pub(super) fn floor_hides(&self) -> bool {
        let config = &self.config.anchor_bias;
        let low = |height_m: &f64| *height_m < config.low_anchor_m;
        let since_s = self.at.seconds_since(self.floor.hidden_at);
        config.estimate
            && self.anchors.heights_m.iter().any(low)
            && since_s < SHOWN_AFTER * config.hidden_s
    }

    pub(super) fn fuse_tdoa(
        &mut self,
        tdoa: &Tdoa,
        a_E: Vector3<f64>,
        b_E: Vector3<f64>,
        ahead_s: f64,
        record: &mut UwbRecord,
    ) {
        let bias = &self.config.anchor_bias;
        let floor_m = if bias.estimate { bias.hidden_below_m.max(FLOOR_M) } else { FLOOR_M };
        if self.height_m() > floor_m {
            self.floor.above_at = self.at;
        }
        let near_floor = self.is_near_floor(FLOOR_M);
        let rank_a = self.anchors.rank(tdoa.anchor_a);
        let rank_b = self.anchors.rank(tdoa.anchor_b);
        let biased = self.state.as_ref().is_some_and(|state| state.biases.of_anchors());
        let least_s = match biased {
            false if near_floor => REST_CORRELATION_S,
            true if self.is_near_floor(floor_m) => HIDDEN_CORRELATION_S,
            _ => 0.0,
        };
        let correlation_s = self.config.uwb_correlation_s.max(least_s);
        let worth = 0.5
            * (self.worth(tdoa.anchor_a.0, tdoa.valid_at, correlation_s)
                + self.worth(tdoa.anchor_b.0, tdoa.valid_at, correlation_s));
        let ranks = Pair { a: rank_a, b: rank_b };
        let (factor, stated) = if self.config.quality.learn {
            let q = &self.qualities;
            (0.5 * (q.of(rank_a) + q.of(rank_b)), 0.5 * (q.stated(rank_a) + q.stated(rank_b)))
        } else {
            (1.0, 1.0)
        };
        let hidden = self.floor_hides();
        let Some(state) = &mut self.state else { return };
        let c = &self.config;
        let std_m =
            tdoa.std_m.filter(|s| s.is_finite()).map_or(c.std_uwb_m, |s| s.max(c.std_uwb_m));
        let plain_var = noise::height_factor(c.uwb_noise, -state.x_E.z) * std_m * std_m;
        let mut var = plain_var * factor;
        let pair = biased.then_some(ranks);
        if pair.is_some_and(|pair| !state.biases.holds(pair)) {
            // More anchors than there are biases for: theirs is noise.
            let b = &c.anchor_bias;
            var += 2.0 * (b.std_m * b.std_m + b.constant_std_m * b.constant_std_m);
        }
        let p_BT_B = match c.motion {
            // Both anchors have been moved instead (`level_arm_E_m`).
            Motion::Unaided => Vector3::zeros(),
            Motion::Inertial => c.p_BT_B_m.into(),
        };
        let geometry = tdoa::Geometry { a_E, b_E, p_BT_B, ahead_s };
        let Some(mut o) = tdoa::observe(state, &geometry, tdoa.distance_diff_m, pair, var) else {
            self.drops.add(DropReason::UwbGated, 1);
            return;
        };
        if c.isolation.leave_out {
            // Near the floor low anchors are hidden, which is known; what was before says nothing then.
            if near_floor {
                self.isolation.clear();
            } else {
                let biases_m = pair.map_or(0.0, |pair| state.biases.difference_m(pair));
                self.isolation.note(ranks, &o.h_pos, o.innovation + biases_m);
            }
            if self.isolation.is_out(rank_a) || self.isolation.is_out(rank_b) {
                // With a bias of its own it says nothing already; without, it is noise.
                let std_m = if biased { 0.0 } else { FREE_M };
                var += std_m * std_m;
                o.var = var;
            }
        }
        let projected = update::project(state, &o);
        let var_innovation = projected.var_predicted + var - plain_var * (factor - stated);
        let ratio2 = o.innovation * o.innovation / var_innovation;
        let test_ratio = ratio2 / (c.gate.sigma * c.gate.sigma);
        record.innovation_m = o.innovation;
        record.var_innovation_m2 = var_innovation;
        record.test_ratio = test_ratio;
        let beyond = test_ratio > 1.0;
        self.doubt.note(beyond, rank_a, rank_b);
        if c.quality.learn && !(self.isolation.is_out(rank_a) || self.isolation.is_out(rank_b)) {
            for (rank, anchor) in [(rank_a, tdoa.anchor_a), (rank_b, tdoa.anchor_b)] {
                let (_, interval_s) = self.intervals[usize::from(anchor.0)];
                self.qualities.learn(&c.quality, rank, ratio2, interval_s, hidden);
            }
        }
        if beyond && c.gate.reject && !(c.gate.recover && self.doubt.open()) {
            self.counts.tdoa_gated += 1;
            self.drops.add(DropReason::UwbGated, 1);
            return;
        }
        let tail = if beyond && c.gate.reject { Tail::Huber } else { c.gate.tail };
        o.var = var * worth * gate::tail_factor(tail, c.gate.tail_sigma, ratio2);
        record.fused = update::fuse_projected(state, &o, &projected);
        if record.fused {
            self.counts.tdoa_fused += 1;
            self.note_fused(self.at.max(tdoa.valid_at));
        }
    }

    /// Variance factor of an anchor whose error stays the same for a while.
    #[inline]
    pub(super) fn worth(&mut self, anchor: u8, at: HostTime, correlation_s: f64) -> f64 {
        let (last, interval_s) = &mut self.intervals[usize::from(anchor)];
        let newest_s = at.seconds_since(*last).clamp(0.0, LONGEST_INTERVAL_S);
        *last = at.max(*last);
        *interval_s += (newest_s - *interval_s) * INTERVAL_WEIGHT;
        noise::correlation_factor(correlation_s, *interval_s)
    }

    /// Leaves out an anchor that does not fit, or takes it back.
    fn isolate(&mut self) {
        let config = &self.config.isolation;
        if !config.leave_out {
            return;
        }
        let (low, high) = self.volume();
        let Some(state) = &mut self.state else { return };
        let reach = [low - state.x_E, high - state.x_E];
        let Some(out) = self.isolation.judge(config, self.at, &reach) else { return };
        state.restart_position(state.x_E + out.shift_E_m, out.std_m);
        // What led the position astray led the velocity astray with it.
        state.restart_velocity(state.v_B, STD_WIDEN);
        let left_out = self.isolation.left_out();
        state.biases.restart(&self.config.anchor_bias, &self.anchors.heights_m, false, left_out);
        state.biases.set_wandering(out.rank, out.bias_m);
        self.qualities = Qualities::default();
        self.doubt.clear();
        self.counts.left_out += 1;
    }

    /// Whether most anchors have been much worse than usual.
    pub(super) fn most_are_suspect(&self) -> bool {
        let factor = (SUSPECT_STD_M / self.config.std_uwb_m).powi(2);
        self.qualities.share_beyond(factor, self.anchors.heights_m.len()) > SUSPECT_SHARE
    }

    /// Whether it may have left the floor without noticing. Without IMU only the estimated height says that the floor
    /// hides the low anchors; with their biases free a height that is too low fits as well as the true one.
    fn may_be_above_floor(&self) -> bool {
        let Some(state) = &self.state else { return false };
        self.config.motion == Motion::Unaided
            && state.biases.of_anchors()
            && state.P[(POS + 2, POS + 2)] > STD_FALSE_FLOOR_M * STD_FALSE_FLOOR_M
            && self.is_near_floor(self.config.anchor_bias.hidden_below_m)
    }

    /// Does something about a filter that is wrong.
    pub(super) fn heal(&mut self) {
        let most_suspect = self.most_are_suspect();
        let Some(state) = &mut self.state else { return };
        let mut seek = (0..3).any(|i| state.P[(i, i)] > STD_SEEK_FIX_M * STD_SEEK_FIX_M);
        // Quality is learned from innovations, and so swallows those of a filter that is wrong. Then
        // nearly all anchors look bad at once.
        seek |= most_suspect;
        if let Some(remedy) = self.doubt.remedy(&self.config.gate) {
            self.counts.remedies += 1;
            let std = if remedy == Remedy::Widen { STD_WIDEN } else { STD_WIDEN_MORE };
            for i in (POS..POS + 3).chain(VEL..VEL + 3) {
                state.P[(i, i)] += std * std;
            }
            seek |= remedy == Remedy::Relocate;
        }
        let false_floor = self.may_be_above_floor();
        seek |= false_floor;
        if !(seek && self.config.gate.recover && self.airborne && self.fix_is_due()) {
            return;
        }
        let Some(state) = &self.state else { return };
        let oldest = self.at.offset_us(-((FIX_WINDOW_S * 1e6) as i64));
        let present_m = self.recent.median_residual_m(oldest, &state.x_E, 0.0);
        let risen_m = self.config.anchor_bias.hidden_below_m + LEAST_RISE_M;
        let better = self.locate(FIX_WINDOW_S, None, Some(state.x_E)).is_some_and(|fix| {
            fix.median_m < FIX_BETTER_FRAC * present_m && (!false_floor || -fix.x_E.z > risen_m)
        });
        if better {
            self.realign();
        }
    }

    /// Takes an air pressure. At rest it sets the zero, in flight it is fused.
    pub fn baro(&mut self, sample: &BaroSample) {
        let Some(baro_m) = standard_height_m(sample.pressure_pa) else {
            self.drops.add(DropReason::BadValue, 1);
            return;
        };
        let Some(state) = &mut self.state else { return };
        if !self.config.baro.fuse {
            return;
        }
        if !self.airborne || !self.baro_zero.is_known() {
            self.baro_zero.learn(baro_m, -state.x_E.z);
            return;
        }
        let BaroConfig { std_m, correlation_s, .. } = self.config.baro;
        // Without a sample before, it speaks for the whole correlation time.
        let interval_s =
            self.aided.baro_at.map_or(correlation_s, |at| sample.valid_at.seconds_since(at));
        self.aided.baro_at = Some(sample.valid_at);
        let worth = noise::correlation_factor(correlation_s, interval_s);
        let o = self.baro_zero.observe(state, baro_m, std_m * std_m);
        self.fuse_soft(o, worth);
    }

    /// Takes a pose of motion capture; fused only if configured.
    pub fn reference(&mut self, pose: &ReferencePose) {
        if !self.config.fuse_reference {
            return;
        }
        if !pose.pos_E_m.is_finite() {
            self.drops.add(DropReason::BadValue, 1);
            return;
        }
        let var = self.config.std_reference_m * self.config.std_reference_m;
        for axis in 0..3 {
            let Some(state) = &self.state else { return };
            let o = reference::observe(state, axis, pose.pos_E_m[axis], var);
            self.fuse_soft(o, 1.0);
        }
        self.note_fused(self.at);
    }

    /// Fuses with a heavy tail and no gate; `worth` is the variance factor of correlated samples.
    pub(super) fn fuse_soft(&mut self, mut o: Observation, worth: f64) {
        let Some(state) = &mut self.state else { return };
        let projected = update::project(state, &o);
        let ratio2 = o.innovation * o.innovation / (projected.var_predicted + o.var);
        o.var *= worth * gate::tail_factor(Tail::Huber, self.config.gate.tail_sigma, ratio2);
        update::fuse_projected(state, &o, &projected);
    }
}
