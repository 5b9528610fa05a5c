//! Quantiles: of the normal distribution, of Student's, of what was seen.

use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// Φ(z).
pub(super) fn share(z: f64) -> f64 {
    Normal::standard().cdf(z)
}

/// Φ⁻¹(p).
pub(super) fn quantile(p: f64) -> f64 {
    Normal::standard().inverse_cdf(p)
}

/// Quantile of Student's t; of at least one degree of freedom.
pub(super) fn student_quantile(p: f64, freedom: f64) -> f64 {
    StudentsT::new(0.0, 1.0, freedom.max(1.0)).map_or(f64::NAN, |t| t.inverse_cdf(p))
}

/// Sigma above the mean of `count` values below which the next one lies with probability `p`:
/// `t √(1 + 1/n)`, a prediction limit of a normal variable.
pub(super) fn prediction_factor(p: f64, count: usize) -> f64 {
    let n = count.max(2) as f64;
    student_quantile(p, n - 1.0) * (1.0 + 1.0 / n).sqrt()
}

/// Logarithm of the mean of numbers whose logarithms these are.
pub(super) fn log_mean_exp(logs: &[f64]) -> f64 {
    let most = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mean = logs.iter().map(|v| (v - most).exp()).sum::<f64>() / logs.len() as f64;
    if most.is_finite() { most + mean.ln() } else { most }
}

/// The middle value, the mean of both where there are two; NaN where there is none.
pub(super) fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    match values.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => values[middle],
        _ => 0.5 * (values[middle - 1] + values[middle]),
    }
}

/// Empirical quantile, on the safe side (the next larger value); infinite without values.
pub(super) fn empirical_quantile(values: impl Iterator<Item = f64>, share: f64) -> f64 {
    let mut sorted: Vec<f64> = values.filter(|v| !v.is_nan()).collect();
    sorted.sort_by(f64::total_cmp);
    let rank = ((sorted.len() as f64 + 1.0) * share).ceil() as usize;
    sorted.get(rank.saturating_sub(1)).or(sorted.last()).copied().unwrap_or(f64::INFINITY)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables of Abramowitz & Stegun, 26.1 and 26.10.
    #[test]
    fn val_shares_and_quantiles_of_tables() {
        assert!((share(1.0) - 0.841_344_746).abs() < 1e-7);
        assert!((quantile(0.975) - 1.959_963_985).abs() < 1e-5);
        for (p, freedom, want) in [
            (0.95, 4.0, 2.132),
            (0.99, 4.0, 3.747),
            (0.975, 10.0, 2.228),
            (0.995, 10.0, 3.169),
            (0.99, 30.0, 2.457),
            (0.995, 60.0, 2.660),
        ] {
            let found = student_quantile(p, freedom);
            assert!((found - want).abs() < 0.012, "{p} {freedom}: {found}, table {want}");
        }
    }

    #[test]
    fn prop_a_prediction_limit_is_exceeded_as_often_as_it_says() {
        let mut rng = haltere_model::random::Stream::new(4, "prediction");
        let (mut above, mut trials) = (0.0, 0.0);
        for _ in 0..20_000 {
            let few: Vec<f64> = (0..9).map(|_| rng.normal()).collect();
            let mean = few.iter().sum::<f64>() / 9.0;
            let sigma = (few.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 8.0).sqrt();
            above += f64::from(rng.normal() > mean + prediction_factor(0.98, 9) * sigma);
            trials += 1.0;
        }
        // 400 expected, its sigma is 20.
        assert!((above / trials - 0.02_f64).abs() < 0.004, "{above} of {trials}");
    }
}
