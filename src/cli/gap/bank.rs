//! `haltere gap bank`: flies the bank of a mission.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::options::{BankOptions, SceneOptions};
use crate::cli::output::{print, print_json};
use crate::cli::which_flight::{WhichFlight, tell};
use crate::progress::Progress;
use haltere_gap::bank::make_bank::{Part, Recipe};
use haltere_gap::bank::missions;
use haltere_gap::bank::parts::{self, Stage, Standing};
use haltere_gap::bank::workshop::{BANK_SEED, Workshop};
use haltere_gap::flight::logs;
use haltere_gap::scene::Scene;
use haltere_log::written;

/// Flies the bank that flights of a mission are compared with, and keeps it.
///
/// Without a log: the standard diagnostic flight in the standard room.
#[derive(Debug, Args)]
pub struct BankCommand {
    /// A flight of the mission.
    log: Option<PathBuf>,
    #[command(flatten)]
    which: WhichFlight,
    #[command(flatten)]
    told: SceneOptions,
    #[command(flatten)]
    options: BankOptions,
    /// Flies part I of N and keeps it as a piece beside the bank: first of the flights without effect, and by the same
    /// command again, once those of all parts are there, of the effects (docs/CAMPAIGNS.md).
    #[arg(long, value_name = "I/N", conflicts_with = "join")]
    part: Option<Part>,
    /// Joins the pieces of N parts to the bank, byte for byte what flying it at once makes.
    #[arg(long, value_name = "N")]
    join: Option<usize>,
    /// Writes the bank as JSON too, for other methods.
    #[arg(long, value_name = "FILE", conflicts_with = "part")]
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
        let (folder, library, size) =
            (self.options.folder(), self.options.library()?, self.options.size());
        let recipe =
            Recipe { scene: &scene, items: &items, library: &library, size, seed: BANK_SEED };
        if let Some(part) = self.part {
            let progress = Progress::new("part of a bank");
            let standing = parts::fly(&folder, &recipe, part, |done, of| progress.at(done, of))?;
            return self.tell_part(part, standing);
        }
        let joined = self.join.map(|of| parts::join(&folder, &recipe, of)).transpose()?;
        let progress = Progress::new("bank");
        let mut workshop =
            Workshop::open(&folder, scene, items, library, size, |done, of| progress.at(done, of))?;
        workshop.lost.extend(joined.into_iter().flat_map(|made| made.lost));
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
    fn tell_part(&self, part: Part, standing: Standing) -> anyhow::Result<ExitCode> {
        let Standing { stage, there, of } = standing;
        if self.json {
            print_json(&json!({
                "part": part.number, "of": of, "flown": stage.words(), "parts_there": there,
            }))?;
            return Ok(ExitCode::SUCCESS);
        }
        let next = match (stage, there == of) {
            (Stage::Healthy, _) => {
                "; the same command flies the effects once all are there".to_owned()
            }
            (Stage::Effects, true) => format!("; `--join {of}` joins them"),
            (Stage::Effects, false) => String::new(),
        };
        let number = part.number;
        print(&format!(
            "part {number}: {} of {there} of {of} parts are there{next}\n",
            stage.words()
        ))?;
        Ok(ExitCode::SUCCESS)
    }
}
