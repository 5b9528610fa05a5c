//! One flight of a mission in lockstep, in any world, written as the companion's own log.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use haltere_gap::scene::Scene;
use haltere_model::lockstep::{Flight, FlightError, Lockstep, World, fly};
use haltere_pilot::settings::Config;

use crate::tape::Tape;

/// Longest flight, s of simulated time: a pack lasts for four minutes.
const LIMIT_S: f64 = 200.0;

/// What came of it.
#[derive(Debug, Clone, Copy)]
pub struct Outcome {
    /// Ended disarmed on the floor.
    pub landed: bool,
    /// From arming to the end, s; 0: it refused to fly, and its log says why.
    pub flown_s: f64,
    /// Length of the log, bytes.
    pub bytes: u64,
}

/// The configuration that the companion flies with in this scene.
fn config(scene: &Scene) -> Result<Config> {
    let pilot = &scene.pilot;
    let mut config = Config {
        flight: pilot.flight.clone(),
        limits: pilot.limits.clone(),
        uwb: pilot.uwb.clone(),
        estimator: pilot.estimator.clone(),
        control: pilot.control.clone(),
        ..Config::default()
    };
    config.board.north_offset_deg = pilot.board_north_offset_rad.to_degrees();
    if !pilot.store {
        config.store.directory = PathBuf::new();
    }
    if config.pilot() != *pilot {
        bail!("the scene's companion has settings that no configuration file can hold");
    }
    Ok(config)
}

/// Flies and writes `path`, and says what came of it; nothing stands there unless the log is whole.
pub fn record<W: World>(
    scene: &Scene,
    world: W,
    items: &[MISSION_ITEM_INT_DATA],
    path: &Path,
) -> Result<Outcome> {
    let (flown, bytes) = fly_taped(scene, world, items, path)?;
    Ok(match flown {
        Ok(flight) => {
            Outcome { landed: flight.landed, flown_s: flight.samples.len() as f64 * 0.01, bytes }
        }
        Err(_) => Outcome { landed: false, flown_s: 0.0, bytes },
    })
}

/// The same with the whole flight, or why there was none, and the length of the log, bytes.
pub fn fly_taped<W: World>(
    scene: &Scene,
    world: W,
    items: &[MISSION_ITEM_INT_DATA],
    path: &Path,
) -> Result<(Result<Flight, FlightError>, u64)> {
    let tape = Tape::begin(path, &config(scene)?, &scene.survey)?;
    let mut lockstep =
        Lockstep::in_world(world, scene.pilot.clone(), &scene.survey, Some(tape.listener()))
            .without_topics()
            .with_tap(tape.tap());
    let flown = fly(&mut lockstep, items, LIMIT_S);
    drop(lockstep); // it holds the tape
    let bytes = tape.end()?;
    Ok((flown, bytes))
}
