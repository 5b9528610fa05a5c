//! Variance of a TDOA: height factor λ and the worth of correlated samples.
//!
//! `λ(z) = 0.5` for z ≥ 1 m, `1.5 − z` between 0.5 and 1 m, 1 below; z is the estimated height,
//! m (the source, IMAV 2021). Near the floor multipath is strongest.

use super::config::UwbNoise;

/// Height from which the full benefit holds, m (source).
const HIGH_M: f64 = 1.0;
/// Height below which there is none, m (source).
const LOW_M: f64 = 0.5;

/// λ at a height above the origin's level, m.
#[inline]
pub fn height_factor(noise: UwbNoise, height_m: f64) -> f64 {
    match noise {
        UwbNoise::Constant => 1.0,
        UwbNoise::HeightDependent => 1.5 - height_m.clamp(LOW_M, HIGH_M),
    }
}

/// How many samples of a correlated error are worth one white sample.
///
/// An error with correlation `exp(−|t|/τ)` sampled every Δ informs about its mean like white noise
/// of `coth(Δ/2τ)` times the variance. `√(1 + (2τ/Δ)²)` is that within 9 %, without `exp`.
#[inline]
pub fn correlation_factor(correlation_s: f64, interval_s: f64) -> f64 {
    let ratio = 2.0 * correlation_s / interval_s.max(1e-4);
    (1.0 + ratio * ratio).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_lambda_of_the_source() {
        for (height_m, lambda) in [(-1.0, 1.0), (0.5, 1.0), (0.75, 0.75), (1.0, 0.5), (9.0, 0.5)] {
            assert_eq!(height_factor(UwbNoise::HeightDependent, height_m), lambda);
            assert_eq!(height_factor(UwbNoise::Constant, height_m), 1.0);
        }
    }

    #[test]
    fn val_correlation_factor_is_near_the_hyperbolic_cotangent() {
        assert_eq!(correlation_factor(0.0, 0.01), 1.0);
        for i in 1..100 {
            let half = 0.05 * f64::from(i);
            let exact = 1.0 / half.tanh();
            let ours = correlation_factor(1.0, 2.0 * half);
            assert!((ours / exact - 1.0).abs() < 0.09, "{half}: {ours} {exact}");
        }
    }
}
