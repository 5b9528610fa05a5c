//! The flights that an attributor learns from, and flights made of them.

use super::Settings;
use super::blocks::Groups;
use super::library::{Library, Part};
use super::scatter::{Hours, Scatter, in_sigma};
use super::whiten::{Standard, Whitening};
use crate::bank::{Bank, Draw};
use haltere_model::effects::Block;
use haltere_model::random::Stream;

/// Bank, references and blocks, with what healthy flights scatter by.
pub(super) struct Teachers<'a> {
    /// The bank.
    pub bank: &'a Bank,
    /// Accepted flights.
    pub references: &'a [Vec<f64>],
    /// Accepted flights that only limits come from.
    pub calibration: &'a [Vec<f64>],
    /// What another hour than theirs may add.
    pub hours: Hours<'a>,
    blocks: &'a [Block],
    /// Of every statistic; of one that no flight of the bank knows, nothing.
    scatter: Vec<Scatter>,
}

impl<'a> Teachers<'a> {
    /// Collects. `more`: variance that another hour adds to every statistic, in variances within one, or empty.
    pub fn new(
        bank: &'a Bank,
        references: &'a [Vec<f64>],
        blocks: &'a [Block],
        more: &'a [f64],
    ) -> Self {
        let rows = |of: &'a [Vec<f64>]| of.iter().map(Vec::as_slice).collect::<Vec<_>>();
        let accepted = rows(references);
        let [seeds, jitter] = [&bank.seeds, &bank.jitter].map(|flights| rows(flights));
        let hours = Hours::of(more, references.len());
        let of = |j: usize| Scatter::of(j, [&seeds, &jitter], &accepted, hours).unwrap_or_default();
        let scatter = (0..bank.names.len()).map(of).collect();
        Self { bank, references, calibration: &[], hours, blocks, scatter }
    }

    /// References as rows.
    pub fn reference_rows(&self) -> Vec<&'a [f64]> {
        self.references.iter().map(Vec::as_slice).collect()
    }

    /// Learns from a part how healthy flights scatter. `allowed`: statistics that may be used, by place.
    pub fn whitening(
        &self,
        part: Part,
        references: &[&[f64]],
        allowed: impl Fn(usize) -> bool,
        settings: &Settings,
    ) -> Whitening {
        let taught = |rows: &'a [Vec<f64>]| -> Vec<&'a [f64]> {
            let kept = rows.iter().enumerate().filter(|(i, _)| part.teaches(*i));
            kept.map(|(_, row)| row.as_slice()).collect()
        };
        let [seeds, jitter] = [&self.bank.seeds, &self.bank.jitter].map(|rows| taught(rows));
        let draws = self.bank.effects.iter().flat_map(|effect| {
            let kept = effect.draws.iter().enumerate().filter(|(i, _)| part.teaches(*i));
            kept.map(|(_, draw)| draw.statistics.as_slice())
        });
        let standard = Standard::new(
            [&seeds, &jitter],
            draws,
            references,
            &settings.resolution,
            self.hours,
            allowed,
        );
        Whitening::new(standard, &jitter, references)
    }

    /// Learns from a part, beside all accepted flights.
    pub fn library(
        &self,
        part: Part,
        allowed: impl Fn(usize) -> bool,
        settings: &Settings,
    ) -> Library {
        let whitening = self.whitening(part, &self.reference_rows(), allowed, settings);
        Library::new(self.bank, part, whitening)
    }

    /// Blocks by the same whitening.
    pub fn groups(&self, library: &Library) -> Groups {
        Groups::new(&library.whitening, self.blocks)
    }

    /// Flights with jitter that a part does not learn from.
    pub fn held_out_nulls(&self, part: Part) -> Vec<&'a [f64]> {
        let kept = self.bank.jitter.iter().enumerate().filter(|(i, _)| !part.teaches(*i));
        kept.map(|(_, r)| r.as_slice()).collect()
    }

    /// A flight of the bank as the airframe of the accepted flights would have flown it: as many sigma of its next flight from their
    /// middle as it lies from that of the bank. Without accepted flights: as it is.
    pub fn placed(&self, flight: &[f64]) -> Vec<f64> {
        let at = |(value, scatter): (&f64, &Scatter)| match scatter.accepted {
            Some([middle, _]) => middle + scatter.next[0] * in_sigma(*value, scatter.bank),
            None => *value,
        };
        flight.iter().zip(&self.scatter).map(at).collect()
    }

    /// An accepted flight as it would have been in another hour and with other constants, of that number: these differ as those flights of
    /// the bank do that this part does not learn from. Those that it learned from would look like noise that it knows.
    pub fn elsewhen(&self, flight: &[f64], part: Part, hour: usize) -> Vec<f64> {
        let unknown = self.held_out_nulls(part);
        let Some(by) = unknown.get(hour % unknown.len().max(1)) else {
            return flight.to_vec();
        };
        let moved = |((value, by), scatter): ((&f64, &f64), &Scatter)| {
            let off = scatter.next[1] * in_sigma(*by, scatter.bank);
            value + if off.is_finite() { off } else { 0.0 }
        };
        flight.iter().zip(*by).zip(&self.scatter).map(moved).collect()
    }

    /// What a draw differs by from the same flight without the effect, by another law of it: off by `law`, relative, and
    /// independently in every statistic.
    pub fn effect(&self, draw: &Draw, law: f64, rng: &mut Stream) -> Vec<f64> {
        let base = &self.bank.jitter[draw.twin];
        let bent = |(v, b): (&f64, &f64)| (v - b) * (1.0 + law * rng.normal());
        draw.statistics.iter().zip(base).map(bent).collect()
    }

    /// The flight that a draw would have been without its effect.
    pub fn without_effect(&self, draw: &Draw) -> Vec<f64> {
        self.placed(&self.bank.jitter[draw.twin])
    }
}
