//! Speed after an angle step: which speed it tends to, and how fast.
//!
//! **Equation.** The source fits `v(t) = a − b·e^(−c·t + d)`. Its b and d are one parameter:
//! `b·e^d = B`, and any b goes with a d. They are merged here, `v(t) = a − B·e^(−c·t)`; a is the
//! extrapolated final speed, c the rate, and B holds the speed at the start, `v(0) = a − B`.
//!
//! **Method.** For a given c the rest is linear; c is searched between bounds, so nothing depends on
//! a start value. Standard errors as in [`super::correlated`].
//!
//! **Symbols.** t time since the step (or since the attitude arrived), s; v speed along the step,
//! m/s; a, B m/s; c 1/s. **Validity.** Linear drag at constant lean. While the attitude is on its
//! way the law does not hold: leave that part out.

use serde::Serialize;

use super::correlated::Noise;
use super::linear::{Rows, solve};
use super::value::Value;

/// Shares of the data that the source fits.
pub const SHARES: [f64; 5] = [0.1, 0.3, 0.5, 0.7, 0.9];
/// Fewest samples.
const LEAST_SAMPLES: usize = 8;
/// The rate is searched from a curve that has bent by a twentieth within the data …
const LEAST_BEND: f64 = 0.05;
/// … to one that is over after a sixtieth of it.
const MOST_BEND: f64 = 60.0;
/// Extrapolation is determined when its standard error is below this share of it.
const DETERMINED_FRAC: f64 = 0.25;

/// Why no transient was fitted.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum TransientError {
    /// Too few samples.
    #[error("{found} samples in the first {percent:.0} %, at least {LEAST_SAMPLES} needed")]
    TooFew {
        /// Found.
        found: usize,
        /// Of the data.
        percent: f64,
    },
    /// Not finite, or times do not ascend.
    #[error("times must ascend and speeds be numbers")]
    BadData,
}

/// A fitted transient.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Transient {
    /// Share of the data that was used, 0 to 1.
    pub share: f64,
    /// Extrapolated final speed, m/s.
    pub a_mps: Value,
    /// b·e^d of the source, m/s: the two are one parameter.
    pub b_exp_d_mps: Value,
    /// Rate, 1/s.
    pub c_per_s: Value,
    /// How much of the way to the final speed was seen, 0 to 1: `1 − e^(−c·T)`.
    pub seen_frac: f64,
    /// Rms of what is left, m/s.
    pub residual_mps: f64,
    /// Time over which the noise lasts, s.
    pub correlation_s: f64,
    /// Whether the data determine the final speed: standard error below a quarter of it, and the
    /// rate not at a bound of the search.
    pub determined: bool,
}

impl Transient {
    /// Speed at this time, m/s.
    pub fn at(&self, t_s: f64) -> f64 {
        self.a_mps.value - self.b_exp_d_mps.value * (-self.c_per_s.value * t_s).exp()
    }
}

/// Fits the first `share` (0 to 1) of the samples. Times in s, ascending; speeds in m/s, positive in
/// the direction of flight or all negative.
pub fn fit(times_s: &[f64], speeds_mps: &[f64], share: f64) -> Result<Transient, TransientError> {
    fit_in_noise(times_s, speeds_mps, share, None)
}

/// The same with noise that was learned elsewhere, in a hover of the same flight: a second of data
/// does not tell noise that lasts half a second from the curve.
pub fn fit_in_noise(
    times_s: &[f64],
    speeds_mps: &[f64],
    share: f64,
    noise: Option<&Noise>,
) -> Result<Transient, TransientError> {
    let usable = times_s.len() == speeds_mps.len()
        && times_s.windows(2).all(|w| w[1] > w[0])
        && times_s.iter().chain(speeds_mps).all(|v| v.is_finite());
    if !usable {
        return Err(TransientError::BadData);
    }
    let count = (times_s.len() as f64 * share.clamp(0.0, 1.0)).round() as usize;
    let (t, v) = (&times_s[..count], &speeds_mps[..count]);
    if count < LEAST_SAMPLES {
        return Err(TransientError::TooFew { found: count, percent: share * 100.0 });
    }
    let start_s = t[0];
    let length_s = t[count - 1] - start_s;
    let bounds = [LEAST_BEND / length_s, MOST_BEND / length_s];
    // Time from the first sample, for the search: e^(−c·t) of a late start would underflow.
    let trial = |c: f64| -> Option<(f64, [f64; 2])> {
        let rows = Rows::from_fn(count, 2, |i, row| {
            row.copy_from_slice(&[1.0, -(-c * (t[i] - start_s)).exp()]);
        });
        let beta = solve(&rows, v, None)?;
        let square = rows.times(&beta).iter().zip(v).map(|(m, v)| (v - m).powi(2)).sum();
        Some((square, [beta[0], beta[1]]))
    };
    let c = search(bounds, |c| trial(c).map_or(f64::INFINITY, |t| t.0));
    let (square, [a, b_start]) = trial(c).ok_or(TransientError::BadData)?;
    let jacobian = Rows::from_fn(count, 3, |i, row| {
        let since_s = t[i] - start_s;
        let e = (-c * since_s).exp();
        row.copy_from_slice(&[1.0, -e, b_start * since_s * e]);
    });
    let model = |i: usize| a - b_start * (-c * (t[i] - start_s)).exp();
    let residual: Vec<f64> = (0..count).map(|i| v[i] - model(i)).collect();
    let nothing = |value| Value { value, std: f64::INFINITY, dof: 1.0 };
    // B at t = 0 instead of at the first sample.
    let back = (c * start_s).exp();
    let learned = noise.cloned().or_else(|| Noise::learn(t, &jacobian, &residual));
    let correlation_s = learned.as_ref().map_or(0.0, Noise::lasts_s);
    let cov = learned.and_then(|n| n.covariance(t, &jacobian));
    let (a_mps, b_exp_d_mps, c_per_s) = match cov {
        Some(cov) => (
            cov.value(0, a),
            cov.combine(b_start * back, &[0.0, back, b_start * back * start_s]),
            cov.value(2, c),
        ),
        None => (nothing(a), nothing(b_start * back), nothing(c)),
    };
    let inside = c > bounds[0] * 1.01 && c < bounds[1] * 0.99;
    Ok(Transient {
        share,
        a_mps,
        b_exp_d_mps,
        c_per_s,
        seen_frac: 1.0 - (-c * length_s).exp(),
        residual_mps: (square / count as f64).sqrt(),
        correlation_s,
        determined: inside && a_mps.std < DETERMINED_FRAC * a.abs(),
    })
}

/// Fits every share of the source; what cannot be fitted says why.
pub fn shares(
    times_s: &[f64],
    speeds_mps: &[f64],
) -> [(f64, Result<Transient, TransientError>); SHARES.len()] {
    SHARES.map(|share| (share, fit(times_s, speeds_mps, share)))
}

/// Least value of a function of a positive argument between bounds: a coarse look at the logarithm,
/// then the golden section around the best.
pub(crate) fn search([low, high]: [f64; 2], value: impl Fn(f64) -> f64) -> f64 {
    const LOOKS: i32 = 60;
    let at = |k: i32| low * (high / low).powf(f64::from(k) / f64::from(LOOKS));
    let best = (0..=LOOKS).min_by(|a, b| value(at(*a)).total_cmp(&value(at(*b)))).unwrap_or(0);
    let (mut left, mut right) = (at((best - 1).max(0)).ln(), at((best + 1).min(LOOKS)).ln());
    let golden = 0.5 * (5f64.sqrt() - 1.0);
    for _ in 0..60 {
        let (x, y) = (right - golden * (right - left), left + golden * (right - left));
        if value(x.exp()) < value(y.exp()) {
            right = y;
        } else {
            left = x;
        }
    }
    (0.5 * (left + right)).exp()
}
