//! The vertical in a steady wind, and what helps against its leaning.

use std::fmt::Write as _;

use anyhow::Result;
use rayon::prelude::*;

use haltere_core::estimator::EstimatorConfig;
use haltere_model::EffectSet;

use super::{SEED, hall, hover, middle_and_most};

/// Hover, s: the vertical of a filter that knows no wind has drifted to its end by then.
const HOVER_S: f64 = 30.0;
/// With neither remedy, with each of the two.
const VARIANTS: [fn(&mut EstimatorConfig); 3] = [
    |c| c.board_vertical.fuse = false,
    |c| {
        c.board_vertical.fuse = false;
        c.slow_force_s = 2.0;
    },
    |_| (),
];

/// Effects of the simulator: id and values by name.
type Effects = &'static [(&'static str, &'static [(&'static str, f64)])];

const AIRS: [(&str, Effects); 5] = [
    ("still air", &[]),
    ("0.3 m/s (A5)", &[("A5", &[("north", 0.3)])]),
    ("0.6 m/s", &[("A5", &[("north", 0.6)])]),
    ("still air, accelerometer 0.4 m/s² off along x (M1)", &[("M1", &[("x", 0.4)])]),
    ("0.6 m/s, accelerometer 0.4 m/s² off", &[("A5", &[("north", 0.6)]), ("M1", &[("x", 0.4)])]),
];

/// Angle between the estimated and the true vertical after a hover, degrees, one for each flight that got there.
fn leaning_deg(n: u64, effects: Effects, change: fn(&mut EstimatorConfig)) -> Result<Vec<f64>> {
    let angles: Vec<Option<f64>> = (0..n)
        .into_par_iter()
        .map(|i| {
            let mut set = EffectSet::nominal();
            for (id, values) in effects {
                set = set.with(id, values)?;
            }
            let mut world = hall(SEED + 500 + i, |plant, pilot| {
                change(&mut pilot.estimator);
                plant.effects = set;
            })?;
            if let Err(why) = hover(&mut world, 1.2) {
                eprintln!("seed {}: {why:#}", SEED + 500 + i);
                return Ok(None);
            }
            let end_us = world.t_us() + (HOVER_S * 1e6) as u64;
            while world.t_us() < end_us {
                world.run_until(world.t_us() + 500_000);
                super::forget(&mut world);
            }
            let (seen, truth) = (world.pilot().estimate().R_EB, world.truth().R_EB);
            let dot: f64 = (0..3).map(|k| seen.matrix()[(2, k)] * truth.matrix()[(2, k)]).sum();
            Ok(Some(dot.clamp(-1.0, 1.0).acos().to_degrees()))
        })
        .collect::<Result<_>>()?;
    Ok(angles.into_iter().flatten().collect())
}

/// Writes the part of the page.
pub fn write(page: &mut String, n: u64) -> Result<()> {
    writeln!(page, "\n## Vertical in a steady wind\n\n{ABOUT}\n")?;
    writeln!(
        page,
        "| air | neither, deg | slow force, deg | board's vertical (as shipped), deg |"
    )?;
    writeln!(page, "|---|---|---|---|")?;
    for (name, effects) in AIRS {
        let cell = |change: fn(&mut EstimatorConfig)| -> Result<String> {
            let angles = leaning_deg(n, effects, change)?;
            let short = match angles.len() as u64 {
                all if all == n => String::new(),
                got => format!(" ({got} of {n})"),
            };
            Ok(format!("{}{short}", middle_and_most(&angles)))
        };
        let [none, slow, board] = VARIANTS;
        writeln!(page, "| {name} | {} | {} | {} |", cell(none)?, cell(slow)?, cell(board)?)?;
    }
    Ok(())
}

const ABOUT: &str = "\
Angle between the estimated and the true vertical after 30 s of hover: median, worst of the flights; in brackets how
many of them hovered, where not all. The filter models drag in still air along body x and y; a wind looks to it like a lean. There
are two remedies. `estimator.slow_force_s = 2`, off unless configured, takes what lasts beyond drag from the accelerometer; with a
recorded accelerometer that reads 2.6 m/s² too little in flight the filter diverges so ([ESTIMATOR.md](ESTIMATOR.md), *what lasts
beyond drag*). `estimator.board_vertical.fuse`, on as shipped, takes the vertical of the board's own filter (no recording has
one).";
