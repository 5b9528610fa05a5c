//! Heading with and without magnetometer: at the start, in hover, on a path, under a gyroscope that drifts.

use std::fmt::Write as _;

use anyhow::Result;
use rayon::prelude::*;

use haltere_core::estimate::{Estimate, Health};
use haltere_core::estimator::EstimatorConfig;
use haltere_core::frames::wrap_pi_rad;
use haltere_dialect::mav::haltere::MavCmd;
use haltere_model::lockstep::{Ground, Lockstep};
use haltere_model::{Fault, PlantConfig, Truth};
use haltere_pilot::{Mode, PilotConfig};

use super::shadow::{Shadow, fly_along};
use super::{SEED, hall, hover, middle_and_most};
use crate::steps::item;

/// Longest wait for a heading, s.
const WAIT_S: f64 = 40.0;

fn error_deg(estimate: &Estimate, truth: &Truth) -> f64 {
    wrap_pi_rad(estimate.R_EB.yaw_rad() - truth.R_EB.yaw_rad()).to_degrees()
}

fn knows(estimate: &Estimate) -> bool {
    matches!(estimate.health, Health::Good | Health::Degraded)
}

/// A row: how many found a heading, after which time, and how wrong it was then and later.
struct Row {
    of: usize,
    after_s: Vec<f64>,
    then_deg: Vec<f64>,
    later_deg: Vec<f64>,
}

fn row(page: &mut String, name: &str, with: &str, row: &Row) -> Result<()> {
    writeln!(
        page,
        "| {name} | {with} | {} of {} | {} | {} | {} |",
        row.after_s.len(),
        row.of,
        middle_and_most(&row.after_s),
        middle_and_most(&row.then_deg),
        middle_and_most(&row.later_deg),
    )?;
    Ok(())
}

/// On the floor, the board's north 57 degrees from where the configuration has it.
fn on_floor(n: u64, fuse: bool, floor_ut: f64) -> Result<Row> {
    let starts: Vec<(f64, f64)> = (0..n)
        .into_par_iter()
        .map(|i| {
            let mut world = hall(SEED + i, |plant, pilot| {
                pilot.board_north_offset_rad = 1.0;
                pilot.estimator.magnetometer.fuse = fuse;
                plant.board.magnetometer.floor_ut = floor_ut;
                let place = i as f64;
                plant.start_E_m = haltere_core::frames::Vec3::new(
                    3.0 + 0.37 * place % 4.0,
                    3.0 + 0.53 * place % 4.0,
                    0.0,
                );
            })?;
            while world.t_us() < 40_000_000 && !knows(world.pilot().estimate()) {
                world.run_until(world.t_us() + 10_000);
            }
            Ok((world.t_us() as f64 * 1e-6, error_deg(world.pilot().estimate(), &world.truth())))
        })
        .collect::<Result<_>>()?;
    let (after_s, then_deg): (Vec<_>, Vec<_>) = starts.into_iter().unzip();
    Ok(Row { of: n as usize, after_s, then_deg, later_deg: Vec::new() })
}

/// Filters that are switched on in the air and told nothing.
fn in_the_air(n: u64, on_path: bool) -> Result<[Row; 2]> {
    type Found = Option<(f64, f64, f64)>;
    let flights: Vec<[Found; 2]> = (0..n)
        .into_par_iter()
        .map(|i| {
            let mut world = hall(SEED + 100 + i, |_, _| {})?;
            let survey = PlantConfig::hall(SEED + 100 + i).survey;
            if on_path {
                fly_square(&mut world)?;
            } else {
                hover(&mut world, 1.2)?;
            }
            let mut shadows = [false, true].map(|fuse| {
                let mut config = PilotConfig::default().estimator_in_force();
                config.cold_start = true;
                config.magnetometer = magnetometer(fuse);
                Shadow::new(config, &world, &survey)
            });
            let mut found: [Found; 2] = [None; 2];
            fly_along(&mut world, &mut shadows, WAIT_S, |t_s, shadows, truth| {
                for (shadow, found) in shadows.iter().zip(&mut found) {
                    let estimate = shadow.estimator.estimate();
                    match found {
                        None if knows(&estimate) => {
                            *found = Some((t_s, error_deg(&estimate, truth), f64::NAN));
                        }
                        Some((at_s, _, later)) if later.is_nan() && t_s > *at_s + 10.0 => {
                            *later = error_deg(&estimate, truth);
                        }
                        _ => {}
                    }
                }
                !truth.on_ground
            });
            Ok(found)
        })
        .collect::<Result<_>>()?;
    Ok([0, 1].map(|with| {
        let found: Vec<_> = flights.iter().filter_map(|f| f[with]).collect();
        Row {
            of: n as usize,
            after_s: found.iter().map(|f| f.0).collect(),
            then_deg: found.iter().map(|f| f.1).collect(),
            later_deg: found.iter().map(|f| f.2).filter(|v| v.is_finite()).collect(),
        }
    }))
}

fn magnetometer(fuse: bool) -> haltere_core::estimator::MagnetometerConfig {
    haltere_core::estimator::MagnetometerConfig {
        fuse,
        north_deg: super::NORTH_DEG,
        ..EstimatorConfig::default().magnetometer
    }
}

/// On a square of 1.6 m at 0.5 m/s, from its first corner on.
fn fly_square(world: &mut Lockstep) -> Result<()> {
    let corners = [[5.8, 5.8], [5.8, 4.2], [4.2, 4.2], [4.2, 5.8]];
    let mut items = vec![item(MavCmd::MAV_CMD_NAV_TAKEOFF, [5.0, 5.0, -1.2])];
    for round in 0..4 {
        for (i, [n, e]) in corners.iter().enumerate() {
            let mut corner = item(MavCmd::MAV_CMD_NAV_WAYPOINT, [*n, *e, -1.2]);
            corner.param1 = if round + i == 0 { 2.0 } else { 0.0 };
            items.push(corner);
        }
    }
    items.push(item(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3]));
    haltere_model::lockstep::start(world, &mut Ground::new(), &items)?;
    let until_us = world.t_us() + 60_000_000;
    while -world.truth().pos_E_m.z() < 1.1 && world.t_us() < until_us {
        world.step();
    }
    super::forget(world);
    Ok(())
}

/// Error of the heading after 20 and 60 s of hover with a gyroscope that was right on the floor.
fn drift(n: u64, fuse: bool, learn: bool, steady: bool) -> Result<[Vec<f64>; 2]> {
    let errors: Vec<[f64; 2]> = (0..n)
        .into_par_iter()
        .map(|i| {
            let mut world = hall(SEED + 200 + i, |_, pilot| {
                pilot.estimator.magnetometer.fuse = fuse;
                pilot.estimator.gyro_bias.estimate = learn;
            })?;
            hover(&mut world, 1.2)?;
            if !steady {
                let values = vec![("x".to_owned(), 0.0), ("z".to_owned(), 0.01)];
                world.plant_mut().inject(Fault::EffectOn { id: "M5".into(), values })?;
            }
            let mut at = [f64::NAN; 2];
            for (slot, seconds) in at.iter_mut().zip([20, 40]) {
                world.run_until(world.t_us() + seconds * 1_000_000);
                super::forget(&mut world);
                if world.pilot().mode() == Mode::Hold {
                    *slot = error_deg(world.pilot().estimate(), &world.truth());
                }
            }
            Ok(at)
        })
        .collect::<Result<_>>()?;
    Ok([0, 1].map(|at| errors.iter().map(|e| e[at]).filter(|e| e.is_finite()).collect()))
}

/// Writes the part of the page.
pub fn write(page: &mut String, n: u64) -> Result<()> {
    writeln!(page, "\n## Magnetometer\n\n{ABOUT}\n")?;
    writeln!(
        page,
        "| start | magnetometer | heading found | after, s | its error, deg | 10 s later, deg |"
    )?;
    writeln!(page, "|---|---|---|---|---|---|")?;
    row(page, "on the floor", "no: the board's word, 57 deg off", &on_floor(n, false, 8.0)?)?;
    row(page, "on the floor", "yes, steel of 8 µT", &on_floor(n, true, 8.0)?)?;
    row(page, "on the floor", "yes, steel of 30 µT", &on_floor(n, true, 30.0)?)?;
    for (name, on_path) in [("in hover", false), ("on a square, 0.5 m/s", true)] {
        let [without, with] = in_the_air(n, on_path)?;
        row(page, name, "no", &without)?;
        row(page, name, "yes", &with)?;
    }
    writeln!(page, "\n{ABOUT_DRIFT}\n")?;
    writeln!(
        page,
        "| gyroscope | magnetometer | after 20 s, deg | after 60 s, deg | still hovers |"
    )?;
    writeln!(page, "|---|---|---|---|---|")?;
    for (gyro, steady) in [("as at the start", true), ("0.01 rad/s more about z", false)] {
        for (name, fuse, learn) in
            [("no", false, false), ("yes", true, false), ("yes, and bias learned", true, true)]
        {
            let [early, late] = drift(n, fuse, learn, steady)?;
            writeln!(
                page,
                "| {gyro} | {name} | {} | {} | {} of {n} |",
                middle_and_most(&early),
                middle_and_most(&late),
                late.len()
            )?;
        }
    }
    Ok(())
}

const ABOUT: &str = "\
The simulated board has a magnetometer of 50 Hz with 0.4 µT of noise, 1.1 µT of hard iron and, from the
steel in the floor, up to 8 µT on it (`src/model/magnetometer.rs`); the room's field has 49 µT, dips by 66
degrees, and its north is 25 degrees east of the room's. Each cell: median, worst. *On the floor* the board
was switched on anywhere: its north is not where `board.north_offset_deg` has it. *In hover* and *on a
square* a second filter with `estimator.cold_start` is switched on beside the one that flies and is told
neither position nor heading. Found: health is no longer `Lost`.";
const ABOUT_DRIFT: &str = "\
In hover nothing else shows the heading. The gyroscope's bias is learned on the floor and changes after the
take-off. *Bias learned*: `estimator.gyro_bias.estimate`, off unless configured, goes on learning it in flight.";
