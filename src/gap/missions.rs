//! The standard flights of the diagnosis, as missions that any ground station can upload.
//!
//! What is not excited is not known: the diagnostic flight visits floor and ceiling, turns on the
//! spot, dashes along both axes, follows the walls at two heights, and rocks attitude and thrust at
//! two amplitudes (GAP.md 2.6). The plain flight is a hover and a box. The held-out flight shares
//! no leg with the diagnostic one and is what shrinkage is measured on.

use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame};

use super::scene::Scene;

/// Height of everything that is not about height, m.
const HEIGHT_M: f64 = 1.0;
/// Near the floor, m.
const LOW_M: f64 = 0.30;
/// Near a ceiling of 3 m, m.
const HIGH_M: f64 = 2.6;
/// Half the way of a dash, m.
const DASH_M: f64 = 1.9;
/// Half the side of the square along the walls, m.
const EDGE_M: f64 = 2.2;
/// Speed of ordinary legs and of dashes, m/s.
const LEG_MPS: f32 = 0.8;
const DASH_MPS: f32 = 1.6;
const EDGE_MPS: f32 = 1.2;
/// Doublets: axis, amplitude (degrees, or share of full throttle), length of each half, s. Two
/// amplitudes and two lengths tell a dead band from a lag (GAP.md 2.6: 0.15 rad 0.6 s, 0.08 rad
/// 0.3 s; throttle 12 %).
const ROLL: [f32; 3] = [0.0, 8.6, 0.5];
const ROLL_SMALL: [f32; 3] = [0.0, 4.6, 0.3];
const PITCH: [f32; 3] = [1.0, 8.6, 0.5];
const PITCH_SMALL: [f32; 3] = [1.0, 4.6, 0.3];
const THRUST: [f32; 3] = [2.0, 0.12, 0.4];
const THRUST_SMALL: [f32; 3] = [2.0, 0.04, 0.4];
/// Distance at which a point counts as reached, m: larger than the error of tracking under an
/// effect, so that a flight does not hang on it.
const REACHED_M: f32 = 0.7;

/// A list of items under construction, relative to the middle of the room.
struct Plan {
    middle_NE_m: [f64; 2],
    items: Vec<MISSION_ITEM_INT_DATA>,
}

impl Plan {
    fn new(scene: &Scene) -> Self {
        let mut plan = Self { middle_NE_m: scene.start_NE_m, items: Vec::new() };
        plan.at(MavCmd::MAV_CMD_NAV_TAKEOFF, [0.0, 0.0], HEIGHT_M);
        plan
    }

    fn push(&mut self, command: MavCmd, params: [f32; 4]) -> &mut MISSION_ITEM_INT_DATA {
        let seq = self.items.len() as u16;
        self.items.push(MISSION_ITEM_INT_DATA {
            seq,
            command,
            frame: MavFrame::MAV_FRAME_LOCAL_NED,
            param1: params[0],
            param2: params[1],
            param3: params[2],
            param4: params[3],
            autocontinue: 1,
            ..Default::default()
        });
        let last = self.items.len() - 1;
        &mut self.items[last]
    }

    fn at(&mut self, command: MavCmd, off_NE_m: [f64; 2], height_m: f64) {
        let [north, east] = self.middle_NE_m;
        let item = self.push(command, [0.0, REACHED_M, 0.0, f32::NAN]);
        // Local missions count in 0.1 mm.
        item.x = ((north + off_NE_m[0]) * 1e4).round() as i32;
        item.y = ((east + off_NE_m[1]) * 1e4).round() as i32;
        item.z = -height_m as f32;
    }

    fn go(&mut self, off_NE_m: [f64; 2], height_m: f64, hold_s: f32) {
        self.at(MavCmd::MAV_CMD_NAV_WAYPOINT, off_NE_m, height_m);
        if let Some(item) = self.items.last_mut() {
            item.param1 = hold_s;
        }
    }

    fn speed(&mut self, mps: f32) {
        self.push(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [0.0, mps, 0.0, 0.0]);
    }

    fn turn(&mut self, yaw_deg: f32, stay_s: f32) {
        self.push(MavCmd::MAV_CMD_CONDITION_YAW, [yaw_deg, 0.0, 0.0, 0.0]);
        self.push(MavCmd::MAV_CMD_NAV_DELAY, [stay_s, 0.0, 0.0, 0.0]);
    }

    /// Axis, amplitude and half length as in the mission protocol, then a rest to come back.
    fn doublet(&mut self, [axis, amplitude, half_s]: [f32; 3]) {
        self.push(MavCmd::MAV_CMD_USER_1, [axis, amplitude, half_s, 0.0]);
        self.push(MavCmd::MAV_CMD_NAV_DELAY, [1.4, 0.0, 0.0, 0.0]);
    }

    fn land(mut self) -> Vec<MISSION_ITEM_INT_DATA> {
        self.push(MavCmd::MAV_CMD_NAV_LAND, [0.0; 4]);
        self.items
    }
}

/// The standard diagnostic flight, about 100 s.
pub fn diagnostic(scene: &Scene) -> Vec<MISSION_ITEM_INT_DATA> {
    let mut plan = Plan::new(scene);
    plan.speed(LEG_MPS);
    plan.go([0.0, 0.0], HEIGHT_M, 3.0);
    plan.go([0.0, 0.0], LOW_M, 4.0);
    plan.go([0.0, 0.0], HIGH_M, 4.0);
    plan.go([0.0, 0.0], HEIGHT_M, 1.0);
    for yaw_deg in [90.0, 180.0, -90.0, 0.0] {
        plan.turn(yaw_deg, 2.5);
    }
    plan.speed(DASH_MPS);
    for axis in 0..2 {
        for side in [1.0, -1.0, 1.0] {
            let mut off = [0.0; 2];
            off[axis] = side * DASH_M;
            plan.go(off, HEIGHT_M, 0.4);
        }
        plan.go([0.0, 0.0], HEIGHT_M, 0.5);
    }
    plan.speed(EDGE_MPS);
    for (height_m, corners) in [
        (HEIGHT_M, [[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]]),
        (1.8, [[-1.0, 1.0], [1.0, 1.0], [1.0, 0.0]]),
    ] {
        for [n, e] in corners {
            plan.go([n * EDGE_M, e * EDGE_M], height_m, 0.3);
        }
    }
    plan.go([0.0, 0.0], HEIGHT_M, 1.0);
    for [large, small] in [[ROLL, ROLL_SMALL], [PITCH, PITCH_SMALL], [THRUST, THRUST_SMALL]] {
        plan.doublet(large);
        plan.doublet(small);
    }
    plan.go([0.0, 0.0], HEIGHT_M, 1.0);
    plan.land()
}

/// A hover and a box, about 60 s: what people fly who do not think of a diagnosis.
pub fn plain(scene: &Scene) -> Vec<MISSION_ITEM_INT_DATA> {
    let mut plan = Plan::new(scene);
    plan.speed(LEG_MPS);
    plan.go([0.0, 0.0], HEIGHT_M, 10.0);
    for _ in 0..2 {
        for [n, e] in [[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]] {
            plan.go([n, e], HEIGHT_M, 1.0);
        }
    }
    plan.go([0.0, 0.0], HEIGHT_M, 5.0);
    plan.land()
}

/// Another mission than the diagnostic one, about 80 s, on which shrinkage is measured: diagonals,
/// a ladder of heights, and legs flown sideways and backwards.
pub fn held_out(scene: &Scene) -> Vec<MISSION_ITEM_INT_DATA> {
    let mut plan = Plan::new(scene);
    plan.speed(LEG_MPS);
    for height_m in [0.35, 0.8, 1.5, 2.4, 1.2] {
        plan.go([0.0, 0.0], height_m, 3.0);
    }
    plan.speed(1.3);
    for [n, e] in [[1.6, 1.6], [-1.6, -1.6], [1.6, -1.6], [-1.6, 1.6], [0.0, 0.0]] {
        plan.go([n, e], 1.2, 0.5);
    }
    plan.turn(120.0, 2.0);
    for [n, e] in [[2.1, 0.0], [0.0, 2.1], [-2.1, 0.0], [0.0, -2.1], [0.0, 0.0]] {
        plan.go([n, e], 1.4, 0.5);
    }
    plan.turn(-60.0, 2.0);
    plan.go([1.5, -0.5], 0.8, 1.0);
    plan.go([-0.5, 1.5], 1.6, 1.0);
    plan.go([0.0, 0.0], HEIGHT_M, 3.0);
    plan.land()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lockstep::{Lockstep, fly};

    #[test]
    fn val_every_standard_flight_is_flown_to_its_end() {
        let scene = Scene::lab().unwrap();
        for (name, items) in [
            ("diagnostic", diagnostic(&scene)),
            ("plain", plain(&scene)),
            ("held out", held_out(&scene)),
        ] {
            let mut world = Lockstep::new(scene.plant(1), scene.pilot.clone(), &scene.survey)
                .unwrap()
                .without_topics();
            let flight = fly(&mut world, &items, 200.0).unwrap();
            let flown_s = flight.samples.len() as f64 * 0.01;
            println!(
                "{name}: {flown_s:.1} s, reached {:?}, {:?}",
                flight.samples.last().map(|s| s.reached),
                flight.texts
            );
            assert!(flight.landed, "{name}");
            assert!(flight.samples.iter().all(|s| !s.truth.crashed), "{name}");
            assert!((50.0..130.0).contains(&flown_s), "{name}: {flown_s} s");
        }
    }
}
