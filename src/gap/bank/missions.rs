//! The standard flights of the diagnosis, as missions that any ground station can upload.
//!
//! What is not excited is not known: the diagnostic flight visits floor and ceiling, turns on the
//! spot, dashes along both axes, follows the walls at two heights, and rocks attitude and thrust at
//! two amplitudes (GAP.md 2.6). The plain flight is a hover and a box. The held-out flight shares
//! no leg with the diagnostic one and is what shrinkage is measured on.

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;

use haltere_pilot::mission_file::{Command, DoubletAxis, Item, MissionFile};

use crate::scene::Scene;
use haltere_model::room::Room;

/// Height of everything that is not about height, m.
pub const HEIGHT_M: f64 = 1.0;
/// Near the floor, m: multipath shifts the estimate there by some 0.2 m, and at 0.45 m, where this hover once was, 5
/// of 60 healthy simulated vehicles met the floor, in the laboratory's room 16 of 40; a vehicle that stands
/// on its feet hides everything else. At 0.55 m none of 60 did, and 454 of 500 drawn effects stood out, 422 at 0.45 m
/// without the flights that the floor had carried, and 425 at 0.65 m (small banks of 2026-11-22).
pub(crate) const LOW_M: f64 = 0.55;
/// Near a ceiling of 3 m, m.
const HIGH_M: f64 = 2.6;
/// Half the way of a dash, m.
const DASH_M: f64 = 1.9;
/// Half the side of the square along the walls, m.
const EDGE_M: f64 = 2.4;
/// Speed of ordinary legs and of dashes, m/s.
pub const LEG_MPS: f64 = 0.8;
const DASH_MPS: [f64; 2] = [1.2, 1.6];
const EDGE_MPS: f64 = 1.2;
/// Doublets: amplitude (degrees, or share of full throttle) and length of each half, s. Two
/// amplitudes and two lengths tell a dead band from a lag (GAP.md 2.6: 0.15 rad 0.6 s, 0.08 rad
/// 0.3 s; throttle 12 %).
const LEAN_DOUBLETS: [[f64; 2]; 2] = [[8.6, 0.5], [4.6, 0.3]];
const THRUST_DOUBLETS: [[f64; 2]; 2] = [[0.12, 0.4], [0.04, 0.4]];
/// Rest after each, s.
const DOUBLET_REST_S: f64 = 1.4;
/// Distance at which a point counts as reached, m: larger than the error of tracking under an
/// effect, so that a flight does not hang on it.
const REACHED_M: f64 = 0.7;

/// Least distance of a waypoint to a wall, and to the ceiling, m: the error of tracking under an
/// effect and half a wing span.
const WALL_MARGIN_M: f64 = 0.6;
const CEILING_MARGIN_M: f64 = 0.4;
/// Ceiling below which there is no room for any of these flights, m.
const LOWEST_CEILING_M: f64 = 1.5;

/// A mission under construction, relative to the place of take-off. Waypoints stay inside the room.
pub struct Plan {
    middle_NE_m: [f64; 2],
    room: Room,
    pub(crate) items: Vec<Item>,
}

impl Plan {
    /// Begins with the take-off.
    pub fn new(scene: &Scene) -> Self {
        let height_m = HEIGHT_M.min(0.5 * scene.room.ceiling_m.max(LOWEST_CEILING_M));
        let takeoff = Item { height_m: Some(height_m), ..Item::new(Command::Takeoff) };
        Self { middle_NE_m: scene.start_NE_m, room: scene.room.clone(), items: vec![takeoff] }
    }

    /// To a place, and so long there.
    pub fn go(&mut self, off_NE_m: [f64; 2], height_m: f64, hold_s: f64) {
        let [north, east] = self.inside(off_NE_m);
        self.items.push(Item {
            hold_s: Some(hold_s),
            acceptance_m: Some(REACHED_M),
            ..Item::waypoint(north, east, self.under(height_m))
        });
    }

    /// Place in the room, moved away from walls.
    pub(crate) fn inside(&self, off_NE_m: [f64; 2]) -> [f64; 2] {
        let away = |at: f64, [low, high]: [f64; 2]| {
            let margin_m = WALL_MARGIN_M.min(0.5 * (high - low));
            // Not `clamp`: in a room narrower than both margins the two ends are one, but for the last bit,
            // and may stand the wrong way round.
            at.max(low + margin_m).min(high - margin_m)
        };
        let [north, east] = self.middle_NE_m;
        [away(north + off_NE_m[0], self.room.north_m), away(east + off_NE_m[1], self.room.east_m)]
    }

    /// Height in the room, moved away from the ceiling.
    pub(crate) fn under(&self, height_m: f64) -> f64 {
        let highest_m = self.room.ceiling_m.max(LOWEST_CEILING_M) - CEILING_MARGIN_M;
        height_m.min(highest_m)
    }

    /// Speed of the legs that follow.
    pub fn speed(&mut self, mps: f64) {
        self.items.push(Item { speed_mps: Some(mps), ..Item::new(Command::Speed) });
    }

    pub(crate) fn wait(&mut self, duration_s: f64) {
        self.items.push(Item { duration_s: Some(duration_s), ..Item::new(Command::Delay) });
    }

    pub(crate) fn turn(&mut self, yaw_deg: f64, stay_s: f64) {
        self.items.push(Item { yaw_deg: Some(yaw_deg), ..Item::new(Command::Yaw) });
        self.wait(stay_s);
    }

    /// Two doublets with a rest to come back after each.
    pub(crate) fn doublets(&mut self, axis: DoubletAxis, sizes: [[f64; 2]; 2]) {
        for [amplitude, half_s] in sizes {
            self.items.push(Item {
                axis: Some(axis),
                amplitude: Some(amplitude),
                half_s: Some(half_s),
                ..Item::new(Command::Doublet)
            });
            self.wait(DOUBLET_REST_S);
        }
    }

    /// Ends with the landing.
    pub fn land(mut self) -> MissionFile {
        self.items.push(Item::new(Command::Land));
        MissionFile { items: self.items }
    }
}

/// The standard diagnostic flight, about 100 s.
pub fn diagnostic_file(scene: &Scene) -> MissionFile {
    let mut plan = Plan::new(scene);
    plan.speed(LEG_MPS);
    plan.go([0.0, 0.0], HEIGHT_M, 3.0);
    plan.go([0.0, 0.0], LOW_M, 4.0);
    plan.go([0.0, 0.0], HIGH_M, 4.0);
    plan.go([0.0, 0.0], HEIGHT_M, 1.0);
    for yaw_deg in [90.0, 180.0, -90.0, 0.0] {
        plan.turn(yaw_deg, 2.5);
    }
    for (axis, mps) in DASH_MPS.into_iter().enumerate() {
        plan.speed(mps);
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
    plan.doublets(DoubletAxis::Roll, LEAN_DOUBLETS);
    plan.doublets(DoubletAxis::Pitch, LEAN_DOUBLETS);
    plan.doublets(DoubletAxis::Thrust, THRUST_DOUBLETS);
    plan.go([0.0, 0.0], HEIGHT_M, 1.0);
    plan.land()
}

/// A hover and a box, about 60 s: what people fly who do not think of a diagnosis.
pub fn plain_file(scene: &Scene) -> MissionFile {
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
pub fn held_out_file(scene: &Scene) -> MissionFile {
    let mut plan = Plan::new(scene);
    plan.speed(LEG_MPS);
    for height_m in [0.6, 0.8, 1.5, 2.4, 1.2] {
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

/// [`diagnostic_file`] as uploaded.
pub fn diagnostic(scene: &Scene) -> Vec<MISSION_ITEM_INT_DATA> {
    wire(&diagnostic_file(scene))
}

/// [`plain_file`] as uploaded.
pub fn plain(scene: &Scene) -> Vec<MISSION_ITEM_INT_DATA> {
    wire(&plain_file(scene))
}

/// [`held_out_file`] as uploaded.
pub fn held_out(scene: &Scene) -> Vec<MISSION_ITEM_INT_DATA> {
    wire(&held_out_file(scene))
}

/// As uploaded to whoever listens; lockstep has one vehicle.
pub fn wire(mission: &MissionFile) -> Vec<MISSION_ITEM_INT_DATA> {
    mission.items.iter().zip(0..).map(|(item, seq)| item.to_wire(seq, 0, 0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_core::frames::Vec3;
    use haltere_model::lockstep::{Lockstep, fly};

    /// A cage narrower than both margins: the ends of what is left stood the wrong way round by a bit.
    #[test]
    fn regress_a_narrow_room_has_a_middle() {
        let mut scene = Scene::lab().unwrap();
        scene.start_NE_m = [0.2, 0.7];
        let mut reversed = 0;
        for n in 1..60_u32 {
            let wall_m = [0.1, 0.1 + 0.01 * f64::from(n)];
            let half_m = 0.5 * (wall_m[1] - wall_m[0]);
            reversed += u32::from(wall_m[0] + half_m > wall_m[1] - half_m);
            scene.room.north_m = wall_m;
            let [north_m, _] = Plan::new(&scene).inside([3.0, 0.0]);
            assert!((wall_m[0]..=wall_m[1]).contains(&north_m), "{north_m} in {wall_m:?}");
        }
        assert!(reversed > 0, "none of these rooms shows it");
    }

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
            let start_E_m = Vec3::new(scene.start_NE_m[0], scene.start_NE_m[1], 0.0);
            let planned_s = world.pilot().mission().length_s(start_E_m, &scene.pilot.flight);
            println!(
                "{name}: planned {planned_s:.1} s, flown {flown_s:.1} s, reached {:?}, {:?}",
                flight.samples.last().map(|s| s.reached),
                flight.texts
            );
            assert!(flight.landed, "{name}");
            assert!(flight.samples.iter().all(|s| !s.truth.crashed), "{name}");
            assert!((50.0..130.0).contains(&flown_s), "{name}: {flown_s} s");
            assert!((planned_s / flown_s - 1.0).abs() < 0.15, "{name}: {planned_s} s");
        }
    }
}
