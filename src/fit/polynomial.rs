//! A command over battery voltage: polynomials of order 1 to 3, and the power law of physics.
//!
//! **Equations.** `y = c0 + c1·x + c2·x² + c3·x³` with `x = V − centre`, as the configuration takes
//! it, and `y = y_centre·(V/centre)^n`. A motor of a wing that turns at a speed proportional to the
//! voltage times the command carries the same weight at the same product: n = −1. Recorded hovers of
//! this vehicle show −1.01.
//!
//! **Method.** Least squares in y; the power law in logarithms. Standard errors as in
//! [`super::correlated`]: thrust follows the loops over seconds, so a minute of hover is no six
//! thousand samples. **Symbols.** V battery, V; y thrust command, share of full throttle, or the
//! product of anything with it.

use serde::Serialize;

use super::correlated::covariance;
use super::linear::{Rows, r_squared, solve};
use super::value::Value;

/// Fewest samples.
const LEAST_SAMPLES: usize = 20;

/// A polynomial that was fitted.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Polynomial {
    /// Order, 1 to 3.
    pub order: usize,
    /// Voltage that is taken off, V.
    pub centre_v: f64,
    /// Coefficients of (V − centre) to the power 0, 1, …
    pub coefficients: Vec<Value>,
    /// Share of the variance that is explained.
    pub r_squared: f64,
    /// Rms of what is left.
    pub residual: f64,
}

/// The power law.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PowerLaw {
    /// Exponent n.
    pub exponent: Value,
    /// Voltage at which the next is meant, V.
    pub centre_v: f64,
    /// y at that voltage.
    pub at_centre: Value,
    /// Share of the variance of y that is explained.
    pub r_squared: f64,
    /// Rms of what is left in y.
    pub residual: f64,
}

/// Every form over the same data.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OverVoltage {
    /// Orders 1, 2 and 3, as far as the data determine them.
    pub polynomials: Vec<Polynomial>,
    /// The power law.
    pub power: PowerLaw,
    /// Voltages of the data, V: the forms hold in between.
    pub range_v: [f64; 2],
    /// Samples.
    pub samples: usize,
}

/// Why nothing was fitted.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum PolynomialError {
    /// Too few samples.
    #[error("{found} samples, at least {LEAST_SAMPLES} needed")]
    TooFew {
        /// Found.
        found: usize,
    },
    /// Not finite, not positive, or times do not ascend.
    #[error("times must ascend, voltages and commands be positive numbers")]
    BadData,
    /// All at one voltage.
    #[error("the voltage does not change: nothing can be said about it")]
    OneVoltage,
}

impl Polynomial {
    /// y at this voltage.
    pub fn at(&self, supply_v: f64) -> f64 {
        let x = supply_v - self.centre_v;
        self.coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c.value)
    }
}

impl PowerLaw {
    /// y at this voltage.
    pub fn at(&self, supply_v: f64) -> f64 {
        self.at_centre.value * (supply_v / self.centre_v).powf(self.exponent.value)
    }
}

/// Fits `y` over the voltage. Times in s, ascending.
pub fn fit(
    times_s: &[f64],
    supply_v: &[f64],
    y: &[f64],
    centre_v: f64,
) -> Result<OverVoltage, PolynomialError> {
    let n = times_s.len();
    if n < LEAST_SAMPLES {
        return Err(PolynomialError::TooFew { found: n });
    }
    let positive =
        |values: &[f64]| values.len() == n && values.iter().all(|v| *v > 0.0 && v.is_finite());
    if !positive(supply_v) || !positive(y) || !times_s.windows(2).all(|w| w[1] > w[0]) {
        return Err(PolynomialError::BadData);
    }
    let polynomials: Vec<Polynomial> =
        (1..=3).filter_map(|order| polynomial(times_s, supply_v, y, centre_v, order)).collect();
    let power = power(times_s, supply_v, y, centre_v).ok_or(PolynomialError::OneVoltage)?;
    if polynomials.is_empty() {
        return Err(PolynomialError::OneVoltage);
    }
    let range_v = supply_v
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], v| [low.min(*v), high.max(*v)]);
    Ok(OverVoltage { polynomials, power, range_v, samples: n })
}

fn left(y: &[f64], model: &[f64]) -> (Vec<f64>, f64) {
    let residual: Vec<f64> = y.iter().zip(model).map(|(y, m)| y - m).collect();
    let rms = (residual.iter().map(|r| r * r).sum::<f64>() / y.len().max(1) as f64).sqrt();
    (residual, rms)
}

fn polynomial(
    times_s: &[f64],
    supply_v: &[f64],
    y: &[f64],
    centre_v: f64,
    order: usize,
) -> Option<Polynomial> {
    let rows = Rows::from_fn(y.len(), order + 1, |i, row| {
        let x = supply_v[i] - centre_v;
        row.iter_mut().zip(0..).for_each(|(slot, k)| *slot = x.powi(k));
    });
    let beta = solve(&rows, y, None)?;
    let (residual, rms) = left(y, &rows.times(&beta));
    let cov = covariance(times_s, &rows, &residual)?;
    Some(Polynomial {
        order,
        centre_v,
        coefficients: beta.iter().enumerate().map(|(i, b)| cov.value(i, *b)).collect(),
        r_squared: r_squared(y, &residual),
        residual: rms,
    })
}

fn power(times_s: &[f64], supply_v: &[f64], y: &[f64], centre_v: f64) -> Option<PowerLaw> {
    let rows = Rows::from_fn(y.len(), 2, |i, row| {
        row.copy_from_slice(&[1.0, (supply_v[i] / centre_v).ln()]);
    });
    let logs: Vec<f64> = y.iter().map(|y| y.ln()).collect();
    let beta = solve(&rows, &logs, None)?;
    let (residual, _) = left(&logs, &rows.times(&beta));
    let cov = covariance(times_s, &rows, &residual)?;
    let at_centre = beta[0].exp();
    let model: Vec<f64> =
        supply_v.iter().map(|v| at_centre * (v / centre_v).powf(beta[1])).collect();
    let (residual, rms) = left(y, &model);
    Some(PowerLaw {
        exponent: cov.value(1, beta[1]),
        centre_v,
        at_centre: cov.combine(at_centre, &[at_centre, 0.0]),
        r_squared: r_squared(y, &residual),
        residual: rms,
    })
}
