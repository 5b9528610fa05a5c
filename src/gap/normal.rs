//! The normal distribution and Student's.

/// Φ(z), Abramowitz & Stegun 26.2.17, error below 7.5e-8.
pub(super) fn share(z: f64) -> f64 {
    let t = 1.0 / (1.0 + 0.231_641_9 * z.abs());
    let poly = t
        * (0.319_381_530
            + t * (-0.356_563_782
                + t * (1.781_477_937 + t * (-1.821_255_978 + t * 1.330_274_429))));
    let tail = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt() * poly;
    if z >= 0.0 { 1.0 - tail } else { tail }
}

/// Φ⁻¹(p) by bisection.
pub(super) fn quantile(p: f64) -> f64 {
    let (mut low, mut high) = (-8.0, 8.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if share(middle) < p {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Quantile of Student's t by its expansion about the normal one, Abramowitz & Stegun 26.7.5: right to 0.01 from four
/// degrees of freedom on, for `p` up to 0.995.
pub(super) fn student_quantile(p: f64, freedom: f64) -> f64 {
    let z = quantile(p);
    let n = freedom.max(1.0);
    let odd = |terms: [f64; 5]| {
        let even = terms.iter().rev().fold(0.0, |sum, c| sum * z * z + c);
        z * even
    };
    z + odd([1.0, 1.0, 0.0, 0.0, 0.0]) / (4.0 * n)
        + odd([3.0, 16.0, 5.0, 0.0, 0.0]) / (96.0 * n.powi(2))
        + odd([-15.0, 17.0, 19.0, 3.0, 0.0]) / (384.0 * n.powi(3))
        + odd([-945.0, -1920.0, 1482.0, 776.0, 79.0]) / (92_160.0 * n.powi(4))
}

/// Sigma above the mean of `count` values below which the next one lies with probability `p`:
/// `t √(1 + 1/n)`, a prediction limit of a normal variable.
pub(super) fn prediction_factor(p: f64, count: usize) -> f64 {
    let n = count.max(2) as f64;
    student_quantile(p, n - 1.0) * (1.0 + 1.0 / n).sqrt()
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
