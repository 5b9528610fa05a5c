//! Linear algebra that every part of the attribution shares: shrunk covariance, triangular
//! whitening, low rank by the Gram matrix.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Rows to a matrix. Rows of another length than `columns` are cut or filled with 0.
pub(super) fn matrix(rows: &[Vec<f64>], columns: usize) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), columns, |i, j| rows[i].get(j).copied().unwrap_or(0.0))
}

/// Covariance about zero of centred rows, shrunk towards its own diagonal with the weight that
/// minimises the expected squared error (Schäfer & Strimmer 2005, target D; the diagonal form of
/// Ledoit & Wolf 2004). Returns covariance and weight.
pub(super) fn shrunk_covariance(rows: &DMatrix<f64>) -> (DMatrix<f64>, f64) {
    let (n, p) = rows.shape();
    let count = n.max(1) as f64;
    let mean = rows.row_mean();
    let mut centred = rows.clone();
    for mut row in centred.row_iter_mut() {
        row -= &mean;
    }
    let unbiased = count / (count - 1.0).max(1.0);
    // Products of a transpose: `tr_mul` takes dot products, which is several times slower for large matrices.
    let covariance = centred.transpose() * &centred * (unbiased / count);
    // Variance of every product moment, from the scatter of the products over the rows.
    let squared = centred.map(|v| v * v);
    let fourth = squared.transpose() * &squared;
    let (mut noise, mut signal) = (0.0, 0.0);
    for j in 0..p {
        for i in 0..j {
            let product = covariance[(i, j)] / unbiased;
            noise += (fourth[(i, j)] / count - product * product).max(0.0) / (count - 1.0).max(1.0);
            signal += covariance[(i, j)].powi(2);
        }
    }
    let weight = if signal > 0.0 { (noise / signal).clamp(0.0, 1.0) } else { 1.0 };
    let mut shrunk = covariance * (1.0 - weight);
    for j in 0..p {
        shrunk[(j, j)] /= (1.0 - weight).max(f64::MIN_POSITIVE);
    }
    if weight >= 1.0 {
        let variance = centred.row_variance() * unbiased;
        shrunk = DMatrix::from_diagonal(&variance.transpose());
    }
    (shrunk, weight)
}

/// Inverse of the lower Cholesky factor, `W Σ Wᵀ = 1`, and the factor. Adds to the diagonal until it exists.
pub(super) fn whitener(covariance: &DMatrix<f64>) -> [DMatrix<f64>; 2] {
    let p = covariance.nrows();
    let scale = (covariance.trace() / p.max(1) as f64).max(f64::MIN_POSITIVE);
    let mut ridge = LEAST_RIDGE;
    loop {
        let mut padded = covariance.clone();
        for j in 0..p {
            padded[(j, j)] += ridge * scale;
        }
        let factor = padded.cholesky().map(|c| c.l());
        let inverse = factor.and_then(|l| Some([inverse_of_lower(&l)?, l]));
        match inverse {
            Some([w, l]) if w.iter().all(|v| v.is_finite()) => return [w, l],
            // A matrix that no ridge repairs holds numbers that are not finite.
            _ if ridge > 1.0 => return [(); 2].map(|()| DMatrix::identity(p, p)),
            _ => ridge *= 10.0,
        }
    }
}

fn inverse_of_lower(l: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    l.solve_lower_triangular(&DMatrix::identity(l.nrows(), l.nrows()))
}

/// Relative to the mean variance; far below any shrinkage.
const LEAST_RIDGE: f64 = 1e-9;

/// Directions of the rows of `rows` (n × p) by the n × n Gram matrix: eigenvalues of `rowsᵀ rows`
/// in falling order, and the directions as columns.
pub(super) fn directions(rows: &DMatrix<f64>, most: usize) -> (Vec<f64>, DMatrix<f64>) {
    let gram = rows * rows.transpose();
    let eigen = SymmetricEigen::new(gram);
    let mut order: Vec<usize> = (0..eigen.eigenvalues.len()).collect();
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let total: f64 = eigen.eigenvalues.iter().map(|v| v.max(0.0)).sum();
    order.retain(|k| eigen.eigenvalues[*k] > 1e-12 * total.max(f64::MIN_POSITIVE));
    order.truncate(most);
    let values: Vec<f64> = order.iter().map(|k| eigen.eigenvalues[*k]).collect();
    let mut basis = DMatrix::zeros(rows.ncols(), order.len());
    for (to, (k, value)) in order.iter().zip(&values).enumerate() {
        let direction = rows.tr_mul(&eigen.eigenvectors.column(*k)) / value.sqrt();
        basis.set_column(to, &direction);
    }
    (values, basis)
}

/// The columns of both.
pub(super) fn joined(a: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let n = a.ncols();
    DMatrix::from_fn(a.nrows(), n + b.ncols(), |i, j| if j < n { a[(i, j)] } else { b[(i, j - n)] })
}

/// `(1 + diag(d) + U Uᵀ)`: noise of an effect's flights in whitened statistics, prepared for solving.
#[derive(Debug, Clone)]
pub(super) struct Noise {
    /// One over `1 + d`.
    inverse: DVector<f64>,
    /// `D⁻¹ U K⁻ᵀ` with `K Kᵀ = 1 + Uᵀ D⁻¹ U`: the inverse is `D⁻¹ - V Vᵀ`.
    v: DMatrix<f64>,
    /// Logarithm of the determinant.
    pub log_det: f64,
}

impl Noise {
    /// `d`: variance beyond one per statistic; `u`: columns of low rank.
    pub fn new(d: &DVector<f64>, u: &DMatrix<f64>) -> Self {
        let inverse = d.map(|v| 1.0 / (1.0 + v.max(0.0)));
        let mut log_det = -inverse.iter().map(|v| v.ln()).sum::<f64>();
        let mut scaled = u.clone();
        for mut column in scaled.column_iter_mut() {
            column.component_mul_assign(&inverse);
        }
        let core = DMatrix::identity(u.ncols(), u.ncols()) + u.transpose() * &scaled;
        let v = match core.cholesky() {
            Some(chol) => {
                log_det += 2.0 * chol.l().diagonal().iter().map(|v| v.ln()).sum::<f64>();
                let inverse = inverse_of_lower(&chol.l());
                inverse.map_or_else(|| DMatrix::zeros(d.len(), 0), |w| scaled * w.transpose())
            }
            None => DMatrix::zeros(d.len(), 0),
        };
        Self { inverse, v, log_det }
    }

    /// The inverse times columns.
    pub fn solve(&self, z: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(z.nrows(), z.ncols(), |i, j| z[(i, j)] * self.inverse[i])
            - &self.v * (self.v.transpose() * z)
    }

    /// Largest entry, in sigma of the diagonal part.
    pub fn peak(&self, z: &DVector<f64>) -> f64 {
        let sized = z.iter().zip(self.inverse.iter()).map(|(a, w)| a.abs() * w.sqrt());
        sized.fold(0.0, f64::max)
    }

    /// `zᵀ N⁻¹ z`.
    pub fn squared(&self, z: &DVector<f64>) -> f64 {
        let plain: f64 = z.iter().zip(self.inverse.iter()).map(|(a, w)| a * a * w).sum();
        plain - self.v.tr_mul(z).norm_squared()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_model::random::Stream;

    #[test]
    fn prop_low_rank_noise_solves_like_the_dense_matrix() {
        let mut rng = Stream::new(1, "linear");
        let d = DVector::from_fn(7, |_, _| rng.uniform() * 3.0);
        let u = DMatrix::from_fn(7, 2, |_, _| rng.normal());
        let z = DVector::from_fn(7, |_, _| rng.normal());
        let dense = DMatrix::identity(7, 7) + DMatrix::from_diagonal(&d) + &u * u.transpose();
        let noise = Noise::new(&d, &u);
        let solved = dense.clone().try_inverse().unwrap() * &z;
        let columns = DMatrix::from_columns(std::slice::from_ref(&z));
        assert!((noise.solve(&columns).column(0) - &solved).norm() < 1e-9);
        assert!((noise.squared(&z) - z.dot(&solved)).abs() < 1e-9);
        assert!((noise.log_det - dense.determinant().ln()).abs() < 1e-9);
    }

    #[test]
    fn prop_shrinkage_falls_with_flights_and_whitening_whitens() {
        let mut rng = Stream::new(2, "linear");
        let mix = DMatrix::from_fn(20, 20, |i, j| match i.cmp(&j) {
            std::cmp::Ordering::Equal => 1.0,
            std::cmp::Ordering::Greater => 0.3 * rng.normal(),
            std::cmp::Ordering::Less => 0.0,
        });
        let mut sample = |n: usize| DMatrix::from_fn(n, 20, |_, _| rng.normal()) * mix.transpose();
        let (few, many) = (sample(15), sample(4000));
        let ((_, w_few), (cov, w_many)) = (shrunk_covariance(&few), shrunk_covariance(&many));
        assert!(w_few > 0.05 && w_many < 0.02 && w_many < w_few, "{w_few} {w_many}");
        let [w, _] = whitener(&cov);
        let fresh = sample(4000) * w.transpose();
        let (white, _) = shrunk_covariance(&fresh);
        assert!((white - DMatrix::identity(20, 20)).amax() < 0.15);
    }
}
