//! What the program makes of a world: the vehicle commissioned to accepted flights, its bank, and the statistics of every flight.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use haltere_gap::bank::bank_file::{self, to_disk};
use haltere_gap::bank::library;
use haltere_gap::bank::make_bank::BankSize;
use haltere_gap::bank::workshop::Workshop;
use haltere_gap::commission::commission_traces;
use haltere_gap::flight::statistics::statistics_of;
use haltere_gap::flight::trace::Trace;
use haltere_gap::nominal::Nominal;
use haltere_gap::scene::Scene;
use haltere_log::written;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::flown::{Flyable, Row};
use crate::score::Truth;

/// What is kept of a world.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Seen {
    /// Its seed, after as many draws that did not fly.
    pub seed: u64,
    /// See `seed`.
    pub redrawn: u64,
    /// Its mass, kg.
    pub mass_kg: f64,
    /// Blocks in which the commissioned simulator is farther than a simulator of this vehicle is: distance over limit.
    pub beyond: Vec<(String, f64)>,
    /// Names of the statistics.
    pub names: Vec<String>,
    /// Accepted flights.
    pub accepted: Vec<Vec<Option<f64>>>,
    /// Flights to judge.
    pub rows: Vec<Row>,
    /// Processor time for world, commissioning and bank, s.
    pub processor_s: [f64; 3],
}

/// Processor time of this process, s.
pub fn processor_s() -> f64 {
    let used = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::new(used.tv_sec.cast_unsigned(), u32::try_from(used.tv_nsec).unwrap_or(0))
        .as_secs_f64()
}

/// Flies a world, commissions the owner's file to its accepted flights and flies the bank, of that size, which lands at `bank`.
pub fn seen(
    flyable: &Flyable,
    size: BankSize,
    begun_s: f64,
    bank: &Path,
    tell: &(dyn Fn(String) + Sync),
) -> Result<Seen> {
    let Flyable { scene, items, accepted, .. } = flyable;
    let steps = AtomicUsize::new(0);
    let told = |what: &'static str| {
        let steps = &steps;
        move |done: usize, of: usize| {
            if done / 200 != steps.swap(done / 200, Ordering::Relaxed) && done > 0 {
                tell(format!("{what}: {done} of {of} flights"));
            }
        }
    };
    let flown_s = processor_s();
    let traces: Vec<&Trace> = accepted.iter().collect();
    let found = commission_traces(scene, items, &traces, told("commissioning"))
        .map_err(anyhow::Error::new)?;
    let nearer = found.whole.before.is_nan() || found.whole.after < found.whole.before;
    let vehicle = if nearer { found.vehicle.clone() } else { scene.vehicle.clone() };
    tell(format!("commissioned: {:.1}, before {:.1}", found.whole.after, found.whole.before));
    let commissioned_s = processor_s();
    let scene = Scene { vehicle, ..scene.clone() }.for_bank(items);
    let folder = tempfile::tempdir()?;
    let workshop = Workshop::open(
        folder.path(),
        scene.clone(),
        items.clone(),
        library::standard(),
        size,
        told("bank"),
    )
    .map_err(anyhow::Error::new)?;
    bank_file::write(bank, &workshop.bank).map_err(|error| anyhow!("{error}"))?;
    let bank_s = processor_s();
    let nominal = Nominal::of_scene(&scene);
    let observed = |trace: &Trace| statistics_of(trace, &nominal).ok().map(|row| to_disk(&row));
    let healthy = flyable.healthy.iter().map(|(session, trace)| Row {
        truth: Truth::NoGap,
        times: 0.0,
        session: *session,
        statistics: observed(trace),
    });
    let mut rows: Vec<Row> = healthy.collect();
    rows.par_extend(flyable.jobs().into_par_iter().map(|job| Row {
        statistics: flyable.fly(&job).ok().as_ref().and_then(observed),
        truth: job.truth,
        times: job.times,
        session: job.session,
    }));
    let accepted: Option<Vec<_>> = accepted.iter().map(observed).collect();
    let beyond = found.blocks.iter().filter(|n| !n.holds());
    let judged_s = processor_s();
    Ok(Seen {
        seed: flyable.world.seed,
        redrawn: flyable.redrawn,
        mass_kg: flyable.world.craft.stated_kg,
        beyond: beyond.map(|n| (n.block.to_owned(), n.after / n.limit)).collect(),
        names: workshop.bank.names.clone(),
        accepted: accepted.context("an accepted flight cannot be observed")?,
        rows,
        processor_s: [
            flown_s - begun_s + judged_s - bank_s,
            commissioned_s - flown_s,
            bank_s - commissioned_s,
        ],
    })
}

/// Keeps it.
pub fn remember(path: &Path, seen: &Seen) -> Result<()> {
    let text = serde_json::to_string(seen)? + "\n";
    Ok(written::write(path, text, &[""; 0])?)
}

/// What was kept.
pub fn recall(path: &Path) -> Result<Seen> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    serde_json::from_str(&text).with_context(|| path.display().to_string())
}
