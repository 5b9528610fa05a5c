//! Where the gap lies: every block of the chain by its own statistics.
//!
//! Per block `u_bᵀ C_b⁻¹ u_b` over the block's compressed statistics, `C_b` the shrunk covariance
//! of the null flights, as a normal score and as its rank among held-out null flights.

use nalgebra::{DMatrix, DVector};

use super::linear::{matrix, shrunk_covariance, whitener};
use super::open_set::score;
use super::whiten::{Standard, compressed};
use haltere_model::effects::Block;

/// Statistics of one block.
#[derive(Debug, Clone)]
struct Group {
    block: Block,
    /// Places among the statistics in use.
    places: Vec<usize>,
    w: DMatrix<f64>,
    /// Mean of the null flights.
    mean: DVector<f64>,
}

/// All blocks that have a statistic.
#[derive(Debug, Clone)]
pub(super) struct Groups {
    standard: Standard,
    groups: Vec<Group>,
}

impl Groups {
    /// `blocks`: block of every statistic of the bank; `nulls`: rows that give the covariance.
    /// `standard` is that of the flights, with references if there are; `plain` that of the bank.
    pub fn new(standard: Standard, plain: &Standard, nulls: &[&[f64]], blocks: &[Block]) -> Self {
        let rows: Vec<Vec<f64>> = nulls.iter().map(|r| compressed(&plain.raw(r))).collect();
        let mut kinds: Vec<Block> =
            standard.columns.iter().filter_map(|c| blocks.get(*c).copied()).collect();
        kinds.sort();
        kinds.dedup();
        let groups = kinds
            .into_iter()
            .map(|block| {
                let inside = |k: &usize| blocks.get(standard.columns[*k]) == Some(&block);
                let places: Vec<usize> = (0..standard.columns.len()).filter(inside).collect();
                let own: Vec<Vec<f64>> =
                    rows.iter().map(|r| places.iter().map(|k| r[*k]).collect()).collect();
                let own = matrix(&own, places.len());
                let (covariance, _) = shrunk_covariance(&own);
                let floor = DVector::from_iterator(
                    places.len(),
                    places.iter().map(|k| LEAST_VARIANCE + standard.unresolved(*k)),
                );
                let [w, _] = whitener(&(covariance + DMatrix::from_diagonal(&floor)));
                Group { block, places, w, mean: own.row_mean().transpose() }
            })
            .collect();
        Self { standard, groups }
    }

    /// Normal score per block.
    pub fn scores(&self, statistics: &[f64]) -> Vec<(Block, usize, f64)> {
        let u = compressed(&self.standard.raw(statistics));
        self.groups
            .iter()
            .map(|g| {
                let own = DVector::from_fn(g.places.len(), |k, _| u[g.places[k]]) - &g.mean;
                (g.block, g.places.len(), score((&g.w * own).norm_squared(), g.places.len()))
            })
            .collect()
    }
}

/// As in whitening: a statistic that never varies in a null flight.
const LEAST_VARIANCE: f64 = 1e-2;
