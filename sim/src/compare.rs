//! `haltere-sim steps`: the step tests, `raw` against `modified`, beside the source's figures.

use std::time::Instant;

use anyhow::{Context, Result, bail};
use rayon::prelude::*;
use serde_json::json;

use haltere::sources::{self, Sources};
use haltere_core::control::{ControlConfig, Version};
use haltere_model::PlantConfig;
use haltere_model::lockstep::Lockstep;
use haltere_pilot::PilotConfig;

use crate::paper::source;
use crate::steps::{AXES, SIZES_M, StepScore, WINDOW_S, fly_steps, is_complete, mean_of};
use crate::variation::{VARIATIONS, Variation};

/// First seed of the scores.
const SCORE_SEED: u64 = 100;

/// `haltere-sim steps`
#[derive(Debug, clap::Args)]
pub struct StepOptions {
    /// Repetitions, each with a seed of its own; five as in the source.
    #[arg(long, default_value_t = 5)]
    pub repetitions: u64,
    /// Configuration whose `[control]` and `[estimator]` sections are flown.
    #[arg(long, value_name = "FILE")]
    pub config: Option<std::path::PathBuf>,
    /// Change one key, as for the companion.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Fly this one of the variations of the vehicle that the search uses; 0 is the nominal one.
    #[arg(long, default_value_t = 0)]
    pub variation: usize,
    /// Print JSON instead of the table.
    #[arg(long)]
    pub json: bool,
}

/// The hall with the nominal vehicle, flown by this configuration.
pub fn world(
    pilot: &PilotConfig,
    control: &ControlConfig,
    variation: &Variation,
    seed: u64,
) -> Result<Lockstep> {
    let plant = variation.plant(PlantConfig::hall(seed))?;
    in_plant(pilot, &variation.control(control), plant)
}

/// Any plant, flown by this configuration.
pub fn in_plant(
    pilot: &PilotConfig,
    control: &ControlConfig,
    plant: PlantConfig,
) -> Result<Lockstep> {
    let mut pilot = PilotConfig { control: control.clone(), ..pilot.clone() };
    pilot.flight.gear_height_m = plant.vehicle.body.gear_m;
    pilot.board_north_offset_rad = 0.0;
    let survey = plant.survey.clone();
    Ok(Lockstep::new(plant, pilot, &survey)?.without_topics())
}

/// Middle of the hall.
pub const CENTRE_NE_M: [f64; 2] = [5.0, 5.0];

/// A flight of the step tests.
pub struct Flown {
    /// Of each step.
    pub scores: Vec<StepScore>,
    /// Simulated time, s.
    pub length_s: f64,
    /// Ended disarmed on the floor.
    pub landed: bool,
}

/// Flies the step tests; a flight without all of its steps is an error.
pub fn fly(
    pilot: &PilotConfig,
    control: &ControlConfig,
    variation: &Variation,
    seed: u64,
) -> Result<Flown> {
    let mut world = world(pilot, control, variation, seed)?;
    let (scores, flight) = fly_steps(&mut world, CENTRE_NE_M)?;
    let crashed = flight.samples.iter().any(|s| s.truth.crashed);
    if !is_complete(&scores) || crashed {
        bail!(
            "seed {seed}: {} of {} steps, {}; {:?}",
            scores.len(),
            2 * AXES.len() * SIZES_M.len(),
            if crashed { "crashed" } else { "not crashed" },
            flight.texts.last()
        );
    }
    Ok(Flown { scores, length_s: world.t_us() as f64 * 1e-6, landed: flight.landed })
}

/// What the companion is configured to, without a disk.
pub fn pilot_config(file: Option<&std::path::Path>, set: &[String]) -> Result<PilotConfig> {
    let files = file.map(std::path::Path::to_path_buf).into_iter().collect();
    let config = sources::load(&Sources::new(files, set.to_vec()))?;
    // Nobody here answers for a disk.
    Ok(PilotConfig { store: false, ..config.pilot() })
}

/// Flies and prints. `false`: a target is missed.
pub fn steps(options: &StepOptions) -> Result<bool> {
    let pilot = pilot_config(options.config.as_deref(), &options.set)?;
    let variation = VARIATIONS.get(options.variation).context("no such variation")?;
    let started = Instant::now();
    let jobs: Vec<(Version, u64)> = [Version::Raw, Version::Modified]
        .into_iter()
        .flat_map(|v| (0..options.repetitions).map(move |i| (v, SCORE_SEED + i)))
        .collect();
    let flights: Vec<(Version, Flown)> = jobs
        .into_par_iter()
        .map(|(version, seed)| {
            let control = ControlConfig { version, ..pilot.control.clone() };
            fly(&pilot, &control, variation, seed).map(|flown| (version, flown))
        })
        .collect::<Result<_>>()?;
    let of = |version: Version| -> Vec<StepScore> {
        flights.iter().filter(|f| f.0 == version).flat_map(|f| f.1.scores.clone()).collect()
    };
    let (raw, modified) = (of(Version::Raw), of(Version::Modified));
    let flown_s: f64 = flights.iter().map(|f| f.1.length_s).sum();
    let not_landed = flights.iter().filter(|f| !f.1.landed).count();
    let mut rows = Vec::new();
    let mut ok = not_landed == 0;
    for (axis, axis_name) in AXES.iter().enumerate() {
        let mut ratios = Vec::new();
        for (i, size_m) in SIZES_M.into_iter().enumerate() {
            let get = |scores: &[StepScore], pick: fn(&StepScore) -> f64| {
                mean_of(scores, axis, size_m, pick).context("no steps were flown")
            };
            let raw_m = get(&raw, |s| s.position_mae_m)?;
            let modified_m = get(&modified, |s| s.position_mae_m)?;
            ratios.push(raw_m / modified_m);
            ok &= modified_m <= source::MODIFIED_M[i][axis];
            rows.push(json!({
                "axis": axis_name,
                "size_m": size_m,
                "raw_mae_m": raw_m,
                "modified_mae_m": modified_m,
                "ratio": raw_m / modified_m,
                "raw_seen_mae_m": get(&raw, |s| s.seen_mae_m)?,
                "modified_seen_mae_m": get(&modified, |s| s.seen_mae_m)?,
                "raw_rest_mae_m": get(&raw, |s| s.rest_mae_m)?,
                "modified_rest_mae_m": get(&modified, |s| s.rest_mae_m)?,
                "raw_overshoot_m": get(&raw, |s| s.overshoot_m)?,
                "modified_overshoot_m": get(&modified, |s| s.overshoot_m)?,
                "raw_velocity_mae_mps": get(&raw, |s| s.velocity_mae_mps)?,
                "modified_velocity_mae_mps": get(&modified, |s| s.velocity_mae_mps)?,
                "source_modified_mae_m": source::MODIFIED_M[i][axis],
                "source_ratio": source::RATIO[i][axis],
            }));
        }
        if axis < 2 {
            ok &= ratios.iter().sum::<f64>() / ratios.len() as f64 >= 1.5;
        }
    }
    let took_s = started.elapsed().as_secs_f64();
    if options.json {
        println!(
            "{}",
            json!({ "window_s": WINDOW_S, "ok": ok, "not_landed": not_landed, "steps": rows })
        );
        return Ok(ok);
    }
    println!(
        "                                       source             of it: seen    at rest   overshoot"
    );
    println!(
        "axis size   raw m  modified m  ratio   modified  ratio    raw   mod    raw   mod    raw   mod"
    );
    for row in &rows {
        let f = |key: &str| row[key].as_f64().unwrap_or(f64::NAN);
        println!(
            "{:>4} {:>3.0} m  {:6.3}  {:10.3}  {:5.2}   {:8.3}  {:5.2}  {:.3} {:.3}  {:.3} {:.3}  \
             {:.3} {:.3}",
            row["axis"].as_str().unwrap_or(""),
            f("size_m"),
            f("raw_mae_m"),
            f("modified_mae_m"),
            f("ratio"),
            f("source_modified_mae_m"),
            f("source_ratio"),
            f("raw_seen_mae_m"),
            f("modified_seen_mae_m"),
            f("raw_rest_mae_m"),
            f("modified_rest_mae_m"),
            f("raw_overshoot_m"),
            f("modified_overshoot_m"),
        );
    }
    if not_landed > 0 {
        println!("{not_landed} flights did not end on the floor, disarmed");
    }
    println!(
        "mean |truth - command| over {WINDOW_S:.0} s after each step; {} flights, {flown_s:.0} s \
         simulated in {took_s:.2} s",
        flights.len()
    );
    Ok(ok)
}
