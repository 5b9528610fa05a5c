//! Flight logs for the process tests: the nominal plant in lockstep, recorded as the companion does.

use std::path::Path;

use haltere::report::truth::HEADER;
use haltere::taped::fly_taped;
use haltere_core::time::HostTime;
use haltere_gap::scene::Scene;
use haltere_model::lockstep::HOST_START_US;
use haltere_model::{EffectSet, Plant};
use haltere_pilot::mission_file::{Command as ItemCommand, Item, MissionFile};

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
    let mut plant = scene.plant(seed);
    plant.effects = effects;
    let items: Vec<_> =
        mission.items.iter().zip(0..).map(|(item, seq)| item.to_wire(seq, 0, 0)).collect();
    let (flown, _) = fly_taped(scene, Plant::new(plant).unwrap(), &items, path).unwrap();
    let flight = flown.unwrap();
    assert!(flight.landed, "{:?}", flight.texts);
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
