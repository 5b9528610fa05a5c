//! The flights that an attributor learns from, and flights made of them.

use super::Settings;
use super::blocks::Groups;
use super::library::{Library, Part};
use super::whiten::{LEAST_REFERENCES, variance};
use crate::bank::{Bank, Draw};
use haltere_model::effects::Block;
use haltere_model::random::Stream;

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
    /// What another session adds to every statistic, one sigma, in its unit; empty: nothing.
    elsewhen: Vec<f64>,
}

impl<'a> Teachers<'a> {
    /// Collects.
    pub fn new(
        bank: &'a Bank,
        references: &'a [Vec<f64>],
        blocks: &'a [Block],
        sessions: &[f64],
    ) -> Self {
        let width = bank.names.len();
        // Jitter is even to both sides: together they know the middle best.
        let mean = |j: usize| {
            let nulls = bank.seeds.iter().chain(&bank.jitter).map(|row| row[j]);
            let known = nulls.filter(|v| v.is_finite());
            let (sum, n) = known.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
            sum / n
        };
        let mean = (0..width).map(mean).collect();
        let rows: Vec<&[f64]> = references.iter().map(Vec::as_slice).collect();
        let std = |(j, ratio): (usize, &f64)| (ratio * variance(&rows, j)).sqrt();
        let elsewhen = match references.len() >= LEAST_REFERENCES {
            true => sessions.iter().enumerate().map(std).collect(),
            false => Vec::new(),
        };
        Self { bank, references, calibration: &[], blocks, mean, elsewhen }
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
        let standard = library.whitening.standard.clone();
        let nulls = rows(&self.bank.jitter);
        Groups::new(standard.clone(), &standard.without_shift(), &nulls, self.blocks)
    }

    /// Flights with jitter that a part does not learn from.
    pub fn held_out_nulls(&self, part: Part) -> Vec<&'a [f64]> {
        let kept = self.bank.jitter.iter().enumerate().filter(|(i, _)| !part.teaches(*i));
        kept.map(|(_, r)| r.as_slice()).collect()
    }

    /// A flight of the bank as the airframe of the reference flights would have flown it: what it
    /// differs by from a nominal flight, by `share`, on a reference flight. Without references: as
    /// it is.
    pub fn placed(&self, flight: &[f64], which: usize, share: f64) -> Vec<f64> {
        let Some(reference) = self.references.get(which % self.references.len().max(1)) else {
            return flight.to_vec();
        };
        let here = flight.iter().zip(reference.iter().zip(&self.mean));
        self.elsewhen(here.map(|(v, (r, m))| r + share * (v - m)).collect(), which)
    }

    /// A flight of the airframe as it would have been in another session, of that number.
    pub fn elsewhen(&self, mut flight: Vec<f64>, session: usize) -> Vec<f64> {
        let mut rng = Stream::new(session as u64, "another session");
        flight.iter_mut().zip(&self.elsewhen).for_each(|(v, std)| *v += std * rng.normal());
        flight
    }

    /// What a draw differs by from the same flight without the effect, by another law of it: off by `law`, relative, and
    /// independently in every statistic.
    pub fn effect(&self, draw: &Draw, law: f64, rng: &mut Stream) -> Vec<f64> {
        let base = &self.bank.jitter[draw.twin];
        let bent = |(v, b): (&f64, &f64)| (v - b) * (1.0 + law * rng.normal());
        draw.statistics.iter().zip(base).map(bent).collect()
    }

    /// The flight that a draw would have been without its effect. `which`: of the references.
    pub fn without_effect(&self, draw: &Draw, which: usize) -> Vec<f64> {
        self.placed(&self.bank.jitter[draw.twin], which, HALF)
    }
}

/// A null flight of the bank, placed on the airframe, keeps this much of its own deviation: the
/// airframe has its constants already.
pub(super) const HALF: f64 = 0.5;
