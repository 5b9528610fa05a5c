//! Start values: level and gyroscope bias from rest, position from TDOA by least squares.
//!
//! Level: at rest the accelerometer reads `−Rᵀ g`, so `roll = atan2(−f_y, −f_z)`,
//! `pitch = atan2(f_x, |f_yz|)`. Heading cannot be seen at rest and is told from outside.
//! Position: Gauss-Newton with Levenberg damping on `Σ ln(1 + r²/s²)` (Cauchy, s = 0.3 m), from
//! several starts because differences of distance have false minima outside the anchors.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::frames::{B, G_MPS2, Vec3};
use crate::time::HostTime;

/// Specific force at rest over gravity: farther than this from 1 it is told and taken into the filter as a scale. Gravity
/// itself differs by 0.005 over the earth, and healthy simulated vehicles stand within 0.01.
pub const FORCE_TOLD_SHARE: f64 = 0.02;
/// Farther than this from 1 it is no gravity that is read: a scale of 0.05, the largest that is flown with (M3 of the
/// library), with the bias of a sensor beside it. What is left of an offset that was taken for a scale is 0.2 m/s² where
/// thrust changes by a third.
pub const FORCE_MOST_SHARE: f64 = 0.07;
/// Time constant of what the IMU reads while the vehicle stands, s, and how long it is looked at before it is known.
pub const STANDING_S: f64 = 1.0;

/// A rest ends when a sample differs from the mean by this much, m/s².
const REST_ACC_MPS2: f64 = 1.0;
/// The same for the rate, rad/s.
const REST_RATE_RADPS: f64 = 0.1;
/// Samples over which the mean runs at most: a bias that drifts while standing is followed.
const LONGEST_MEAN: f64 = 5000.0;
/// Bias a gyroscope may have, rad/s: more is a rotation.
pub const LARGEST_BIAS_RADPS: f64 = 0.2;

/// What the IMU reads while the vehicle stands, whether it rests or not: mean and scatter.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Standing {
    /// Mean specific force.
    pub acc_B_mps2: Vec3<B>,
    /// Mean rate.
    pub rate_B_radps: Vec3<B>,
    /// Scatter about the first, of all three axes together, m/s².
    pub std_acc_mps2: f64,
    /// The same of the second, rad/s.
    pub std_rate_radps: f64,
    seen_s: f64,
}

impl Standing {
    /// Takes a sample that came `dt_s` after the one before.
    pub fn add(&mut self, dt_s: f64, acc_B_mps2: Vec3<B>, rate_B_radps: Vec3<B>) {
        if self.seen_s == 0.0 {
            *self = Self { acc_B_mps2, rate_B_radps, ..Self::default() };
        }
        self.seen_s += dt_s;
        let weight = dt_s / (STANDING_S + dt_s);
        let follow = |mean: &mut Vec3<B>, std: &mut f64, now: Vec3<B>| {
            let off = now - *mean;
            *mean += off * weight;
            *std = ((1.0 - weight) * (*std * *std + weight * off.norm().powi(2))).sqrt();
        };
        follow(&mut self.acc_B_mps2, &mut self.std_acc_mps2, acc_B_mps2);
        follow(&mut self.rate_B_radps, &mut self.std_rate_radps, rate_B_radps);
    }

    /// Whether it was looked at for long enough.
    pub fn is_known(&self) -> bool {
        self.seen_s >= STANDING_S
    }
}

/// Mean of the IMU while nothing moves.
#[derive(Debug, Clone, Default)]
pub struct RestAverage {
    since: Option<HostTime>,
    last: HostTime,
    n: f64,
    acc_B: Vector3<f64>,
    rate_B: Vector3<f64>,
}

impl RestAverage {
    /// Takes a sample; a sample that does not rest starts anew.
    pub fn add(&mut self, at: HostTime, acc_B: &Vector3<f64>, rate_B: &Vector3<f64>) {
        let moves = (acc_B - self.acc_B).norm() > REST_ACC_MPS2
            || (rate_B - self.rate_B).norm() > REST_RATE_RADPS
            || rate_B.norm() > LARGEST_BIAS_RADPS;
        if self.n > 0.0 && moves {
            self.clear();
        }
        self.since.get_or_insert(at);
        self.last = at;
        self.n = (self.n + 1.0).min(LONGEST_MEAN);
        self.acc_B += (acc_B - self.acc_B) / self.n;
        self.rate_B += (rate_B - self.rate_B) / self.n;
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// How long it has rested, s.
    pub fn duration_s(&self) -> f64 {
        self.since.map_or(0.0, |since| self.last.seconds_since(since))
    }

    /// Mean rate: the bias, rad/s.
    pub fn rate_B(&self) -> Vector3<f64> {
        self.rate_B
    }

    /// What the specific force is to be multiplied with, so that it is gravity at rest: 1 where it is so nearly, or where it
    /// is so far from it that no scale is the reason.
    pub fn force_gain(&self) -> f64 {
        let share = self.acc_B.norm() / G_MPS2;
        let off = (share - 1.0).abs();
        if (FORCE_TOLD_SHARE..=FORCE_MOST_SHARE).contains(&off) { share.recip() } else { 1.0 }
    }

    /// Roll and pitch from the mean specific force, with a heading.
    pub fn attitude(&self, yaw_rad: f64) -> UnitQuaternion<f64> {
        let f = self.acc_B;
        let roll = f64::atan2(-f.y, -f.z);
        let pitch = f64::atan2(f.x, f.y.hypot(f.z));
        UnitQuaternion::from_euler_angles(roll, pitch, yaw_rad)
    }
}

/// A TDOA kept for a later least-squares fix.
#[derive(Debug, Clone, Copy)]
pub struct Kept {
    /// When it was true.
    pub at: HostTime,
    /// Anchor that is subtracted, Earth frame, m.
    pub a_E: Vector3<f64>,
    /// Anchor that is added, Earth frame, m.
    pub b_E: Vector3<f64>,
    /// Measurement, m.
    pub distance_diff_m: f64,
    /// What of a common bias of the anchors that the floor hides is in it: -1, 0 or 1.
    pub hidden: f64,
}

/// How many are kept: 0.6 s of TDoA2.
pub const KEPT: usize = 256;
/// Fewer than this give no fix.
const LEAST_KEPT: usize = 24;
/// Steps of the least squares from each start.
const STEPS: usize = 25;
/// Scale of the Cauchy cost, m.
const SCALE_M: f64 = 0.3;
/// A fix with a larger median residual is no fix, m.
const LARGEST_MEDIAN_M: f64 = 0.6;
/// Smallest information along any direction, 1/m² per measurement: below, one axis is unseen.
const LEAST_INFORMATION: f64 = 1e-3;
/// One sigma of the height of a standing vehicle, m.
const STD_REST_HEIGHT_M: f64 = 0.05;

/// The last TDOA measurements, oldest overwritten.
#[derive(Debug, Clone)]
pub struct Recent {
    kept: [Option<Kept>; KEPT],
    next: usize,
}

impl Default for Recent {
    fn default() -> Self {
        Self { kept: [None; KEPT], next: 0 }
    }
}

/// A position found by least squares.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fix {
    /// Position, Earth frame, m.
    pub x_E: Vector3<f64>,
    /// Median of the absolute residuals, m.
    pub median_m: f64,
    /// Measurements used.
    pub used: usize,
    /// Common range bias of the anchors that the floor hides, m.
    pub hidden_m: f64,
}

impl Recent {
    /// Keeps a measurement.
    #[inline]
    pub fn push(&mut self, kept: Kept) {
        self.kept[self.next] = Some(kept);
        self.next = (self.next + 1) % KEPT;
    }

    fn since(&self, oldest: HostTime) -> impl Iterator<Item = &Kept> + Clone {
        self.kept.iter().flatten().filter(move |k| k.at >= oldest)
    }

    /// Median absolute residual at a position, m; infinite with too few measurements.
    pub fn median_residual_m(&self, oldest: HostTime, x_E: &Vector3<f64>, hidden_m: f64) -> f64 {
        let mut buffer = [0.0; KEPT];
        let mut n = 0;
        for (slot, kept) in buffer.iter_mut().zip(self.since(oldest)) {
            *slot = residual(kept, x_E, hidden_m).0.abs();
            n += 1;
        }
        let used = &mut buffer[..n];
        if n < LEAST_KEPT {
            return f64::INFINITY;
        }
        *used.select_nth_unstable_by(n / 2, f64::total_cmp).1
    }

    /// Position from the measurements since `oldest`, from a known place at a known height: what TDOA alone say, whatever a
    /// filter makes of them.
    pub fn near(&self, oldest: HostTime, start: Vector3<f64>) -> Option<Vector3<f64>> {
        if self.since(oldest).count() < LEAST_KEPT {
            return None;
        }
        self.descend(oldest, start, Some(-start.z), 0.0).map(|(_, x_E)| x_E)
    }

    /// Position from the measurements since `oldest`, searched from every start; only inside
    /// `volume` (lowest and highest corner). `height_m` is the height of a vehicle that is known to
    /// stand; `hidden_m` are the common biases to try for the anchors that the floor hides.
    pub fn locate(
        &self,
        oldest: HostTime,
        starts: &[Vector3<f64>],
        volume: &(Vector3<f64>, Vector3<f64>),
        height_m: Option<f64>,
        hidden_m: &[f64],
    ) -> Option<Fix> {
        let used = self.since(oldest).count();
        if used < LEAST_KEPT {
            return None;
        }
        let mut best: Option<(f64, Vector3<f64>, f64)> = None;
        for (start, bias_m) in
            hidden_m.iter().flat_map(|bias_m| starts.iter().map(move |start| (start, *bias_m)))
        {
            if let Some((cost, x_E)) = self.descend(oldest, *start, height_m, bias_m)
                && x_E >= volume.0
                && x_E <= volume.1
                && best.is_none_or(|(least, ..)| cost < least)
            {
                best = Some((cost, x_E, bias_m));
            }
        }
        let (_, x_E, hidden_m) = best?;
        let median_m = self.median_residual_m(oldest, &x_E, hidden_m);
        // Multipath on the floor spoils the fit; the known height keeps the answer honest.
        let largest_m = LARGEST_MEDIAN_M * if height_m.is_some() { 2.0 } else { 1.0 };
        (median_m <= largest_m).then_some(Fix { x_E, median_m, used, hidden_m })
    }

    /// Cost at a position, with the normal equations there: whoever goes on from it needs them, and the residuals are the same.
    fn fit_at(
        &self,
        oldest: HostTime,
        x_E: Vector3<f64>,
        height_m: Option<f64>,
        hidden_m: f64,
    ) -> FitAt {
        let mut fit = FitAt {
            x_E,
            cost: 0.0,
            information: Matrix3::zeros(),
            right: Vector3::zeros(),
            n: 0.0,
        };
        for kept in self.since(oldest) {
            let (r, h) = residual(kept, &x_E, hidden_m);
            let loss = 1.0 + (r / SCALE_M).powi(2);
            let w = 1.0 / loss / (SCALE_M * SCALE_M);
            fit.cost += loss.ln();
            fit.information += h * h.transpose() * w;
            fit.right += h * (r * w);
            fit.n += 1.0;
        }
        fit.cost += height_m.map_or(0.0, |h| fit.n * ((h + x_E.z) / STD_REST_HEIGHT_M).powi(2));
        if let Some(h) = height_m {
            let w = fit.n / (STD_REST_HEIGHT_M * STD_REST_HEIGHT_M);
            fit.information[(2, 2)] += w;
            fit.right.z += w * (-h - x_E.z);
        }
        fit
    }

    fn descend(
        &self,
        oldest: HostTime,
        start: Vector3<f64>,
        height_m: Option<f64>,
        hidden_m: f64,
    ) -> Option<(f64, Vector3<f64>)> {
        let mut fit = self.fit_at(oldest, start, height_m, hidden_m);
        let mut damping = 1e-3;
        // Of the place from which the last step was tried.
        let mut information = Matrix3::zeros();
        for _ in 0..STEPS {
            information = fit.information;
            let mut damped = information;
            for i in 0..3 {
                damped[(i, i)] += damping * (information[(i, i)] + 1e-6);
            }
            let step = damped.try_inverse()? * fit.right;
            let tried = self.fit_at(oldest, fit.x_E + step, height_m, hidden_m);
            if tried.cost.is_finite() && tried.cost < fit.cost {
                fit = tried;
                damping = (damping * 0.3).max(1e-9);
                if step.norm() < 1e-4 {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        let FitAt { x_E, cost, n, .. } = fit;
        let seen = information.symmetric_eigenvalues().min() > LEAST_INFORMATION * n;
        (seen && x_E.iter().all(|c| c.is_finite())).then_some((cost, x_E))
    }
}

/// What the measurements come to at a position.
struct FitAt {
    x_E: Vector3<f64>,
    cost: f64,
    information: Matrix3<f64>,
    right: Vector3<f64>,
    /// Measurements.
    n: f64,
}

/// Residual (measured minus predicted) and its Jacobian's direction.
fn residual(kept: &Kept, x_E: &Vector3<f64>, hidden_m: f64) -> (f64, Vector3<f64>) {
    let (from_a, from_b) = (x_E - kept.a_E, x_E - kept.b_E);
    let (a, b) = (from_a.norm().max(1e-3), from_b.norm().max(1e-3));
    (kept.distance_diff_m - kept.hidden * hidden_m - (b - a), from_b / b - from_a / a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_few_percent_of_gravity_are_a_scale_and_more_is_none() {
        let gain = |share: f64| {
            let mut rest = RestAverage::default();
            let acc_B = Vector3::new(0.3, -0.2, -1.0).normalize() * (share * G_MPS2);
            (0..100).for_each(|n| rest.add(HostTime::from_us(n * 4000), &acc_B, &Vector3::zeros()));
            rest.force_gain()
        };
        for share in [0.96, 1.04] {
            assert!((gain(share) * share - 1.0).abs() < 1e-9, "{share}: {}", gain(share));
        }
        for share in [0.5, 0.92, 0.99, 1.0, 1.015, 1.08, 2.0] {
            assert_eq!(gain(share), 1.0, "{share}");
        }
    }

    #[test]
    fn prop_standing_tells_mean_and_scatter_and_forgets_what_was() {
        let mut standing = Standing::default();
        let mut feel = |seconds: f64, rate_radps: f64, scatter_radps: f64| {
            for n in 0..(seconds * 250.0) as u32 {
                let sign = if n.is_multiple_of(2) { 1.0 } else { -1.0 };
                let rate_B = Vec3::new(0.0, rate_radps + sign * scatter_radps, 0.0);
                standing.add(0.004, Vec3::new(0.0, 0.0, -G_MPS2), rate_B);
            }
            standing
        };
        assert!(!feel(0.5, 0.0, 0.01).is_known());
        let quiet = feel(2.0, 0.02, 0.01);
        assert!(quiet.is_known() && (quiet.rate_B_radps.y() - 0.02).abs() < 0.005, "{quiet:?}");
        assert!(
            (quiet.std_rate_radps - 0.01).abs() < 0.005 && quiet.std_acc_mps2 < 1e-9,
            "{quiet:?}"
        );
        let loud = feel(3.0, 0.5, 0.2);
        assert!(loud.rate_B_radps.y() > 0.45 && loud.std_rate_radps > 0.15, "{loud:?}");
        let again = feel(6.0, 0.0, 0.0);
        assert!(again.std_rate_radps < 0.05 && again.rate_B_radps.y().abs() < 0.01, "{again:?}");
    }
}
