//! From statistics with units to whitened numbers: robust centre and scale per statistic, a
//! compression of extreme values, and the covariance of null flights (seeds and benign jitter).
//!
//! `x = (s - c - shift) / w`, `u = k asinh(x / k)`, `z = W u`. Compressed, an effect a thousand
//! sigma large weighs some forty; a 10 % error of its size stays below one sigma and cannot outvote
//! all other statistics. `c`, `w`: median and robust sigma of the null flights.

use nalgebra::{DMatrix, DVector};

use super::linear::{matrix, shrunk_covariance, whitener};

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
/// Weight, in flights, of "references scatter as the bank says" against their own scatter.
const SCATTER_PRIOR: f64 = 10.0;

/// `k asinh(x/k)`.
pub(super) fn compress(x: f64) -> f64 {
    KNEE * (x / KNEE).asinh()
}

/// Inverse of [`compress`].
pub(super) fn expand(u: f64) -> f64 {
    KNEE * (u / KNEE).sinh().clamp(-LARGEST, LARGEST)
}

/// Centre and scale of the statistics in use.
#[derive(Debug, Clone)]
pub(super) struct Standard {
    /// Places of the statistics in use.
    pub columns: Vec<usize>,
    centre: Vec<f64>,
    scale: Vec<f64>,
    /// What reference flights move the centre by.
    shift: Vec<f64>,
}

impl Standard {
    /// From null flights; `effects` only give a scale to statistics that never vary in a null
    /// flight. `allowed`: which statistics may be used.
    pub fn new<'a>(
        nulls: &[&'a [f64]],
        effects: impl Iterator<Item = &'a [f64]> + Clone,
        allowed: impl Fn(usize) -> bool,
    ) -> Self {
        let width = nulls.first().map_or(0, |r| r.len());
        let mut standard = Self { columns: vec![], centre: vec![], scale: vec![], shift: vec![] };
        for j in (0..width).filter(|j| allowed(*j)) {
            let mut known: Vec<f64> =
                nulls.iter().map(|r| r[j]).filter(|v| v.is_finite()).collect();
            let unknown = nulls.len() - known.len();
            if known.is_empty() || unknown as f64 > MOST_UNKNOWN * nulls.len() as f64 {
                continue;
            }
            let centre = median(&mut known);
            let mut scale = spread(&known, centre);
            if scale <= f64::EPSILON * centre.abs() {
                let away: Vec<f64> =
                    effects.clone().map(|r| r[j]).filter(|v| v.is_finite()).collect();
                // Never moved in a null flight: an effect that moves it counts as some sigma.
                scale = spread(&away, centre) / KNEE;
            }
            if scale.is_finite() && scale > f64::EPSILON * centre.abs() && scale > f64::MIN_POSITIVE
            {
                standard.columns.push(j);
                standard.centre.push(centre);
                standard.scale.push(scale);
                standard.shift.push(0.0);
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

    /// Sigma of a null flight, in units of the statistic.
    pub fn scale(&self, k: usize) -> f64 {
        self.scale[k]
    }

    /// Centred on the bank again.
    pub fn without_shift(mut self) -> Self {
        self.shift.fill(0.0);
        self
    }

    /// Moves the centre to the mean of reference flights; returns the factor on the sigma of every
    /// statistic by which their scatter exceeds that of the bank, and by which the mean is unsure.
    fn refer(&mut self, references: &[&[f64]]) -> Vec<f64> {
        let rows: Vec<Vec<f64>> = references.iter().map(|r| self.raw(r)).collect();
        let mut factors = vec![1.0; self.columns.len()];
        for (k, factor) in factors.iter_mut().enumerate() {
            let mut known: Vec<f64> = rows.iter().map(|r| r[k]).filter(|v| v.is_finite()).collect();
            let n = known.len() as f64;
            if known.is_empty() {
                continue;
            }
            let middle = median(&mut known);
            // Mean without what lies beyond three sigma of the middle.
            let width = 3.0 * spread(&known, middle).max(1.0);
            let kept: Vec<f64> =
                known.iter().copied().filter(|v| (v - middle).abs() <= width).collect();
            let mean = kept.iter().sum::<f64>() / kept.len().max(1) as f64;
            let variance =
                kept.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
            self.shift[k] += mean * self.scale[k];
            let pooled = (n * variance + SCATTER_PRIOR) / (n + SCATTER_PRIOR);
            *factor = (pooled.max(1.0) * (1.0 + 1.0 / n)).sqrt();
        }
        factors
    }
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    match n {
        0 => f64::NAN,
        _ if n % 2 == 1 => values[n / 2],
        _ => 0.5 * (values[n / 2 - 1] + values[n / 2]),
    }
}

/// Robust sigma about `centre`; the plain one for variables that are mostly constant.
fn spread(values: &[f64], centre: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let mut off: Vec<f64> = values.iter().map(|v| (v - centre).abs()).collect();
    let plain = (off.iter().map(|v| v * v).sum::<f64>() / off.len() as f64).sqrt();
    let robust = SIGMA_PER_MAD * median(&mut off);
    if robust >= LEAST_ROBUST_SHARE * plain { robust } else { plain }
}

/// Compressed and whitened statistics.
#[derive(Debug, Clone)]
pub(super) struct Whitening {
    /// Centre and scale.
    pub standard: Standard,
    w: DMatrix<f64>,
}

impl Whitening {
    /// `nulls`: rows that give the covariance (jitter, which contains the noise of seeds).
    pub fn new(mut standard: Standard, nulls: &[&[f64]], references: &[&[f64]]) -> Self {
        let rows: Vec<Vec<f64>> = nulls.iter().map(|r| compressed(&standard.raw(r))).collect();
        let (mut covariance, _) = shrunk_covariance(&matrix(&rows, standard.columns.len()));
        for k in 0..covariance.nrows() {
            covariance[(k, k)] = covariance[(k, k)].max(LEAST_VARIANCE);
        }
        if !references.is_empty() {
            let factors = standard.refer(references);
            for i in 0..covariance.nrows() {
                for j in 0..covariance.ncols() {
                    covariance[(i, j)] *= factors[i] * factors[j];
                }
            }
        }
        Self { w: whitener(&covariance), standard }
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

    /// Compressed numbers of whitened ones.
    pub fn undo(&self, z: &DVector<f64>) -> DVector<f64> {
        self.w.solve_lower_triangular(z).unwrap_or_else(|| z.clone())
    }
}

/// Least variance of a standardised statistic: one that never varies in a null flight.
const LEAST_VARIANCE: f64 = 1e-2;

/// Compressed; unknown becomes "as in a null flight".
pub(super) fn compressed(raw: &[f64]) -> Vec<f64> {
    raw.iter().map(|x| if x.is_finite() { compress(*x) } else { 0.0 }).collect()
}
