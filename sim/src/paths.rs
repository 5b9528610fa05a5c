//! `haltere-sim paths`: shapes at walking pace in lockstep, over many seeds: how good the estimate
//! is, how far a take-off overshoots, and how soon a landing is noticed.

use anyhow::{Result, bail};
use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd};
use rayon::prelude::*;
use serde_json::json;

use haltere_core::control::{ControlConfig, Version};
use haltere_model::PlantConfig;
use haltere_model::lockstep::{Flight, Sample, fly};
use haltere_pilot::{Mode, PilotConfig};

use crate::compare::{CENTRE_NE_M, in_plant, pilot_config};
use crate::steps::{AXES, HEIGHT_M, item};

/// First seed.
const SEED: u64 = 100;
/// Longest flight, s.
const LIMIT_S: f64 = 120.0;
/// Speed of the setpoint, m/s.
const SPEED_MPS: f32 = 0.5;
/// Mean absolute error of the estimate that is allowed on a path, m (paper: 8 to 10 cm).
const ESTIMATE_BOUND_M: f64 = 0.10;
/// A landing must be noticed within this time after contact, s.
const TOUCH_BOUND_S: f64 = 2.0;
/// Shapes of the source: corners from the centre, north and east, m.
pub const SHAPES: [(&str, &[[f64; 2]]); 4] = [
    ("straight", &[[-1.2, -0.9], [1.2, 0.9], [-1.2, -0.9]]),
    ("square", &[[0.8, 0.8], [0.8, -0.8], [-0.8, -0.8], [-0.8, 0.8], [0.8, 0.8]]),
    ("rhombus", &[[1.2, 0.0], [0.0, 0.8], [-1.2, 0.0], [0.0, -0.8], [1.2, 0.0]]),
    (
        "hexagon",
        &[
            [0.9, 0.0],
            [0.45, 0.779],
            [-0.45, 0.779],
            [-0.9, 0.0],
            [-0.45, -0.779],
            [0.45, -0.779],
            [0.9, 0.0],
        ],
    ),
];

/// `haltere-sim paths`
#[derive(Debug, clap::Args)]
pub struct PathOptions {
    /// Repetitions, each with a seed of its own.
    #[arg(long, default_value_t = 20)]
    pub repetitions: u64,
    /// Configuration to fly.
    #[arg(long, value_name = "FILE")]
    pub config: Option<std::path::PathBuf>,
    /// Change one key, as for the companion.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub set: Vec<String>,
    /// Print JSON instead of the table.
    #[arg(long)]
    pub json: bool,
}

/// What one flight showed.
#[derive(Debug, Clone, Copy, Default)]
pub struct PathScore {
    /// Mean |estimate - truth|, m.
    pub estimate_m: [f64; 3],
    /// Mean |estimate - truth| of the velocity, Earth frame, m/s.
    pub velocity_mps: [f64; 3],
    /// Mean |truth - setpoint|, m.
    pub tracking_m: [f64; 3],
    /// How far the take-off went above its height, m.
    pub takeoff_over_m: f64,
    /// From contact with the floor to disarming, s. Infinite: not noticed.
    pub touch_s: f64,
    /// Whether it fell.
    pub crashed: bool,
}

fn mission(corners: &[[f64; 2]]) -> Vec<MISSION_ITEM_INT_DATA> {
    let [n, e] = CENTRE_NE_M;
    let mut items = vec![item(MavCmd::MAV_CMD_NAV_TAKEOFF, [n, e, -HEIGHT_M])];
    let mut settle = item(MavCmd::MAV_CMD_NAV_WAYPOINT, [n, e, -HEIGHT_M]);
    settle.param1 = 4.0;
    items.push(settle);
    let mut speed = item(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [0.0; 3]);
    speed.param2 = SPEED_MPS;
    items.push(speed);
    for (i, [dn, de]) in corners.iter().enumerate() {
        let mut corner = item(MavCmd::MAV_CMD_NAV_WAYPOINT, [n + dn, e + de, -HEIGHT_M]);
        corner.param1 = if i == 0 { 2.0 } else { 0.0 };
        corner.param2 = 0.5;
        items.push(corner);
    }
    items.push(item(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3]));
    items
}

/// Flies a shape in any plant.
pub fn fly_path(
    pilot: &PilotConfig,
    version: Version,
    corners: &[[f64; 2]],
    plant: PlantConfig,
) -> Result<(PathScore, Flight)> {
    let control = ControlConfig { version, ..pilot.control.clone() };
    let mut world = in_plant(pilot, &control, plant)?;
    let flight = fly(&mut world, &mission(corners), LIMIT_S)?;
    Ok((score(&flight), flight))
}

/// The part of a flight in which the shape was flown.
///
/// Items: take-off, settle, speed, then corners; on the path from the first corner on.
pub fn on_path(flight: &Flight) -> Vec<&Sample> {
    flight.samples.iter().filter(|s| s.mode == Mode::Mission && s.reached >= 4).collect()
}

fn mean(samples: &[&Sample], pick: impl Fn(&Sample, usize) -> f64) -> [f64; 3] {
    std::array::from_fn(|axis| {
        samples.iter().map(|s| pick(s, axis)).sum::<f64>() / samples.len().max(1) as f64
    })
}

fn score(flight: &Flight) -> PathScore {
    let on_path = on_path(flight);
    let contact = flight.samples.iter().find(|s| s.mode == Mode::Land && s.truth.on_ground);
    let end = flight.samples.last();
    PathScore {
        estimate_m: mean(&on_path, |s, i| (s.estimate.pos_E_m[i] - s.truth.pos_E_m[i]).abs()),
        velocity_mps: mean(&on_path, |s, i| {
            (s.estimate.vel_E_mps()[i] - s.truth.vel_E_mps[i]).abs()
        }),
        tracking_m: mean(&on_path, |s, i| {
            s.control.pos_setpoint_E_m[i].map_or(0.0, |p| (s.truth.pos_E_m[i] - p).abs())
        }),
        takeoff_over_m: flight
            .samples
            .iter()
            .filter(|s| s.reached < 4)
            .map(|s| -s.truth.pos_E_m.z() - HEIGHT_M)
            .fold(0.0, f64::max),
        touch_s: match (contact, end, flight.landed) {
            (Some(contact), Some(end), true) => (end.t_us - contact.t_us) as f64 * 1e-6,
            _ => f64::INFINITY,
        },
        crashed: flight.samples.iter().any(|s| s.truth.crashed),
    }
}

/// Flies and prints. `false`: a bound is broken.
pub fn paths(options: &PathOptions) -> Result<bool> {
    let pilot = pilot_config(options.config.as_deref(), &options.set)?;
    let mut ok = true;
    let mut rows = Vec::new();
    for version in [Version::Raw, Version::Modified] {
        for (name, corners) in SHAPES {
            let scores: Vec<PathScore> = (0..options.repetitions)
                .into_par_iter()
                .map(|i| {
                    let plant = PlantConfig::hall(SEED + i);
                    Ok(fly_path(&pilot, version, corners, plant)?.0)
                })
                .collect::<Result<_>>()?;
            if scores.is_empty() {
                bail!("nothing was flown: --repetitions must be at least 1");
            }
            let n = scores.len() as f64;
            let average = |pick: fn(&PathScore) -> [f64; 3]| -> [f64; 3] {
                std::array::from_fn(|axis| scores.iter().map(|s| pick(s)[axis]).sum::<f64>() / n)
            };
            let worst = |pick: fn(&PathScore) -> f64| scores.iter().map(pick).fold(0.0, f64::max);
            let estimate_m = average(|s| s.estimate_m);
            let touch_s = worst(|s| s.touch_s);
            let mut touches: Vec<f64> = scores.iter().map(|s| s.touch_s).collect();
            touches.sort_by(f64::total_cmp);
            let share = |part: f64| touches[((touches.len() - 1) as f64 * part).round() as usize];
            let crashes = scores.iter().filter(|s| s.crashed).count();
            if version == Version::Modified {
                ok &= estimate_m.iter().all(|e| *e <= ESTIMATE_BOUND_M);
            }
            ok &= touch_s <= TOUCH_BOUND_S && crashes == 0;
            rows.push(json!({
                "version": format!("{version:?}"),
                "path": name,
                "estimate_mae_m": estimate_m,
                "estimate_worst_m": std::array::from_fn::<f64, 3, _>(|axis| {
                    scores.iter().map(|s| s.estimate_m[axis]).fold(0.0, f64::max)
                }),
                "velocity_mae_mps": average(|s| s.velocity_mps),
                "tracking_mae_m": average(|s| s.tracking_m),
                "takeoff_over_m": worst(|s| s.takeoff_over_m),
                "touch_s": touch_s,
                "touch_median_s": share(0.5),
                "touch_p95_s": share(0.95),
                "crashes": crashes,
            }));
        }
    }
    if options.json {
        println!("{}", json!({ "ok": ok, "paths": rows }));
        return Ok(ok);
    }
    println!(
        "{:8} {:8} {:^20} {:^20} {:^20} {:^20} {:>8} {:>7} {:>5} {:>5} crashes",
        "version",
        "path",
        "estimate-truth m",
        "worst flight m",
        "velocity m/s",
        "truth-setpoint m",
        "over m",
        "touch s",
        "95 %",
        "50 %"
    );
    for row in &rows {
        let three = |key: &str| {
            let v = |i: usize| row[key][i].as_f64().unwrap_or(f64::NAN);
            AXES.iter().enumerate().map(|(i, _)| format!("{:6.3}", v(i))).collect::<String>()
        };
        println!(
            "{:8} {:8} {:^20} {:^20} {:^20} {:^20} {:8.3} {:7.2} {:5.2} {:5.2} {}",
            row["version"].as_str().unwrap_or(""),
            row["path"].as_str().unwrap_or(""),
            three("estimate_mae_m"),
            three("estimate_worst_m"),
            three("velocity_mae_mps"),
            three("tracking_mae_m"),
            row["takeoff_over_m"].as_f64().unwrap_or(f64::NAN),
            row["touch_s"].as_f64().unwrap_or(f64::INFINITY),
            row["touch_p95_s"].as_f64().unwrap_or(f64::INFINITY),
            row["touch_median_s"].as_f64().unwrap_or(f64::INFINITY),
            row["crashes"],
        );
    }
    println!(
        "means over {} flights each; over: most of a take-off above its height, touch: most from \
         contact to disarming",
        options.repetitions
    );
    Ok(ok)
}
