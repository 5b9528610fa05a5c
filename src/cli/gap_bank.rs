//! `haltere gap bank`: flies the bank of a mission.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::gap::{BankOptions, SceneOptions};
use super::which_flight::{WhichFlight, tell};
use super::{print, print_json};
use crate::progress::Progress;
use haltere_gap::bank::missions;
use haltere_gap::bank::workshop::Workshop;
use haltere_gap::flight::logs;
use haltere_gap::scene::Scene;
use haltere_log::written;

/// Flies the bank that flights of a mission are compared with, and keeps it.
///
/// Without a log: the standard diagnostic flight in the standard room.
#[derive(Debug, Args)]
pub(super) struct BankCommand {
    /// A flight of the mission.
    log: Option<PathBuf>,
    #[command(flatten)]
    which: WhichFlight,
    #[command(flatten)]
    told: SceneOptions,
    #[command(flatten)]
    options: BankOptions,
    /// Writes the bank as JSON too, for other methods.
    #[arg(long, value_name = "FILE")]
    export: Option<PathBuf>,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

impl BankCommand {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let inputs: Vec<&PathBuf> = self.log.iter().chain(self.told.vehicle_file()).collect();
        if let Some(path) = &self.export {
            written::look(path, &inputs)?;
        }
        let told = self.told.told()?;
        let (scene, items) = match &self.log {
            Some(log) => {
                let flown = logs::read_flight(log, self.which.number())?;
                tell(log, flown.flight);
                (flown.scene(&told).for_bank(&flown.mission), flown.mission)
            }
            None => {
                let lab = Scene::lab().map_err(anyhow::Error::new)?;
                let room = told.room.unwrap_or_else(|| lab.room.clone());
                let scene = Scene { room, vehicle: told.vehicle, ..lab };
                let items = missions::diagnostic(&scene);
                (scene, items)
            }
        };
        let started = Instant::now();
        let progress = Progress::new("bank");
        let workshop = Workshop::open(
            &self.options.folder(),
            scene,
            items,
            self.options.library()?,
            self.options.size(),
            |done, of| progress.at(done, of),
        )?;
        let bank = &workshop.bank;
        if let Some(path) = &self.export {
            let text = serde_json::to_string(bank)?;
            written::write(path, text, &inputs)?;
        }
        let draws: usize = bank.effects.iter().map(|e| e.draws.len()).sum();
        let seconds = started.elapsed().as_secs_f64();
        if self.json {
            print_json(&json!({
                "bank": format!("{:016x}", workshop.bank_hash),
                "seeds": bank.seeds.len(),
                "jitter": bank.jitter.len(),
                "effects": bank.effects.len(),
                "draws": draws,
                "lost": workshop.lost,
                "seconds": seconds,
            }))?;
        } else {
            print(&format!(
                "bank {:016x}: {} nominal flights, {} with jitter, {draws} of {} effects; {seconds:.0} s\n",
                workshop.bank_hash,
                bank.seeds.len(),
                bank.jitter.len(),
                bank.effects.len(),
            ))?;
            for (id, count) in &workshop.lost {
                let of = if id.is_empty() { "without effect" } else { id };
                print(&format!("  {of}: {count} flights could not be flown or observed\n"))?;
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}
