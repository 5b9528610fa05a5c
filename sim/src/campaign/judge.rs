//! Whether a flight went well, by the truth alone.
//!
//! Outside: the centre of mass is beyond the fence while the vehicle is off the floor, by any amount.
//! Crashed: it tumbles (body z more than 80° from upright, anywhere), or it meets the floor sinking
//! faster than 2 m/s (the height of a fall of 0.2 m; what the simulated vehicle breaks at), moving
//! faster than 1.5 m/s over it, or leaning by more than 45°.

use haltere::checks::Problems;
use haltere::model::Truth;
use haltere::model::room::Room;
use serde::{Deserialize, Serialize};

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

/// What has been seen of a flight.
#[derive(Debug, Clone, Default)]
pub struct Judge {
    last: Option<Truth>,
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
    /// Looks at one step.
    pub fn see(&mut self, fence: &Fence, truth: &Truth) {
        let tilt_deg = tilt_deg(truth);
        self.tilt_deg = self.tilt_deg.max(tilt_deg);
        if truth.height_m > LIFTED_M {
            self.lifted = true;
            self.airborne = true;
        }
        if tilt_deg > TUMBLE_DEG {
            self.crashed(truth, format!("tumbled at {:.2} m", truth.height_m));
        }
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
            } else if tilt_deg > CONTACT_TILT_DEG {
                self.crashed(truth, format!("met the floor leaning by {tilt_deg:.0}°"));
            }
        }
        if self.airborne {
            self.airborne_steps += 1;
            let outside_m = fence.outside_m(truth);
            if outside_m > 0.0 {
                self.left_us.get_or_insert(truth.t_us);
                self.outside_m = self.outside_m.max(outside_m);
            }
        }
        self.last = Some(*truth);
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
    use haltere::frames::Vec3;
    use haltere::model::{Plant, PlantConfig};

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
