//! A fitted number with its standard error, and the interval that follows from both.

use serde::Serialize;
use statrs::distribution::{ContinuousCDF, StudentsT};

/// A parameter of a fit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Value {
    /// The parameter, unit as named where it stands.
    pub value: f64,
    /// Its standard error, same unit.
    pub std: f64,
    /// Degrees of freedom with which the standard error itself is known: an interval takes
    /// Student's quantile for it.
    pub dof: f64,
}

impl Value {
    /// Half the width of the interval that covers the truth with this probability (0 to 1).
    pub fn half_width(&self, probability: f64) -> f64 {
        self.std * student_quantile(self.dof, probability)
    }

    /// The interval that covers the truth with this probability.
    pub fn interval(&self, probability: f64) -> [f64; 2] {
        let half = self.half_width(probability);
        [self.value - half, self.value + half]
    }

    /// Another unit: value and error times a factor.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { value: self.value * factor, std: self.std * factor.abs(), dof: self.dof }
    }
}

/// The t with `P(|T| < t) = probability` for this many degrees of freedom; infinite for less than
/// one half of a degree, NaN for NaN.
pub fn student_quantile(dof: f64, probability: f64) -> f64 {
    if dof.is_nan() || probability.is_nan() {
        return f64::NAN;
    }
    if dof < 0.5 {
        return f64::INFINITY;
    }
    StudentsT::new(0.0, 1.0, dof).map_or(f64::NAN, |t| t.inverse_cdf(0.5 + 0.5 * probability))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_quantiles_of_student() {
        // Tables: two-sided 95 % for 1, 3, 10, 30 and many degrees of freedom; 68.27 % is 1 sigma.
        for (dof, t) in [(1.0, 12.706), (3.0, 3.182), (10.0, 2.228), (30.0, 2.042), (1e6, 1.960)] {
            assert!((student_quantile(dof, 0.95) / t - 1.0).abs() < 1e-3, "{dof}");
        }
        assert!((student_quantile(1e6, 0.6827) - 1.0).abs() < 1e-3);
        assert!((student_quantile(2.0, 0.6827) - 1.321).abs() < 2e-3);
        assert!(student_quantile(f64::NAN, 0.9).is_nan());
        assert_eq!(student_quantile(0.0, 0.9), f64::INFINITY);
    }
}
