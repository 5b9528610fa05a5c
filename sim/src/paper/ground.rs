//! Figure 9 and equation 7: thrust in ground effect over thrust out of it, against height.

use anyhow::{Context, Result};
use haltere::control::Version;
use haltere::lockstep::Sample;
use haltere::model::PlantConfig;

use super::bench::{Bench, Plan, leg};
use super::results::Section;

/// Heights of the landing gear over the floor, m: the source's range, 0.33 to 1.2 m.
const HEIGHTS_M: [f64; 8] = [0.33, 0.38, 0.44, 0.52, 0.62, 0.76, 0.95, 1.2];
/// Height that counts as out of the ground effect, m.
const OUT_M: f64 = 2.2;
/// Stay out of the ground effect and in it, s: over a minute, as the source.
const OUT_S: f64 = 30.0;
const IN_S: f64 = 65.0;
/// What the begin of a stay leaves out, control steps: 5 s.
const SETTLE: usize = 500;
/// Simulated time of a flight, s.
const FLIGHT_S: f64 = 115.0;

/// Simulated seconds.
pub fn cost(bench: &Bench) -> u64 {
    bench.cost(HEIGHTS_M.len(), FLIGHT_S)
}

/// One hover: mean height, m, thrust ratio, and its scatter over the stay.
#[derive(Debug, Clone, Copy)]
struct Hover {
    height_m: f64,
    ratio: f64,
    scatter: f64,
}

/// Mean and standard deviation.
fn mean_std(samples: &[Sample], pick: impl Fn(&Sample) -> f64) -> Option<[f64; 2]> {
    let values: Vec<f64> = samples.get(SETTLE..)?.iter().map(pick).collect();
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let var = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    (n > 0.0).then_some([mean, var.sqrt()])
}

fn hover(bench: &Bench, height_m: f64, seed: u64) -> Result<Hover> {
    let plant = PlantConfig::hall(seed);
    let gear_m = plant.vehicle.body.gear_m;
    let mut plan = Plan::from_height(OUT_M + gear_m, FLIGHT_S + 30.0);
    let out = plan.step([0.0, 0.0, OUT_M + gear_m], OUT_S);
    let low = plan.step([0.0, 0.0, height_m + gear_m], IN_S);
    plan.step([0.0, 0.0, OUT_M + gear_m], 2.0);
    let flight = bench.fly_in(plant, &bench.version(Version::Raw), &plan.land())?;
    // Command times voltage is thrust: the command for a thrust goes with one over the voltage.
    let thrust = |s: &Sample| s.control.thrust_frac * s.truth.supply_v;
    let missing =
        || format!("{height_m} m, seed {seed}: no hover; {:?}", flight.texts.last());
    let [thrust_out, _] = mean_std(leg(&flight, out), thrust).with_context(missing)?;
    let [thrust_in, std_in] = mean_std(leg(&flight, low), thrust).with_context(missing)?;
    let [height, _] = mean_std(leg(&flight, low), |s| s.truth.height_m).with_context(missing)?;
    Ok(Hover { height_m: height, ratio: thrust_in / thrust_out, scatter: std_in / thrust_out })
}

pub fn run(bench: &Bench) -> Result<Section> {
    let h = bench.each(&HEIGHTS_M, FLIGHT_S, |height, seed| hover(bench, *height, seed))?;
    for h in &h {
        println!("{h:.4?}");
    }
    Ok(Section::default())
}
