//! A fitted number with its standard error, and the interval that follows from both.

use serde::Serialize;

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
///
/// The distribution function is the regularised incomplete beta function by its continued fraction
/// (Abramowitz and Stegun 26.5.8, 26.7.1), inverted by bisection: no table to mistype.
pub fn student_quantile(dof: f64, probability: f64) -> f64 {
    if dof.is_nan() || probability.is_nan() {
        return f64::NAN;
    }
    if dof < 0.5 {
        return f64::INFINITY;
    }
    let (mut low, mut high) = (0.0, 1e3);
    for _ in 0..80 {
        let t = 0.5 * (low + high);
        let covered = 1.0 - incomplete_beta(dof / (dof + t * t), 0.5 * dof, 0.5);
        if covered < probability {
            low = t;
        } else {
            high = t;
        }
    }
    0.5 * (low + high)
}

/// Regularised incomplete beta function I_x(a, b).
fn incomplete_beta(x: f64, a: f64, b: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    if x >= 1.0 {
        return 1.0;
    }
    let front =
        (a * x.ln() + b * (1.0 - x).ln() + ln_gamma(a + b) - ln_gamma(a) - ln_gamma(b)).exp();
    if x < (a + 1.0) / (a + b + 2.0) {
        front * beta_fraction(x, a, b) / a
    } else {
        1.0 - front * beta_fraction(1.0 - x, b, a) / b
    }
}

/// The continued fraction, by Lentz's method.
fn beta_fraction(x: f64, a: f64, b: f64) -> f64 {
    const TINY: f64 = 1e-300;
    let away = |v: f64| if v.abs() < TINY { TINY } else { v };
    let mut c = 1.0;
    let mut d = away(1.0 - (a + b) * x / (a + 1.0)).recip();
    let mut h = d;
    for m in 1..400 {
        let m = f64::from(m);
        for step in [
            m * (b - m) * x / ((a + 2.0 * m - 1.0) * (a + 2.0 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2.0 * m) * (a + 2.0 * m + 1.0)),
        ] {
            d = away(1.0 + step * d).recip();
            c = away(1.0 + step / c);
            h *= c * d;
        }
        if (c * d - 1.0).abs() < 1e-13 {
            break;
        }
    }
    h
}

/// Logarithm of the gamma function, Lanczos with g = 7 and nine terms.
fn ln_gamma(x: f64) -> f64 {
    const G: f64 = 7.0;
    const C: [f64; 9] = [
        0.999_999_999_999_809_9,
        676.520_368_121_885_1,
        -1_259.139_216_722_402_8,
        771.323_428_777_653_1,
        -176.615_029_162_140_6,
        12.507_343_278_686_905,
        -0.138_571_095_265_720_12,
        9.984_369_578_019_572e-6,
        1.505_632_735_149_311_6e-7,
    ];
    let x = x - 1.0;
    let t = x + G + 0.5;
    let sum = C.iter().zip(0..).skip(1).fold(C[0], |sum, (c, i)| sum + c / (x + f64::from(i)));
    0.5 * (2.0 * std::f64::consts::PI).ln() + (x + 0.5) * t.ln() - t + sum.ln()
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
