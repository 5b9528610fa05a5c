//! What becomes of the name of a flight whose cause is known, step by step: for the oracle ladder of the laboratory.

use std::collections::BTreeMap;

use nalgebra::DVector;
use serde::Serialize;

use super::evidence::Fit;
use super::foretold::foretold;
use super::library::{Library, Part};
use super::{Attribution, Attributor};

/// The steps of one flight. Shares are of the gap: the excess of the whitened squared distance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Rungs {
    /// The verdict.
    pub attribution: Attribution,
    /// Place of the cause in the ranking, from 1; absent: the library does not hold it.
    pub rank: Option<usize>,
    /// Its probability.
    pub posterior: f64,
    /// Share that the library's law of the cause explains at its best size on this very flight.
    pub law: f64,
    /// Share that it foretells in statistics that its size was not fitted to.
    pub foretold: f64,
    /// The same of the best effect that is not the cause.
    pub foretold_wrong: f64,
    /// Best parameters of the cause, on the unit cube.
    pub unit: Vec<f64>,
    /// Mean square of what the cause leaves, per statistic, by block; 1 is what a healthy flight has.
    pub left: BTreeMap<&'static str, f64>,
}

impl Attributor {
    /// The ladder of a flight. `causes`: ids of effects that the key counts as right; empty: none of the library.
    pub fn rungs(&self, statistics: &[f64], causes: &[String]) -> Rungs {
        let attribution = self.attribute(statistics);
        let library = self.library_of(statistics);
        let z = library.flight(statistics);
        let is_cause = |fit: &&Fit| causes.contains(&self.id(fit.effect));
        // All of them are searched: a cause may be far down.
        let fits = library.explain(&z, usize::MAX);
        let posterior = self.limits.calibration.posterior(&library.likeness(&z));
        let cause = fits.iter().find(is_cause);
        let wrong = fits.iter().find(|fit| !is_cause(fit));
        let share = |fit: Option<&Fit>| {
            let effect = fit.and_then(|fit| library.effects.get(fit.effect));
            effect.map_or(0.0, |effect| foretold(effect, &z))
        };
        let law =
            cause.map_or(0.0, |fit| super::decide::explained(library.left(&z, fit).squared, &z));
        let residual = cause.map_or_else(|| z.clone(), |fit| library.residual(&z, fit));
        Rungs {
            rank: attribution.candidates.iter().position(|c| causes.contains(&c.id)).map(|k| k + 1),
            posterior: cause.and_then(|fit| posterior.get(fit.effect).copied()).unwrap_or(0.0),
            law,
            foretold: share(cause),
            foretold_wrong: share(wrong),
            unit: cause.map(|fit| fit.unit.clone()).unwrap_or_default(),
            left: self.by_block(&library, &residual),
            attribution,
        }
    }

    /// Share of a flight's gap that an effect closes at parameters that were found on another flight.
    pub fn closed_by(&self, statistics: &[f64], id: &str, unit: &[f64]) -> Option<f64> {
        let library = self.library_of(statistics);
        let z = library.flight(statistics);
        let place = self.bank.effects.iter().position(|e| e.id == id)?;
        let s = library.effects.get(place)?;
        let fit = Fit { effect: place, h: s.coordinates(unit), ..Fit::default() };
        Some(super::decide::explained(library.left(&z, &fit).squared, &z))
    }

    /// Half the mean squared distance of two flights per statistic that both know: 1 is what two healthy ones have.
    pub fn apart(&self, one: &[f64], other: &[f64]) -> f64 {
        let both: Vec<f64> =
            one.iter().zip(other).map(|(a, b)| if b.is_finite() { *a } else { f64::NAN }).collect();
        let library = self.library_of(&both);
        let off = library.flight(one) - library.flight(other);
        0.5 * off.norm_squared() / off.len().max(1) as f64
    }

    /// Mean square of a flight per statistic, by block.
    pub fn by_block_of(&self, statistics: &[f64]) -> BTreeMap<&'static str, f64> {
        let library = self.library_of(statistics);
        let z = library.flight(statistics);
        self.by_block(&library, &z)
    }

    fn by_block(&self, library: &Library, z: &DVector<f64>) -> BTreeMap<&'static str, f64> {
        let mut sums: BTreeMap<&'static str, (f64, f64)> = BTreeMap::new();
        for (v, column) in library.whitening.undo(z).iter().zip(&library.whitening.standard.columns)
        {
            if let Some(block) = self.blocks.get(*column) {
                let (sum, count) = sums.entry(block.name()).or_default();
                (*sum, *count) = (*sum + v * v, *count + 1.0);
            }
        }
        sums.into_iter().map(|(block, (sum, count))| (block, sum / count)).collect()
    }

    /// The library without what a flight cannot say.
    fn library_of(&self, statistics: &[f64]) -> Library {
        let teachers = self.teachers();
        let known = |j: usize| statistics.get(j).is_some_and(|v| v.is_finite());
        teachers.library(Part { held_out: None }, known, &self.settings)
    }
}
