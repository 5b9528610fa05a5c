//! The demo's mission: steps of 1 m and 2 m along each axis, then four path shapes.

use haltere::report::errors::{Leg, PathKind, STEP_WINDOW_S};
use haltere_core::frames::Vec3;
use haltere_pilot::mission_file::{Command as ItemCommand, Item};

/// Height of everything that is not a step in height, m (the source's hover height).
const HEIGHT_M: f64 = 1.2;
/// Middle of the 10 × 10 m hall, north and east, m.
pub const CENTRE_M: [f64; 2] = [5.0, 5.0];
/// Steps start this far from the centre, so that they end as far on its other side, m.
const STEP_START_M: f64 = -1.0;
/// Sizes of steps, m (the source).
const STEPS_M: [f64; 2] = [1.0, 2.0];
/// Stay after a step has come within reach, s: with the rise it fills the window of the metric.
const STEP_HOLD_S: f64 = STEP_WINDOW_S - 0.8;
/// Rest after the way back from a step, s.
const STEP_BACK_S: f64 = 4.0;
/// Stay before a shape begins, s.
const CALM_S: f64 = 1.2;
/// Speed of the setpoint along shapes, m/s.
const SHAPE_SPEED_MPS: f64 = 0.5;
/// A speed at which the setpoint jumps: above any limit of the controller, m/s.
const JUMP_SPEED_MPS: f64 = 10.0;
/// Distance at which a corner counts as reached, m. Larger than the tracking error, so that the
/// setpoint does not wait at corners.
const CORNER_M: f64 = 0.5;
/// Half the side of the square, half the diagonals of the rhombus, radius of the hexagon, m.
const SQUARE_M: f64 = 0.7;
const RHOMBUS_M: [f64; 2] = [1.1, 0.7];
const HEXAGON_M: f64 = 0.8;
/// Ends of the straight line from the centre, m: through the room, climbing.
const LINE_M: [[f64; 3]; 2] = [[-1.2, -0.9, 1.0], [1.2, 0.9, 1.6]];

/// Names of the four shapes, as in tables and JSON.
pub const SHAPES: [&str; 4] = ["square", "rhombus", "hexagon", "line"];

/// A mission, and how each of its legs is judged.
#[derive(Debug, Clone, Default)]
pub struct Plan {
    /// As uploaded.
    pub items: Vec<Item>,
    /// One per waypoint, in order.
    pub legs: Vec<Leg>,
}

impl Plan {
    /// Everything, or without the steps.
    pub fn new(steps: bool) -> Self {
        let mut plan = Self::default();
        plan.items.push(Item { height_m: Some(HEIGHT_M), ..Item::new(ItemCommand::Takeoff) });
        if steps {
            plan.steps();
        }
        plan.speed(SHAPE_SPEED_MPS);
        plan.shapes();
        plan.go([0.0, 0.0, HEIGHT_M], CALM_S, None);
        plan.items.push(Item::new(ItemCommand::Land));
        plan
    }

    fn steps(&mut self) {
        for axis in 0..3 {
            let name = ["x", "y", "z"][axis];
            let mut from = [0.0, 0.0, HEIGHT_M];
            if axis < 2 {
                from[axis] = STEP_START_M;
            }
            self.speed(SHAPE_SPEED_MPS);
            self.go(from, CALM_S, None);
            self.speed(JUMP_SPEED_MPS);
            for size_m in STEPS_M {
                let mut to = from;
                to[axis] += size_m;
                let path = Some((format!("step {name} {size_m:.0} m"), PathKind::Step { axis }));
                self.go(to, STEP_HOLD_S, path);
                // Back by a jump too, but not judged: the battery is for the judged ones.
                self.go(from, STEP_BACK_S, None);
            }
        }
    }

    fn shapes(&mut self) {
        let level = |points: &[[f64; 2]]| -> Vec<[f64; 3]> {
            points.iter().map(|[n, e]| [*n, *e, HEIGHT_M]).collect()
        };
        let s = SQUARE_M;
        let [r, q] = RHOMBUS_M;
        let hexagon: Vec<[f64; 2]> = (0..6)
            .map(|i| {
                let (sin, cos) = (f64::from(i) * std::f64::consts::FRAC_PI_3).sin_cos();
                [HEXAGON_M * cos, HEXAGON_M * sin]
            })
            .collect();
        let corners = [
            level(&[[s, s], [s, -s], [-s, -s], [-s, s]]),
            level(&[[r, 0.0], [0.0, q], [-r, 0.0], [0.0, -q]]),
            level(&hexagon),
            LINE_M.to_vec(),
        ];
        for (name, corners) in SHAPES.into_iter().zip(corners) {
            let Some(first) = corners.first().copied() else { continue };
            self.go(first, CALM_S, None);
            let closed = corners.len() > 2;
            let last = if closed { Some(first) } else { None };
            for corner in corners.into_iter().skip(1).chain(last) {
                self.go(corner, 0.0, Some((name.to_string(), PathKind::Shape)));
            }
        }
    }

    fn speed(&mut self, speed_mps: f64) {
        self.items.push(Item { speed_mps: Some(speed_mps), ..Item::new(ItemCommand::Speed) });
    }

    /// Offsets from the centre north and east, height above the floor.
    fn go(
        &mut self,
        [north, east, height_m]: [f64; 3],
        hold_s: f64,
        path: Option<(String, PathKind)>,
    ) {
        let (north_m, east_m) = (CENTRE_M[0] + north, CENTRE_M[1] + east);
        self.items.push(Item {
            hold_s: Some(hold_s),
            acceptance_m: Some(CORNER_M),
            path: path.as_ref().map(|(name, _)| name.clone()),
            ..Item::waypoint(north_m, east_m, height_m)
        });
        self.legs.push(Leg { path, to_E_m: Vec3::new(north_m, east_m, -height_m) });
    }

    /// Time of flight at the planned speeds, s, for progress and for the timeout.
    pub fn duration_s(&self) -> f64 {
        let mut speed_mps = SHAPE_SPEED_MPS;
        let mut total_s = 2.0 * HEIGHT_M / 0.4;
        let mut before = Vec3::new(CENTRE_M[0], CENTRE_M[1], -HEIGHT_M);
        let mut legs = self.legs.iter();
        for item in &self.items {
            match item.command {
                ItemCommand::Speed => speed_mps = item.speed_mps.unwrap_or(speed_mps),
                ItemCommand::Waypoint => {
                    if let Some(leg) = legs.next() {
                        // A jump takes the vehicle about its own time constant.
                        let travel_s = (leg.to_E_m - before).norm() / speed_mps.min(1.0);
                        total_s += travel_s + item.hold_s.unwrap_or(0.0);
                        before = leg.to_E_m;
                    }
                }
                _ => {}
            }
        }
        total_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_plan_fits_the_battery_and_the_hall() {
        let plan = Plan::new(true);
        // 210 s is what the task allows for the whole demo, the battery lasts 240 s at least.
        assert!(plan.duration_s() < 195.0, "{}", plan.duration_s());
        for leg in &plan.legs {
            let [n, e, d] = leg.to_E_m.to_array();
            assert!((1.0..=9.0).contains(&n) && (1.0..=9.0).contains(&e), "{n} {e}");
            assert!((0.5..=5.0).contains(&-d), "{d}");
        }
        let waypoints = plan.items.iter().filter(|i| i.command == ItemCommand::Waypoint).count();
        assert_eq!(waypoints, plan.legs.len());
        let named = |name: &str| {
            let is = |l: &&Leg| l.path.as_ref().is_some_and(|(n, _)| n == name);
            plan.legs.iter().filter(is).count()
        };
        assert_eq!(SHAPES.map(named), [4, 4, 6, 1]);
        assert_eq!(named("step z 2 m"), 1);
    }
}
