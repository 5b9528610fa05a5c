//! How well flights of one mission tell a few candidates apart.
//!
//! ```text
//! u = k asinh((s - c)/(k w))                     compressed statistics, c and w of null flights
//! D²_ij = (|z̄_i - z̄_j|² - v_i/n_i - v_j/n_j) / max(1, v),       z = Σ^-1/2 u
//! P(correct) = Σ π_h P(argmax_k π_k N(y; x_k, I) = h | y ~ N(x_h, I))
//! ```
//! `Σ`: covariance of null flights with benign jitter, shrunk towards its diagonal (Schäfer & Strimmer
//! 2005); flights of candidates have no part in it, or few of them would look farther apart than they
//! are. `v_i`: trace of the variance within class i, `v` the variance along the difference of the two: what is
//! unknown of the parameters is in it, since every flight of a class draws its own. Added to the diagonal of `Σ` is the square of a tenth of every candidate's own signature:
//! another law of the same effect, as in the attribution. `D²` is free of the bias that few flights put on a distance. `x_k`: points in as
//! many dimensions as there are candidates that have these distances (classical scaling), so that
//! `P(correct)` is an integral by sampling in few dimensions. T-optimality (Atkinson & Fedorov 1975)
//! is the smallest `D²`.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use crate::shrink::{median, scales};
use haltere_model::random::Stream;

/// Sigma at which compression sets in: the attribution's own.
const KNEE: f64 = 8.0;
/// Share of the flights of every class that must know a statistic.
const LEAST_KNOWN: f64 = 0.8;
/// Samples of the integral per candidate.
const SAMPLES: usize = 2000;
/// Coordinates of a class centre within this many standard errors of the mean of all classes are taken
/// for it (nearest shrunken centroids, Tibshirani et al. 2002): most statistics say nothing about most
/// differences.
const SHRUNK: f64 = 1.5;
/// Relative uncertainty of a signature: that of the attribution's default.
const FORM: f64 = 0.1;
/// Degrees of freedom that the mean variance counts as, against that along one direction.
const LEANING: f64 = 10.0;
/// Factors on squared distances that are tried, so that posteriors of flights that are left out of their
/// class are as sure as they are right.
const TEMPERATURES: [f64; 7] = [1.0, 1.5, 2.5, 4.0, 7.0, 12.0, 20.0];
/// Least eigenvalue of the covariance of standardised statistics.
const LEAST_VARIANCE: f64 = 1e-3;

/// Candidates as clouds of whitened flights.
#[derive(Debug, Clone)]
pub struct Clouds {
    columns: Vec<usize>,
    centre: Vec<f64>,
    scale: Vec<f64>,
    whitener: DMatrix<f64>,
    means: Vec<DVector<f64>>,
    /// Trace of the variance within each class, and its number of flights.
    within: Vec<(f64, f64)>,
    /// Variance per coordinate, pooled.
    pooled: DVector<f64>,
    /// Whitened flights less the mean of their class.
    scatter: Vec<Vec<DVector<f64>>>,
    /// Factor on squared distances in a posterior.
    temperature: f64,
}

impl Clouds {
    /// From null flights and flights of each candidate. `None`: no statistic is known to all.
    pub fn new(nulls: &[Vec<f64>], classes: &[Vec<Vec<f64>>]) -> Option<Self> {
        let width = nulls.first().map_or(0, Vec::len);
        let all_scales = scales(nulls);
        let known = |rows: &[Vec<f64>], j: usize| {
            let count = rows.iter().filter(|r| r.get(j).is_some_and(|v| v.is_finite())).count();
            !rows.is_empty() && count as f64 >= LEAST_KNOWN * rows.len() as f64
        };
        let columns: Vec<usize> = (0..width)
            .filter(|j| all_scales.get(*j).is_some_and(|s| s.is_finite()))
            .filter(|j| known(nulls, *j) && classes.iter().all(|c| known(c, *j)))
            .collect();
        if columns.is_empty() || classes.iter().any(|c| c.len() < 2) {
            return None;
        }
        let centre: Vec<f64> = columns
            .iter()
            .map(|j| {
                let mut values: Vec<f64> = nulls
                    .iter()
                    .filter_map(|r| r.get(*j).copied())
                    .filter(|v| v.is_finite())
                    .collect();
                median(&mut values)
            })
            .collect();
        let scale: Vec<f64> = columns.iter().map(|j| all_scales[*j]).collect();
        let mut clouds = Self {
            columns,
            centre,
            scale,
            whitener: DMatrix::zeros(0, 0),
            means: Vec::new(),
            within: Vec::new(),
            pooled: DVector::zeros(0),
            scatter: Vec::new(),
            temperature: 1.0,
        };
        let groups: Vec<Vec<DVector<f64>>> = std::iter::once(nulls)
            .chain(classes.iter().map(Vec::as_slice))
            .map(|rows| rows.iter().map(|r| clouds.compressed(r)).collect())
            .collect();
        let p = clouds.columns.len();
        let null = mean(&groups[0]);
        let residuals: Vec<DVector<f64>> = groups[0].iter().map(|r| r - &null).collect();
        let freedom = residuals.len().saturating_sub(1).max(1) as f64;
        let mut form = DVector::zeros(p);
        for rows in &groups[1..] {
            form += (mean(rows) - &null).map(|v| (FORM * v).powi(2)) / classes.len() as f64;
        }
        clouds.whitener = whitener(&residuals, freedom, &form);
        clouds.pooled = DVector::zeros(p);
        for rows in &groups[1..] {
            let z: Vec<DVector<f64>> = rows.iter().map(|r| &clouds.whitener * r).collect();
            let mean = mean(&z);
            let mut variance = DVector::zeros(p);
            for row in &z {
                variance += (row - &mean).map(|v| v * v);
            }
            variance /= (z.len() - 1) as f64;
            clouds.within.push((variance.sum(), z.len() as f64));
            clouds.pooled += variance / classes.len() as f64;
            clouds.scatter.push(z.iter().map(|row| row - &mean).collect());
            clouds.means.push(mean);
        }
        clouds.temperature = clouds.fitting();
        Some(clouds)
    }

    /// The temperature with the least logarithmic loss on flights left out of their class.
    fn fitting(&self) -> f64 {
        let n = self.means.len();
        let mut squared: Vec<(usize, Vec<f64>)> = Vec::new();
        for (own, rows) in self.scatter.iter().enumerate() {
            for row in rows {
                let count = rows.len() as f64;
                // Without this flight the mean of its class lies on the other side.
                let left = &self.means[own] - row / (count - 1.0);
                let flight = &self.means[own] + row;
                let means: Vec<&DVector<f64>> =
                    (0..n).map(|k| if k == own { &left } else { &self.means[k] }).collect();
                squared.push((own, self.squares(&flight, &means)));
            }
        }
        let loss = |temperature: f64| -> f64 {
            squared
                .iter()
                .map(|(own, s)| {
                    let logs: Vec<f64> = s.iter().map(|v| -0.5 * v / temperature).collect();
                    -softmax(&logs)[*own].max(1e-12).ln()
                })
                .sum()
        };
        TEMPERATURES
            .into_iter()
            .map(|t| (t, loss(t)))
            .fold((1.0, f64::INFINITY), |a, b| if b.1 < a.1 { b } else { a })
            .0
    }

    /// Squared distances of a whitened flight to class centres, which are shrunk to their common mean.
    fn squares(&self, z: &DVector<f64>, means: &[&DVector<f64>]) -> Vec<f64> {
        let n = means.len() as f64;
        let grand = means.iter().fold(DVector::zeros(z.len()), |sum, m| sum + *m) / n.max(1.0);
        means
            .iter()
            .zip(&self.within)
            .map(|(mean, (_, count))| {
                (0..z.len())
                    .map(|k| {
                        let se = (self.pooled[k] / count).sqrt();
                        let off = mean[k] - grand[k];
                        let kept = (off.abs() - SHRUNK * se).max(0.0) * off.signum();
                        (z[k] - grand[k] - kept).powi(2)
                    })
                    .sum()
            })
            .collect()
    }

    /// Compressed statistics; unknown ones as in a null flight.
    fn compressed(&self, statistics: &[f64]) -> DVector<f64> {
        let at = |k: usize| {
            let value = statistics.get(self.columns[k]).copied().unwrap_or(f64::NAN);
            let x = (value - self.centre[k]) / self.scale[k];
            if x.is_finite() { KNEE * (x / KNEE).asinh() } else { 0.0 }
        };
        DVector::from_fn(self.columns.len(), |k, _| at(k))
    }

    /// Squared distance of two candidates, sigma², never below zero.
    pub fn squared(&self, i: usize, j: usize) -> f64 {
        let (Some(a), Some(b)) = (self.means.get(i), self.means.get(j)) else { return 0.0 };
        let bias = self.within[i].0 / self.within[i].1 + self.within[j].0 / self.within[j].1;
        let apart = a - b;
        let unbiased = (apart.norm_squared() - bias).max(0.0);
        let Some(along) = apart.try_normalize(f64::MIN_POSITIVE) else { return 0.0 };
        let spread = |k: usize| {
            let rows = &self.scatter[k];
            rows.iter().map(|r| r.dot(&along).powi(2)).sum::<f64>() / (rows.len() - 1) as f64
        };
        // The variance along one direction is known from few flights: it leans on the mean of all.
        let mean = self.pooled.sum() / self.columns.len() as f64;
        let freedom = self.within[i].1 + self.within[j].1 - 2.0;
        let along = 0.5 * (spread(i) + spread(j));
        let unit = (freedom * along + LEANING * mean) / (freedom + LEANING);
        let unit = unit.max(1.0);
        unbiased / unit
    }

    /// All squared distances.
    pub fn distances(&self) -> DMatrix<f64> {
        let n = self.means.len();
        DMatrix::from_fn(n, n, |i, j| if i == j { 0.0 } else { self.squared(i, j) })
    }

    /// Posterior of the candidates for one flight, from these priors.
    pub fn posterior(&self, statistics: &[f64], prior: &[f64]) -> Vec<f64> {
        let z = &self.whitener * self.compressed(statistics);
        let means: Vec<&DVector<f64>> = self.means.iter().collect();
        let logs: Vec<f64> = self
            .squares(&z, &means)
            .into_iter()
            .zip(prior)
            .map(|(squared, prior)| prior.max(1e-12).ln() - 0.5 * squared / self.temperature)
            .collect();
        softmax(&logs)
    }
}

fn softmax(logs: &[f64]) -> Vec<f64> {
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let shares: Vec<f64> = logs.iter().map(|l| (l - most).exp()).collect();
    let sum: f64 = shares.iter().sum();
    shares.into_iter().map(|s| s / sum).collect()
}

fn mean(rows: &[DVector<f64>]) -> DVector<f64> {
    rows.iter().sum::<DVector<f64>>() / rows.len().max(1) as f64
}

/// Symmetric inverse root of the shrunk covariance of residuals.
fn whitener(residuals: &[DVector<f64>], freedom: f64, form: &DVector<f64>) -> DMatrix<f64> {
    let p = residuals.first().map_or(0, DVector::len);
    let x = DMatrix::from_fn(residuals.len(), p, |i, j| residuals[i][j]);
    let covariance = x.tr_mul(&x) / freedom;
    let squared = x.map(|v| v * v);
    let fourth = squared.tr_mul(&squared) / freedom;
    let (mut noise, mut signal) = (0.0, 0.0);
    for j in 0..p {
        for i in 0..j {
            noise += (fourth[(i, j)] - covariance[(i, j)].powi(2)).max(0.0) / freedom;
            signal += covariance[(i, j)].powi(2);
        }
    }
    let weight = if signal > 0.0 { (noise / signal).clamp(0.0, 1.0) } else { 1.0 };
    let shrunk = DMatrix::from_fn(p, p, |i, j| {
        if i == j {
            covariance[(i, i)].max(LEAST_VARIANCE) + form[i]
        } else {
            covariance[(i, j)] * (1.0 - weight)
        }
    });
    let eigen = SymmetricEigen::new(shrunk);
    let root = eigen.eigenvalues.map(|v| 1.0 / v.max(LEAST_VARIANCE).sqrt());
    &eigen.eigenvectors * DMatrix::from_diagonal(&root) * eigen.eigenvectors.transpose()
}

/// P(correct) of the best guess among candidates with these squared distances and priors.
pub fn correct(squared: &DMatrix<f64>, prior: &[f64], seed: u64) -> f64 {
    let n = prior.len();
    let total: f64 = prior.iter().sum();
    if n < 2 || total <= 0.0 {
        return 1.0;
    }
    // Classical scaling: -½ J D² J = X Xᵀ.
    let centring = DMatrix::identity(n, n) - DMatrix::from_element(n, n, 1.0 / n as f64);
    let gram = &centring * squared * &centring * -0.5;
    let eigen = SymmetricEigen::new(gram);
    let x =
        &eigen.eigenvectors * DMatrix::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0).sqrt()));
    let mut rng = Stream::new(seed, "correct");
    let mut sum = 0.0;
    for h in 0..n {
        let mut hits = 0.0;
        for _ in 0..SAMPLES {
            let y = DVector::from_fn(n, |k, _| x[(h, k)] + rng.normal());
            let score = |k: usize| {
                let off: f64 = (0..n).map(|d| (y[d] - x[(k, d)]).powi(2)).sum();
                prior[k].max(1e-12).ln() - 0.5 * off
            };
            let own = score(h);
            hits += f64::from(u8::from((0..n).all(|k| k == h || score(k) < own)));
        }
        sum += prior[h] / total * hits / SAMPLES as f64;
    }
    sum.max(prior.iter().copied().fold(0.0, f64::max) / total)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(rng: &mut Stream, shift: f64, count: usize, p: usize) -> Vec<Vec<f64>> {
        (0..count)
            .map(|_| (0..p).map(|j| rng.normal() + if j == 3 { shift } else { 0.0 }).collect())
            .collect()
    }

    #[test]
    fn val_distance_of_known_shifts_is_not_biased_by_few_flights() {
        let (mut sum, mut near) = (0.0, 0.0);
        for seed in 0..20 {
            let mut rng = Stream::new(seed, "clouds");
            let nulls = cloud(&mut rng, 0.0, 40, 60);
            let classes = [0.0, 3.0, 3.0].map(|shift| cloud(&mut rng, shift, 10, 60)).to_vec();
            let clouds = Clouds::new(&nulls, &classes).unwrap();
            sum += clouds.squared(0, 1) / 20.0;
            near += clouds.squared(1, 2) / 20.0;
        }
        // 3 sigma; the naive estimate would be 9 + 2 · 60 / 10 = 21. Forty null flights do not know a
        // covariance of sixty numbers: what is lost to that makes the distance smaller, never larger.
        assert!((5.0..10.0).contains(&sum), "{sum}");
        assert!(near < 4.0, "{near}");
    }

    #[test]
    fn val_probability_of_two_is_that_of_the_textbook() {
        // Two equal candidates D apart: Φ(D/2).
        for (d, want) in [(0.0, 0.5), (2.0, 0.8413), (4.0, 0.9772)] {
            let squared = DMatrix::from_row_slice(2, 2, &[0.0, d * d, d * d, 0.0]);
            let p = correct(&squared, &[0.5, 0.5], 1);
            assert!((p - want).abs() < 0.015, "{d}: {p}");
        }
        let squared = DMatrix::from_row_slice(2, 2, &[0.0, 1e-6, 1e-6, 0.0]);
        assert!((correct(&squared, &[0.9, 0.1], 1) - 0.9).abs() < 1e-9, "the prior stays");
    }

    #[test]
    fn prop_a_flight_is_given_to_its_own_cloud_and_none_to_all() {
        let mut rng = Stream::new(4, "clouds");
        let nulls = cloud(&mut rng, 0.0, 40, 100);
        let classes = [0.0, 5.0].map(|shift| cloud(&mut rng, shift, 30, 100)).to_vec();
        let clouds = Clouds::new(&nulls, &classes).unwrap();
        let mut right = 0;
        for (k, shift) in [0.0, 5.0].into_iter().enumerate() {
            for row in cloud(&mut rng, shift, 50, 100) {
                right += usize::from(clouds.posterior(&row, &[0.5, 0.5])[k] > 0.5);
            }
        }
        assert!(right >= 90, "{right} of 100");
        let nothing = vec![f64::NAN; 100];
        let p = clouds.posterior(&nothing, &[0.5, 0.5]);
        assert!((p.iter().sum::<f64>() - 1.0).abs() < 1e-9);
        assert!(Clouds::new(&[], &[]).is_none() && Clouds::new(&nulls, &[vec![]]).is_none());
    }
}
