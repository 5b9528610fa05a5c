//! Whether a flight went well, by the truth alone.
//!
//! Outside: the centre of mass is beyond the fence while the vehicle is off the floor, by any amount.
//! Crashed: it tumbles (body z more than 80° from upright, anywhere), or it meets the floor sinking
//! faster than 2 m/s (the height of a fall of 0.2 m; what the simulated vehicle breaks at), moving
//! faster than 1.5 m/s over it, or leaning by more than 45°. Off the floor again: it has flown and has met the
//! floor, and is 0.15 m above it again (gear that springs stays below).

use haltere_core::checks::Problems;
use haltere_model::Truth;
use haltere_model::room::Room;
use serde::{Deserialize, Serialize};

use crate::simulated::faults::Shape;

/// Sinking speed at contact that breaks it, m/s.
pub const SINK_MPS: f64 = 2.0;
/// Speed over the floor at contact that trips it, m/s.
pub const SLIDE_MPS: f64 = 1.5;
/// Tilt at contact at which a wing meets the floor first, degrees.
pub const CONTACT_TILT_DEG: f64 = 45.0;
/// Tilt that is a tumble anywhere, degrees.
pub const TUMBLE_DEG: f64 = 80.0;
/// Higher than this it is off the floor, m: gear that rocks is no flight.
const LIFTED_M: f64 = 0.05;
/// Higher than this it has flown, m: what it touches down from is a flight and no hop of the spool-up.
const FLOWN_M: f64 = 0.3;
/// So far above the floor after a touch-down it has left it again, m.
const AGAIN_M: f64 = 0.15;
/// So far inside of what a station's fence forbids the centre of mass may be, m: what the estimate errs by. The
/// fence of the campaign itself has no such allowance, missions keep away from it.
const FORBIDDEN_ALLOWANCE_M: f64 = 0.3;

/// A vehicle that lies on its side has its centre of mass no higher than this, m.
const LYING_M: f64 = 0.25;
/// It may have thrust for so long then, µs …
const LYING_US: u64 = 1_000_000;
/// … above this, N: a third of the nominal vehicle's weight.
const LYING_THRUST_N: f64 = 0.33;

/// Where the vehicle may be, m.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fence {
    /// South and north end.
    pub north_m: [f64; 2],
    /// West and east end.
    pub east_m: [f64; 2],
    /// Top over the floor.
    pub height_m: f64,
}

impl Fence {
    /// The walls and the ceiling.
    pub fn of_room(room: &Room) -> Self {
        Self { north_m: room.north_m, east_m: room.east_m, height_m: room.ceiling_m }
    }

    /// Says what is wrong with it.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        for (name, [low, high]) in [("north_m", self.north_m), ("east_m", self.east_m)] {
            problems.range(format_args!("{key}.{name}[0]"), low, -200.0..=200.0, "m");
            problems.range(format_args!("{key}.{name}[1]"), high, low + 0.5..=low + 400.0, "m");
        }
        problems.range(format_args!("{key}.height_m"), self.height_m, 0.3..=50.0, "m");
    }

    /// How far a place is outside, m; 0 inside.
    pub fn outside_m(&self, truth: &Truth) -> f64 {
        let pos = truth.pos_E_m;
        let beyond = |at: f64, [low, high]: [f64; 2]| (low - at).max(at - high).max(0.0);
        let over_m = (truth.height_m - self.height_m).max(0.0);
        beyond(pos.x(), self.north_m).max(beyond(pos.y(), self.east_m)).max(over_m)
    }
}

/// Where a station's fence says that nobody may be, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Forbidden {
    /// Its form.
    pub shape: Shape,
    /// Its middle, room north and east.
    pub centre_m: [f64; 2],
    /// Its radius, of a square half its side.
    pub radius_m: f64,
}

impl Forbidden {
    /// How far inside of it a place is, m; below 0 outside, then no farther away than so much.
    pub fn inside_m(&self, [north_m, east_m]: [f64; 2]) -> f64 {
        let off = [north_m - self.centre_m[0], east_m - self.centre_m[1]];
        let from_centre_m = match self.shape {
            Shape::Circle => off[0].hypot(off[1]),
            Shape::Square => off[0].abs().max(off[1].abs()),
        };
        self.radius_m - from_centre_m
    }
}

/// What has been seen of a flight.
#[derive(Debug, Clone, Default)]
pub struct Judge {
    last: Option<Truth>,
    /// Take-offs of the mission after the first: so often it may leave the floor again.
    further_takeoffs: usize,
    /// It cannot stand: falling over on the floor is the fault and no crash, thrust while it lies is one.
    cannot_stand: bool,
    lies_since_us: Option<u64>,
    /// It was higher than a hop.
    pub has_flown: bool,
    is_down: bool,
    /// What a station's fence forbids, from when it was taken.
    pub forbidden: Vec<Forbidden>,
    /// First time that it left the floor again, µs of simulated time.
    pub again_us: Option<u64>,
    /// How high it came after that, m.
    pub again_m: f64,
    /// It was in the air.
    pub lifted: bool,
    /// It is in the air.
    pub airborne: bool,
    /// First time outside, µs of simulated time.
    pub left_us: Option<u64>,
    /// Farthest outside, m.
    pub outside_m: f64,
    /// When it crashed, and how.
    pub crash: Option<(u64, String)>,
    /// Contacts with the floor after lift-off.
    pub contacts: u64,
    /// Hardest of them, m/s.
    pub contact_mps: f64,
    /// Largest tilt so far, degrees.
    pub tilt_deg: f64,
    /// Steps in the air.
    pub airborne_steps: u64,
}

/// Angle between body z and the vertical, degrees.
pub fn tilt_deg(truth: &Truth) -> f64 {
    let up = truth.R_EB.raw().to_rotation_matrix().matrix()[(2, 2)];
    up.clamp(-1.0, 1.0).acos().to_degrees()
}

impl Judge {
    /// For a mission with so many take-offs. `cannot_stand`: its gear is what breaks.
    pub fn new(takeoffs: usize, cannot_stand: bool) -> Self {
        Self { further_takeoffs: takeoffs.saturating_sub(1), cannot_stand, ..Self::default() }
    }

    /// Looks at one step.
    pub fn see(&mut self, fence: &Fence, truth: &Truth) {
        let tilt_deg = tilt_deg(truth);
        self.tilt_deg = self.tilt_deg.max(tilt_deg);
        if truth.height_m > LIFTED_M {
            self.lifted = true;
            self.airborne = true;
        }
        if self.cannot_stand && truth.height_m < LYING_M {
            self.watch_lying(truth, tilt_deg);
        } else if tilt_deg > TUMBLE_DEG {
            self.crashed(truth, format!("tumbled at {:.2} m", truth.height_m));
        }
        self.watch_floor(truth);
        if self.airborne && truth.on_ground {
            self.airborne = false;
            self.contacts += 1;
            // The floor has already taken the speed: that of the step before counts.
            let before = self.last.unwrap_or(*truth);
            let vel = before.vel_E_mps;
            let slide_mps = vel.x().hypot(vel.y());
            self.contact_mps = self.contact_mps.max(vel.z());
            if vel.z() > SINK_MPS {
                self.crashed(truth, format!("hit the floor at {:.1} m/s", vel.z()));
            } else if slide_mps > SLIDE_MPS {
                self.crashed(truth, format!("slid on the floor at {slide_mps:.1} m/s"));
            } else if tilt_deg > CONTACT_TILT_DEG && !self.cannot_stand {
                self.crashed(truth, format!("met the floor leaning by {tilt_deg:.0}°"));
            }
        }
        if self.airborne {
            self.airborne_steps += 1;
            let at = [truth.pos_E_m.x(), truth.pos_E_m.y()];
            let inside = self.forbidden.iter().map(|f| f.inside_m(at) - FORBIDDEN_ALLOWANCE_M);
            let outside_m = inside.fold(fence.outside_m(truth), f64::max);
            if outside_m > 0.0 {
                self.left_us.get_or_insert(truth.t_us);
                self.outside_m = self.outside_m.max(outside_m);
            }
        }
        self.last = Some(*truth);
    }

    /// Whether motors run while it lies on its side.
    fn watch_lying(&mut self, truth: &Truth, tilt_deg: f64) {
        if tilt_deg < CONTACT_TILT_DEG || truth.thrust_n < LYING_THRUST_N {
            self.lies_since_us = None;
            return;
        }
        let since_us = *self.lies_since_us.get_or_insert(truth.t_us);
        if truth.t_us - since_us > LYING_US {
            let seconds = LYING_US as f64 * 1e-6;
            self.crashed(truth, format!("lay on its side with thrust for {seconds:.1} s"));
        }
    }

    /// Whether it leaves the floor again after it was down.
    fn watch_floor(&mut self, truth: &Truth) {
        self.has_flown |= truth.height_m > FLOWN_M;
        self.is_down |= self.has_flown && truth.on_ground;
        if !self.is_down || truth.height_m < AGAIN_M {
            return;
        }
        match self.further_takeoffs.checked_sub(1) {
            Some(left) => (self.further_takeoffs, self.is_down) = (left, false),
            None => {
                self.again_us.get_or_insert(truth.t_us);
                self.again_m = self.again_m.max(truth.height_m);
            }
        }
    }

    fn crashed(&mut self, truth: &Truth, how: String) {
        if self.crash.is_none() {
            self.crash = Some((truth.t_us, how));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_core::frames::Vec3;
    use haltere_model::{Plant, PlantConfig};

    fn truth(height_m: f64, vel: [f64; 3]) -> Truth {
        let still = Plant::new(PlantConfig::hall(1)).unwrap().truth();
        Truth {
            height_m,
            on_ground: height_m <= 0.0,
            pos_E_m: Vec3::new(5.0, 5.0, -height_m),
            vel_E_mps: Vec3::from_array(vel),
            ..still
        }
    }

    fn judged(steps: &[Truth]) -> Judge {
        let fence = Fence::of_room(&Room::default());
        let mut judge = Judge::default();
        steps.iter().for_each(|t| judge.see(&fence, t));
        judge
    }

    #[test]
    fn prop_contacts_are_told_from_crashes() {
        let end = truth(0.0, [0.0; 3]);
        let of = |vel| judged(&[truth(0.5, [0.0; 3]), truth(0.01, vel), end]);
        assert!(of([0.0, 0.0, 0.5]).crash.is_none() && of([0.0, 0.0, 0.5]).contacts == 1);
        assert!(of([0.0, 0.0, 2.1]).crash.is_some_and(|(_, how)| how.contains("2.1 m/s")));
        assert!(of([1.2, 1.2, 0.2]).crash.is_some_and(|(_, how)| how.contains("slid")));
        let still = judged(&[end, truth(0.01, [0.0; 3]), end]);
        assert!(!still.lifted && still.contacts == 0);
    }

    #[test]
    fn prop_down_is_down() {
        let still = [0.0; 3];
        let (high, end, hop) = (truth(0.5, still), truth(0.0, still), truth(0.1, still));
        let again = |steps: &[Truth]| judged(steps).again_us.is_some();
        assert!(again(&[end, high, end, high]));
        assert!(!again(&[end, high, end, hop, end]), "gear that springs");
        assert!(!again(&[end, truth(0.2, still), end, high, end]), "a hop before it flies");
        let mut twice = Judge::new(2, false);
        let fence = Fence::of_room(&Room::default());
        [high, end, high, end].iter().for_each(|t| twice.see(&fence, t));
        assert!(twice.again_us.is_none(), "the mission takes off twice");
        twice.see(&fence, &high);
        assert!(twice.again_us.is_some());
    }

    #[test]
    fn prop_what_cannot_stand_may_lie_but_not_with_thrust() {
        use haltere_core::frames::Rot;
        use nalgebra::{UnitQuaternion, Vector3};
        let side = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 1.6);
        let lying = |t_us, thrust_n| Truth {
            R_EB: Rot::from_raw(side),
            t_us,
            thrust_n,
            ..truth(0.0, [0.0; 3])
        };
        let crash = |cannot_stand, thrust_n| {
            let fence = Fence::of_room(&Room::default());
            let mut judge = Judge::new(1, cannot_stand);
            [0, 700_000, 1_400_000].iter().for_each(|t| judge.see(&fence, &lying(*t, thrust_n)));
            judge.crash.map(|(_, how)| how)
        };
        assert!(crash(false, 0.0).is_some_and(|how| how.contains("tumbled")));
        assert_eq!(crash(true, 0.0), None);
        assert!(crash(true, 0.9).is_some_and(|how| how.contains("with thrust")));
    }

    #[test]
    fn prop_what_a_station_forbids_is_outside() {
        let mut judge = Judge::default();
        let (centre_m, radius_m) = ([5.0, 5.0], 0.6);
        judge.forbidden.push(Forbidden { shape: Shape::Circle, centre_m, radius_m });
        let fence = Fence::of_room(&Room::default());
        let at = |north: f64| {
            let mut t = truth(1.0, [0.0; 3]);
            t.pos_E_m = Vec3::new(north, 5.0, -1.0);
            t
        };
        judge.see(&fence, &at(4.65));
        assert!(judge.left_us.is_none(), "what the estimate errs by");
        judge.see(&fence, &at(4.9));
        assert!(judge.left_us.is_some() && (judge.outside_m - 0.2).abs() < 1e-9);
        let square = Forbidden { shape: Shape::Square, centre_m, radius_m };
        assert!((square.inside_m([5.5, 4.5]) - 0.1).abs() < 1e-9);
    }

    #[test]
    fn prop_outside_counts_in_the_air_only() {
        let mut beyond = truth(1.0, [0.0; 3]);
        beyond.pos_E_m = Vec3::new(10.4, 5.0, -1.0);
        let judge = judged(&[beyond]);
        assert!(judge.left_us.is_some() && (judge.outside_m - 0.4).abs() < 1e-9);
        let on_floor = Truth { height_m: 0.0, on_ground: true, ..beyond };
        assert!(judged(&[on_floor]).left_us.is_none());
        assert!(judged(&[truth(7.5, [0.0; 3])]).left_us.is_some());
    }
}
