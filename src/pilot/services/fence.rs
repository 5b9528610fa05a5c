//! The fence that a station draws: where the vehicle may be, seen from above.
//!
//! Rules of common.xml's `MAV_CMD_NAV_FENCE_*`: the vehicle must be inside all inclusions of one
//! group, and outside of every exclusion. Without an inclusion everything is inside. Height is
//! bounded by the flight volume alone. A point is inside a polygon by the even-odd rule.

use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd, MavMissionResult};

use crate::control::{AxisCommand, Command};
use crate::estimate::Estimate;

use super::super::mission_items::Refusal;

/// Most corners of a polygon, and most items of a fence.
pub const MOST_CORNERS: usize = 200;
/// Points of a leg are looked at in steps of this, m; borders of exclusions are crossed exactly.
const STEP_M: f64 = 0.05;
/// Setpoints that would leave are moved this far inside, m.
const INSIDE_M: f64 = 0.05;
/// A velocity setpoint is followed for this long before it could be taken back, s (lag of attitude
/// and velocity loop) …
const REACT_S: f64 = 0.6;
/// … and braked with this, m/s²: a lean of 15 degrees; drag helps.
const BRAKE_MPS2: f64 = 2.5;

/// A point seen from above: room north and east, m.
type Point = [f64; 2];

#[derive(Debug, Clone, PartialEq)]
enum Shape {
    Polygon(Vec<Point>),
    Circle { centre: Point, radius_m: f64 },
}

/// The fence in force.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Fence {
    /// With the number of its group.
    inclusions: Vec<(u8, Shape)>,
    exclusions: Vec<Shape>,
}

fn distance(a: Point, b: Point) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The point of a line between two points that is nearest to a third.
fn nearest_on_line(a: Point, b: Point, p: Point) -> Point {
    let way = [b[0] - a[0], b[1] - a[1]];
    let square = way[0] * way[0] + way[1] * way[1];
    let along = (p[0] - a[0]) * way[0] + (p[1] - a[1]) * way[1];
    let share = if square > 0.0 { (along / square).clamp(0.0, 1.0) } else { 0.0 };
    [a[0] + share * way[0], a[1] + share * way[1]]
}

/// Whether two lines between points cross.
fn cross(a: Point, b: Point, c: Point, d: Point) -> bool {
    let side = |p: Point, q: Point, r: Point| {
        (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
    };
    side(a, b, c) * side(a, b, d) <= 0.0 && side(c, d, a) * side(c, d, b) <= 0.0
}

/// Sides of a polygon.
fn sides(corners: &[Point]) -> impl Iterator<Item = (Point, Point)> {
    corners.iter().copied().zip(corners.iter().copied().cycle().skip(1))
}

impl Shape {
    fn contains(&self, p: Point) -> bool {
        match self {
            Shape::Circle { centre, radius_m } => distance(*centre, p) <= *radius_m,
            Shape::Polygon(corners) => {
                let crossed = |(a, b): &(Point, Point)| {
                    (a[1] > p[1]) != (b[1] > p[1])
                        && p[0] < (b[0] - a[0]) * (p[1] - a[1]) / (b[1] - a[1]) + a[0]
                };
                sides(corners).filter(crossed).count() % 2 == 1
            }
        }
    }

    /// The point of its border that is nearest.
    fn border_near(&self, p: Point) -> Point {
        match self {
            Shape::Circle { centre, radius_m } => {
                let far = distance(*centre, p);
                if far < 1e-9 {
                    return [centre[0] + radius_m, centre[1]];
                }
                std::array::from_fn(|i| centre[i] + (p[i] - centre[i]) * radius_m / far)
            }
            Shape::Polygon(corners) => sides(corners)
                .map(|(a, b)| nearest_on_line(a, b, p))
                .min_by(|a, b| distance(*a, p).total_cmp(&distance(*b, p)))
                .unwrap_or(p),
        }
    }

    fn is_crossed_by(&self, a: Point, b: Point) -> bool {
        match self {
            Shape::Circle { centre, radius_m } => {
                distance(nearest_on_line(a, b, *centre), *centre) <= *radius_m
            }
            Shape::Polygon(corners) => {
                self.contains(a) || sides(corners).any(|(c, d)| cross(a, b, c, d))
            }
        }
    }
}

impl Fence {
    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.inclusions.is_empty() && self.exclusions.is_empty()
    }

    /// Whether the vehicle may be there.
    pub fn contains(&self, p: Point) -> bool {
        let in_group =
            |group: u8| self.inclusions.iter().all(|(g, shape)| *g != group || shape.contains(p));
        let included =
            self.inclusions.is_empty() || self.inclusions.iter().any(|(group, _)| in_group(*group));
        included && !self.exclusions.iter().any(|shape| shape.contains(p))
    }

    /// Whether the straight way between two points leaves it.
    pub fn is_left_between(&self, a: Point, b: Point) -> bool {
        if self.is_empty() {
            return false;
        }
        if self.exclusions.iter().any(|shape| shape.is_crossed_by(a, b)) {
            return true;
        }
        // The volume bounds legs to 200 m per axis: at most some 6000 steps.
        let steps = (distance(a, b) / STEP_M).ceil().clamp(1.0, 10_000.0);
        (0..=steps as u32).any(|i| {
            let share = f64::from(i) / steps;
            !self.contains([a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])])
        })
    }

    /// How far a point is outside, m; 0 inside.
    pub fn beyond_m(&self, p: Point) -> f64 {
        if self.is_empty() || self.contains(p) {
            return 0.0;
        }
        let inside = self.near_inside(p);
        // Where no point inside was found, the fence says nothing about how far.
        inside.map_or(f64::INFINITY, |q| (distance(p, q) - INSIDE_M).max(0.0))
    }

    /// A point inside that is near. `None`: none was found.
    pub fn near_inside(&self, p: Point) -> Option<Point> {
        if self.contains(p) {
            return Some(p);
        }
        let shapes = self.inclusions.iter().map(|(_, shape)| shape).chain(&self.exclusions);
        shapes
            .map(|shape| {
                let border = shape.border_near(p);
                let far = distance(border, p).max(1e-9);
                // On, past the border.
                std::array::from_fn(|i| border[i] + (border[i] - p[i]) * INSIDE_M / far)
            })
            .filter(|candidate| self.contains(*candidate))
            .min_by(|a, b| distance(*a, p).total_cmp(&distance(*b, p)))
    }

    /// Changes a command that would lead out: the vehicle stays at a point inside. `refuge` is where
    /// it was last inside. `true`: it was changed.
    pub fn guard(&self, command: &mut Command, estimate: &Estimate, refuge: Point) -> bool {
        if self.is_empty() {
            return false;
        }
        let velocity = estimate.vel_E_mps();
        let wanted: Point = std::array::from_fn(|axis| match command.axes[axis] {
            AxisCommand::Position_m(p) => p,
            AxisCommand::Velocity_mps(v) => {
                // The faster of what is flown and what is asked for.
                let flown = velocity[axis];
                let v = if flown * v > 0.0 && flown.abs() > v.abs() { flown } else { v };
                estimate.pos_E_m[axis] + v * REACT_S + v * v.abs() / (2.0 * BRAKE_MPS2)
            }
        });
        let here = [estimate.pos_E_m.x(), estimate.pos_E_m.y()];
        let moves = command.axes[..2].iter().any(|a| matches!(a, AxisCommand::Velocity_mps(_)));
        if self.contains(wanted) && !(moves && self.is_left_between(here, wanted)) {
            return false;
        }
        let target = if moves { here } else { wanted };
        let inside = self.near_inside(target).unwrap_or(refuge);
        for (axis, at) in command.axes.iter_mut().zip(inside) {
            *axis = AxisCommand::Position_m(at);
        }
        let mut forward = command.vel_ff_E_mps.to_array();
        forward[0] = 0.0;
        forward[1] = 0.0;
        command.vel_ff_E_mps = crate::frames::Vec3::from_array(forward);
        true
    }

    /// From items, with their places in the room.
    pub fn from_items(items: &[MISSION_ITEM_INT_DATA], places: &[Point]) -> Result<Self, Refusal> {
        use MavMissionResult as R;
        let mut fence = Self::default();
        let mut rest = items.iter().zip(places.iter().copied());
        while let Some((item, place)) = rest.next() {
            let seq = item.seq;
            match item.command {
                MavCmd::MAV_CMD_NAV_FENCE_RETURN_POINT => {}
                MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
                | MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION => {
                    let radius_m = f64::from(item.param1);
                    if !(0.1..=1000.0).contains(&radius_m) {
                        let why =
                            format!("fence item {seq}: radius = {radius_m}, allowed 0.1 to 1000 m");
                        return Err((R::MAV_MISSION_INVALID_PARAM1, why));
                    }
                    fence.add(item, Shape::Circle { centre: place, radius_m });
                }
                MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
                | MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION => {
                    let count = f64::from(item.param1);
                    if !(3.0..=MOST_CORNERS as f64).contains(&count) || count.fract() != 0.0 {
                        let why = format!(
                            "fence item {seq}: a polygon of {count} corners, allowed 3 to \
                             {MOST_CORNERS}"
                        );
                        return Err((R::MAV_MISSION_INVALID_PARAM1, why));
                    }
                    let mut corners = vec![place];
                    while corners.len() < count as usize {
                        match rest.next() {
                            Some((next, place))
                                if next.command == item.command && next.param1 == item.param1 =>
                            {
                                corners.push(place);
                            }
                            _ => {
                                let why = format!(
                                    "fence item {seq}: its polygon has {} of {count} corners",
                                    corners.len()
                                );
                                return Err((R::MAV_MISSION_INVALID, why));
                            }
                        }
                    }
                    fence.add(item, Shape::Polygon(corners));
                }
                other => {
                    let why = format!("fence item {seq}: {other:?} not supported");
                    return Err((R::MAV_MISSION_UNSUPPORTED, why));
                }
            }
        }
        Ok(fence)
    }

    fn add(&mut self, item: &MISSION_ITEM_INT_DATA, shape: Shape) {
        match item.command {
            MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
            | MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION => self.exclusions.push(shape),
            _ => {
                // A saturating cast: NaN and nonsense are group 0.
                self.inclusions.push((item.param2 as u8, shape));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Vec3;

    fn item(seq: u16, command: MavCmd, param1: f32) -> MISSION_ITEM_INT_DATA {
        MISSION_ITEM_INT_DATA { seq, command, param1, ..Default::default() }
    }

    /// A square of 4 m around the origin without a circle of 0.5 m at (1, 0).
    fn yard() -> Fence {
        let corner = MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION;
        let mut items: Vec<_> = (0..4).map(|n| item(n, corner, 4.0)).collect();
        items.push(item(4, MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION, 0.5));
        let places = [[-2.0, -2.0], [-2.0, 2.0], [2.0, 2.0], [2.0, -2.0], [1.0, 0.0]];
        Fence::from_items(&items, &places).unwrap()
    }

    #[test]
    fn prop_inside_and_outside() {
        let fence = yard();
        assert!(fence.contains([0.0, 0.0]) && fence.contains([-1.9, 1.9]));
        assert!(!fence.contains([2.1, 0.0]) && !fence.contains([1.2, 0.1]));
        assert!(Fence::default().contains([1e6, 0.0]));
        assert!(fence.is_left_between([0.0, 0.0], [1.9, 0.0]), "through the circle");
        assert!(!fence.is_left_between([-1.5, -1.5], [1.5, -1.5]));
        assert!(fence.is_left_between([1.5, 1.5], [1.5, 2.5]));
    }

    /// A thin exclusion between two samples of a leg is found all the same.
    #[test]
    fn prop_a_thin_wall_is_not_jumped_over() {
        let corner = MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION;
        let items: Vec<_> = (0..4).map(|n| item(n, corner, 4.0)).collect();
        let places = [[0.511, -5.0], [0.512, -5.0], [0.512, 5.0], [0.511, 5.0]];
        let fence = Fence::from_items(&items, &places).unwrap();
        assert!(fence.is_left_between([0.0, 0.0], [1.0, 0.0]));
    }

    #[test]
    fn prop_groups_are_alternatives_and_members_of_one_are_not() {
        let circle = MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION;
        let in_group =
            |seq, group: f32| MISSION_ITEM_INT_DATA { param2: group, ..item(seq, circle, 1.0) };
        let places = [[0.0, 0.0], [1.0, 0.0]];
        let both = Fence::from_items(&[in_group(0, 0.0), in_group(1, 0.0)], &places).unwrap();
        assert!(both.contains([0.5, 0.0]) && !both.contains([-0.5, 0.0]));
        let either = Fence::from_items(&[in_group(0, 0.0), in_group(1, 1.0)], &places).unwrap();
        assert!(either.contains([0.5, 0.0]) && either.contains([-0.5, 0.0]));
    }

    #[test]
    fn prop_broken_polygons_are_refused_by_item() {
        let corner = MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION;
        let check = |items: Vec<MISSION_ITEM_INT_DATA>, says: &str| {
            let places = vec![[0.0, 0.0]; items.len()];
            let (_, why) = Fence::from_items(&items, &places).unwrap_err();
            assert!(why.contains(says), "{why}");
        };
        check((0..2).map(|n| item(n, corner, 2.0)).collect(), "allowed 3 to 200");
        check((0..3).map(|n| item(n, corner, 4.0)).collect(), "3 of 4 corners");
        check(vec![item(7, corner, f32::NAN)], "item 7");
        check(vec![item(0, MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, -1.0)], "radius = -1");
        check(vec![item(0, MavCmd::MAV_CMD_NAV_WAYPOINT, 0.0)], "not supported");
    }

    fn estimate(pos_E_m: [f64; 3]) -> Estimate {
        Estimate {
            at: Default::default(),
            pos_E_m: Vec3::from_array(pos_E_m),
            vel_B_mps: Vec3::zero(),
            R_EB: crate::frames::Rot::identity(),
            rate_B_radps: Vec3::zero(),
            std_pos_E_m: Vec3::zero(),
            std_vel_B_mps: Vec3::zero(),
            std_att_B_rad: Vec3::zero(),
            uwb_noise_factor: 1.0,
            health: crate::estimate::Health::Good,
        }
    }

    #[test]
    fn prop_commands_that_lead_out_end_inside() {
        let fence = yard();
        let mut estimate = estimate([1.5, 1.5, -1.0]);
        let check = |estimate: &Estimate, axes: [AxisCommand; 3], changed: bool| {
            let mut command =
                Command { axes, vel_ff_E_mps: Vec3::new(1.0, 1.0, 0.1), yaw_rad: 0.0 };
            assert_eq!(fence.guard(&mut command, estimate, [0.0, 0.0]), changed, "{axes:?}");
            if changed {
                let at = |i: usize| match command.axes[i] {
                    AxisCommand::Position_m(p) => p,
                    AxisCommand::Velocity_mps(_) => panic!("still a velocity"),
                };
                assert!(fence.contains([at(0), at(1)]));
                assert_eq!(command.vel_ff_E_mps, Vec3::new(0.0, 0.0, 0.1));
            }
        };
        use AxisCommand::{Position_m as Pos, Velocity_mps as Vel};
        check(&estimate, [Pos(1.8), Pos(1.8), Pos(-1.0)], false);
        check(&estimate, [Pos(5.0), Pos(1.8), Pos(-1.0)], true);
        check(&estimate, [Pos(1.0), Pos(0.1), Pos(-1.0)], true);
        check(&estimate, [Vel(-0.5), Vel(0.0), Vel(0.0)], false);
        check(&estimate, [Vel(1.0), Vel(0.0), Vel(0.0)], true);
        estimate.pos_E_m = Vec3::new(3.0, 0.0, -1.0);
        check(&estimate, [Pos(3.0), Pos(0.0), Pos(-1.0)], true);
    }
}
