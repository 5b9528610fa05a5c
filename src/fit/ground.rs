//! Ground effect: the thrust that hovers at a height over the one that hovers far from the floor.
//!
//! **Equation.** `y(h) = y∞·(1 − λ/(h − a)²) + d·t`, the law of [`haltere_core::control::ground`] with its free-air
//! value y∞ and a drift d fitted along: what warms or sags with the time of the flight is not height. y is a thrust command made independent of the battery (times the voltage to
//! the power of the discharge law).
//!
//! **Method.** For a given pole a the rest is linear; a is searched below the lowest height. Standard
//! errors as in [`super::correlated`]. **Bounds**: as in the source, from the scatter of throttle and
//! voltage at one height: a single second of hover at h needs `r(h)·(1 ± s)` of the free-air thrust
//! for one sigma, s the rms of what is left over y.
//!
//! **Symbols.** h landing gear to ground, m; λ m²; a m. **Validity.** Between the lowest and the
//! highest height flown. **Left out.** Errors of the height itself: one rung of a ladder enters with
//! its mean height, which takes noise away but no bias.

use serde::Serialize;

use super::correlated::Noise;
use super::linear::{Rows, r_squared, solve};
use super::transient::search;
use super::value::Value;

/// The pole is searched from this far below the lowest height to this far, m.
const POLE_BELOW_M: [f64; 2] = [0.02, 2.0];
/// Fewest different heights: three parameters and one to judge by.
pub const LEAST_HEIGHTS: usize = 4;
/// Times farther apart than this are two flights, s.
const FLIGHT_GAP_S: f64 = 1000.0;
/// Heights nearer to one another than this are one, m.
const SAME_M: f64 = 0.05;
/// The lowest rung must lie below this, m: at 0.6 m the law asks for 1 %.
pub const LOW_M: f64 = 0.5;
/// The highest rung must lie above this, m: where free air is within 0.2 %.
pub const HIGH_M: f64 = 0.9;

/// The fitted law.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Ground {
    /// Strength, m².
    pub lambda_m2: Value,
    /// Pole, m.
    pub a_m: Value,
    /// Value far from the floor, unit of y.
    pub free: Value,
    /// Ratio at the lowest height, with its standard error: the part of the law that data carry
    /// even where λ and a can be traded for one another.
    pub at_lowest: Value,
    /// Share of the variance that is explained.
    pub r_squared: f64,
    /// One sigma of what is left, over y: the bounds of the law.
    pub scatter_frac: f64,
    /// Lowest and highest height, m.
    pub range_m: [f64; 2],
    /// Different heights.
    pub heights: usize,
    /// The pole ran to the end of its search.
    pub at_bound: bool,
}

impl Ground {
    /// Ratio at this height.
    pub fn ratio(&self, height_m: f64) -> f64 {
        1.0 - self.lambda_m2.value / (height_m - self.a_m.value).powi(2)
    }
}

/// Why nothing was fitted.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum GroundError {
    /// Heights.
    #[error(
        "{found} different heights from {low_m:.2} to {high_m:.2} m, at least {LEAST_HEIGHTS} \
         needed, from below {LOW_M} m to above {HIGH_M} m"
    )]
    Heights {
        /// Found.
        found: usize,
        /// Lowest, m.
        low_m: f64,
        /// Highest, m.
        high_m: f64,
    },
    /// Not finite, or times do not ascend.
    #[error("times must ascend, heights and thrusts be numbers")]
    BadData,
}

/// Time within each flight from its middle, over half its length: flights are told apart by gaps.
fn drift(times_s: &[f64]) -> Vec<f64> {
    times_s
        .chunk_by(|a, b| b - a < FLIGHT_GAP_S)
        .flat_map(|flight| {
            let (first, last) = (flight[0], flight[flight.len() - 1]);
            let half_s = (0.5 * (last - first)).max(1e-9);
            flight.iter().map(move |t| (t - first) / half_s - 1.0)
        })
        .collect()
}

/// Fits the law. Times in s, ascending; heights in m; y above zero.
pub fn fit(times_s: &[f64], height_m: &[f64], y: &[f64]) -> Result<Ground, GroundError> {
    let n = times_s.len();
    let finite = |v: &[f64]| v.len() == n && v.iter().all(|x| x.is_finite());
    let ascending = times_s.windows(2).all(|w| w[1] > w[0]);
    if !(finite(height_m) && finite(y) && ascending && y.iter().all(|y| *y > 0.0)) {
        return Err(GroundError::BadData);
    }
    let mut sorted = height_m.to_vec();
    sorted.sort_by(f64::total_cmp);
    let (Some(low), Some(high)) = (sorted.first().copied(), sorted.last().copied()) else {
        return Err(GroundError::BadData);
    };
    sorted.dedup_by(|a, b| (*a - *b).abs() < SAME_M);
    if sorted.len() < LEAST_HEIGHTS || low > LOW_M || high < HIGH_M {
        return Err(GroundError::Heights { found: sorted.len(), low_m: low, high_m: high });
    }
    let drift = drift(times_s);
    let rows = |a: f64| {
        Rows::from_fn(n, 3, |i, row| {
            row.copy_from_slice(&[1.0, -(height_m[i] - a).powi(-2), drift[i]]);
        })
    };
    let square = |a: f64| {
        let rows = rows(a);
        let Some(beta) = solve(&rows, y, None) else { return f64::INFINITY };
        rows.times(&beta).iter().zip(y).map(|(m, y)| (y - m).powi(2)).sum()
    };
    let below = search(POLE_BELOW_M, |d| square(low - d));
    let a = low - below;
    let design = rows(a);
    let beta = solve(&design, y, None).ok_or(GroundError::BadData)?;
    let (free, m) = (beta[0], beta[1]);
    let jacobian = Rows::from_fn(n, 4, |i, row| {
        let over = height_m[i] - a;
        row.copy_from_slice(&[1.0, -over.powi(-2), -2.0 * m * over.powi(-3), drift[i]]);
    });
    let residual: Vec<f64> = design.times(&beta).iter().zip(y).map(|(m, y)| y - m).collect();
    let noise = Noise::learn(times_s, &jacobian, &residual).ok_or(GroundError::BadData)?;
    let cov = noise.covariance(times_s, &jacobian).ok_or(GroundError::BadData)?;
    let lambda = m / free;
    let over = low - a;
    let ratio_gradient = [
        m / (free * free * over * over),
        -1.0 / (free * over * over),
        -2.0 * lambda / over.powi(3),
        0.0,
    ];
    Ok(Ground {
        lambda_m2: cov.combine(lambda, &[-m / (free * free), 1.0 / free, 0.0, 0.0]),
        a_m: cov.value(2, a),
        free: cov.value(0, free),
        at_lowest: cov.combine(1.0 - lambda / (over * over), &ratio_gradient),
        r_squared: r_squared(y, &residual),
        scatter_frac: noise.std() / free,
        range_m: [low, high],
        heights: sorted.len(),
        at_bound: !(POLE_BELOW_M[0] * 1.01..=POLE_BELOW_M[1] * 0.99).contains(&below),
    })
}
