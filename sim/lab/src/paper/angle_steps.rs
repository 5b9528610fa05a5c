//! Angle steps: a lean held in a long hall until the speed has settled, and what it gathered.

use anyhow::{Context, Result, bail};
use haltere_core::control::Version;
use haltere_core::frames::Vec3;
use haltere_core::survey::Survey;
use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd};
use haltere_model::lockstep::fly;
use haltere_model::room::Room;
use haltere_model::{PlantConfig, Vehicle};

use super::bench::Bench;
use crate::compare::in_plant;
use crate::steps::item;

/// Names of the axes: pitch flies north, roll east.
pub const AXES: [&str; 2] = ["pitch", "roll"];
/// How long a lean is held, s: more than five time constants of either drag.
pub const HOLD_S: f64 = 3.0;
/// Time until the attitude has arrived, s: what is before is not the law of a constant lean.
pub const ARRIVAL_S: f64 = 0.3;
/// The last part of the hold, in which the speed counts as final, s.
const FINAL_S: f64 = 0.3;
/// The part over which it is asked whether the speed still changes, s.
const LATE_S: f64 = 0.5;
/// Simulated time of a flight, s.
pub const FLIGHT_S: f64 = 22.0;
/// Length of the hall along the step, and its width, m. 52° of roll gathers more than 6 m/s: in the
/// source's 10 m nobody would see where that ends.
const HALL_M: [f64; 2] = [34.0, 10.0];
/// Where the flight starts along the hall, and its height, m.
const START_M: f64 = 1.5;
const HEIGHT_M: f64 = 2.0;
/// Length of the source's hall, and what is left to its walls, m.
pub const SOURCE_HALL_M: [f64; 2] = [10.0, 0.9];

/// One step as flown.
#[derive(Debug, Clone)]
pub struct AngleStep {
    /// Since the lean was set: time s, speed m/s, way m.
    pub trace: Vec<[f64; 3]>,
    /// Speed at the end, m/s.
    pub final_mps: f64,
    /// Flap rate, mean of both wings, half a second after the lean was set and at the end, Hz.
    pub flap_hz: [f64; 2],
    /// How many rows of the trace fit into the source's hall.
    pub fits: usize,
}

impl AngleStep {
    /// What the source could see of it: its hall, and braking in it.
    pub fn in_hall(&self) -> &[[f64; 3]] {
        self.trace.get(..self.fits).unwrap_or_default()
    }

    /// Acceleration over the last half second that the source could see, m/s².
    pub fn late_mps2(&self) -> f64 {
        let seen = self.in_hall();
        let end_s = seen.last().map_or(0.0, |row| row[0]);
        let late = seen.partition_point(|row| row[0] <= end_s - LATE_S);
        match seen.get(late..) {
            Some([first, .., last]) => (last[1] - first[1]) / (last[0] - first[0]),
            _ => 0.0,
        }
    }
}

/// The hall, its long side along the step.
fn hall(axis: usize, vehicle: &Vehicle, seed: u64) -> Result<PlantConfig> {
    let [long, wide] = HALL_M;
    let mut room = Room { north_m: [0.0, wide], east_m: [0.0, wide], ..Room::default() };
    let mut start = [wide / 2.0; 2];
    if axis == 0 {
        room.north_m = [0.0, long];
    } else {
        room.east_m = [0.0, long];
    }
    start[axis] = START_M;
    let survey = Survey::new(&room.corner_anchors())?;
    Ok(PlantConfig {
        room,
        vehicle: vehicle.clone(),
        start_E_m: Vec3::new(start[0], start[1], 0.0),
        ..PlantConfig::new(survey, seed)
    })
}

/// A lean of this angle, degrees, towards the far end.
fn tilt(axis: usize, angle_deg: f64) -> MISSION_ITEM_INT_DATA {
    let mut tilt = item(MavCmd::MAV_CMD_USER_2, [0.0; 3]);
    // Axis 0 roll, 1 pitch; nose down flies north, right side down east.
    tilt.param1 = if axis == 0 { 1.0 } else { 0.0 };
    tilt.param2 = if axis == 0 { -angle_deg as f32 } else { angle_deg as f32 };
    tilt.param3 = HOLD_S as f32;
    tilt.param4 = 1.0;
    tilt
}

/// Flies one step of an axis (0 pitch, 1 roll). `None`: the companion refused it for want of thrust, as
/// it does for 52° when the battery is not quite full.
pub fn fly_step(
    bench: &Bench,
    vehicle: &Vehicle,
    axis: usize,
    angle_deg: f64,
    seed: u64,
) -> Result<Option<AngleStep>> {
    let plant = hall(axis, vehicle, seed)?;
    let [north, east, _] = plant.start_E_m.to_array();
    let up = [north, east, -HEIGHT_M];
    let items = [
        item(MavCmd::MAV_CMD_NAV_TAKEOFF, up),
        tilt(axis, angle_deg),
        item(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3]),
    ];
    let mut pilot = bench.pilot.clone();
    // Neither column: what a board says is down is off while it speeds up for seconds.
    pilot.estimator.board_vertical.fuse = false;
    // Quickly, while the battery is full: 52° needs 1.62 of the hover thrust, and that is all there is.
    pilot.flight.takeoff_speed_mps = 1.0;
    // The steps need all of the hall, up to its anchors.
    pilot.limits.resolve_to_anchors(&plant.survey);
    let mut control = bench.version(Version::Modified);
    control.limits.thrust_max_frac = 1.0;
    let mut world = in_plant(&pilot, &control, plant)?;
    let flight = fly(&mut world, &items, FLIGHT_S + 30.0)?;
    let name = AXES[axis];
    let wanted = if axis == 0 { -angle_deg } else { angle_deg }.to_radians();
    let held: Vec<_> = flight
        .samples
        .iter()
        .filter(|s| {
            let set = if axis == 0 { s.control.pitch_rad } else { s.control.roll_rad };
            (set - wanted).abs() < 1e-6
        })
        .collect();
    if flight.texts.iter().any(|t| t.contains("refused") && t.contains("times the hover thrust")) {
        return Ok(None);
    }
    let first = held.first().with_context(|| {
        format!(
            "{} {name} {angle_deg} deg, seed {seed}: not flown; {:?}",
            vehicle.name, flight.texts
        )
    })?;
    let origin = first.truth.pos_E_m;
    let trace: Vec<[f64; 3]> = held
        .iter()
        .map(|s| {
            let t_s = (s.t_us - first.t_us) as f64 * 1e-6;
            [t_s, s.truth.vel_E_mps[axis], s.truth.pos_E_m[axis] - origin[axis]]
        })
        .collect();
    let length_s = trace.last().map_or(0.0, |row| row[0]);
    if length_s < HOLD_S - 0.2 {
        bail!(
            "{} {name} {angle_deg} deg, seed {seed}: held {length_s:.2} s of {HOLD_S}; {:?}",
            vehicle.name,
            flight.texts
        );
    }
    let last: Vec<f64> =
        trace.iter().filter(|row| row[0] > length_s - FINAL_S).map(|row| row[1]).collect();
    let flap =
        |s: &haltere_model::lockstep::Sample| 0.5 * (s.truth.flap_hz[0] + s.truth.flap_hz[1]);
    let early = held.get((LATE_S * 100.0) as usize).unwrap_or(first);
    let [source_m, margin_m] = SOURCE_HALL_M;
    let room_m = source_m - 2.0 * margin_m;
    let fits =
        trace.iter().take_while(|row| row[2] + haltere_pilot::stopping_m(row[1]) < room_m).count();
    Ok(Some(AngleStep {
        final_mps: last.iter().sum::<f64>() / last.len() as f64,
        flap_hz: [flap(early), held.last().map_or(0.0, |s| flap(s))],
        fits,
        trace,
    }))
}
