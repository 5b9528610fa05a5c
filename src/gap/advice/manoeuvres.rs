//! Missions of the catalogue of experiments, fitted to the room: what has no room says so.

use crate::bank::missions::{HEIGHT_M, LEG_MPS, LOW_M, Plan, diagnostic_file};
use crate::scene::Scene;
use haltere_pilot::mission_file::{DoubletAxis, MissionFile};

/// Clear way to either side that a dash needs, m.
const LEAST_DASH_M: f64 = 1.2;
/// Clear height over the take-off height that a ladder needs, m.
const LEAST_CLIMB_M: f64 = 0.8;

/// Space to both sides of the take-off place along an axis, m.
fn clear_m(scene: &Scene, axis: usize) -> f64 {
    let plan = Plan::new(scene);
    let reach = |side: f64| {
        let mut off = [0.0; 2];
        off[axis] = side * 100.0;
        (plan.inside(off)[axis] - scene.start_NE_m[axis]).abs()
    };
    reach(1.0).min(reach(-1.0))
}

/// Largest dash that has room, up to what is wanted.
fn dash_m(scene: &Scene, wanted_m: f64) -> Result<[f64; 2], String> {
    let dash = [clear_m(scene, 0).min(wanted_m), clear_m(scene, 1).min(wanted_m)];
    for (way_m, name) in dash.into_iter().zip(["north", "east"]) {
        if way_m < LEAST_DASH_M {
            return Err(format!(
                "{way_m:.1} m of clear way along {name} from the place of take-off, {LEAST_DASH_M} m needed: \
                 take off nearer the middle of the room"
            ));
        }
    }
    Ok(dash)
}

fn hover(scene: &Scene) -> Plan {
    let mut plan = Plan::new(scene);
    plan.speed(LEG_MPS);
    plan.go([0.0, 0.0], HEIGHT_M, 3.0);
    plan
}

pub(crate) fn yaw_on_the_spot(scene: &Scene) -> Result<MissionFile, String> {
    let mut plan = hover(scene);
    for yaw_deg in [90.0, 180.0, -90.0, 0.0, 90.0, 0.0] {
        plan.turn(yaw_deg, 4.0);
    }
    Ok(plan.land())
}

pub(crate) fn throttle_doublets(scene: &Scene) -> Result<MissionFile, String> {
    let mut plan = hover(scene);
    for _ in 0..3 {
        plan.doublets(DoubletAxis::Thrust, [[0.12, 0.4], [0.04, 0.4]]);
        plan.doublets(DoubletAxis::Thrust, [[-0.12, 0.3], [0.08, 0.4]]);
    }
    plan.go([0.0, 0.0], HEIGHT_M, 1.0);
    Ok(plan.land())
}

pub(crate) fn lean_doublets(scene: &Scene) -> Result<MissionFile, String> {
    dash_m(scene, LEAST_DASH_M)?;
    let mut plan = hover(scene);
    for axis in [DoubletAxis::Roll, DoubletAxis::Pitch] {
        for _ in 0..2 {
            plan.doublets(axis, [[8.6, 0.5], [4.6, 0.3]]);
            plan.doublets(axis, [[2.3, 0.5], [8.6, 0.25]]);
        }
        plan.go([0.0, 0.0], HEIGHT_M, 0.5);
    }
    Ok(plan.land())
}

pub(crate) fn reversal_dashes(scene: &Scene) -> Result<MissionFile, String> {
    let dash = dash_m(scene, 1.9)?;
    let mut plan = hover(scene);
    // The lower of the speed that lean allows: 1.2 m/s along x (missions.rs).
    for (axis, speeds) in [[0.5, 0.9, 1.2], [0.5, 1.0, 1.6]].into_iter().enumerate() {
        for mps in speeds {
            plan.speed(mps);
            for side in [1.0, -1.0] {
                let mut off = [0.0; 2];
                off[axis] = side * dash[axis];
                plan.go(off, HEIGHT_M, 0.2);
            }
        }
        plan.go([0.0, 0.0], HEIGHT_M, 0.5);
    }
    Ok(plan.land())
}

pub(crate) fn straight_dashes(scene: &Scene) -> Result<MissionFile, String> {
    let dash = dash_m(scene, 1.9)?;
    let mut plan = hover(scene);
    for (axis, mps) in [1.2, 1.4].into_iter().enumerate() {
        for side in [1.0, -1.0] {
            let mut off = [0.0; 2];
            off[axis] = side * dash[axis];
            plan.speed(mps);
            plan.go(off, HEIGHT_M, 2.5);
            plan.go([0.0, 0.0], HEIGHT_M, 2.5);
        }
    }
    Ok(plan.land())
}

pub(crate) fn room_edge_square(scene: &Scene) -> Result<MissionFile, String> {
    dash_m(scene, LEAST_DASH_M)?;
    let mut plan = hover(scene);
    plan.speed(1.1);
    for height_m in [HEIGHT_M, 1.8] {
        for corner in [[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]] {
            plan.go(corner.map(|c| 100.0 * c), height_m, 0.8);
        }
    }
    plan.go([0.0, 0.0], HEIGHT_M, 1.0);
    Ok(plan.land())
}

pub(crate) fn height_ladder(scene: &Scene) -> Result<MissionFile, String> {
    let mut plan = hover(scene);
    plan.speed(0.5);
    for height_m in [0.8, 0.65, LOW_M, 0.45, LOW_M, 0.65] {
        plan.go([0.0, 0.0], height_m, 3.5);
    }
    plan.go([0.0, 0.0], HEIGHT_M, 1.0);
    Ok(plan.land())
}

pub(crate) fn under_the_ceiling(scene: &Scene) -> Result<MissionFile, String> {
    let mut plan = hover(scene);
    let top_m = plan.under(100.0);
    if top_m - HEIGHT_M < LEAST_CLIMB_M {
        return Err(format!(
            "ceiling at {:.1} m leaves no climb of {LEAST_CLIMB_M} m over {HEIGHT_M} m",
            scene.room.ceiling_m
        ));
    }
    if top_m > 6.0 {
        return Err(format!(
            "ceiling at {:.1} m: out of reach of these flights, which stay below 6 m",
            scene.room.ceiling_m
        ));
    }
    for height_m in [top_m - 0.6, top_m, top_m - 0.6, top_m] {
        plan.go([0.0, 0.0], height_m, 4.0);
    }
    plan.go([0.0, 0.0], HEIGHT_M, 1.0);
    Ok(plan.land())
}

pub(crate) fn long_hover(scene: &Scene) -> Result<MissionFile, String> {
    let mut plan = hover(scene);
    plan.wait(58.0);
    Ok(plan.land())
}

pub(crate) fn steps_then_hover(scene: &Scene) -> Result<MissionFile, String> {
    let mut plan = hover(scene);
    plan.doublets(DoubletAxis::Thrust, [[0.12, 0.4], [0.04, 0.4]]);
    plan.wait(40.0);
    plan.doublets(DoubletAxis::Thrust, [[0.12, 0.4], [0.04, 0.4]]);
    plan.go([0.0, 0.0], HEIGHT_M, 1.0);
    Ok(plan.land())
}

pub(crate) fn standard(scene: &Scene) -> Result<MissionFile, String> {
    dash_m(scene, LEAST_DASH_M)?;
    Ok(diagnostic_file(scene))
}
