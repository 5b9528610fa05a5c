//! Where the gap lies: every block of the chain by its own statistics.
//!
//! Per block `u_bᵀ C_b⁻¹ u_b` over the block's compressed statistics, `C_b` the covariance
//! of healthy flights, as a normal score and as its rank among held-out null flights.

use nalgebra::{DMatrix, DVector};

use super::linear::whitener;
use super::open_set::score;
use super::whiten::{Standard, Whitening, compressed};
use haltere_model::effects::Block;

/// Statistics of one block.
#[derive(Debug, Clone)]
struct Group {
    block: Block,
    /// Places among the statistics in use.
    places: Vec<usize>,
    w: DMatrix<f64>,
}

/// All blocks that have a statistic.
#[derive(Debug, Clone)]
pub(super) struct Groups {
    standard: Standard,
    groups: Vec<Group>,
}

impl Groups {
    /// `blocks`: block of every statistic of the bank.
    pub fn new(whitening: &Whitening, blocks: &[Block]) -> Self {
        let standard = whitening.standard.clone();
        let mut kinds: Vec<Block> =
            standard.columns.iter().filter_map(|c| blocks.get(*c).copied()).collect();
        kinds.sort();
        kinds.dedup();
        let groups = kinds
            .into_iter()
            .map(|block| {
                let inside = |k: &usize| blocks.get(standard.columns[*k]) == Some(&block);
                let places: Vec<usize> = (0..standard.columns.len()).filter(inside).collect();
                let own = whitening.covariance.select_rows(&places).select_columns(&places);
                let [w, _] = whitener(&own);
                Group { block, places, w }
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
                let own = DVector::from_fn(g.places.len(), |k, _| u[g.places[k]]);
                (g.block, g.places.len(), score((&g.w * own).norm_squared(), g.places.len()))
            })
            .collect()
    }
}
