//! Flight logs for the process tests: the nominal plant in lockstep, recorded as the companion does.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use haltere::report::truth::HEADER;
use haltere_core::time::HostTime;
use haltere_gap::scene::Scene;
use haltere_log::record::{BuildIdentity, Recorder, Session};
use haltere_model::lockstep::{HOST_START_US, Listener, Lockstep, Tap, fly};
use haltere_model::{EffectSet, Plant};
use haltere_pilot::Input;
use haltere_pilot::mission_file::{Command as ItemCommand, Item, MissionFile};
use haltere_pilot::settings::Config;

/// A hover and a small box, some 25 s.
pub fn box_mission() -> MissionFile {
    let go = |north_m: f64, east_m: f64| Item {
        hold_s: Some(1.0),
        acceptance_m: Some(0.6),
        ..Item::waypoint(north_m, east_m, 1.0)
    };
    let takeoff = Item { height_m: Some(1.0), ..Item::new(ItemCommand::Takeoff) };
    let speed = Item { speed_mps: Some(0.9), ..Item::new(ItemCommand::Speed) };
    let land = Item::new(ItemCommand::Land);
    let items = vec![takeoff, speed, go(3.0, 3.0), go(4.0, 3.0), go(4.0, 4.0), go(3.0, 3.0), land];
    MissionFile { items }
}

/// Flies a mission in the laboratory and writes the log, and time and position of the truth beside it (`.csv`).
pub fn record(scene: &Scene, mission: &MissionFile, effects: EffectSet, seed: u64, path: &Path) {
    let pilot = &scene.pilot;
    let mut config = Config {
        flight: pilot.flight.clone(),
        limits: pilot.limits.clone(),
        uwb: pilot.uwb.clone(),
        estimator: pilot.estimator.clone(),
        control: pilot.control.clone(),
        ..Config::default()
    };
    // In memory nobody answers requests for files.
    config.store.directory = PathBuf::new();
    assert_eq!(config.pilot(), *pilot, "the log must say what flies");
    let work = tempfile::tempdir_in(path.parent().unwrap()).unwrap();
    let session = Session {
        build: BuildIdentity::current(),
        started_unix_us: 1_790_000_000_000_000,
        pilot_started_at: HostTime::from_us(HOST_START_US),
        config_toml: config.to_log(&scene.survey),
        survey: scene.survey.clone(),
    };
    let recorder = Recorder::start_waiting(work.path(), &session).unwrap();
    let tape = Arc::new(Mutex::new((recorder, session.pilot_started_at)));
    let (heard, sent) = (tape.clone(), tape.clone());
    let listener: Listener = Box::new(move |at, input| {
        let mut tape = heard.lock().unwrap_or_else(PoisonError::into_inner);
        tape.1 = at;
        if matches!(input, Input::Wake) {
            tape.0.commit(at);
        }
        tape.0.input(at, input);
    });
    let tap: Tap = Box::new(move |_, link, bytes| {
        let mut tape = sent.lock().unwrap_or_else(PoisonError::into_inner);
        let at = tape.1;
        tape.0.output(at, link, bytes);
    });
    let mut plant = scene.plant(seed);
    plant.effects = effects;
    let world = Plant::new(plant).unwrap();
    let mut lockstep =
        Lockstep::in_world(world, scene.pilot.clone(), &scene.survey, Some(listener))
            .without_topics()
            .with_tap(tap);
    let items: Vec<_> =
        mission.items.iter().zip(0..).map(|(item, seq)| item.to_wire(seq, 0, 0)).collect();
    let flight = fly(&mut lockstep, &items, 100.0).unwrap();
    assert!(flight.landed, "{:?}", flight.texts);
    drop(lockstep);
    let (recorder, _) = Arc::into_inner(tape).unwrap().into_inner().unwrap();
    let summary = recorder.finish();
    assert!(summary.error.is_none() && summary.lost_entries == 0);
    let written: PathBuf = summary.path.unwrap();
    std::fs::rename(&written, path).unwrap();
    let mut truth = format!("{HEADER}\n");
    for sample in &flight.samples {
        let at = HostTime::from_us(HOST_START_US + sample.truth.t_us);
        let [north_m, east_m, down_m] = sample.truth.pos_E_m.to_array();
        let rest = ["0"; 17].join(",");
        let (at_us, t_s) = (at.as_us(), sample.truth.t_us as f64 * 1e-6);
        truth += &format!("{at_us},{t_s},{north_m},{east_m},{down_m},{rest}\n");
    }
    std::fs::write(path.with_extension("csv"), truth).unwrap();
}
