//! The step tests of the source, flown by any configuration.

use anyhow::{Result, bail};

use haltere::sources::{self, Sources};
use haltere_core::control::ControlConfig;
use haltere_model::PlantConfig;
use haltere_model::lockstep::Lockstep;
use haltere_pilot::PilotConfig;

use crate::steps::{AXES, SIZES_M, StepScore, fly_steps, is_complete};
use crate::variation::Variation;

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
            "seed {seed}: {} of {} steps, {}; {}",
            scores.len(),
            2 * AXES.len() * SIZES_M.len(),
            if crashed { "crashed" } else { "not crashed" },
            flight.last_words()
        );
    }
    Ok(Flown { scores })
}

/// What the companion is configured to, without a disk.
pub fn pilot_config(file: Option<&std::path::Path>, set: &[String]) -> Result<PilotConfig> {
    let files = file.map(std::path::Path::to_path_buf).into_iter().collect();
    let config = sources::load(&Sources::new(files, set.to_vec()))?;
    // Nobody here answers for a disk.
    Ok(PilotConfig { store: false, ..config.pilot() })
}
