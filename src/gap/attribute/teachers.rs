//! The flights that an attributor learns from, and flights made of them.

use super::Settings;
use super::blocks::Groups;
use super::library::{Library, Part};
use crate::gap::bank::{Bank, Draw, LEAST_NULLS};
use crate::model::effects::Block;
use crate::model::random::Stream;

/// Bank, references and blocks, with the mean of the nominal flights.
pub(super) struct Teachers<'a> {
    /// The bank.
    pub bank: &'a Bank,
    /// Accepted flights.
    pub references: &'a [Vec<f64>],
    /// Accepted flights that only limits come from.
    pub calibration: &'a [Vec<f64>],
    blocks: &'a [Block],
    /// Mean of nominal flights.
    mean: Vec<f64>,
    /// Share of a jitter flight's deviation that a draw lacks.
    lacking: f64,
}

impl<'a> Teachers<'a> {
    /// Collects.
    pub fn new(bank: &'a Bank, references: &'a [Vec<f64>], blocks: &'a [Block]) -> Self {
        let width = bank.names.len();
        let moments = |rows: &[Vec<f64>], j: usize| {
            let known: Vec<f64> = rows.iter().map(|r| r[j]).filter(|v| v.is_finite()).collect();
            let n = known.len() as f64;
            let mean = known.iter().sum::<f64>() / n;
            (mean, known.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n)
        };
        // Jitter is even to both sides: together they know the middle best.
        let nulls: Vec<Vec<f64>> = bank.seeds.iter().chain(&bank.jitter).cloned().collect();
        let mean = (0..width).map(|j| moments(&nulls, j).0).collect();
        // A draw holds the noise of its seed; jitter holds that and more.
        let (mut sum, mut count) = (0.0_f64, 0.0_f64);
        for j in 0..width {
            let ratio = moments(&bank.seeds, j).1 / moments(&bank.jitter, j).1;
            if ratio.is_finite() {
                sum += (1.0 - ratio).clamp(0.0, 1.0);
                count += 1.0;
            }
        }
        let lacking = if count > 0.0 { f64::sqrt(sum / count) } else { 0.0 };
        Self { bank, references, calibration: &[], blocks, mean, lacking }
    }

    /// References as rows.
    pub fn reference_rows(&self) -> Vec<&'a [f64]> {
        self.references.iter().map(Vec::as_slice).collect()
    }

    /// Learns from a part.
    pub fn library(
        &self,
        part: Part,
        references: &[&[f64]],
        allowed: impl Fn(usize) -> bool,
        settings: &Settings,
    ) -> Library {
        Library::new(self.bank, part, references, allowed, settings)
    }

    /// Blocks, from the same part.
    pub fn groups(&self, part: Part, library: &Library) -> Groups {
        let rows = |rows: &'a [Vec<f64>]| -> Vec<&'a [f64]> {
            let kept = rows.iter().enumerate().filter(|(i, _)| part.teaches(*i));
            kept.map(|(_, r)| r.as_slice()).collect()
        };
        let (seeds, jitter) = (rows(&self.bank.seeds), rows(&self.bank.jitter));
        let nulls = if jitter.len() >= LEAST_NULLS {
            jitter
        } else {
            seeds.into_iter().chain(jitter).collect()
        };
        let standard = library.whitening.standard.clone();
        Groups::new(standard.clone(), &standard.without_shift(), &nulls, self.blocks)
    }

    /// Null flights that a part does not learn from: jitter, or seeds where there is too little.
    pub fn held_out_nulls(&self, part: Part) -> Vec<&'a [f64]> {
        let rows = if self.bank.jitter.len() >= LEAST_NULLS {
            &self.bank.jitter
        } else {
            &self.bank.seeds
        };
        let kept = rows.iter().enumerate().filter(|(i, _)| !part.teaches(*i));
        kept.map(|(_, r)| r.as_slice()).collect()
    }

    /// A flight of the bank as the airframe of the reference flights would have flown it: what it
    /// differs by from a nominal flight, by `share`, on a reference flight. Without references: as
    /// it is.
    pub fn placed(&self, flight: &[f64], which: usize, share: f64) -> Vec<f64> {
        let Some(reference) = self.references.get(which % self.references.len().max(1)) else {
            return flight.to_vec();
        };
        flight
            .iter()
            .zip(reference.iter().zip(&self.mean))
            .map(|(v, (r, m))| r + share * (v - m))
            .collect()
    }

    /// What a draw differs by from the same flight without the effect, by another law of it: off by `law`, relative, and
    /// independently in every statistic.
    pub fn effect(&self, draw: &Draw, law: f64, rng: &mut Stream) -> Vec<f64> {
        let twin = draw.twin.and_then(|twin| self.bank.jitter.get(twin));
        let base = twin.unwrap_or(&self.mean);
        let bent = |(v, b): (&f64, &f64)| (v - b) * (1.0 + law * rng.normal());
        draw.statistics.iter().zip(base).map(bent).collect()
    }

    /// The flight that draws would have been without their effects. `which`: of the references; `null`: a null flight, for
    /// draws without a twin.
    pub fn without_effect(&self, draw: &Draw, which: usize, null: Option<&[f64]>) -> Vec<f64> {
        match draw.twin.and_then(|twin| self.bank.jitter.get(twin)) {
            Some(twin) => self.placed(twin, which, HALF),
            // The noise of its seed is in what such a draw differs by: only what jitter does is missing.
            None if !self.references.is_empty() => self.placed(&self.mean, which, 0.0),
            None => {
                let null = null.unwrap_or(&self.mean);
                let off = |(v, m): (&f64, &f64)| {
                    m + Some(self.lacking * (v - m)).filter(|o| o.is_finite()).unwrap_or(0.0)
                };
                null.iter().zip(&self.mean).map(off).collect()
            }
        }
    }
}

/// A null flight of the bank, placed on the airframe, keeps this much of its own deviation: the
/// airframe has its constants already.
pub(super) const HALF: f64 = 0.5;
