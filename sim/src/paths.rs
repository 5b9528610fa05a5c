//! Shapes at walking pace in lockstep: how good the estimate is, how far a take-off overshoots, and how soon a landing is
//! noticed.

use anyhow::Result;
use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd};

use haltere_core::control::{ControlConfig, Version};
use haltere_model::PlantConfig;
use haltere_model::lockstep::{Flight, Sample, fly};
use haltere_pilot::{Mode, PilotConfig};

use crate::compare::{CENTRE_NE_M, in_plant};
use crate::steps::{HEIGHT_M, item};

/// Longest flight, s.
const LIMIT_S: f64 = 120.0;
/// Speed of the setpoint, m/s.
pub const SPEED_MPS: f32 = 0.5;
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

/// Take-off, a shape about the middle of the hall, landing.
pub fn mission(corners: &[[f64; 2]]) -> Vec<MISSION_ITEM_INT_DATA> {
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
