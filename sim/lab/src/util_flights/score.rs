//! Score of an estimate against motion capture.

use nalgebra::{Matrix3, Vector3};

use super::consistency::{self, Consistency};
use haltere_core::estimate::{Estimate, Health};
use haltere_core::measure::ReferencePose;
use haltere_core::time::HostTime;
use haltere_core::topics::UwbRecord;

/// Above this height it counts as airborne, m.
const AIRBORNE_M: f64 = 0.5;
/// Airborne figures begin this long after lift-off, s.
const SETTLED_S: f64 = 5.0;
/// Lift-off is this far above the first pose, m.
const LIFT_M: f64 = 0.1;
/// Squared innovations beyond this many sigma squared say no more.
const MOST_RATIO2: f64 = 25.0;
/// Innovations beyond this many sigma are counted by anchor.
const DOUBTED_SIGMA: f64 = 3.0;
/// An error that health should have warned of, m.
const WRONG_M: f64 = 1.0;
/// An error beyond this, m …
const DIVERGED_M: f64 = 2.0;
/// … for longer than this, s, is a divergence.
const DIVERGED_S: f64 = 1.0;

/// Errors of one flight.
#[derive(Debug, Default)]
pub struct Score {
    errors_m: Vec<f64>,
    airborne_m: Vec<f64>,
    sum: Vector3<f64>,
    /// Time since the first pose, s, and whitened error.
    whitened: Vec<(f64, [f64; 3])>,
    first_at: Option<HostTime>,
    floor_z: Option<f64>,
    lifted_at: Option<HostTime>,
    tilt: f64,
    heading: f64,
    /// Time since the first pose, s, and squared innovation over its variance.
    squares: Vec<(f64, f64)>,
    doubted: std::collections::BTreeMap<u8, u64>,
    settled: bool,
    last_at: Option<HostTime>,
    warned_s: f64,
    unwarned_s: f64,
    far_since: Option<HostTime>,
    diverged: bool,
}

/// What is told of a flight.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Summary {
    /// Root mean square, m.
    pub rmse_m: Option<f64>,
    /// Root mean square while airborne and settled, m.
    pub rmse_airborne_m: Option<f64>,
    /// Median, m.
    pub median_m: Option<f64>,
    /// 95th percentile, m.
    pub p95_m: Option<f64>,
    /// Largest, m.
    pub worst_m: Option<f64>,
    /// Mean error per axis, estimated minus true, Earth frame, m.
    pub bias_m: [f64; 3],
    /// Whether it diverged.
    pub diverged: bool,
    /// Squared error over stated covariance, per axis, airborne.
    pub nees: Option<Consistency>,
    /// Rms of tilt and heading error while airborne, deg.
    pub attitude_deg: Option<[f64; 2]>,
    /// Squared innovation over its variance, airborne.
    pub nis: Option<Consistency>,
    /// TDOA that were rejected or more than 3 sigma off, by anchor.
    pub doubted_by_anchor: Vec<(u8, u64)>,
    /// Time with an error above 1 m, s: health was not good, or was.
    pub warned_s: f64,
    /// As above.
    pub unwarned_s: f64,
}

impl Score {
    /// Takes what became of a TDOA.
    pub fn innovation(&mut self, record: &UwbRecord) {
        if record.var_innovation_m2 <= 0.0 {
            return;
        }
        let ratio2 = record.innovation_m * record.innovation_m / record.var_innovation_m2;
        if self.settled {
            let since_s = self.first_at.map_or(0.0, |at| record.tdoa.valid_at.seconds_since(at));
            self.squares.push((since_s, ratio2.min(MOST_RATIO2)));
        }
        if !record.fused || ratio2 > DOUBTED_SIGMA * DOUBTED_SIGMA {
            for anchor in [record.tdoa.anchor_a, record.tdoa.anchor_b] {
                *self.doubted.entry(anchor.0).or_default() += 1;
            }
        }
    }

    /// Takes a true pose and the estimate at that time with the covariance of its position (Earth frame,
    /// m²), if there is one.
    pub fn add(
        &mut self,
        at: HostTime,
        pose: &ReferencePose,
        estimate: Option<(Estimate, Matrix3<f64>)>,
    ) {
        let first_at = *self.first_at.get_or_insert(at);
        let z = pose.pos_E_m.z();
        let floor_z = *self.floor_z.get_or_insert(z);
        if self.lifted_at.is_none() && floor_z - z > LIFT_M {
            self.lifted_at = Some(at);
        }
        let Some((estimate, cov_E_m2)) = estimate else { return };
        let error = (estimate.pos_E_m - pose.pos_E_m).raw();
        let error_m = error.norm();
        self.sum += error;
        self.errors_m.push(error_m);
        let settled = self.lifted_at.is_some_and(|lifted| at.seconds_since(lifted) > SETTLED_S);
        self.settled = settled && -z > AIRBORNE_M;
        let dt_s = self.last_at.replace(at).map_or(0.0, |last| at.seconds_since(last));
        if error_m > WRONG_M {
            if estimate.health == Health::Good {
                self.unwarned_s += dt_s;
            } else {
                self.warned_s += dt_s;
            }
        }
        if self.settled {
            self.airborne_m.push(error_m);
            if let Some(truth) = pose.attitude {
                let [roll, pitch, yaw] = (truth.inverse() * estimate.R_EB).euler_rad();
                self.tilt += roll * roll + pitch * pitch;
                self.heading += yaw * yaw;
            }
            let whitened = cov_E_m2.cholesky().and_then(|c| c.l().solve_lower_triangular(&error));
            self.whitened.extend(whitened.map(|w| (at.seconds_since(first_at), w.into())));
        }
        // Written so that a NaN counts as far.
        if error_m <= DIVERGED_M {
            self.far_since = None;
        } else {
            let since = *self.far_since.get_or_insert(at);
            self.diverged |= at.seconds_since(since) > DIVERGED_S;
        }
    }

    /// Sums up.
    pub fn summary(mut self) -> Summary {
        self.errors_m.sort_by(f64::total_cmp);
        let n = self.errors_m.len();
        let at = |share: f64| self.errors_m.get(((n as f64 * share) as usize).min(n.max(1) - 1));
        let airborne_n = self.airborne_m.len() as f64;
        Summary {
            rmse_m: rms(&self.errors_m),
            rmse_airborne_m: rms(&self.airborne_m),
            median_m: at(0.5).copied(),
            p95_m: at(0.95).copied(),
            worst_m: self.errors_m.last().copied(),
            bias_m: (self.sum / (n.max(1) as f64)).into(),
            diverged: self.diverged,
            nees: consistency::of_errors(&self.whitened),
            attitude_deg: (self.tilt > 0.0).then(|| {
                [self.tilt, self.heading].map(|sum| (sum / airborne_n).sqrt().to_degrees())
            }),
            nis: consistency::of_innovations(&self.squares),
            doubted_by_anchor: self.doubted.into_iter().collect(),
            warned_s: self.warned_s,
            unwarned_s: self.unwarned_s,
        }
    }
}

fn rms(values: &[f64]) -> Option<f64> {
    let n = values.len() as f64;
    (n > 0.0).then(|| (values.iter().map(|v| v * v).sum::<f64>() / n).sqrt())
}
