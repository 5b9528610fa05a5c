//! Everything learned from one part of a bank: whitening, signatures.

use nalgebra::DVector;
use rayon::prelude::*;

use super::evidence::{Fit, Sufficient};
use super::laws;
use super::likeness::Likeness;
use super::linear::Noise;
use super::surrogate::Surrogate;
use super::whiten::Whitening;
use crate::bank::{Bank, Draw};

/// What an explanation leaves.
#[derive(Debug, Clone, Copy)]
pub(super) struct Left {
    /// `rᵀ N⁻¹ r`.
    pub squared: f64,
    /// Largest whitened residual, sigma.
    pub peak: f64,
}

/// Which flights of a bank teach: all, or all but one fold.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part {
    /// The fold that is held out, and the number of folds.
    pub held_out: Option<(usize, usize)>,
}

impl Part {
    /// Whether flight `i` of its list teaches.
    pub fn teaches(self, i: usize) -> bool {
        self.held_out.is_none_or(|(fold, folds)| i % folds != fold)
    }
}

/// Whitening and signatures.
#[derive(Debug, Clone)]
pub(super) struct Library {
    /// Whitening.
    pub whitening: Whitening,
    /// One per effect of the bank, in its order.
    pub effects: Vec<Surrogate>,
    likeness: Vec<Likeness>,
}

impl Library {
    /// Learns what effects do, by this whitening.
    pub fn new(bank: &Bank, part: Part, whitening: Whitening) -> Self {
        let (effects, likeness) = bank
            .effects
            .par_iter()
            .map(|effect| {
                let teaches = effect.draws.iter().enumerate().filter(|(i, _)| part.teaches(*i));
                let kept: Vec<&Draw> = teaches.map(|(_, d)| d).collect();
                let standard = &whitening.standard;
                let off = |d: &&Draw| standard.apart(&d.statistics, &bank.jitter[d.twin]);
                let z = whitening.apply_rows(&filled(kept.iter().map(off).collect()));
                let thetas: Vec<&[f64]> = kept.iter().map(|d| d.theta.as_slice()).collect();
                let others = laws::of(&effect.id, &bank.names);
                let others: Vec<_> = others.iter().map(|did| standard.in_scale(did)).collect();
                let others = whitening.apply_rows(&others);
                (Surrogate::new(&effect.axes, &thetas, &z, &others), Likeness::new(&z, &others))
            })
            .unzip();
        Self { whitening, effects, likeness }
    }

    /// Standardises, compresses and whitens one flight.
    pub fn flight(&self, statistics: &[f64]) -> DVector<f64> {
        self.whitening.flight(statistics)
    }

    /// Log likelihood of "no effect".
    pub fn null(z: &DVector<f64>) -> f64 {
        -0.5 * z.norm_squared()
    }

    /// Log evidence of every effect over none, by how like it the flight is.
    pub fn likeness(&self, z: &DVector<f64>) -> Vec<f64> {
        self.likeness.iter().map(|effect| effect.of(z)).collect()
    }

    /// Log evidence of every effect over none, by its signature at the draws.
    pub fn evidence(&self, z: &DVector<f64>) -> Vec<f64> {
        let null = Self::null(z);
        let of = |(e, effect)| Sufficient::new(effect, z).screen(e).log_z - null;
        self.effects.iter().enumerate().map(of).collect()
    }

    /// All effects, the likeliest first: the first `survivors` are fitted, the others screened.
    pub fn explain(&self, z: &DVector<f64>, survivors: usize) -> Vec<Fit> {
        let evidence = self.likeness(z);
        let mut order: Vec<usize> = (0..self.effects.len()).collect();
        order.sort_by(|a, b| evidence[*b].total_cmp(&evidence[*a]));
        let fit = |(place, effect): (usize, usize)| {
            let prepared = Sufficient::new(&self.effects[effect], z);
            if place < survivors { prepared.fit(effect) } else { prepared.screen(effect) }
        };
        order.into_iter().enumerate().map(fit).collect()
    }

    /// The flight less what a single explanation does.
    pub fn residual(&self, z: &DVector<f64>, fit: &Fit) -> DVector<f64> {
        self.effects.get(fit.effect).map_or_else(|| z.clone(), |s| z - s.mean(&fit.h))
    }

    /// What a single explanation leaves, by the noise at its level.
    pub fn left(&self, z: &DVector<f64>, fit: &Fit) -> Left {
        let Some(s) = self.effects.get(fit.effect) else {
            return Left { squared: z.norm_squared(), peak: z.amax() };
        };
        let level = s.level(&fit.h);
        let noise = Noise::new(&(&s.spread.0 * level), &(&s.spread.1 * level.sqrt()));
        let residual = self.residual(z, fit);
        Left { squared: noise.squared(&residual), peak: noise.peak(&residual) }
    }
}

/// Unknown statistics of a draw become the mean of the effect's other draws.
fn filled(mut rows: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    let width = rows.first().map_or(0, Vec::len);
    for k in 0..width {
        let known: Vec<f64> = rows.iter().map(|r| r[k]).filter(|v| v.is_finite()).collect();
        let mean =
            if known.is_empty() { 0.0 } else { known.iter().sum::<f64>() / known.len() as f64 };
        for row in rows.iter_mut().filter(|r| !r[k].is_finite()) {
            row[k] = mean;
        }
    }
    rows
}
