//! Small dense least squares: what the fits share.

use nalgebra::{DMatrix, DVector};

/// Rows of regressors, all of one length, and what they are fitted to.
#[derive(Debug, Clone, PartialEq)]
pub struct Rows {
    /// Number of regressors.
    pub width: usize,
    /// Row after row.
    pub flat: Vec<f64>,
}

impl Rows {
    /// From a function of the row.
    pub fn from_fn(rows: usize, width: usize, mut row: impl FnMut(usize, &mut [f64])) -> Self {
        let mut flat = vec![0.0; rows * width];
        for (i, slot) in flat.chunks_exact_mut(width.max(1)).enumerate() {
            row(i, slot);
        }
        Self { width, flat }
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.flat.len().checked_div(self.width).unwrap_or(0)
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.flat.is_empty()
    }

    /// Row after row.
    pub fn iter(&self) -> impl Iterator<Item = &[f64]> {
        self.flat.chunks_exact(self.width.max(1))
    }

    /// Products with coefficients.
    pub fn times(&self, beta: &[f64]) -> Vec<f64> {
        self.iter().map(|row| row.iter().zip(beta).map(|(x, b)| x * b).sum()).collect()
    }

    /// XᵀWX with weights (1 without).
    pub fn normal(&self, weights: Option<&[f64]>) -> DMatrix<f64> {
        let mut normal = DMatrix::zeros(self.width, self.width);
        for (i, row) in self.iter().enumerate() {
            let w = weights.and_then(|w| w.get(i)).copied().unwrap_or(1.0);
            for (a, x) in row.iter().enumerate() {
                for (b, y) in row.iter().enumerate().take(a + 1) {
                    normal[(a, b)] += w * x * y;
                }
            }
        }
        normal.fill_upper_triangle_with_lower_triangle();
        normal
    }
}

/// Least squares of `y` on the rows, with weights (1 without). `None`: the rows do not determine
/// all coefficients, or a value is no number.
pub fn solve(rows: &Rows, y: &[f64], weights: Option<&[f64]>) -> Option<Vec<f64>> {
    let mut right = DVector::zeros(rows.width);
    for (i, (row, y)) in rows.iter().zip(y).enumerate() {
        let w = weights.and_then(|w| w.get(i)).copied().unwrap_or(1.0);
        for (a, x) in row.iter().enumerate() {
            right[a] += w * x * y;
        }
    }
    let beta = inverse(&rows.normal(weights))? * right;
    beta.iter().all(|b| b.is_finite()).then(|| beta.iter().copied().collect())
}

/// Inverse of a symmetric positive matrix, scaled first so that units do not matter.
pub fn inverse(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale: Vec<f64> = a.diagonal().iter().map(|d| d.sqrt()).collect();
    if scale.iter().any(|s| s.is_nan() || *s <= 0.0 || s.is_infinite()) {
        return None;
    }
    let n = scale.len();
    let scaled = DMatrix::from_fn(n, n, |i, j| a[(i, j)] / (scale[i] * scale[j]));
    let factor = scaled.cholesky()?;
    // A correlation so near to one says that two regressors are one.
    if factor.l_dirty().diagonal().iter().any(|d| *d < LEAST_PIVOT) {
        return None;
    }
    let inverse = factor.inverse();
    Some(DMatrix::from_fn(n, n, |i, j| inverse[(i, j)] / (scale[i] * scale[j])))
}

/// Least pivot of the scaled matrix: regressors that agree in all but a millionth are one.
const LEAST_PIVOT: f64 = 1e-6;

/// Share of the variance that a fit explains.
pub fn r_squared(y: &[f64], residual: &[f64]) -> f64 {
    let mean = y.iter().sum::<f64>() / y.len().max(1) as f64;
    let total: f64 = y.iter().map(|v| (v - mean).powi(2)).sum();
    1.0 - residual.iter().map(|r| r * r).sum::<f64>() / total
}
