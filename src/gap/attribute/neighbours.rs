//! The second voter: nearest draws in whitened statistics. No model of the signature at all, so it
//! errs elsewhere than the surrogates do.

use nalgebra::{DMatrix, DVector};

/// Draws that vote; the nearest has the weight of [`VOTERS`], the last of one.
const VOTERS: usize = 7;
/// Vote that every effect has without a near draw.
const FLOOR: f64 = 0.01;

/// Draws of all effects.
#[derive(Debug, Clone)]
pub(super) struct Neighbours {
    /// Whitened draws, p × all, so that one lies in one piece of memory.
    draws: DMatrix<f64>,
    effect: Vec<usize>,
    effects: usize,
}

impl Neighbours {
    /// From the draws of every effect (n × p each).
    pub fn new<'a>(effects: impl Iterator<Item = &'a DMatrix<f64>>) -> Self {
        let mut columns = Vec::new();
        let (mut effect, mut count) = (Vec::new(), 0);
        for (e, z) in effects.enumerate() {
            count = e + 1;
            for row in z.row_iter() {
                columns.push(row.transpose());
                effect.push(e);
            }
        }
        let draws =
            if columns.is_empty() { DMatrix::zeros(0, 0) } else { DMatrix::from_columns(&columns) };
        Self { draws, effect, effects: count }
    }

    /// Share of the vote per effect; sums to one.
    pub fn votes(&self, z: &DVector<f64>) -> Vec<f64> {
        let mut near: Vec<(f64, usize)> = self
            .draws
            .column_iter()
            .zip(&self.effect)
            .map(|(draw, e)| {
                (draw.iter().zip(z.iter()).map(|(a, b)| (a - b).powi(2)).sum::<f64>(), *e)
            })
            .collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut votes = vec![FLOOR; self.effects];
        for (rank, (_, e)) in near.iter().take(VOTERS).enumerate() {
            votes[*e] += (VOTERS - rank) as f64;
        }
        let total: f64 = votes.iter().sum();
        votes.iter().map(|v| v / total).collect()
    }
}
