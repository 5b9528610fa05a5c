//! Score of an estimate against motion capture.

use nalgebra::Vector3;

use crate::estimate::Estimate;
use crate::measure::ReferencePose;
use crate::time::HostTime;

/// Above this height it counts as airborne, m.
const AIRBORNE_M: f64 = 0.5;
/// Airborne figures begin this long after lift-off, s.
const SETTLED_S: f64 = 5.0;
/// Lift-off is this far above the first pose, m.
const LIFT_M: f64 = 0.1;
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
    nees: f64,
    floor_z: Option<f64>,
    lifted_at: Option<HostTime>,
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
    /// Mean squared error over stated variance, per axis, airborne.
    pub nees_per_axis: Option<f64>,
}

impl Score {
    /// Takes a true pose and the estimate at that time, if there is one.
    pub fn add(&mut self, at: HostTime, pose: &ReferencePose, estimate: Option<Estimate>) {
        let z = pose.pos_E_m.z();
        let floor_z = *self.floor_z.get_or_insert(z);
        if self.lifted_at.is_none() && floor_z - z > LIFT_M {
            self.lifted_at = Some(at);
        }
        let Some(estimate) = estimate else { return };
        let error = (estimate.pos_E_m - pose.pos_E_m).raw();
        let error_m = error.norm();
        self.sum += error;
        self.errors_m.push(error_m);
        let settled = self.lifted_at.is_some_and(|lifted| at.seconds_since(lifted) > SETTLED_S);
        if settled && -z > AIRBORNE_M {
            self.airborne_m.push(error_m);
            self.nees +=
                (0..3).map(|i| (error[i] / estimate.std_pos_E_m[i]).powi(2)).sum::<f64>() / 3.0;
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
            nees_per_axis: (airborne_n > 0.0).then(|| self.nees / airborne_n),
        }
    }
}

fn rms(values: &[f64]) -> Option<f64> {
    let n = values.len() as f64;
    (n > 0.0).then(|| (values.iter().map(|v| v * v).sum::<f64>() / n).sqrt())
}
