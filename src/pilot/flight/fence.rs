//! The fence that a station draws: where the vehicle may be, seen from above.
//!
//! Rules of common.xml's `MAV_CMD_NAV_FENCE_*`: the vehicle must be inside all inclusions of one
//! group, and outside of every exclusion. Without an inclusion everything is inside. Height is
//! bounded by the flight volume alone. A point is inside a polygon by the even-odd rule.
//!
//! **Clearance** of a point is how far it is from what is forbidden, m, negative where it is forbidden
//! itself: over exclusions the least distance to one, over inclusions the largest that a group leaves,
//! each the least of its members. It changes by no more than one goes, so a straight way is walked in
//! strides of what is clear around it, and nothing can be jumped over. Groups that the vehicle shall
//! pass between must overlap by twice [`KEEP_M`].

use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd, MavMissionResult};
use haltere_dialect::mav::{known, name_of};

use haltere_core::control::{AxisCommand, Command};
use haltere_core::estimate::Estimate;
use haltere_core::frames::{E, Vec3};

use super::mission::RADIUS_M;
use super::mission_items::Refusal;

/// Most corners of a polygon, and most items of a fence.
pub const MOST_CORNERS: usize = 200;
/// The point that is tracked is led no nearer than this to what is forbidden, m: the wings end there.
pub const KEEP_M: f64 = RADIUS_M;
/// Legs are begun only where they stay so much farther away, m: what the vehicle strays from a leg, which
/// must not be held back beside every corner.
const STRAY_M: f64 = 0.1;
/// A way is walked in strides of at least this, m …
const STRIDE_M: f64 = 0.02;
/// … and of so many at most: beyond the longest diagonal of a volume.
const MOST_STRIDES: usize = 20_000;
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

/// The point so far along the way from one point to another.
fn along(a: Point, b: Point, gone_m: f64) -> Point {
    let length_m = distance(a, b);
    let share = if length_m > 0.0 { gone_m / length_m } else { 0.0 };
    std::array::from_fn(|i| a[i] + share * (b[i] - a[i]))
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

    /// How far a point is inside, m; outside it is negative.
    fn depth_m(&self, p: Point) -> f64 {
        let far = distance(self.border_near(p), p);
        if self.contains(p) { far } else { -far }
    }

    /// The point [`KEEP_M`] beside the border, on the side that is allowed, that is nearest.
    fn beside(&self, p: Point, allowed_inside: bool) -> Point {
        let border = self.border_near(p);
        let far = distance(border, p).max(1e-9);
        let onwards = if self.contains(p) == allowed_inside { -1.0 } else { 1.0 };
        std::array::from_fn(|i| border[i] + (border[i] - p[i]) * onwards * KEEP_M / far)
    }
}

/// What became of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Guarded {
    /// The fence allows it, but the wings would reach over: it was moved off the border.
    KeptOff,
    /// It leads to where the fence forbids, or through there: it ends on the vehicle's side.
    HeldBack,
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

    /// Why the vehicle may not be armed where it stands.
    pub fn forbids(&self, pos_E_m: Vec3<E>) -> Option<String> {
        let [north_m, east_m] = [pos_E_m.x(), pos_E_m.y()];
        let inside = self.contains([north_m, east_m]);
        (!inside).then(|| format!("outside the fence at N {north_m:.2} E {east_m:.2} m"))
    }

    /// How far a point is from what is forbidden, m; negative where it is.
    fn clearance_m(&self, p: Point) -> f64 {
        let clear_m = self.exclusions.iter().map(|s| -s.depth_m(p)).fold(f64::INFINITY, f64::min);
        let groups = self.inclusions.chunk_by(|a, b| a.0 == b.0);
        let depth_m = |group: &[(u8, Shape)]| {
            group.iter().map(|(_, s)| s.depth_m(p)).fold(f64::INFINITY, f64::min)
        };
        groups.map(depth_m).reduce(f64::max).map_or(clear_m, |inside_m| clear_m.min(inside_m))
    }

    /// Whether a point may be asked for: nobody's wings reach out of the fence there.
    pub fn allows(&self, p: Point) -> bool {
        self.is_empty() || self.clearance_m(p) >= KEEP_M
    }

    /// Whether a leg may lead straight from one point to another that is inside. Where it begins or ends
    /// near the border it may be as near all the way.
    pub fn allows_way(&self, a: Point, b: Point) -> bool {
        if self.is_empty() {
            return true;
        }
        let end_m = self.clearance_m(b);
        let least_m = (KEEP_M + STRAY_M).min(self.clearance_m(a)).min(end_m);
        end_m >= 0.0 && self.free_m(a, b, least_m) >= distance(a, b)
    }

    /// How far one comes from a point in a direction before the fence forbids it, m.
    pub fn way_m(&self, from: Point, [north, east]: [f64; 2], most_m: f64) -> f64 {
        let to = [from[0] + north * most_m, from[1] + east * most_m];
        if self.is_empty() { most_m } else { self.free_m(from, to, 0.0) }
    }

    /// How far the straight way from one point to another is at least so clear, m.
    fn free_m(&self, a: Point, b: Point, least_m: f64) -> f64 {
        let length_m = distance(a, b);
        let mut free_m = 0.0;
        let mut next_m = 0.0;
        for _ in 0..MOST_STRIDES {
            let clear_m = self.clearance_m(along(a, b, next_m));
            // Anything else, also no number at all, is not free.
            let is_free = clear_m >= least_m - 1e-9;
            if !is_free {
                break;
            }
            free_m = next_m;
            if free_m >= length_m {
                break;
            }
            next_m = (free_m + (clear_m - least_m).max(STRIDE_M)).min(length_m);
        }
        free_m
    }

    /// How far a point is outside, m; 0 inside.
    pub fn beyond_m(&self, p: Point) -> f64 {
        if self.is_empty() { 0.0 } else { (-self.clearance_m(p)).max(0.0) }
    }

    /// A point inside that is near, and clearer. `None`: none was found.
    fn near_inside(&self, p: Point) -> Option<Point> {
        let clear_m = self.clearance_m(p);
        let inclusions = self.inclusions.iter().map(|(_, s)| (s, true));
        inclusions
            .chain(self.exclusions.iter().map(|s| (s, false)))
            .filter(|(shape, inside)| {
                shape.depth_m(p) * (if *inside { 1.0 } else { -1.0 }) < KEEP_M
            })
            .map(|(shape, inside)| shape.beside(p, inside))
            .filter(|q| self.clearance_m(*q) >= clear_m.max(0.0))
            .min_by(|a, b| distance(*a, p).total_cmp(&distance(*b, p)))
    }

    /// Changes a command that would lead out, or through what is forbidden: the vehicle stays on its own
    /// side of it. `refuge` is where it was last inside. `None`: it was left as it is.
    pub fn guard(
        &self,
        command: &mut Command,
        estimate: &Estimate,
        refuge: Point,
    ) -> Option<Guarded> {
        if self.is_empty() {
            return None;
        }
        let velocity = estimate.vel_E_mps();
        // Where it would come to rest.
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
        let clear_m = self.clearance_m(here);
        let is_allowed = self.clearance_m(wanted) >= 0.0;
        let way_m = distance(here, wanted);
        // Whoever is too near already may stay so, or go away.
        let free_m = self.free_m(here, wanted, KEEP_M.min(clear_m));
        if free_m >= way_m && (is_allowed || clear_m >= 0.0) {
            return None;
        }
        let inside = if clear_m >= KEEP_M {
            along(here, wanted, free_m)
        } else {
            let stay = if clear_m >= 0.0 { here } else { refuge };
            self.near_inside(here).unwrap_or(stay)
        };
        for (axis, at) in command.axes.iter_mut().zip(inside) {
            *axis = AxisCommand::Position_m(at);
        }
        let forward = command.vel_ff_E_mps;
        command.vel_ff_E_mps = haltere_core::frames::Vec3::new(0.0, 0.0, forward.z());
        let passes = is_allowed && self.free_m(here, wanted, clear_m.min(0.0)) >= way_m;
        Some(if passes { Guarded::KeptOff } else { Guarded::HeldBack })
    }

    /// From items, with their places in the room.
    pub fn from_items(items: &[MISSION_ITEM_INT_DATA], places: &[Point]) -> Result<Self, Refusal> {
        use MavMissionResult as R;
        let mut fence = Self::default();
        let mut rest = items.iter().zip(places.iter().copied());
        while let Some((item, place)) = rest.next() {
            let seq = item.seq;
            match known(item.command) {
                Some(MavCmd::MAV_CMD_NAV_FENCE_RETURN_POINT) => {}
                Some(
                    MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
                    | MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
                ) => {
                    let radius_m = f64::from(item.param1);
                    if !(0.1..=1000.0).contains(&radius_m) {
                        let why = format!(
                            "fence item {seq}: radius = {}, allowed 0.1 to 1000 m",
                            item.param1,
                            seq = seq.saturating_add(1)
                        );
                        return Err((R::MAV_MISSION_INVALID_PARAM1, why));
                    }
                    fence.add(item, Shape::Circle { centre: place, radius_m });
                }
                Some(
                    MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
                    | MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
                ) => {
                    let count = f64::from(item.param1);
                    if !(3.0..=MOST_CORNERS as f64).contains(&count) || count.fract() != 0.0 {
                        let why = format!(
                            "fence item {seq}: a polygon of {count} corners, allowed 3 to \
                             {MOST_CORNERS}",
                            seq = seq.saturating_add(1)
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
                                    corners.len(),
                                    seq = seq.saturating_add(1)
                                );
                                return Err((R::MAV_MISSION_INVALID, why));
                            }
                        }
                    }
                    fence.add(item, Shape::Polygon(corners));
                }
                _ => {
                    let name = name_of::<MavCmd>(item.command);
                    let why = format!(
                        "fence item {seq}: {name} not supported",
                        seq = seq.saturating_add(1)
                    );
                    return Err((R::MAV_MISSION_UNSUPPORTED, why));
                }
            }
        }
        // Members of a group stand together.
        fence.inclusions.sort_by_key(|(group, _)| *group);
        Ok(fence)
    }

    fn add(&mut self, item: &MISSION_ITEM_INT_DATA, shape: Shape) {
        match known(item.command) {
            Some(
                MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
                | MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
            ) => self.exclusions.push(shape),
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
    use haltere_core::frames::Vec3;

    fn item(seq: u16, command: MavCmd, param1: f32) -> MISSION_ITEM_INT_DATA {
        MISSION_ITEM_INT_DATA { seq, command: command as u16, param1, ..Default::default() }
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
        assert!(!fence.allows_way([0.0, 0.0], [1.7, 0.0]), "through the circle");
        assert!(fence.allows_way([-1.5, -1.5], [1.5, -1.5]));
        assert!(!fence.allows_way([1.5, 1.5], [1.5, 2.5]));
        // Beside the circle: as near as the wings are wide, or as the way begins.
        assert!(
            fence.allows_way([0.0, 0.9], [1.6, 0.9]) && !fence.allows_way([0.0, 0.8], [1.6, 0.8])
        );
        assert!(
            fence.allows_way([1.0, 0.6], [1.0, 1.5]) && fence.allows_way([1.0, 1.5], [1.0, 0.6])
        );
        assert!(fence.allows([1.7, 1.7]) && !fence.allows([1.8, 1.7]));
        assert!((fence.way_m([0.0, 0.0], [1.0, 0.0], 9.0) - 0.5).abs() < STRIDE_M);
        assert_eq!(fence.way_m([0.0, 0.0], [0.0, 1.0], 1.5), 1.5);
        let beyond = [[0.0, 0.0], [2.5, 0.0], [1.0, 0.2]].map(|p| fence.beyond_m(p));
        assert!((beyond[1] - 0.5).abs() < 1e-9 && (beyond[2] - 0.3).abs() < 1e-9, "{beyond:?}");
    }

    /// A thin exclusion between two samples of a leg is found all the same.
    #[test]
    fn prop_a_thin_wall_is_not_jumped_over() {
        let corner = MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION;
        let items: Vec<_> = (0..4).map(|n| item(n, corner, 4.0)).collect();
        let places = [[0.511, -5.0], [0.512, -5.0], [0.512, 5.0], [0.511, 5.0]];
        let fence = Fence::from_items(&items, &places).unwrap();
        assert!(!fence.allows_way([0.0, 0.0], [1.0, 0.0]));
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
        check(vec![item(7, corner, f32::NAN)], "item 8");
        check(vec![item(0, MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION, -1.0)], "radius = -1");
        check(vec![item(0, MavCmd::MAV_CMD_NAV_WAYPOINT, 0.0)], "not supported");
    }

    fn estimate(pos_E_m: [f64; 3]) -> Estimate {
        Estimate {
            at: Default::default(),
            pos_E_m: Vec3::from_array(pos_E_m),
            vel_B_mps: Vec3::zero(),
            R_EB: haltere_core::frames::Rot::identity(),
            rate_B_radps: Vec3::zero(),
            std_pos_E_m: Vec3::zero(),
            std_vel_B_mps: Vec3::zero(),
            std_att_B_rad: Vec3::zero(),
            uwb_noise_factor: 1.0,
            health: haltere_core::estimate::Health::Good,
        }
    }

    #[test]
    fn prop_commands_that_lead_out_end_inside() {
        let fence = yard();
        let mut estimate = estimate([1.5, 1.5, -1.0]);
        let check = |estimate: &Estimate, axes: [AxisCommand; 3], changed: bool| {
            let mut command =
                Command { axes, vel_ff_E_mps: Vec3::new(1.0, 1.0, 0.1), yaw_rad: 0.0 };
            let guarded = fence.guard(&mut command, estimate, [0.0, 0.0]);
            assert_eq!(guarded.is_some(), changed, "{axes:?}");
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
        check(&estimate, [Pos(1.7), Pos(1.7), Pos(-1.0)], false);
        check(&estimate, [Pos(1.8), Pos(1.7), Pos(-1.0)], true);
        check(&estimate, [Pos(5.0), Pos(1.7), Pos(-1.0)], true);
        check(&estimate, [Pos(1.0), Pos(0.1), Pos(-1.0)], true);
        check(&estimate, [Vel(-0.5), Vel(0.0), Vel(0.0)], false);
        check(&estimate, [Vel(1.0), Vel(0.0), Vel(0.0)], true);
        estimate.pos_E_m = Vec3::new(3.0, 0.0, -1.0);
        check(&estimate, [Pos(3.0), Pos(0.0), Pos(-1.0)], true);
    }

    /// A point that is itself inside was let pass, and the way there led through a pillar; one within the
    /// pillar was moved to whichever side of it was nearer.
    #[test]
    fn regress_what_lies_beyond_an_exclusion_ends_on_this_side_of_it() {
        use AxisCommand::{Position_m as Pos, Velocity_mps as Vel};
        let fence = yard();
        let from = |north: f64, wanted: AxisCommand| {
            let axes = [wanted, Pos(0.0), Pos(-1.0)];
            let mut command = Command { axes, vel_ff_E_mps: Vec3::zero(), yaw_rad: 0.0 };
            let guarded = fence.guard(&mut command, &estimate([north, 0.0, -1.0]), [0.0, 0.0]);
            (guarded, command.axes[0])
        };
        for wanted in [Pos(0.6), Pos(0.9), Pos(1.2), Pos(1.7), Vel(2.0)] {
            let (guarded, Pos(at)) = from(-0.5, wanted) else { panic!("{wanted:?}") };
            assert!((at - 0.25).abs() <= STRIDE_M, "{wanted:?} ends at {at}");
            assert_eq!(guarded, Some(Guarded::HeldBack), "{wanted:?}");
        }
        // Drifted into it, the vehicle leaves it where it came in, and may go on from there.
        let (_, Pos(out)) = from(0.7, Pos(1.7)) else { panic!("a velocity") };
        assert!((out - 0.25).abs() < 1e-9, "{out}");
        assert_eq!(from(0.4, Pos(-1.0)), (None, Pos(-1.0)));
        // Where the fence allows it but the wings would reach over, it is only kept off.
        assert_eq!(from(-0.5, Pos(0.4)).0, Some(Guarded::KeptOff));
    }
}
