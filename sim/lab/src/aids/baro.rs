//! Height with and without barometer: in hover near the floor, where UWB is biased, and without UWB.

use std::fmt::Write as _;

use anyhow::Result;
use rayon::prelude::*;

use haltere_model::{EffectSet, PlantConfig};
use haltere_pilot::PilotConfig;

use super::shadow::{Shadow, fly_along};
use super::{SEED, hall, hover, middle_and_most};

/// Length of a hover, s.
const HOVER_S: f64 = 30.0;

/// Rms errors of the height of filters without and with barometer, told the same, beside one that flies.
fn hovering(n: u64, height_m: f32, effect: Option<&str>) -> Result<[Vec<f64>; 2]> {
    let errors: Vec<[f64; 2]> = (0..n)
        .into_par_iter()
        .map(|i| {
            let mut errors = [0.0; 2];
            for (fuse, error) in [false, true].into_iter().zip(&mut errors) {
                let mut world = hall(SEED + 300 + i, |plant, pilot| {
                    pilot.estimator.baro.fuse = fuse;
                    if let Some(id) = effect {
                        plant.effects = EffectSet::nominal().with(id, &[]).unwrap_or_default();
                    }
                })?;
                // A flight that does not get there has no error to show.
                if let Err(why) = hover(&mut world, height_m) {
                    eprintln!("seed {}: {why:#}", SEED + 300 + i);
                    *error = f64::NAN;
                    continue;
                }
                let (mut sum, mut count) = (0.0, 0.0);
                let end_us = world.t_us() + (HOVER_S * 1e6) as u64;
                while world.t_us() < end_us {
                    world.run_until(world.t_us() + 50_000);
                    super::forget(&mut world);
                    let seen_m = world.pilot().estimate().pos_E_m.z();
                    sum += (seen_m - world.truth().pos_E_m.z()).powi(2);
                    count += 1.0;
                }
                *error = f64::sqrt(sum / count);
            }
            Ok(errors)
        })
        .collect::<Result<_>>()?;
    Ok([0, 1].map(|with| errors.iter().map(|e| e[with]).filter(|e| e.is_finite()).collect()))
}

/// Errors of the height after 5, 10 and 20 s without UWB, without and with barometer. The vehicle itself
/// goes on with its UWB.
fn blind(n: u64) -> Result<Vec<[[f64; 3]; 2]>> {
    (0..n)
        .into_par_iter()
        .map(|i| {
            let seed = SEED + 400 + i;
            let mut world = hall(seed, |_, _| {})?;
            let survey = PlantConfig::hall(seed).survey;
            let mut shadows = [false, true].map(|fuse| {
                let mut config = PilotConfig::default().estimator_in_force();
                config.baro.fuse = fuse;
                let mut shadow = Shadow::new(config, &world, &survey);
                shadow.estimator.set_airborne(false);
                shadow.estimator.set_initial_heading(world.truth().R_EB.yaw_rad(), 0.1);
                shadow
            });
            // The start on the floor, then the climb, which `hover` would forget.
            fly_along(&mut world, &mut shadows, 8.0, |_, _, _| true);
            let mut ground = haltere_model::lockstep::Ground::new();
            super::take_off(&mut world, &mut ground, 1.2)?;
            fly_along(&mut world, &mut shadows, 15.0, |_, shadows, truth| {
                for shadow in shadows {
                    shadow.estimator.set_airborne(!truth.on_ground);
                }
                true
            });
            let mut errors = [[f64::NAN; 3]; 2];
            for shadow in &mut shadows {
                shadow.with_uwb = false;
            }
            fly_along(&mut world, &mut shadows, 20.5, |t_s, shadows, truth| {
                for (errors, shadow) in errors.iter_mut().zip(shadows.iter()) {
                    for (slot, at_s) in errors.iter_mut().zip([5.0, 10.0, 20.0]) {
                        if slot.is_nan() && t_s >= at_s {
                            *slot = shadow.estimator.estimate().pos_E_m.z() - truth.pos_E_m.z();
                        }
                    }
                }
                true
            });
            Ok(errors)
        })
        .collect()
}

/// Writes the part of the page.
pub fn write(page: &mut String, n: u64) -> Result<()> {
    writeln!(page, "\n## Barometer\n\n{ABOUT}\n")?;
    writeln!(page, "| hover | without, m | with, m |\n|---|---|---|")?;
    for (name, height_m, effect) in [
        ("at 1.2 m", 1.2, None),
        ("at 0.4 m, floor multipath of N17", 0.4, None),
        ("at 0.4 m, and more of it (U6)", 0.4, Some("U6")),
    ] {
        let [without, with] = hovering(n, height_m, effect)?;
        let cell = |errors: &[f64]| {
            let short = if errors.len() < n as usize {
                format!(" ({} of {n})", errors.len())
            } else {
                String::new()
            };
            format!("{}{short}", middle_and_most(errors))
        };
        writeln!(page, "| {name} | {} | {} |", cell(&without), cell(&with))?;
    }
    writeln!(page, "\n{ABOUT_BLIND}\n")?;
    writeln!(
        page,
        "| barometer | after 5 s, m | after 10 s, m | after 20 s, m |\n|---|---|---|---|"
    )?;
    let errors = blind(n)?;
    for (name, with) in [("no", 0), ("yes", 1)] {
        let at = |k: usize| middle_and_most(&errors.iter().map(|e| e[with][k]).collect::<Vec<_>>());
        writeln!(page, "| {name} | {} | {} | {} |", at(0), at(1), at(2))?;
    }
    Ok(())
}

const ABOUT: &str = "\
Rms error of the estimated height over 30 s of hover with `estimator.baro.fuse` off and on. Median, worst of
the flights; in brackets how many of them got to hover, where not all. The simulated barometer has white noise of 2.5 Pa (0.2 m), no
weather and no wash of the wings. On recorded flights it does not change the median
([ESTIMATOR.md](ESTIMATOR.md), *without barometer*).";
const ABOUT_BLIND: &str = "\
Error of the height of a filter that hears no UWB any more while the vehicle hovers on (by itself it would
land after 1 s, `limits.uwb_loss_land_s`):";
