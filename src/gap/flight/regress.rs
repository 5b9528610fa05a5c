//! Least squares with a prior, and the moments of what is left.

/// Largest number of regressors.
const MOST: usize = 24;

/// A linear regression under accumulation: `y = Σ β_i x_i + ε`, prior `β_i ~ N(0, σ_i²)`.
#[derive(Debug, Clone)]
pub struct Ridge {
    n: usize,
    normal: Vec<f64>,
    right: Vec<f64>,
}

impl Ridge {
    /// With these prior standard deviations, in units of the coefficient, and this noise of a row
    /// in units of y; a correlated noise counts with `std · √(correlated rows)`.
    pub fn new(prior_std: &[f64], noise_std: f64) -> Self {
        let n = prior_std.len().min(MOST);
        let mut normal = vec![0.0; n * n];
        for i in 0..n {
            normal[i * n + i] = (noise_std / prior_std[i]).powi(2);
        }
        Self { n, normal, right: vec![0.0; n] }
    }

    /// One row.
    #[inline]
    pub fn row(&mut self, x: &[f64], y: f64) {
        if !y.is_finite() {
            return;
        }
        for i in 0..self.n {
            let xi = x[i];
            if xi == 0.0 {
                continue;
            }
            self.right[i] += xi * y;
            let lower = &mut self.normal[i * self.n..=i * self.n + i];
            for (sum, xj) in lower.iter_mut().zip(x) {
                *sum += xi * xj;
            }
        }
    }

    /// The coefficients; NaN when the matrix is not positive.
    pub fn solve(&self) -> Vec<f64> {
        cholesky_solve(self.n, &self.normal, &self.right).unwrap_or_else(|| vec![f64::NAN; self.n])
    }
}

/// Solves `A x = b`, A symmetric positive, lower triangle given row by row.
pub fn cholesky_solve(n: usize, a: &[f64], b: &[f64]) -> Option<Vec<f64>> {
    let mut l = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let mut sum = a[i * n + j];
            for k in 0..j {
                sum -= l[i * n + k] * l[j * n + k];
            }
            if i == j {
                if sum.is_nan() || sum <= 0.0 {
                    return None;
                }
                l[i * n + i] = sum.sqrt();
            } else {
                l[i * n + j] = sum / l[j * n + j];
            }
        }
    }
    let mut x = b.to_vec();
    for i in 0..n {
        for k in 0..i {
            x[i] -= l[i * n + k] * x[k];
        }
        x[i] /= l[i * n + i];
    }
    for i in (0..n).rev() {
        for k in i + 1..n {
            x[i] -= l[k * n + i] * x[k];
        }
        x[i] /= l[i * n + i];
    }
    Some(x)
}

/// Moments of a series.
#[derive(Debug, Clone, Copy)]
pub struct Moments {
    /// Number of finite values.
    pub count: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub std: f64,
    /// Skewness.
    pub skew: f64,
    /// Kurtosis minus three.
    pub excess: f64,
    /// Largest distance from the mean.
    pub most: f64,
}

/// Moments of the finite values; NaN when there are fewer than eight.
pub fn moments(values: impl Iterator<Item = f64> + Clone) -> Moments {
    let (mut count, mut sum) = (0usize, 0.0);
    for v in values.clone().filter(|v| v.is_finite()) {
        count += 1;
        sum += v;
    }
    if count < 8 {
        let nan = f64::NAN;
        return Moments { count, mean: nan, std: nan, skew: nan, excess: nan, most: nan };
    }
    let n = count as f64;
    let mean = sum / n;
    let (mut m2, mut m3, mut m4, mut most) = (0.0, 0.0, 0.0, 0.0f64);
    for v in values.filter(|v| v.is_finite()) {
        let d = v - mean;
        (m2, m3, m4) = (m2 + d * d, m3 + d * d * d, m4 + d * d * d * d);
        most = most.max(d.abs());
    }
    let var = (m2 / n).max(1e-30);
    Moments {
        count,
        mean,
        std: var.sqrt(),
        skew: m3 / n / var.powf(1.5),
        excess: m4 / n / (var * var) - 3.0,
        most,
    }
}

/// Autocorrelation at a lag, of values that are finite at both ends.
pub fn autocorrelation(values: &[f64], lag: usize) -> f64 {
    let m = moments(values.iter().copied());
    if !m.mean.is_finite() || values.len() <= lag {
        return f64::NAN;
    }
    let (mut sum, mut count) = (0.0, 0usize);
    for (a, b) in values.iter().zip(&values[lag..]) {
        let product = (a - m.mean) * (b - m.mean);
        if product.is_finite() {
            sum += product;
            count += 1;
        }
    }
    if count < 8 { f64::NAN } else { sum / count as f64 / (m.std * m.std) }
}

/// Natural logarithm that stays finite at zero.
pub fn log(x: f64) -> f64 {
    x.max(1e-9).ln()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_ridge_finds_a_line_and_shrinks_the_unseen() {
        let mut fit = Ridge::new(&[10.0, 10.0, 1.0], 0.1);
        for i in 0..100 {
            let x = f64::from(i) * 0.01;
            fit.row(&[1.0, x, 0.0], 2.0 - 3.0 * x);
        }
        let b = fit.solve();
        assert!((b[0] - 2.0).abs() < 1e-3 && (b[1] + 3.0).abs() < 1e-3 && b[2] == 0.0, "{b:?}");
    }

    #[test]
    fn prop_moments_of_a_known_series() {
        let m = moments((0..1000).map(|i| if i % 2 == 0 { 1.0 } else { -1.0 }));
        assert!(
            m.mean.abs() < 1e-12 && (m.std - 1.0).abs() < 1e-12 && (m.excess + 2.0).abs() < 1e-9
        );
        let series: Vec<f64> = (0..1000).map(|i| f64::from(i % 2)).collect();
        assert!((autocorrelation(&series, 2) - 1.0).abs() < 1e-9);
        assert!(autocorrelation(&series, 1) < -0.99);
        assert!(moments([1.0, f64::NAN].into_iter()).mean.is_nan());
    }
}
