//! A bank of the other world: what the diagnosis would know if its library held the laws of the generator.
//!
//! No user has it. It says how much of what is missed is lost between the laws of two worlds, and how much is not in the
//! statistics or not in the method (sim/lab/RUNS.md).

use std::path::Path;

use anyhow::{Result, anyhow};
use haltere::progress::Progress;
use haltere_gap::bank::axis::Axis;
use haltere_gap::bank::bank_file;
use haltere_gap::bank::make_bank::BankSize;
use haltere_gap::bank::{Bank, Draw, EffectDraws};
use haltere_gap::flight::statistics::specs;
use rayon::prelude::*;

use super::Bench;
use crate::cases::list::mixed;
use crate::generator::effects::{Deviations, Spec, known};
use crate::generator::hall;
use crate::generator::noise::Noise;

/// Shares of the drawn strength that are tried, largest first, until the mission is flown: steps of 0.7 as in the diagnosis' own
/// bank, down to a third (judgement).
const SHARES: [f64; 4] = [1.0, 0.7, 0.5, 0.35];

/// Flies as many flights as the diagnosis' own bank has, with twins as there, and writes the bank.
pub(super) fn write(bench: &Bench<'_>, path: &Path) -> Result<()> {
    let BankSize { seeds, jitter, draws } = BankSize::default();
    let specs_known: Vec<&'static Spec> = known().collect();
    let total = seeds + jitter + draws * specs_known.len();
    let progress = Progress::counted("flights of the bank", 0, total as u64);
    let seed = |number: usize| mixed(bench.seed ^ 0xba9c, number as u64);
    let healthy: Vec<Option<Vec<f64>>> = (0..seeds + jitter)
        .into_par_iter()
        .map(|k| {
            let name = format!("healthy-{k}");
            let seen = bench.fly(&name, seed(k), k >= seeds, Deviations::default())?;
            progress.advance(1);
            Ok(seen.filter(|seen| seen.landed && seen.whole).map(|seen| seen.statistics))
        })
        .collect::<Result<_>>()?;
    let jobs: Vec<(usize, usize)> =
        (0..specs_known.len()).flat_map(|place| (0..draws).map(move |k| (place, k))).collect();
    // Twins as places among all flights with jitter, until it is known which of these were flown.
    let flown: Vec<Option<Draw>> = jobs
        .par_iter()
        .map(|(place, k)| {
            let twin = (place * draws + k) % jitter;
            let part = [*k, draws];
            let found = draw(bench, specs_known[*place], part, twin, seed(seeds + twin))?;
            progress.advance(1);
            Ok(found)
        })
        .collect::<Result<_>>()?;
    progress.end();
    let mut bank =
        Bank { names: specs().iter().map(|s| s.name.clone()).collect(), ..Bank::default() };
    let mut places = Vec::new();
    for (k, row) in healthy.into_iter().enumerate() {
        let list = if k < seeds { &mut bank.seeds } else { &mut bank.jitter };
        if k >= seeds {
            places.push(row.is_some().then_some(list.len()));
        }
        list.extend(row);
    }
    for (spec, flights) in specs_known.iter().zip(flown.chunks(draws)) {
        let placed = |d: &Draw| Some(Draw { twin: places[d.twin]?, ..d.clone() });
        let draws: Vec<Draw> = flights.iter().flatten().filter_map(placed).collect();
        let parameters = draws.first().map_or(0, |d| d.theta.len());
        let axis = |k: usize| Axis::over(draws.iter().map(move |d| d.theta[k]));
        let axes = (0..parameters).map(axis).collect();
        bank.effects.push(EffectDraws { id: spec.id.to_owned(), axes, draws });
    }
    bank_file::write(path, &bank).map_err(|error| anyhow!("{error}"))?;
    Ok(())
}

/// One flight with an effect, weaker until it is flown to its end, by what was set. `twin`: place of the flight without it
/// among those with jitter.
fn draw(
    bench: &Bench<'_>,
    spec: &Spec,
    [k, of]: [usize; 2],
    twin: usize,
    seed: u64,
) -> Result<Option<Draw>> {
    let number = spec.id[1..].parse::<u64>()?;
    let own = mixed(bench.seed ^ 0xba9d, k as u64) ^ number;
    let [mild, strong] = spec.range.map(|size| spec.strength(size));
    // One in each of as many equal parts of the range as there are draws.
    let part = (k as f64 + Noise::new(own, "strength").uniform()) / of as f64;
    for share in SHARES {
        let size = spec.size(share * (mild + (strong - mild) * part));
        let mut deviations = Deviations::default();
        let mut noise = Noise::new(own, spec.id);
        let set = spec.apply(size, &mut noise, &hall(bench.scene), &mut deviations);
        let name = format!("{}-{k}", spec.id);
        let seen = bench.fly(&name, seed, true, deviations)?;
        if let Some(seen) = seen.filter(|seen| seen.landed && seen.whole) {
            let mut theta: Vec<f64> = set.parameters.values().copied().collect();
            theta.extend(set.place_NE_m.into_iter().flatten());
            return Ok(Some(Draw { theta, seed, twin, statistics: seen.statistics }));
        }
    }
    Ok(None)
}
