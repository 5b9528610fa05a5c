//! The step tests of the source: 1 m and 2 m in x, y and z, `raw` against `modified`.
//!
//! The error of a step is the mean of |truth - command| along the stepped axis over the
//! [`WINDOW_S`] after the command jumps: the response itself and the hold that follows. The search for gains goes by it;
//! `paper` looks at shorter windows as well.

use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd};

use haltere_model::lockstep::{Flight, FlightError, Lockstep, Sample, World, fly, local_item};

/// Time after a step over which its error is averaged, s.
pub const WINDOW_S: f64 = 10.0;
/// The same in control steps.
pub const WINDOW_SAMPLES: usize = (WINDOW_S * 100.0) as usize;
/// Time at the end of the window in which the response is over, s.
pub const REST_S: f64 = 5.0;
/// Height at which steps in x and y are flown, m: as the demo's take-off.
pub const HEIGHT_M: f64 = 1.2;
/// Sizes of the source, m.
pub const SIZES_M: [f64; 2] = [1.0, 2.0];
/// Names of the axes as the source calls them: x north, y east, z up.
pub const AXES: [&str; 3] = ["x", "y", "z"];
/// Speed at which the setpoint jumps, m/s: above every velocity limit that the controller allows.
const JUMP_MPS: f32 = 20.0;
/// Longest flight, s.
const LIMIT_S: f64 = 280.0;

/// Error of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepScore {
    /// 0 x, 1 y, 2 z.
    pub axis: usize,
    /// Size of the step, m.
    pub size_m: f64,
    /// Mean |truth - command| along the axis, m.
    pub position_mae_m: f64,
    /// Standard deviation of |truth - command|, m.
    pub position_std_m: f64,
    /// Mean |velocity - velocity setpoint| along the axis, m/s.
    pub velocity_mae_mps: f64,
    /// Mean |estimate - command| along the axis, m: what control can see of the error.
    pub seen_mae_m: f64,
    /// Mean |truth - command| over the last [`REST_S`], m: what is left when the response is over,
    /// for the most part the bias of the estimate.
    pub rest_mae_m: f64,
    /// Farthest beyond the command, m.
    pub overshoot_m: f64,
}

/// One step of the programme: where from, where to.
#[derive(Debug, Clone, Copy)]
pub struct Leg {
    /// 0 x, 1 y, 2 z.
    pub axis: usize,
    /// Size, m.
    pub size_m: f64,
    /// Coordinate of the stepped axis before, m.
    pub from_m: f64,
    /// Where to, Earth frame, m.
    pub to_E_m: [f64; 3],
}

/// Steps out and back along each axis, with both sizes, from the middle of the hall.
fn programme(centre_NE_m: [f64; 2]) -> Vec<Leg> {
    let home = [centre_NE_m[0], centre_NE_m[1], -HEIGHT_M];
    let mut legs = Vec::new();
    for axis in 0..3 {
        for size_m in SIZES_M {
            let mut out = home;
            // Up is negative.
            out[axis] += if axis == 2 { -size_m } else { size_m };
            legs.push(Leg { axis, size_m, from_m: home[axis], to_E_m: out });
            legs.push(Leg { axis, size_m, from_m: out[axis], to_E_m: home });
        }
    }
    legs
}

/// An item in the local frame.
pub fn item(command: MavCmd, point_E_m: [f64; 3]) -> MISSION_ITEM_INT_DATA {
    local_item(command, point_E_m, 0.0)
}

/// A mission that flies points by steps, each held for the window.
fn mission(centre_NE_m: [f64; 2]) -> Vec<MISSION_ITEM_INT_DATA> {
    let home = [centre_NE_m[0], centre_NE_m[1], -HEIGHT_M];
    let mut items = vec![item(MavCmd::MAV_CMD_NAV_TAKEOFF, home)];
    let mut settle = item(MavCmd::MAV_CMD_NAV_WAYPOINT, home);
    settle.param1 = 4.0;
    items.push(settle);
    let mut jump = item(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [0.0; 3]);
    jump.param2 = JUMP_MPS;
    items.push(jump);
    for leg in programme(centre_NE_m) {
        let mut point = item(MavCmd::MAV_CMD_NAV_WAYPOINT, leg.to_E_m);
        // Held from arrival on, so each leg lasts longer than the window.
        point.param1 = WINDOW_S as f32;
        point.param2 = 0.5;
        items.push(point);
    }
    items.push(item(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3]));
    items
}

/// Flies the programme in a world that is ready to take off.
pub fn fly_steps<W: World>(
    world: &mut Lockstep<W>,
    centre_NE_m: [f64; 2],
) -> Result<(Vec<StepScore>, Flight), FlightError> {
    let flight = fly(world, &mission(centre_NE_m), LIMIT_S)?;
    Ok((score(&flight, &programme(centre_NE_m)), flight))
}

/// Each step that was flown for the whole window, and the number of the sample at which it begins.
pub fn begins(flight: &Flight, centre_NE_m: [f64; 2]) -> Vec<(Leg, usize)> {
    find(flight, &programme(centre_NE_m))
}

/// Finds each step in the commanded position.
fn find(flight: &Flight, legs: &[Leg]) -> Vec<(Leg, usize)> {
    let commanded = |s: &Sample, axis: usize| s.control.pos_setpoint_E_m[axis];
    let mut found = Vec::new();
    let mut from = 0;
    for leg in legs {
        let jump = flight.samples.windows(2).enumerate().skip(from).find_map(|(i, pair)| {
            let before = commanded(&pair[0], leg.axis)?;
            let after = commanded(&pair[1], leg.axis)?;
            let jumped = (after - before).abs() > 0.9 * leg.size_m;
            (jumped && (after - leg.to_E_m[leg.axis]).abs() < 1e-3).then_some(i + 1)
        });
        let Some(start) = jump.filter(|s| s + WINDOW_SAMPLES <= flight.samples.len()) else {
            break;
        };
        from = start;
        found.push((*leg, start));
    }
    found
}

/// Averages over the window of each step.
fn score(flight: &Flight, legs: &[Leg]) -> Vec<StepScore> {
    let count = WINDOW_SAMPLES;
    let mut scores = Vec::new();
    for (leg, start) in find(flight, legs) {
        let window = &flight.samples[start..start + count];
        let errors: Vec<f64> = window
            .iter()
            .map(|s| (s.truth.pos_E_m[leg.axis] - leg.to_E_m[leg.axis]).abs())
            .collect();
        let mean = errors.iter().sum::<f64>() / count as f64;
        let var = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / count as f64;
        let velocity: f64 = window
            .iter()
            .map(|s| (s.truth.vel_E_mps[leg.axis] - s.control.vel_setpoint_E_mps[leg.axis]).abs())
            .sum();
        let seen: f64 = window
            .iter()
            .map(|s| (s.estimate.pos_E_m[leg.axis] - leg.to_E_m[leg.axis]).abs())
            .sum();
        let rest = &errors[count - (REST_S * 100.0) as usize..];
        let way = leg.to_E_m[leg.axis] - leg.from_m;
        let overshoot_m = window
            .iter()
            .map(|s| (s.truth.pos_E_m[leg.axis] - leg.to_E_m[leg.axis]) * way.signum())
            .fold(0.0, f64::max);
        scores.push(StepScore {
            axis: leg.axis,
            size_m: leg.size_m,
            position_mae_m: mean,
            position_std_m: var.sqrt(),
            velocity_mae_mps: velocity / count as f64,
            seen_mae_m: seen / count as f64,
            rest_mae_m: rest.iter().sum::<f64>() / rest.len() as f64,
            overshoot_m,
        });
    }
    scores
}

/// Mean over the steps of one axis and size.
pub fn mean_of(
    scores: &[StepScore],
    axis: usize,
    size_m: f64,
    pick: impl Fn(&StepScore) -> f64,
) -> Option<f64> {
    let picked: Vec<f64> =
        scores.iter().filter(|s| s.axis == axis && s.size_m == size_m).map(pick).collect();
    (!picked.is_empty()).then(|| picked.iter().sum::<f64>() / picked.len() as f64)
}

/// Whether a flight flew all steps.
pub fn is_complete(scores: &[StepScore]) -> bool {
    scores.len() == 2 * AXES.len() * SIZES_M.len()
}
