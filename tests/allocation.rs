//! The pilot's thread in flight asks for no memory and gives none back: a flight is flown in lockstep,
//! then what came is given to the live core, through its real queues and with its real recorder, and
//! the allocator is counted around each of its rounds.

use std::sync::{Arc, Mutex};

use haltere::live::ByHand;
use haltere_core::time::HostTime;
use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd};
use haltere_model::lockstep::{Lockstep, fly, local_item};
use haltere_model::{Plant, PlantConfig};
use haltere_pilot::{Input, LinkId, Mode, PilotConfig};

/// What came, and when.
enum Came {
    Bytes(LinkId, Vec<u8>),
    Up(LinkId),
    Wake,
}

/// Take-off, two squares, a hover of 10 s, landing.
fn mission() -> Vec<MISSION_ITEM_INT_DATA> {
    let mut items = vec![local_item(MavCmd::MAV_CMD_NAV_TAKEOFF, [5.0, 5.0, -1.2], 0.0)];
    for _ in 0..2 {
        for (north, east) in [(6.0, 5.0), (6.0, 6.0), (5.0, 6.0), (5.0, 5.0)] {
            items.push(local_item(MavCmd::MAV_CMD_NAV_WAYPOINT, [north, east, -1.2], 0.0));
        }
    }
    items.push(local_item(MavCmd::MAV_CMD_NAV_WAYPOINT, [5.0, 5.0, -1.2], 10.0));
    items.push(local_item(MavCmd::MAV_CMD_NAV_LAND, [5.0, 5.0, 0.0], 0.0));
    items
}

fn configs() -> (PlantConfig, PilotConfig) {
    let plant = PlantConfig::hall(1);
    let mut pilot = PilotConfig::default();
    pilot.flight.gear_height_m = plant.vehicle.body.gear_m;
    (plant, pilot)
}

/// Everything that the core was given on a flight.
fn flown() -> Vec<(HostTime, Came)> {
    let (plant, pilot) = configs();
    let survey = plant.survey.clone();
    let heard = Arc::new(Mutex::new(Vec::new()));
    let into = heard.clone();
    let listener = move |at: HostTime, input: Input<'_>| {
        let came = match input {
            Input::Bytes { link, bytes } => Came::Bytes(link, bytes.to_vec()),
            Input::LinkUp { link } => Came::Up(link),
            Input::Wake => Came::Wake,
            _ => return,
        };
        into.lock().unwrap().push((at, came));
    };
    let plant = Plant::new(plant).unwrap();
    let mut world = Lockstep::in_world(plant, pilot, &survey, Some(Box::new(listener)));
    let flight = fly(&mut world, &mission(), 120.0).unwrap();
    assert!(flight.landed, "{:?}", flight.texts);
    std::mem::take(&mut *heard.lock().unwrap())
}

#[test]
fn prop_a_round_in_steady_flight_asks_for_no_memory() {
    let mut came = flown();
    // Links open at the time of the clock: the flight comes after that.
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    let now_us = now.tv_sec * 1_000_000 + now.tv_nsec / 1000;
    let shift_us = now_us + 60_000_000 - came[0].0.as_us() as i64;
    came.iter_mut().for_each(|(at, _)| *at = at.offset_us(shift_us));

    let folder = tempfile::tempdir().unwrap();
    let (plant, config) = configs();
    let began = came[0].0;
    let mut live = ByHand::new(config, &plant.survey, began, folder.path()).unwrap();
    let mut counts = Vec::new();
    for (at, came) in came {
        match came {
            Came::Bytes(link, bytes) => assert!(live.bytes(at, link, &bytes)),
            Came::Up(link) => live.up(link),
            Came::Wake => {
                let mode = live.mode();
                let asked = allocation_counter::measure(|| live.round(at));
                // Texts are made of memory: a change of mode, a touch-down.
                counts.push((at, mode, live.rest(), asked));
            }
        }
    }
    // It flew, and the same modes were gone through.
    let mut modes: Vec<Mode> = counts.iter().map(|(_, mode, ..)| *mode).collect();
    modes.dedup();
    assert!(modes.contains(&Mode::Mission) && modes.contains(&Mode::Disarming), "{modes:?}");
    assert_eq!(live.losses(), 0, "a full queue would hide what is asked");

    // In flight memory is asked for, or given back, only where somebody is told something.
    let silent = |mode: Mode| counts.iter().filter(move |(_, m, told, _)| *m == mode && *told == 0);
    for mode in [Mode::Spool, Mode::Takeoff, Mode::Mission, Mode::Land] {
        let asked = silent(mode).filter(|(.., a)| a.count_total > 0 || a.count_current != 0);
        let at_s: Vec<_> = asked.map(|(at, ..)| at.seconds_since(began)).collect();
        assert!(at_s.is_empty(), "{mode:?}: memory was asked for at {at_s:?} s");
        assert!(silent(mode).count() > 50, "{mode:?}: nothing was measured");
    }
    let told = counts.iter().filter(|(_, mode, told, _)| *mode != Mode::Disarmed && *told > 0);
    assert!(told.count() < 20);
}
