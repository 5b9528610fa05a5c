//! How well one effect explains a flight: likelihood over θ, best θ, evidence, intervals.
//!
//! `log p(z | e, θ) = -½ (z - m)ᵀ N⁻¹ (z - m) - ½ log|N|`, `m = Q h(θ)`, `N` at the level of θ; the
//! constant `-p/2 log 2π` is left out everywhere. The prior is uniform on the unit cube, that is
//! log-uniform over wide positive ranges. The evidence where θ is searched is a mixture importance sample: half from
//! the prior, half from the Laplace approximation at the best θ; otherwise it is the mean over the draws.

use std::cell::OnceCell;

use nalgebra::{DMatrix, DVector};

use super::surrogate::{LEVELS, Surrogate};
use super::theta::normals;
use crate::normal::log_mean_exp;

/// Points of the prior, per evidence.
const PRIOR_POINTS: usize = 96;
/// Points around the best θ.
const LOCAL_POINTS: usize = 64;
/// Starts of the search.
const STARTS: usize = 3;
/// First and last step of the search on the unit cube.
const FIRST_STEP: f64 = 0.125;
const LAST_STEP: f64 = 1.0 / 512.0;
/// Rounds over all axes after which a search stops where it is.
const MOST_ROUNDS: usize = 60;
/// Half step of second differences.
const DIFFERENCE: f64 = 0.01;
/// Curvature of the prior, so that a parameter without influence has a finite width: a normal as
/// wide as the cube.
const PRIOR_CURVATURE: f64 = 12.0;

/// What the likelihood of one effect needs of a flight.
pub(super) struct Sufficient<'a> {
    surrogate: &'a Surrogate,
    z: &'a DVector<f64>,
    /// `(Qᵀ N⁻¹ z, zᵀ N⁻¹ z)` per level, as far as it was asked for.
    parts: [OnceCell<(DVector<f64>, f64)>; LEVELS.len()],
}

/// What a flight says about one effect.
#[derive(Debug, Clone, Default)]
pub(super) struct Fit {
    /// Place of the effect in the bank.
    pub effect: usize,
    /// Best θ on the unit cube.
    pub unit: Vec<f64>,
    /// Coordinates of its signature.
    pub h: DVector<f64>,
    /// Log likelihood there.
    pub peak: f64,
    /// Log evidence.
    pub log_z: f64,
    /// Weighted points of the posterior; empty when only screened.
    pub points: Vec<(Vec<f64>, f64)>,
}

impl<'a> Sufficient<'a> {
    /// Of a whitened flight.
    pub fn new(surrogate: &'a Surrogate, z: &'a DVector<f64>) -> Self {
        Self { surrogate, z, parts: Default::default() }
    }

    fn part(&self, level: usize) -> &(DVector<f64>, f64) {
        let Surrogate { solved, noise, .. } = self.surrogate;
        self.parts[level]
            .get_or_init(|| (solved[level][1].tr_mul(self.z), noise[level].squared(self.z)))
    }

    /// Log likelihood of a signature.
    pub fn log_likelihood(&self, h: &DVector<f64>) -> f64 {
        let level = self.surrogate.level(h);
        let place = (level / LEVELS[0]).ln() / (LEVELS[1] / LEVELS[0]).ln();
        let below = (place.floor() as usize).min(LEVELS.len() - 2);
        let share = place - below as f64;
        let at = |l: usize| {
            let (b, c) = self.part(l);
            let a = &self.surrogate.solved[l][0];
            let mut quadratic = 0.0;
            for j in 0..h.len() {
                let mut column = 0.0;
                for i in 0..h.len() {
                    column += a[(i, j)] * h[i];
                }
                quadratic += column * h[j];
            }
            -0.5 * (c - 2.0 * h.dot(b) + quadratic) - 0.5 * self.surrogate.noise[l].log_det
        };
        (1.0 - share) * at(below) + share * at(below + 1)
    }

    /// Log evidence by the draws of the effect alone: `log (1/n) Σ_i p(z | θ_i)`, and the best of them.
    pub fn screen(&self, effect: usize) -> Fit {
        let starts = &self.surrogate.starts;
        let values: Vec<f64> = starts.iter().map(|(_, h)| self.log_likelihood(h)).collect();
        let best = values.iter().copied().enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
        let (place, peak) = best.unwrap_or((0, f64::NEG_INFINITY));
        let (unit, h) = starts.get(place).cloned().unwrap_or_default();
        Fit { effect, unit, h, peak, log_z: log_mean_exp(&values), points: Vec::new() }
    }

    /// Searches θ and integrates over it.
    pub fn fit(&self, effect: usize) -> Fit {
        let s = self.surrogate;
        let d = s.space.len();
        let mut prior: Vec<(Vec<f64>, f64)> = s
            .space
            .spread(PRIOR_POINTS)
            .into_iter()
            .map(|u| {
                let value = self.log_likelihood(&s.coordinates(&u));
                (u, value)
            })
            .collect();
        let mut starts: Vec<(f64, &[f64])> =
            s.starts.iter().map(|(u, h)| (self.log_likelihood(h), u.as_slice())).collect();
        starts.extend(prior.iter().map(|(u, v)| (*v, u.as_slice())));
        starts.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut best = (f64::NEG_INFINITY, vec![0.5; d]);
        for (value, unit) in starts.iter().take(STARTS) {
            let found = climb(*value, unit.to_vec(), |u| self.log_likelihood(&s.coordinates(u)));
            if found.0 > best.0 {
                best = found;
            }
        }
        let (peak, unit) = best;
        let root = self.local_root(&unit, peak);
        let local = normals(LOCAL_POINTS, d);
        let log_det: f64 = root.diagonal().iter().map(|v| v.abs().max(1e-12).ln()).sum();
        let log_q = |x2: f64| -0.5 * x2 - 0.5 * d as f64 * std::f64::consts::TAU.ln() - log_det;
        // Points, log likelihood, log density of the local proposal.
        let mut points: Vec<(Vec<f64>, f64, f64)> = Vec::new();
        let inverse = root.clone().try_inverse();
        for (u, value) in prior.drain(..) {
            let off = DVector::from_fn(d, |i, _| u[i] - unit[i]);
            let x2 = inverse.as_ref().map_or(f64::INFINITY, |m| (m * off).norm_squared());
            points.push((u, value, log_q(x2)));
        }
        for n in &local {
            let step = &root * DVector::from_column_slice(n);
            let u: Vec<f64> = unit.iter().zip(step.iter()).map(|(a, b)| a + b).collect();
            if u.iter().all(|v| (0.0..=1.0).contains(v)) {
                let value = self.log_likelihood(&s.coordinates(&u));
                points.push((u, value, log_q(n.iter().map(|v| v * v).sum())));
            }
        }
        let total = (PRIOR_POINTS + LOCAL_POINTS) as f64;
        let (share_prior, share_local) = (PRIOR_POINTS as f64 / total, LOCAL_POINTS as f64 / total);
        let mut sum = 0.0;
        let points: Vec<(Vec<f64>, f64)> = points
            .into_iter()
            .map(|(u, value, log_q)| {
                let weight = (value - peak).exp() / (share_prior + share_local * log_q.exp());
                sum += weight;
                (u, weight)
            })
            .collect();
        let log_z = peak + (sum / total).max(f64::MIN_POSITIVE).ln();
        let h = s.coordinates(&unit);
        Fit { effect, unit, h, peak, log_z, points }
    }

    /// Lower root of the inverse of the curvature at the peak.
    fn local_root(&self, unit: &[f64], peak: f64) -> DMatrix<f64> {
        let d = unit.len();
        let value = |u: &[f64]| self.log_likelihood(&self.surrogate.coordinates(u));
        let mut curvature = DMatrix::identity(d, d) * PRIOR_CURVATURE;
        // Second differences around a point inside, so that all steps stay in the cube.
        let inside: Vec<f64> = unit.iter().map(|u| u.clamp(DIFFERENCE, 1.0 - DIFFERENCE)).collect();
        let middle = if inside == unit { peak } else { value(&inside) };
        let moved = |i: usize, a: f64, j: usize, b: f64| {
            let mut u = inside.clone();
            u[i] += a * DIFFERENCE;
            u[j] += b * DIFFERENCE;
            value(&u)
        };
        for i in 0..d {
            let second = moved(i, 1.0, i, 0.0) + moved(i, -1.0, i, 0.0) - 2.0 * middle;
            curvature[(i, i)] += (-second / DIFFERENCE.powi(2)).max(0.0);
            for j in 0..i {
                let mixed = moved(i, 1.0, j, 1.0) + moved(i, -1.0, j, -1.0)
                    - moved(i, 1.0, j, -1.0)
                    - moved(i, -1.0, j, 1.0);
                let value = -mixed / (4.0 * DIFFERENCE.powi(2));
                curvature[(i, j)] = value;
                curvature[(j, i)] = value;
            }
        }
        let diagonal = DMatrix::from_diagonal(&curvature.diagonal());
        for matrix in [curvature, diagonal] {
            if let Some(root) = matrix.cholesky().and_then(|c| c.inverse().cholesky()) {
                return root.l();
            }
        }
        DMatrix::identity(d, d) * 0.3
    }
}

impl Fit {
    /// Whether its parameters were searched, and not only those of the draws looked at.
    pub fn is_searched(&self) -> bool {
        !self.points.is_empty()
    }

    /// Central 90 % of a parameter on the unit cube; the whole range when only screened. `widen`:
    /// factor on its distance from the best value.
    pub fn interval(&self, k: usize, widen: f64) -> [f64; 2] {
        let [low, high] = self.narrow(k);
        let best = self.unit.get(k).copied().unwrap_or(0.5);
        let wide = |end: f64| (best + widen * (end - best)).clamp(0.0, 1.0);
        [wide(low.min(best)), wide(high.max(best))]
    }

    fn narrow(&self, k: usize) -> [f64; 2] {
        let mut along: Vec<(f64, f64)> = self
            .points
            .iter()
            .filter_map(|(u, w)| Some((*u.get(k)?, *w)).filter(|(_, w)| *w > 0.0))
            .collect();
        let total: f64 = along.iter().map(|(_, w)| w).sum();
        if total <= 0.0 {
            return [0.0, 1.0];
        }
        along.sort_by(|a, b| a.0.total_cmp(&b.0));
        let quantile = |share: f64| {
            let mut sum = 0.0;
            for (u, w) in &along {
                sum += w / total;
                if sum >= share {
                    return *u;
                }
            }
            1.0
        };
        [quantile(0.05), quantile(0.95)]
    }
}

/// Pattern search on the unit cube: steps along every axis, halved when none helps.
pub(super) fn climb(
    value: f64,
    start: Vec<f64>,
    objective: impl Fn(&[f64]) -> f64,
) -> (f64, Vec<f64>) {
    let (mut best, mut at, mut step) = (value, start, FIRST_STEP);
    let mut left = MOST_ROUNDS;
    while step >= LAST_STEP && left > 0 {
        left -= 1;
        let mut moved = false;
        for k in 0..at.len() {
            for sign in [1.0, -1.0] {
                let before = at[k];
                at[k] = (before + sign * step).clamp(0.0, 1.0);
                let trial = if at[k] == before { best } else { objective(&at) };
                if trial > best {
                    best = trial;
                    moved = true;
                    break;
                }
                at[k] = before;
            }
        }
        if !moved {
            step *= 0.5;
        }
    }
    (best, at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::axis::{Axis, Size};
    use haltere_model::random::Stream;

    /// Markov's inequality asks of the gate that a flight without an effect is, on average, as likely by one as by none. By the best draw
    /// less two for each parameter, the law before for effects that were not searched, it is about a quarter as likely.
    #[test]
    fn prop_evidence_by_the_draws_is_one_on_average_without_an_effect() {
        let p = 12;
        let thetas: Vec<[f64; 1]> = (0..21).map(|i| [-1.0 + 0.1 * f64::from(i)]).collect();
        let refs: Vec<&[f64]> = thetas.iter().map(|t| t.as_slice()).collect();
        let z = DMatrix::from_fn(21, p, |i, j| if j < 4 { 0.6 * thetas[i][0] } else { 0.0 });
        let axis = Axis { low: -1.0, high: 1.0, choice: false, size: Some(Size::From(0.0)) };
        let s = Surrogate::new(std::slice::from_ref(&axis), &refs, &z, &DMatrix::zeros(0, p));
        let mut rng = Stream::new(10, "evidence");
        let mut ratio = || {
            let flight = DVector::from_fn(p, |_, _| rng.normal());
            (Sufficient::new(&s, &flight).screen(0).log_z + 0.5 * flight.norm_squared()).exp()
        };
        let mean = (0..20_000).map(|_| ratio()).sum::<f64>() / 20_000.0;
        assert!((mean - 1.0).abs() < 0.05, "{mean}");
    }

    /// A linear effect in known noise: evidence and interval have closed forms.
    #[test]
    fn val_evidence_and_interval_of_a_linear_effect() {
        let p = 30;
        let along = DVector::from_fn(p, |j, _| if j < 4 { 6.0 } else { 0.0 });
        let thetas: Vec<[f64; 1]> = (0..41).map(|i| [-1.0 + 0.05 * f64::from(i)]).collect();
        let z = DMatrix::from_fn(41, p, |i, j| along[j] * thetas[i][0]);
        let refs: Vec<&[f64]> = thetas.iter().map(|t| t.as_slice()).collect();
        let s = Surrogate::new(
            &[Axis { low: -1.0, high: 1.0, choice: false, size: Some(Size::From(0.0)) }],
            &refs,
            &z,
            &DMatrix::zeros(0, p),
        );
        let mut rng = Stream::new(9, "evidence");
        let noise = DVector::from_fn(p, |_, _| rng.normal());
        let flight = &along * 0.4 + &noise;
        let fit = Sufficient::new(&s, &flight).fit(0);
        let theta = s.space.value(&fit.unit)[0];
        let sigma = 1.0 / along.norm();
        let want = 0.4 + along.dot(&noise) / along.norm_squared();
        assert!((theta - want).abs() < 0.2 * sigma, "{theta} {want}");
        // ∫ dθ/2 of a Gaussian peak.
        let residual = &flight - &along * want;
        let peak = -0.5 * residual.norm_squared();
        let log_z = peak + (std::f64::consts::TAU.sqrt() * sigma / 2.0).ln();
        assert!((fit.log_z - log_z).abs() < 0.25, "{} {log_z}", fit.log_z);
        let [low, high] = fit.interval(0, 1.0).map(|u| s.space.value(&[u])[0]);
        assert!((high - low - 3.29 * sigma).abs() < 0.8 * sigma, "{low} {high} {sigma}");
    }
}
