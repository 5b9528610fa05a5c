//! `haltere-lab beside`: the steps of the source's table 3 in the generator's world, for `haltere-lab paper --beside`.
//!
//! No gain was tuned there, and its physics is not that of the simulator (see `generator`): what `modified` gains over
//! `raw` here was not fitted to here.

use std::path::PathBuf;

use crate::paper::beside::Beside;
use crate::paper::table_3::{Flown, WINDOWS_S, fly};
use anyhow::{Context, Result};
use haltere_core::control::{ControlConfig, Version};
use haltere_gap::scene::Scene;
use haltere_model::lockstep::Lockstep;
use haltere_model::{PlantConfig, Vehicle};
use rayon::prelude::*;

use crate::generator::{Foreign, Setup};

/// First seed; none was looked for.
const SEED: u64 = 500;

/// `haltere-lab beside`
#[derive(Debug, clap::Args)]
pub struct Options {
    /// The file to write, as JSON.
    file: PathBuf,
    /// Repetitions, each with a seed of its own; five as in the source.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=1000))]
    repetitions: u64,
    /// Configuration that is flown; as for `haltere-lab paper`.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Change one key, as for the companion.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// Flies both versions on the same seeds and writes what they showed.
pub fn run(options: &Options) -> Result<bool> {
    let inputs: Vec<&PathBuf> = options.config.iter().collect();
    haltere_log::written::look(&options.file, &inputs)?;
    let pilot = crate::compare::pilot_config(options.config.as_deref(), &options.set)?;
    // The source's hall, as the steps are flown in the simulator.
    let PlantConfig { room, survey, start_E_m, .. } = PlantConfig::hall(SEED);
    let vehicle = Vehicle::default();
    let scene = |version: Version| {
        let mut pilot = pilot.clone();
        pilot.control = ControlConfig { version, ..pilot.control };
        pilot.flight.gear_height_m = vehicle.body.gear_m;
        pilot.board_north_offset_rad = 0.0;
        Scene {
            room: room.clone(),
            survey: survey.clone(),
            start_NE_m: [start_E_m.x(), start_E_m.y()],
            vehicle: vehicle.clone(),
            pilot,
            until_s: None,
        }
    };
    let flown = |version: Version| -> Result<Vec<Flown>> {
        let scene = scene(version);
        (SEED..SEED + options.repetitions)
            .into_par_iter()
            .map(|seed| {
                let world = Foreign::new(Setup::healthy(&scene, seed));
                let mut lockstep =
                    Lockstep::in_world(world, scene.pilot.clone(), &scene.survey, None)
                        .without_topics();
                let (flown, _) =
                    fly(&mut lockstep).with_context(|| format!("{version:?}, seed {seed}"))?;
                Ok(flown)
            })
            .collect()
    };
    let beside = Beside {
        world: "the generator of the sealed suite".into(),
        windows_s: WINDOWS_S.to_vec(),
        raw: flown(Version::Raw)?,
        modified: flown(Version::Modified)?,
    };
    let text = serde_json::to_string_pretty(&beside)?;
    haltere_log::written::write::<&PathBuf>(&options.file, text, &[])?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is written is what `--beside` reads, and what is spoilt is refused with the way out.
    #[test]
    fn prop_the_other_side_reads_what_is_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("beside.json");
        let options = Options { file: file.clone(), repetitions: 1, config: None, set: Vec::new() };
        assert!(run(&options).expect("flown"));
        let read = Beside::read(&file).expect("read");
        assert_eq!([read.raw.len(), read.modified.len()], [1, 1]);
        let spoil = |change: &dyn Fn(&mut Beside)| {
            let mut other = read.clone();
            change(&mut other);
            std::fs::write(&file, serde_json::to_string(&other).expect("JSON")).expect("written");
            Beside::read(&file).expect_err("spoilt").to_string()
        };
        let said = spoil(&|b| b.windows_s[0] = 1);
        assert!(said.contains("windows_s = [1, ") && said.contains("anew"), "{said}");
        let said = spoil(&|b| b.raw.clear());
        assert!(said.contains("0 flights of raw and 1 of modified"), "{said}");
        let said = spoil(&|b| b.modified[0].errors[3].rest = 0.0);
        assert!(said.contains("flight 1 lacks an error"), "{said}");
        std::fs::write(&file, "{}").expect("written");
        assert!(
            Beside::read(&file).expect_err("no such").to_string().contains("haltere-lab beside")
        );
    }
}
