//! Shapes at walking pace in lockstep: how good the estimate is, and how well they are followed.

use anyhow::Result;
use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd};

use haltere::named_missions::{SHAPE_HEIGHT_M as HEIGHT_M, SHAPE_SPEED_MPS};
use haltere_core::control::{ControlConfig, Version};
use haltere_model::PlantConfig;
use haltere_model::lockstep::{Flight, Sample, fly};
use haltere_pilot::{Mode, PilotConfig};

use crate::compare::{CENTRE_NE_M, in_plant};
use crate::steps::item;

/// Longest flight, s.
const LIMIT_S: f64 = 120.0;
/// What one flight showed.
#[derive(Debug, Clone, Copy, Default)]
pub struct PathScore {
    /// Mean |estimate - truth|, m.
    pub estimate_m: [f64; 3],
    /// Mean |truth - setpoint|, m.
    pub tracking_m: [f64; 3],
    /// Whether it fell.
    pub crashed: bool,
}

/// Take-off, a shape about the middle of the hall, landing.
pub fn mission(corners: &[[f64; 2]]) -> Vec<MISSION_ITEM_INT_DATA> {
    let [n, e] = CENTRE_NE_M;
    let mut items = vec![item(MavCmd::MAV_CMD_NAV_TAKEOFF, [n, e, -HEIGHT_M])];
    let mut settle = item(MavCmd::MAV_CMD_NAV_WAYPOINT, [n, e, -HEIGHT_M]);
    settle.param1 = 4.0;
    items.push(settle);
    let mut speed = item(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [0.0; 3]);
    speed.param2 = SHAPE_SPEED_MPS;
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
    PathScore {
        estimate_m: mean(&on_path, |s, i| (s.estimate.pos_E_m[i] - s.truth.pos_E_m[i]).abs()),
        tracking_m: mean(&on_path, |s, i| {
            s.control.pos_setpoint_E_m[i].map_or(0.0, |p| (s.truth.pos_E_m[i] - p).abs())
        }),
        crashed: flight.samples.iter().any(|s| s.truth.crashed),
    }
}
