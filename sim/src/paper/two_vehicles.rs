//! Figure 6: final speed against lean for two vehicles, and the saturating exponential through it.

use anyhow::{Context, Result};
use haltere::model::Vehicle;

use super::angle_steps::{AXES, FLIGHT_S, fly_step};
use super::bench::Bench;
use super::results::Section;
use super::source;

/// The second vehicle.
const NIMBLE: &str = include_str!("../../vehicles/delfly-nimble.toml");

/// Simulated seconds.
pub fn cost(bench: &Bench) -> u64 {
    bench.cost(2 * source::ANGLES_DEG.iter().map(|a| a.len()).sum::<usize>(), FLIGHT_S)
}

fn vehicles() -> Result<[Vehicle; 2]> {
    Ok([Vehicle::default(), toml::from_str(NIMBLE).context("vehicles/delfly-nimble.toml")?])
}

pub fn run(bench: &Bench) -> Result<Section> {
    let vehicles = vehicles()?;
    let mut cases = Vec::new();
    for vehicle in &vehicles {
        for (axis, angles) in source::ANGLES_DEG.iter().enumerate() {
            cases.extend(angles.iter().map(|angle| (vehicle, axis, *angle)));
        }
    }
    let flown = bench.each(&cases, FLIGHT_S, |(vehicle, axis, angle), seed| {
        match fly_step(bench, vehicle, *axis, *angle, seed) { Ok(None) => println!("refused {angle}"), Ok(Some(s)) => println!("{} {} {angle} {:.3} fits {:.2} k {:.2}", vehicle.name, AXES[*axis], s.final_mps, s.fits_frac, 9.81 * angle.to_radians().tan() / s.final_mps), Err(e) => println!("{e:#}") }
        Ok(())
    })?;
    let _ = flown;
    Ok(Section::default())
}
