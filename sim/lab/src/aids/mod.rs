//! `haltere-lab aids`: what magnetometer, barometer, slow force and the survey check are worth, in lockstep, with
//! and without. The recorded flights have no magnetometer, so this is all that is known of it.

mod anchors;
mod baro;
mod heading;
mod shadow;
mod wind;

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Result, bail};
use haltere_dialect::mav::haltere::{MavCmd, MavResult};

use haltere::named_missions::SHAPES;
use haltere_core::control::Version;
use haltere_model::PlantConfig;
use haltere_model::lockstep::{Ground, Lockstep};
use haltere_pilot::{Mode, PilotConfig};

use crate::paths::fly_path;
use crate::recorded::ranging::{self, ROOMS};
use rayon::prelude::*;

/// First seed.
const SEED: u64 = 700;
/// Time to arm and to climb, µs.
const PATIENCE_US: u64 = 40_000_000;

/// `haltere-lab aids`
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Flights of each kind.
    #[arg(long, default_value_t = 20)]
    pub flights: u64,
    /// Write the page into this file instead of printing it.
    #[arg(long, value_name = "FILE")]
    pub document: Option<PathBuf>,
}

/// Flies everything and writes the page.
pub fn run(options: &Options) -> Result<bool> {
    let n = options.flights.max(1);
    let command = format!("haltere-lab aids --flights {n}");
    let mut page = INTRODUCTION.replace("haltere-lab aids", &command);
    type Part = fn(&mut String, u64) -> Result<()>;
    let parts: [(&str, Part); 5] = [
        ("magnetometer", heading::write),
        ("barometer", baro::write),
        ("wind", wind::write),
        ("survey check", anchors::write),
        ("paths", paths),
    ];
    for (name, part) in parts {
        eprintln!("{name}: {n} flights of each kind");
        part(&mut page, n)?;
    }
    match &options.document {
        Some(file) => {
            haltere_log::written::write::<&std::path::Path>(file, &page, &[])?;
        }
        None => print!("{page}"),
    }
    Ok(true)
}

/// A hall whose board has a magnetometer, and a pilot that knows its place; the edit comes last.
pub fn hall(seed: u64, edit: impl FnOnce(&mut PlantConfig, &mut PilotConfig)) -> Result<Lockstep> {
    let mut plant = PlantConfig::hall(seed);
    plant.start_yaw_rad = 0.7 * seed as f64 % 6.0 - 3.0;
    plant.board.magnetometer.fitted = true;
    plant.board.magnetometer.north_deg = NORTH_DEG;
    let mut pilot = PilotConfig::default();
    pilot.flight.gear_height_m = plant.vehicle.body.gear_m;
    pilot.estimator.magnetometer.north_deg = NORTH_DEG;
    edit(&mut plant, &mut pilot);
    let survey = plant.survey.clone();
    Ok(Lockstep::new(plant, pilot, &survey)?)
}

/// Magnetic north from room north in these halls, deg.
const NORTH_DEG: f64 = 25.0;

/// Takes off to a height and holds there.
pub fn hover(world: &mut Lockstep, height_m: f32) -> Result<()> {
    let mut ground = Ground::new();
    take_off(world, &mut ground, height_m)?;
    let until_us = world.t_us() + PATIENCE_US;
    while world.pilot().mode() != Mode::Hold {
        if world.t_us() > until_us {
            ground.listen(world);
            let mode = world.pilot().mode();
            bail!("no hover at {height_m} m, but {mode:?}: {:?}", ground.texts);
        }
        world.step();
    }
    world.run_until(world.t_us() + 2_000_000);
    forget(world);
    Ok(())
}

/// Arms as soon as it is possible; the take-off is under way then.
pub fn take_off(world: &mut Lockstep, ground: &mut Ground, height_m: f32) -> Result<()> {
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, height_m];
    ground.command(world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    let arm = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let command = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
    while ground.command(world, command, arm) != Some(MavResult::MAV_RESULT_ACCEPTED) {
        if world.t_us() > PATIENCE_US {
            bail!("not armed: {:?}", ground.texts);
        }
        world.run_until(world.t_us() + 500_000);
    }
    Ok(())
}

/// Throws away the records of the core.
pub fn forget(world: &mut Lockstep) {
    world.pilot_mut().drain_topics(drop);
}

/// Middle and largest of absolute values, as "4.1, 9.0"; "-" without any.
pub fn middle_and_most(values: &[f64]) -> String {
    let mut sizes: Vec<f64> = values.iter().map(|v| v.abs()).collect();
    sizes.sort_by(f64::total_cmp);
    match (sizes.get(sizes.len() / 2), sizes.last()) {
        (Some(middle), Some(most)) => format!("{middle:.2}, {most:.2}"),
        _ => "-, -".to_owned(),
    }
}

fn paths(page: &mut String, n: u64) -> Result<()> {
    writeln!(page, "\n## Estimate on the four path shapes\n\n{ABOUT_PATHS}\n")?;
    writeln!(
        page,
        "| room | path | N, m | E, m | D, m | flown | aim, m |\n|---|---|---|---|---|---|---|"
    )?;
    let pilot = PilotConfig::default();
    for ((room, scenario), aim_m) in ROOMS.into_iter().zip([0.03, 0.08]) {
        for (name, corners) in SHAPES {
            let errors: Vec<[f64; 3]> = (0..n)
                .into_par_iter()
                .map(|i| {
                    let plant = ranging::room(scenario, SEED + i)?;
                    Ok(fly_path(&pilot, Version::Modified, corners, plant)?.0.estimate_m)
                })
                // Nothing was flown.
                .filter(|error_m| !matches!(error_m, Ok([0.0, 0.0, 0.0])))
                .collect::<Result<_>>()?;
            let mean =
                |axis: usize| errors.iter().map(|e| e[axis]).sum::<f64>() / errors.len() as f64;
            let [north, east, down] = [mean(0), mean(1), mean(2)];
            let ok = if north.max(east).max(down) <= aim_m { "met" } else { "missed" };
            writeln!(
                page,
                "| {room} | {name} | {north:.3} | {east:.3} | {down:.3} | {} of {n} | {aim_m}, {ok} |",
                errors.len()
            )?;
        }
    }
    Ok(())
}

const INTRODUCTION: &str = "\
# Estimator: what its aids are worth in simulation

Written by `haltere-lab aids`. Everything here is
flown in lockstep with the nominal effect set in the hall of 10 × 10 × 7 m, one seed a flight. What the
estimator does on recorded flights stands in [ESTIMATOR.md](ESTIMATOR.md); these have no magnetometer.
";
const ABOUT_PATHS: &str = "\
Mean absolute error of the estimate against truth from the first corner to the last, each axis, version
`modified` of the controller, the shapes of the source at 0.5 m/s. Cluttered: the scenario of that name, whose ranging is
that of recorded rooms among obstacles ([RANGING.md](RANGING.md)); where a cabinet before an anchor is seen before the
take-off nothing is flown.";
