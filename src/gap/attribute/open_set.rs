//! Is the best explanation good enough, and what is left if not.
//!
//! The judge is a logistic regression on how much an explanation leaves, in itself and as a share
//! of the gap. It learns from held-out flights with their effect in the library and with it taken
//! out: what the best of the other effects leaves is what an unknown effect looks like.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

use super::library::{Left, Library};
use crate::outcome::Remainder;
use haltere_model::effects::Block;

/// Statistics that are listed of a remainder, and their least size in sigma.
const LISTED: usize = 5;
const LEAST_LISTED: f64 = 3.0;

/// Standard normal score of a chi-square sum (Wilson & Hilferty 1931): comparable between flights
/// with another number of known statistics.
pub(super) fn score(squared: f64, freedom: usize) -> f64 {
    let k = freedom.max(1) as f64;
    let spread = 2.0 / (9.0 * k);
    ((squared.max(0.0) / k).cbrt() - (1.0 - spread)) / spread.sqrt()
}

/// Numbers that an explanation is judged by.
const FEATURES: usize = 4;

/// Of a flight at squared distance `whole`, with `width` statistics.
pub(super) fn features(left: Left, whole: f64, width: usize) -> [f64; FEATURES] {
    let p = width.max(1) as f64;
    let excess = |v: f64| (v - p).max(0.0) / p + 1.0 / p.sqrt();
    let (rest, gap) = (excess(left.squared), excess(whole));
    [score(left.squared, width).asinh(), (rest / gap).ln(), gap.ln(), left.peak.max(0.1).ln()]
}

/// Log odds that an explanation is not the cause.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Judge {
    mean: [f64; FEATURES],
    scale: [f64; FEATURES],
    /// Constant last.
    weights: [f64; FEATURES + 1],
}

/// Ridge of the regression, per flight.
const RIDGE: f64 = 1e-2;
/// Newton steps.
const STEPS: usize = 25;

impl Judge {
    /// From held-out flights with and without their effect in the library.
    pub fn new(known: &[[f64; FEATURES]], unknown: &[[f64; FEATURES]]) -> Self {
        let all = || known.iter().chain(unknown);
        let n = (known.len() + unknown.len()).max(1) as f64;
        let (mut mean, mut scale) = ([0.0; FEATURES], [1.0; FEATURES]);
        for k in 0..FEATURES {
            mean[k] = all().map(|f| f[k]).sum::<f64>() / n;
            let variance = all().map(|f| (f[k] - mean[k]).powi(2)).sum::<f64>() / n;
            scale[k] = variance.sqrt().max(1e-6);
        }
        let mut judge = Self { mean, scale, weights: [0.0; FEATURES + 1] };
        // Without examples of one kind: the residual alone.
        if known.is_empty() || unknown.is_empty() {
            judge.weights[0] = 1.0;
            return judge;
        }
        let share = |count: usize| 0.5 / count as f64;
        let mut weights = DVector::zeros(FEATURES + 1);
        for _ in 0..STEPS {
            let mut gradient = &weights * -RIDGE;
            let mut curvature = DMatrix::identity(FEATURES + 1, FEATURES + 1) * RIDGE;
            let sides = [(known, 0.0, share(known.len())), (unknown, 1.0, share(unknown.len()))];
            for (rows, truth, weight) in sides {
                for row in rows {
                    let x = judge.row(row);
                    let p = 1.0 / (1.0 + (-weights.dot(&x)).exp());
                    gradient += &x * (weight * (truth - p));
                    curvature += &x * x.transpose() * (weight * p * (1.0 - p));
                }
            }
            match curvature.cholesky() {
                Some(c) => weights += c.solve(&gradient),
                None => break,
            }
        }
        judge.weights.copy_from_slice(weights.as_slice());
        judge
    }

    fn row(&self, features: &[f64; FEATURES]) -> DVector<f64> {
        DVector::from_fn(FEATURES + 1, |k, _| match features.get(k) {
            Some(v) => (v - self.mean[k]) / self.scale[k],
            None => 1.0,
        })
    }

    /// Log odds of "not the cause".
    pub fn odds(&self, features: &[f64; FEATURES]) -> f64 {
        self.row(features).iter().zip(&self.weights).map(|(x, w)| x * w).sum()
    }
}

/// What is left of a gap: the block that holds most of it, and what sticks out in single statistics, sigma each, unwhitened
/// so that names mean something.
///
/// Of two blocks with as large a remainder for each of their statistics the one with more of them holds more. `blocks`: of every
/// statistic of the bank.
pub(super) fn remainder(
    library: &Library,
    residual: &DVector<f64>,
    share: f64,
    names: &[String],
    blocks: &[Block],
) -> Remainder {
    let plain = library.whitening.undo(residual);
    let columns = &library.whitening.standard.columns;
    let mut held: BTreeMap<Block, f64> = BTreeMap::new();
    for (v, column) in plain.iter().zip(columns) {
        if let Some(block) = blocks.get(*column) {
            // One is what a healthy flight has.
            *held.entry(*block).or_default() += v * v - 1.0;
        }
    }
    let most = held.into_iter().max_by(|a, b| a.1.total_cmp(&b.1));
    let mut sized: Vec<(String, f64)> = plain
        .iter()
        .zip(columns)
        .filter(|(v, _)| v.abs() >= LEAST_LISTED)
        .filter_map(|(v, column)| Some((names.get(*column)?.clone(), *v)))
        .collect();
    sized.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    sized.truncate(LISTED);
    let block = most.map(|(block, _)| block.name().to_owned()).unwrap_or_default();
    Remainder { share, block, statistics: sized }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_the_judge_separates_what_it_was_shown() {
        let mut rng = haltere_model::random::Stream::new(4, "judge");
        let mut rows = |off: f64| -> Vec<[f64; FEATURES]> {
            (0..300).map(|_| [rng.normal(), off + rng.normal(), rng.normal(), 0.0]).collect()
        };
        let judge = Judge::new(&rows(0.0), &rows(2.0));
        let right = |rows: &[[f64; FEATURES]], sign: f64| {
            rows.iter().filter(|r| sign * judge.odds(r) > 0.0).count()
        };
        // Two normals two sigma apart: 84 % each.
        let (a, b) = (right(&rows(0.0), -1.0), right(&rows(2.0), 1.0));
        assert!(a > 232 && b > 232 && a < 275 && b < 275, "{a} {b} of 300");
    }

    #[test]
    fn val_score_of_chi_square() {
        // 95 % points of chi-square, Abramowitz & Stegun table 26.8: 18.307 at 10, 124.342 at 100.
        assert!((score(18.307, 10) - 1.645).abs() < 0.02);
        assert!((score(124.342, 100) - 1.645).abs() < 0.01);
    }
}
