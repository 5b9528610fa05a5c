//! Figure 7: throttle in hover against battery voltage, polynomials of order 1 to 3 and their R².

use anyhow::{Result, bail};
use haltere::control::Version;
use haltere::model::PlantConfig;
use haltere_dialect::mav::haltere::MavCmd;

use super::bench::{Bench, Plan};
use super::results::Section;
use crate::steps::item;

/// Height of the hover, m, and what its start leaves out, s.
const HEIGHT_M: f64 = 1.2;
const SETTLE_S: f64 = 5.0;
/// Hovers until this voltage, V: just above the critical 6.0 V.
const UNTIL_V: f64 = 6.1;
/// Longest hover and simulated time of a flight, s.
const LONGEST_S: f64 = 400.0;
const FLIGHT_S: f64 = 300.0;
/// Points are taken this often, in control steps: 10 Hz.
const EVERY: usize = 10;

/// Simulated seconds.
pub fn cost(bench: &Bench) -> u64 {
    bench.cost(1, FLIGHT_S)
}

/// Voltage, V, and throttle, 0 to 1, of one hover.
fn hover(bench: &Bench, plant: PlantConfig, seed: u64) -> Result<Vec<[f64; 2]>> {
    let mut plan = Plan::from_height(HEIGHT_M, LONGEST_S + 60.0);
    let start = plan.step([0.0, 0.0, HEIGHT_M], SETTLE_S);
    let mut wait = item(MavCmd::MAV_CMD_USER_3, [0.0; 3]);
    wait.param1 = UNTIL_V as f32;
    wait.param2 = LONGEST_S as f32;
    plan.items.push(wait);
    let flight = bench.fly_in(plant, &bench.version(Version::Raw), &plan.land())?;
    let hovering = super::bench::leg(&flight, start);
    let points: Vec<[f64; 2]> = hovering
        .iter()
        .skip((SETTLE_S * 100.0) as usize)
        .step_by(EVERY)
        .map(|s| [s.truth.supply_v, s.control.thrust_frac])
        .collect();
    if points.len() < 100 {
        bail!("seed {seed}: {} points of hover; {:?}", points.len(), flight.texts);
    }
    Ok(points)
}

pub fn run(bench: &Bench) -> Result<Section> {
    let h = bench.each(&[()], FLIGHT_S, |(), seed| hover(bench, PlantConfig::hall(seed), seed))?;
    for p in &h[0] {
        let n = p.len() as f64;
        let (mv, mt) = (p.iter().map(|p| p[0]).sum::<f64>() / n, p.iter().map(|p| p[1]).sum::<f64>() / n);
        let svv: f64 = p.iter().map(|p| (p[0] - mv).powi(2)).sum();
        let svt: f64 = p.iter().map(|p| (p[0] - mv) * (p[1] - mt)).sum();
        let stt: f64 = p.iter().map(|p| (p[1] - mt).powi(2)).sum();
        println!("{} pts V {:.2}..{:.2} thrust {:.3} r2 {:.3}", p.len(), p[0][0], p.last().unwrap()[0], mt, svt * svt / svv / stt);
    }
    Ok(Section::default())
}
