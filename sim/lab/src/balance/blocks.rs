//! Sums over blocks of time: every fit, cross-validation, held-out error and bootstrap is made of
//! them, so that no step goes back to the samples.
//!
//! A block is [`BLOCK_S`] of one flight, followed by a guard of [`GUARD_S`] that is not used: what
//! one block knows of the next is gone by then (correlation of the residual: some 0.5 s). Per block
//! and body axis: the Gram matrix of all columns with the target and a constant.

use nalgebra::{DMatrix, DVector};

use super::terms::{Column, Nominal};
use haltere_log::import::motion::Sample;
use haltere_model::random::Stream;

/// Length of a block, s (GAP.md 2.3: at least 5 s).
pub const BLOCK_S: f64 = 5.0;
/// Guard behind each block, s (GAP.md 2.5).
pub const GUARD_S: f64 = 1.0;
/// A block with fewer samples than this is left out: half of a full one.
const LEAST_SAMPLES: usize = 50;

/// Sums of one block.
#[derive(Debug, Clone)]
pub struct Block {
    /// Samples in it.
    pub n: f64,
    /// Sums of what motion capture and vehicle differ in roll and pitch, rad.
    pub tilt_apart_rad: [f64; 2],
    /// Per body axis: columns, target, constant.
    gram: [DMatrix<f64>; 3],
}

/// Blocks of one flight.
pub fn blocks(samples: &[Sample], nominal: &Nominal, columns: &[Column]) -> Vec<Block> {
    let width = columns.len() + 2;
    let mut found: Vec<(u64, Block)> = Vec::new();
    for s in samples {
        let stride = BLOCK_S + GUARD_S;
        let index = (s.t_s / stride).floor();
        if s.t_s - index * stride >= BLOCK_S {
            continue;
        }
        let index = index as u64;
        if found.last().is_none_or(|(at, _)| *at != index) {
            let gram = std::array::from_fn(|_| DMatrix::zeros(width, width));
            found.push((index, Block { n: 0.0, tilt_apart_rad: [0.0; 2], gram }));
        }
        let Some((_, block)) = found.last_mut() else { continue };
        block.n += 1.0;
        for (sum, apart) in block.tilt_apart_rad.iter_mut().zip(s.tilt_apart_rad) {
            *sum += apart;
        }
        let target = nominal.target(s).to_array();
        let forces: Vec<[f64; 3]> = columns.iter().map(|c| (c.force)(nominal, s)).collect();
        for (axis, gram) in block.gram.iter_mut().enumerate() {
            let mut row = DVector::zeros(width);
            for (slot, force) in row.iter_mut().zip(&forces) {
                *slot = force[axis];
            }
            row[width - 2] = target[axis];
            row[width - 1] = 1.0;
            gram.ger(1.0, &row, &row, 1.0);
        }
    }
    found.into_iter().map(|(_, block)| block).filter(|b| b.n >= LEAST_SAMPLES as f64).collect()
}

/// Parameters of the active columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Fit {
    /// Columns, ascending.
    pub active: Vec<usize>,
    /// Their parameters.
    pub value: DVector<f64>,
}

impl Fit {
    /// Parameter of a column.
    pub fn of(&self, column: usize) -> Option<f64> {
        self.active.iter().position(|c| *c == column).and_then(|i| self.value.get(i).copied())
    }
}

/// Least squares over blocks, each axis by its weight (1/variance). `None` when the columns cannot
/// be told apart.
pub fn fit<'a>(
    blocks: impl IntoIterator<Item = &'a Block>,
    active: &[usize],
    weight: [f64; 3],
) -> Option<Fit> {
    let k = active.len();
    let mut normal = DMatrix::<f64>::zeros(k, k);
    let mut right = DVector::<f64>::zeros(k);
    for block in blocks {
        for (gram, weight) in block.gram.iter().zip(weight) {
            let target = gram.ncols() - 2;
            for (i, a) in active.iter().enumerate() {
                right[i] += weight * gram[(*a, target)];
                for (j, b) in active.iter().enumerate() {
                    normal[(i, j)] += weight * gram[(*a, *b)];
                }
            }
        }
    }
    // Unit diagonal: the limit on the pivots then has no unit.
    let scale = normal.diagonal().map(|d| if d > 0.0 { d.sqrt().recip() } else { 0.0 });
    if scale.iter().any(|s| *s == 0.0) {
        return None;
    }
    let unit = DMatrix::from_fn(k, k, |i, j| normal[(i, j)] * scale[i] * scale[j]);
    let cholesky = unit.cholesky()?;
    // Share of a column that the ones before it do not explain: below this it is rounding.
    const LEAST_PIVOT: f64 = 1e-4;
    if cholesky.l_dirty().diagonal().iter().any(|pivot| *pivot < LEAST_PIVOT) {
        return None;
    }
    let value = cholesky.solve(&right.component_mul(&scale)).component_mul(&scale);
    Some(Fit { active: active.to_vec(), value })
}

impl Block {
    /// Sum of squared residuals along an axis.
    pub fn square(&self, axis: usize, fit: &Fit) -> f64 {
        let gram = &self.gram[axis];
        let target = gram.ncols() - 2;
        let mut sum = gram[(target, target)];
        for (i, a) in fit.active.iter().enumerate() {
            sum -= 2.0 * fit.value[i] * gram[(*a, target)];
            for (j, b) in fit.active.iter().enumerate() {
                sum += fit.value[i] * fit.value[j] * gram[(*a, *b)];
            }
        }
        sum.max(0.0)
    }

    /// Sum of residuals along an axis.
    pub fn sum(&self, axis: usize, fit: &Fit) -> f64 {
        self.product(axis, fit, self.gram[axis].ncols() - 1)
    }

    /// Sum of residuals times a column along an axis.
    pub fn product(&self, axis: usize, fit: &Fit, column: usize) -> f64 {
        let gram = &self.gram[axis];
        let target = gram.ncols() - 2;
        let fitted: f64 =
            fit.active.iter().zip(fit.value.iter()).map(|(a, v)| v * gram[(*a, column)]).sum();
        gram[(target, column)] - fitted
    }

    /// Sum of squared residuals over axes by weight.
    pub fn loss(&self, axes: &[usize], fit: &Fit, weight: [f64; 3]) -> f64 {
        axes.iter().map(|a| weight[*a] * self.square(*a, fit)).sum()
    }
}

/// Mean squared residual along an axis, m²/s⁴.
pub fn mean_square(blocks: &[Block], axis: usize, fit: &Fit) -> f64 {
    let n: f64 = blocks.iter().map(|b| b.n).sum();
    blocks.iter().map(|b| b.square(axis, fit)).sum::<f64>() / n.max(1.0)
}

/// Mean residual along an axis, m/s².
pub fn mean(blocks: &[Block], axis: usize, fit: &Fit) -> f64 {
    let n: f64 = blocks.iter().map(|b| b.n).sum();
    blocks.iter().map(|b| b.sum(axis, fit)).sum::<f64>() / n.max(1.0)
}

/// An estimate with its interval.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Interval {
    /// Estimate.
    pub value: f64,
    /// Lower end.
    pub low: f64,
    /// Upper end.
    pub high: f64,
}

/// Draws of the block bootstrap.
const DRAWS: usize = 1000;

/// Block bootstrap: `statistic` of blocks drawn with repetition; the interval covers `level`.
pub fn bootstrap<T>(
    value: f64,
    items: &[T],
    level: f64,
    name: &str,
    statistic: impl Fn(&[&T]) -> Option<f64>,
) -> Interval {
    let mut rng = Stream::new(0, name);
    let mut draws: Vec<f64> = Vec::with_capacity(DRAWS);
    if !items.is_empty() {
        for _ in 0..DRAWS {
            let drawn: Vec<&T> = (0..items.len())
                .filter_map(|_| items.get((rng.uniform() * items.len() as f64) as usize))
                .collect();
            draws.extend(statistic(&drawn).filter(|v| v.is_finite()));
        }
    }
    draws.sort_by(f64::total_cmp);
    let at = |share: f64| {
        let index = (share * (draws.len().saturating_sub(1)) as f64).round() as usize;
        draws.get(index).copied().unwrap_or(f64::NAN)
    };
    Interval { value, low: at(0.5 * (1.0 - level)), high: at(0.5 * (1.0 + level)) }
}

impl Block {
    /// Sum of a column along an axis.
    pub fn moment(&self, axis: usize, column: usize) -> f64 {
        let gram = &self.gram[axis];
        gram[(column, gram.ncols() - 1)]
    }

    /// Sum of the square of a column along an axis.
    pub fn square_of(&self, axis: usize, column: usize) -> f64 {
        self.gram[axis][(column, column)]
    }
}
