//! The second variant of the sealed suite: every effect is taken out of the library in turn, and its
//! flights are diagnosed without it. The right answer is then "not in the library", and where.
//!
//! Which flights belong to which effect stands in the keys; the scorer chooses by them, the diagnosis
//! sees the flight alone.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Serialize;

use haltere_gap::attribute::Attributor;
use haltere_gap::bank::library;
use haltere_gap::flight::statistics::specs;
use haltere_gap::outcome::Outcome;
use haltere_gap::scene::Told;
use haltere_model::effects::Block;

use crate::blind::hall::{Bench, Hall, statistics};
use crate::blind::{BlindError, Choice, Entry, Key, Suite, open, read};
use crate::score::Share;

/// Flights of one effect, diagnosed by a library without it.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Withheld {
    /// Flights.
    pub flights: usize,
    /// Said to be not in the library.
    pub rejected: usize,
    /// Said to be another effect, with something left over.
    pub with_remainder: usize,
    /// Loudest block is the true one, whatever was said.
    pub block: usize,
    /// What was said, and how often: an effect's id, or the outcome.
    pub said: BTreeMap<String, usize>,
}

/// All effects.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WithheldResult {
    /// By the id of the effect.
    pub effects: BTreeMap<String, Withheld>,
    /// Said to be not in the library, of flights with an alarm or without.
    pub rejected: Share,
    /// Right block.
    pub block: Share,
}

/// Diagnoses single effects of the diagnostic mission, each without its own effect in the library.
pub fn run(
    dir: &Path,
    banks: &Path,
    told: &Told,
    choice: &Choice,
    tell: &(impl Fn(String) + Sync),
) -> Result<WithheldResult, BlindError> {
    let (suite, _): (Suite, _) = read(&dir.join("cases.json"))?;
    let chosen = |c: &&Entry| {
        c.mission == "diagnostic"
            && (!choice.tenth || c.tenth)
            && (!c.lockbox || choice.lockbox)
            && dir.join(&c.log).exists()
    };
    let mut by_effect: BTreeMap<String, Vec<(&Entry, Key)>> = BTreeMap::new();
    for case in suite.cases.iter().filter(chosen) {
        let key = open(dir, case)?;
        if let ("single", [effect]) = (key.class.as_str(), &key.effects[..]) {
            by_effect.entry(effect.id.clone()).or_default().push((case, key));
        }
    }
    let Some((first, _)) = by_effect.values().flatten().next() else {
        return Err(BlindError::Empty(dir.to_owned()));
    };
    let library = library::standard();
    let hall = Hall { dir, banks, told, choice, suite: &suite, library: &library };
    let Bench { workshop, references, calibration, .. } = hall.bench(first, None, tell)?;
    let blocks: Vec<Block> = specs().iter().map(|s| s.block).collect();
    let started = std::time::Instant::now();
    let of = by_effect.len();
    let mut effects = BTreeMap::new();
    for (k, (id, cases)) in by_effect.iter().enumerate() {
        let mut bank = workshop.bank.clone();
        bank.effects.retain(|effect| effect.id != *id);
        let attributor =
            Attributor::new(&bank, &references, &calibration, &blocks, &choice.settings)
                .map_err(BlindError::Learn)?;
        let mut row = Withheld::default();
        for (case, key) in cases {
            let seen = statistics(dir, std::iter::once(&case.log), &workshop);
            let Some(seen) = seen.first() else { continue };
            let verdict = attributor.attribute(seen);
            row.flights += 1;
            row.rejected += usize::from(matches!(verdict.outcome, Outcome::NotInLibrary { .. }));
            row.with_remainder +=
                usize::from(matches!(verdict.outcome, Outcome::NamedWithRemainder { .. }));
            let truth = key.effects.first().map(|e| e.block.as_str());
            row.block += usize::from(verdict.blocks.first().map(|b| b.block.as_str()) == truth);
            let said = match verdict.outcome.effects() {
                [] => verdict.outcome.key().to_owned(),
                [first, ..] => first.id.clone(),
            };
            *row.said.entry(said).or_default() += 1;
        }
        effects.insert(id.clone(), row);
        let left_s = started.elapsed().as_secs_f64() / (k + 1) as f64 * (of - k - 1) as f64;
        tell(format!("{} of {of} effects withheld, {left_s:.0} s left", k + 1));
    }
    let total = |of: fn(&Withheld) -> usize| effects.values().map(of).sum::<usize>();
    let flights = total(|w| w.flights);
    Ok(WithheldResult {
        rejected: Share::new(total(|w| w.rejected), flights),
        block: Share::new(total(|w| w.block), flights),
        effects,
    })
}

impl WithheldResult {
    /// Table for people.
    pub fn table(&self) -> String {
        use std::fmt::Write;
        let mut out = String::new();
        for (name, s) in [("not in the library", &self.rejected), ("right block", &self.block)] {
            let share = s.value().unwrap_or(f64::NAN);
            let limits = format!("[{:.3}, {:.3}]", s.low, s.high);
            let _ = writeln!(out, "{name:<34} {share:6.3}  {limits}  {} of {}", s.hits, s.of);
        }
        for (id, w) in &self.effects {
            let said: Vec<String> = w.said.iter().map(|(n, c)| format!("{n} {c}")).collect();
            let _ = writeln!(
                out,
                "  {id:<4} {} flights, {} not in the library, {} right block; said {}",
                w.flights,
                w.rejected,
                w.block,
                said.join(", ")
            );
        }
        out
    }
}
