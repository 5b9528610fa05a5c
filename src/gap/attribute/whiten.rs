//! From statistics with units to whitened numbers: robust centre and scale per statistic, a
//! compression of extreme values, and the covariance of null flights (seeds and benign jitter).
//!
//! `x = (s - c - shift) / w`, `u = k asinh(x / k)`, `z = W u`. Compressed, an effect a thousand
//! sigma large weighs some forty; a 10 % error of its size stays below one sigma and cannot outvote
//! all other statistics. `c`, `w`: median and robust sigma of the null flights. With reference flights
//! of the airframe `shift` is what their median differs by, and their variance adds to `w²` and to
//! the covariance: a number that wanders on healthy flights of this airframe says nothing. So does the
//! resolution of a statistic: what the recording computer adds, which a simulator does not.

use nalgebra::{DMatrix, DVector};

use super::linear::{matrix, shrunk_covariance, whitener};
use crate::normal::median;

/// Sigma at which compression sets in.
const KNEE: f64 = 8.0;
/// Largest standardised value; beyond it a number says no more than "very large".
const LARGEST: f64 = 1e5;
/// A statistic unknown in more than this share of null flights is not used.
const MOST_UNKNOWN: f64 = 0.2;
/// Sigma of a normal variable per median absolute deviation, 1/Φ⁻¹(3/4).
const SIGMA_PER_MAD: f64 = 1.4826;
/// A robust sigma below this share of the plain one is that of a variable that is mostly constant.
const LEAST_ROBUST_SHARE: f64 = 0.3;
/// Fewer reference flights say nothing about a centre and a scatter.
pub(super) const LEAST_REFERENCES: usize = 4;
/// Weight of "no correlation" on the covariance of reference flights: there are far fewer of them
/// than statistics.
const REFERENCE_SHRINKAGE: f64 = 0.7;

/// `k asinh(x/k)`.
pub(super) fn compress(x: f64) -> f64 {
    KNEE * (x / KNEE).asinh()
}

/// Inverse of [`compress`].
pub(super) fn expand(u: f64) -> f64 {
    KNEE * (u / KNEE).sinh().clamp(-LARGEST, LARGEST)
}

/// Centre and scale of the statistics in use.
#[derive(Debug, Clone, Default)]
pub(super) struct Standard {
    /// Places of the statistics in use.
    pub columns: Vec<usize>,
    centre: Vec<f64>,
    scale: Vec<f64>,
    /// What reference flights move the centre by.
    shift: Vec<f64>,
    /// Share of the resolution in the square of the scale.
    unresolved: Vec<f64>,
    /// Variance that sessions add, in variances of the references.
    sessions: Vec<f64>,
}

impl Standard {
    /// From null flights; `effects` only give a scale to statistics that never vary in a null
    /// flight. `resolution` and variance between `sessions`: of every statistic, or empty. `allowed`: which statistics may be used.
    pub fn new<'a>(
        nulls: &[&'a [f64]],
        effects: impl Iterator<Item = &'a [f64]> + Clone,
        references: &[&[f64]],
        [resolution, sessions]: [&[f64]; 2],
        allowed: impl Fn(usize) -> bool,
    ) -> Self {
        let width = nulls.first().map_or(0, |r| r.len());
        let mut standard = Self::default();
        for j in (0..width).filter(|j| allowed(*j)) {
            let known: Vec<f64> = nulls.iter().map(|r| r[j]).filter(|v| v.is_finite()).collect();
            let unknown = nulls.len() - known.len();
            if known.is_empty() || unknown as f64 > MOST_UNKNOWN * nulls.len() as f64 {
                continue;
            }
            let centre = median(known.iter().copied());
            let mut scale = spread(&known, centre);
            if scale <= f64::EPSILON * centre.abs() {
                let away: Vec<f64> =
                    effects.clone().map(|r| r[j]).filter(|v| v.is_finite()).collect();
                // Never moved in a null flight: an effect that moves it counts as some sigma.
                scale = spread(&away, centre) / KNEE;
            }
            let resolution = resolution.get(j).copied().unwrap_or(0.0);
            scale = scale.hypot(resolution);
            let accepted: Vec<f64> =
                references.iter().map(|r| r[j]).filter(|v| v.is_finite()).collect();
            let mut shift = 0.0;
            let more = sessions.get(j).copied().unwrap_or(0.0);
            if accepted.len() >= LEAST_REFERENCES {
                let middle = median(accepted.iter().copied());
                let n = accepted.len() as f64;
                // Plain and not robust: what an accepted flight does now and then is no gap.
                let variance =
                    accepted.iter().map(|v| (v - middle).powi(2)).sum::<f64>() / (n - 1.0);
                shift = middle - centre;
                scale = (scale.powi(2) + variance * (1.0 + 1.0 / n + more)).sqrt();
            }
            if scale.is_finite() && scale > f64::EPSILON * centre.abs() && scale > f64::MIN_POSITIVE
            {
                standard.columns.push(j);
                standard.centre.push(centre);
                standard.scale.push(scale);
                standard.shift.push(shift);
                standard.unresolved.push((resolution / scale).powi(2));
                standard.sessions.push(more);
            }
        }
        standard
    }

    /// Standardised, NaN where unknown.
    pub fn raw(&self, statistics: &[f64]) -> Vec<f64> {
        let at = |k: usize| {
            let value = statistics.get(self.columns[k]).copied().unwrap_or(f64::NAN);
            let x = (value - self.centre[k] - self.shift[k]) / self.scale[k];
            if x.is_nan() { x } else { x.clamp(-LARGEST, LARGEST) }
        };
        (0..self.columns.len()).map(at).collect()
    }

    /// Variance of the resolution, in units of the scale.
    pub fn unresolved(&self, k: usize) -> f64 {
        self.unresolved[k]
    }

    /// Sigma of a null flight, in units of the statistic.
    pub fn scale(&self, k: usize) -> f64 {
        self.scale[k]
    }

    /// Centred on the bank again.
    pub fn without_shift(mut self) -> Self {
        self.shift.fill(0.0);
        self
    }
}

/// Variance of a statistic over the flights that know it.
pub(super) fn variance(rows: &[&[f64]], j: usize) -> f64 {
    let known: Vec<f64> = rows.iter().map(|row| row[j]).filter(|v| v.is_finite()).collect();
    let n = known.len() as f64;
    let mean = known.iter().sum::<f64>() / n.max(1.0);
    known.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)
}

/// Robust sigma about `centre`; the plain one for variables that are mostly constant.
fn spread(values: &[f64], centre: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let off: Vec<f64> = values.iter().map(|v| (v - centre).abs()).collect();
    let plain = (off.iter().map(|v| v * v).sum::<f64>() / off.len() as f64).sqrt();
    let robust = SIGMA_PER_MAD * median(off);
    if robust >= LEAST_ROBUST_SHARE * plain { robust } else { plain }
}

/// Compressed and whitened statistics.
#[derive(Debug, Clone)]
pub(super) struct Whitening {
    /// Centre and scale.
    pub standard: Standard,
    w: DMatrix<f64>,
    /// Its inverse.
    back: DMatrix<f64>,
}

impl Whitening {
    /// `nulls`: rows that give the covariance (jitter, which contains the noise of seeds), as the bank
    /// has them; `references`: accepted flights, whose scatter adds to it.
    pub fn new(standard: Standard, nulls: &[&[f64]], references: &[&[f64]]) -> Self {
        let width = standard.columns.len();
        let plain = standard.clone().without_shift();
        let rows: Vec<Vec<f64>> = nulls.iter().map(|r| compressed(&plain.raw(r))).collect();
        let (mut covariance, _) = shrunk_covariance(&matrix(&rows, width));
        if references.len() >= LEAST_REFERENCES {
            let rows: Vec<Vec<f64>> =
                references.iter().map(|r| compressed(&standard.raw(r))).collect();
            let (scatter, _) = shrunk_covariance(&matrix(&rows, width));
            for i in 0..width {
                for j in 0..width {
                    let keep =
                        if i == j { 1.0 + standard.sessions[i] } else { 1.0 - REFERENCE_SHRINKAGE };
                    covariance[(i, j)] += keep * scatter[(i, j)];
                }
            }
        }
        for k in 0..width {
            covariance[(k, k)] += standard.unresolved(k);
            covariance[(k, k)] = covariance[(k, k)].max(LEAST_VARIANCE);
        }
        let [w, back] = whitener(&covariance);
        Self { standard, w, back }
    }

    /// Number of statistics in use.
    pub fn width(&self) -> usize {
        self.standard.columns.len()
    }

    /// Whitened numbers of compressed ones.
    pub fn apply(&self, compressed: &[f64]) -> DVector<f64> {
        &self.w * DVector::from_column_slice(compressed)
    }

    /// Whitened rows of compressed rows.
    pub fn apply_rows(&self, rows: &[Vec<f64>]) -> DMatrix<f64> {
        matrix(rows, self.width()) * self.w.transpose()
    }

    /// What one unit of a compressed number does to the whitened ones.
    pub fn direction(&self, k: usize) -> DVector<f64> {
        self.w.column(k).into_owned()
    }

    /// Compressed numbers of whitened ones.
    pub fn undo(&self, z: &DVector<f64>) -> DVector<f64> {
        &self.back * z
    }

    /// The same of whitened rows, as columns.
    pub fn undo_rows(&self, rows: &DMatrix<f64>) -> DMatrix<f64> {
        &self.back * rows.transpose()
    }
}

/// Least variance of a standardised statistic: one that never varies in a null flight.
const LEAST_VARIANCE: f64 = 1e-2;

/// Compressed; unknown becomes "as in a null flight".
pub(super) fn compressed(raw: &[f64]) -> Vec<f64> {
    raw.iter().map(|x| if x.is_finite() { compress(*x) } else { 0.0 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_what_a_computer_cannot_resolve_is_no_gap_in_any_view() {
        // A number that is exact in the simulator: it varies by 1e-8 from flight to flight.
        let nulls: Vec<Vec<f64>> = (0..30).map(|i| vec![f64::from(i % 5) * 1e-8]).collect();
        let nulls: Vec<&[f64]> = nulls.iter().map(Vec::as_slice).collect();
        let none = std::iter::empty::<&[f64]>();
        let seen = |resolution: &[f64], off: f64| {
            let standard = Standard::new(&nulls, none.clone(), &[], [resolution, &[]], |_| true);
            let raw = compressed(&standard.raw(&[off]));
            Whitening::new(standard, &nulls, &[]).apply(&raw)[0]
        };
        assert!(seen(&[], 1e-5) > 8.0, "without a resolution it stands out");
        assert!(seen(&[1e-4], 1e-5).abs() < 0.2, "a tenth of the resolution is nothing");
        let ten = seen(&[1e-4], 1e-3);
        assert!((5.0..10.5).contains(&ten), "ten times is ten sigma, compressed: {ten}");
    }
}
