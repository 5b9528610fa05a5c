//! One flight of the suite: flown in lockstep, written as the companion's own flight log.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result, bail};
use haltere::config::Config;
use haltere::gap::missions;
use haltere::gap::scene::Scene;
use haltere::lockstep::{HOST_START_US, Listener, Lockstep, Tap, fly};
use haltere::pilot::Input;
use haltere::record::{BuildIdentity, Recorder, Session};
use haltere::time::HostTime;

use super::list::Mission;
use crate::generator::{Foreign, Setup};

/// Longest flight, s of simulated time: a pack lasts for four minutes.
const LIMIT_S: f64 = 200.0;
/// Wall clock of the first log, µs since 1970: logs of one suite are equal byte for byte.
const STARTED_UNIX_US: i64 = 1_790_000_000_000_000;

/// What came of it.
#[derive(Debug, Clone, Copy)]
pub struct Outcome {
    /// Ended disarmed on the floor.
    pub landed: bool,
    /// From arming to the end, s.
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
        config.store.directory = std::path::PathBuf::new();
    }
    if config.pilot() != *pilot {
        bail!("the scene's companion has settings that no configuration file can hold");
    }
    Ok(config)
}

/// Recorder and the time that its outputs stand at.
struct Tape {
    recorder: Recorder,
    at: HostTime,
}

/// Flies and writes `path`; nothing stands there unless the log is whole.
pub fn record(scene: &Scene, setup: Setup, mission: Mission, path: &Path) -> Result<Outcome> {
    let items = match mission {
        Mission::Diagnostic => missions::diagnostic(scene),
        Mission::HeldOut => missions::held_out(scene),
        Mission::Plain => missions::plain(scene),
    };
    let folder = path.parent().unwrap_or(Path::new("."));
    let work = tempfile::tempdir_in(folder).with_context(|| folder.display().to_string())?;
    let session = Session {
        build: BuildIdentity::current(),
        started_unix_us: STARTED_UNIX_US,
        pilot_started_at: HostTime::from_us(HOST_START_US),
        config_toml: config(scene)?.to_toml(),
        survey: scene.survey.clone(),
    };
    let recorder = Recorder::start_waiting(work.path(), &session)?;
    let tape = Arc::new(Mutex::new(Tape { recorder, at: session.pilot_started_at }));
    let (heard, sent) = (tape.clone(), tape.clone());
    let listener: Listener = Box::new(move |at, input| {
        let mut tape = heard.lock().unwrap_or_else(PoisonError::into_inner);
        tape.at = at;
        if matches!(input, Input::Wake) {
            // Before the input: what is committed is whole.
            tape.recorder.commit(at);
        }
        tape.recorder.input(at, input);
    });
    let tap: Tap = Box::new(move |_, link, bytes| {
        let mut tape = sent.lock().unwrap_or_else(PoisonError::into_inner);
        let at = tape.at;
        tape.recorder.output(at, link, bytes);
    });
    let world = Foreign::new(setup);
    let mut lockstep =
        Lockstep::in_world(world, scene.pilot.clone(), &scene.survey, Some(listener))
            .without_topics()
            .with_tap(tap);
    let flown = fly(&mut lockstep, &items, LIMIT_S);
    // The closures hold the tape.
    drop(lockstep);
    let tape = Arc::into_inner(tape).context("the tape is still in use")?;
    let tape = tape.into_inner().unwrap_or_else(PoisonError::into_inner);
    let summary = tape.recorder.finish();
    if let Some(error) = summary.error {
        return Err(error.into());
    }
    if summary.lost_entries > 0 {
        bail!("{}: the recorder lost {} entries", path.display(), summary.lost_entries);
    }
    let written: PathBuf = summary.path.context("nothing was recorded")?;
    let bytes = std::fs::metadata(&written)?.len();
    std::fs::rename(&written, path).with_context(|| path.display().to_string())?;
    Ok(match flown {
        Ok(flight) => {
            Outcome { landed: flight.landed, flown_s: flight.samples.len() as f64 * 0.01, bytes }
        }
        // A vehicle that refuses to fly is a flight too: its log says why.
        Err(_) => Outcome { landed: false, flown_s: 0.0, bytes },
    })
}
