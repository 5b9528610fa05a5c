//! How like what an effect does a flight is, whatever the size of the effect and the law that it follows.
//!
//! ```text
//! z ~ N(0, 1 + a² E),   E = Σ d dᵀ / n + Σ x xᵀ,   log p(z) - log p(z | none) = log mean_a exp(½ Σ_k (y_k² s_k / (1 + s_k) - log(1 + s_k)))
//! ```
//! z: a flight, whitened; d: the n draws of the bank less their twins; x: what the effect does by other laws on other vehicles, as large as
//! the draws; a: how large the effect is, of the draws' mean size; y_k: z along a principal direction of E, and s_k = a² λ_k.

use nalgebra::{DMatrix, DVector};

use super::linear::directions;
use crate::normal::log_mean_exp;

/// Sizes of an effect, as likely as one another: from hardly seen to twice the mean of the draws (judgement).
const SIZES: [f64; 5] = [0.1, 0.25, 0.5, 1.0, 2.0];

/// What an effect does, as principal directions.
#[derive(Debug, Clone)]
pub(super) struct Likeness {
    /// Directions, p × r.
    along: DMatrix<f64>,
    /// By size: `½ s_k / (1 + s_k)` of every direction, and `½ Σ_k log(1 + s_k)`.
    sizes: Vec<(DVector<f64>, f64)>,
}

impl Likeness {
    /// `draws`: less their twins, whitened (n × p). `others`: what the effect does by other laws (m × p), of any size.
    pub fn new(draws: &DMatrix<f64>, others: &DMatrix<f64>) -> Self {
        let n = draws.nrows().max(1) as f64;
        let size = draws.norm_squared() / n;
        let whole = others.norm_squared().max(f64::MIN_POSITIVE);
        let mut rows = DMatrix::zeros(draws.nrows() + others.nrows(), draws.ncols());
        rows.rows_mut(0, draws.nrows()).copy_from(&(draws / n.sqrt()));
        rows.rows_mut(draws.nrows(), others.nrows()).copy_from(&(others * (size / whole).sqrt()));
        let (values, along) = directions(&rows, usize::MAX);
        let at = |a: f64| {
            let s = DVector::from_vec(values.clone()) * (a * a);
            (s.map(|s| 0.5 * s / (1.0 + s)), 0.5 * s.map(f64::ln_1p).sum())
        };
        Self { sizes: SIZES.map(at).to_vec(), along }
    }

    /// Log evidence of the effect over none.
    pub fn of(&self, z: &DVector<f64>) -> f64 {
        let squares = self.along.tr_mul(z).map(|y| y * y);
        let at = |(gain, price): &(DVector<f64>, f64)| gain.dot(&squares) - price;
        log_mean_exp(&self.sizes.iter().map(at).collect::<Vec<f64>>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_model::random::Stream;

    /// Against the dense matrix.
    #[test]
    fn val_evidence_is_that_of_the_dense_normal() {
        let mut rng = Stream::new(3, "likeness");
        let (p, n) = (8, 5);
        let draws = DMatrix::from_fn(n, p, |_, _| 3.0 * rng.normal());
        let z = DVector::from_fn(p, |_, _| 2.0 * rng.normal());
        let spread = draws.transpose() * &draws / n as f64;
        let at = |size: f64| {
            let dense = DMatrix::identity(p, p) + &spread * (size * size);
            let solved = dense.clone().try_inverse().unwrap() * &z;
            (0.5 * (z.norm_squared() - z.dot(&solved)) - 0.5 * dense.determinant().ln()).exp()
        };
        let want = (SIZES.map(at).iter().sum::<f64>() / SIZES.len() as f64).ln();
        let found = Likeness::new(&draws, &DMatrix::zeros(0, p)).of(&z);
        assert!((found - want).abs() < 1e-9, "{found} {want}");
    }

    /// By another law than the simulator's an effect does something beside its signature: that is like it, and nothing else is.
    #[test]
    fn prop_a_flight_by_another_law_is_like_its_effect_whatever_the_size() {
        let mut rng = Stream::new(7, "likeness");
        let p = 30;
        let mut along = || DVector::from_fn(p, |_, _| rng.normal()).normalize();
        let [own, law, other] = [along(), along(), along()];
        let draws = DMatrix::from_fn(20, p, |i, j| 2.0 * (i + 1) as f64 * own[j]);
        let laws = DMatrix::from_fn(3, p, |i, j| own[j] + [0.6, -0.4, 0.5][i] * law[j]);
        let (one, all) =
            (Likeness::new(&draws, &DMatrix::zeros(0, p)), Likeness::new(&draws, &laws));
        for size in [10.0, 30.0] {
            let gained = [&law, &other].map(|by| {
                let flight = (&own + by * 0.5) * size;
                all.of(&flight) - one.of(&flight)
            });
            assert!(gained[0] > 5.0 && gained[1] < 0.2 * gained[0], "{gained:?} at {size}");
        }
        assert!(all.of(&(&own * 0.5)) < 0.5, "what is hardly there is no evidence");
        let small = Likeness::new(&draws, &(&laws * 1e-3)).of(&(&own * 20.0));
        assert!((small - all.of(&(&own * 20.0))).abs() < 1e-6, "in any unit");
    }
}
