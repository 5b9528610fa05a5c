//! Time of a flight in lockstep and of a control step of the core: `cargo bench --bench pilot`.
//! Best of several runs, since the machine is shared. Recording is off.
//!
//! The flight is flown once with everything that arrives at the core kept; the core alone is then
//! timed on that, and what is left of the whole is the plant.

use std::hint::black_box;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use haltere_core::time::HostTime;
use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd};
use haltere_model::PlantConfig;
use haltere_model::lockstep::{Lockstep, fly, local_item};
use haltere_pilot::{Input, LinkId, Pilot, PilotConfig};

const RUNS: usize = 12;
/// Simulated length of the flight, alignment included, s.
const FLIGHT_S: f64 = 90.0;

/// Squares of 1 m without end.
fn mission() -> Vec<MISSION_ITEM_INT_DATA> {
    let mut items = vec![local_item(MavCmd::MAV_CMD_NAV_TAKEOFF, [5.0, 5.0, -1.2], 0.0)];
    for _ in 0..10 {
        for (north, east) in [(6.0, 5.0), (6.0, 6.0), (5.0, 6.0), (5.0, 5.0)] {
            items.push(local_item(MavCmd::MAV_CMD_NAV_WAYPOINT, [north, east, -1.2], 1.0));
        }
    }
    items
}

fn configs(seed: u64) -> (PlantConfig, PilotConfig) {
    let plant = PlantConfig::hall(seed);
    let mut pilot = PilotConfig::default();
    pilot.flight.gear_height_m = plant.vehicle.body.gear_m;
    (plant, pilot)
}

fn world() -> Lockstep {
    let (plant, pilot) = configs(1);
    let survey = plant.survey.clone();
    let world = Lockstep::new(plant, pilot, &survey).expect("the hall can be flown in");
    world.without_topics()
}

/// One flight. Simulated time, s.
fn flight(mut world: Lockstep) -> f64 {
    let items = mission();
    // The limit counts from arming; whatever is left after it is flown without samples.
    let flown = fly(&mut world, &items, FLIGHT_S - 15.0).expect("it flies");
    black_box(flown.samples.len());
    world.run_until((FLIGHT_S * 1e6) as u64);
    world.t_us() as f64 * 1e-6
}

/// Something that arrived.
struct Arrival {
    t_us: u64,
    link: LinkId,
    bytes: Vec<u8>,
}

fn recorded() -> Vec<Arrival> {
    let heard = Arc::new(Mutex::new(Vec::new()));
    let into = heard.clone();
    flight(world().with_damage(Box::new(move |t_us, link, bytes| {
        if let Ok(mut heard) = into.lock() {
            heard.push(Arrival { t_us, link, bytes: bytes.clone() });
        }
    })));
    heard.lock().map(|mut heard| std::mem::take(&mut *heard)).unwrap_or_default()
}

/// The core alone. Control steps taken, bytes sent.
fn core_alone(arrivals: &[Arrival], only: impl Fn(LinkId) -> bool) -> (u64, usize) {
    let start_us = 100_000_000; // as in lockstep
    let at = |t_us: u64| HostTime::from_us(start_us + t_us);
    let (plant, config) = configs(1);
    let mut pilot = Pilot::new(config, plant.survey.clone(), at(0)).without_topics();
    for link in [LinkId::Tag, LinkId::Board, LinkId::Ground(0)] {
        pilot.handle(at(0), Input::LinkUp { link });
    }
    let (mut steps, mut sent) = (0, 0);
    for arrival in arrivals {
        let now = at(arrival.t_us);
        if !arrival.bytes.is_empty() && only(arrival.link) {
            pilot.handle(now, Input::Bytes { link: arrival.link, bytes: &arrival.bytes });
        }
        if arrival.link == LinkId::Board && now >= pilot.next_deadline() {
            pilot.handle(now, Input::Wake);
            steps += 1;
        }
        pilot.drain_output(|_, bytes| sent += black_box(bytes).len());
    }
    (steps, sent)
}

fn best_s(mut run: impl FnMut()) -> f64 {
    (0..RUNS)
        .map(|_| {
            let begin = Instant::now();
            run();
            begin.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

fn main() {
    let arrivals = recorded();
    let bytes: usize = arrivals.iter().map(|a| a.bytes.len()).sum();
    let whole_s = best_s(|| {
        black_box(flight(world()));
    });
    let mut told = (0, 0);
    let core_s = best_s(|| told = core_alone(&arrivals, |_| true));
    let without_tag_s = best_s(|| {
        core_alone(&arrivals, |link| link != LinkId::Tag);
    });
    let idle_s = best_s(|| {
        core_alone(&arrivals, |_| false);
    });
    let (steps, sent) = told;
    println!(
        "flight of {FLIGHT_S} s in lockstep: {:.1} ms, {:.0} x real time (best of {RUNS})",
        whole_s * 1e3,
        FLIGHT_S / whole_s
    );
    println!(
        "  core {:.1} ms ({:.0} %), plant and the rest {:.1} ms",
        core_s * 1e3,
        100.0 * core_s / whole_s,
        (whole_s - core_s) * 1e3
    );
    println!("  {:.1} MB in, {:.1} MB out of the core", bytes as f64 * 1e-6, sent as f64 * 1e-6);
    println!(
        "pilot step, with what arrives in 10 ms: {:.1} us ({steps} steps); without the tag {:.1} us \
         (on the floor: not aligned), no input at all {:.2} us",
        core_s * 1e6 / steps as f64,
        without_tag_s * 1e6 / steps as f64,
        idle_s * 1e6 / steps as f64
    );
}
