//! The mission: items as checked types, in local coordinates.

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;

use haltere_core::frames::{E, Vec3};

use super::excitation::Doublet;
use super::tilt_step::TiltStep;

/// Most items of a mission. Bounds what a peer can make us store.
pub const MOST_ITEMS: usize = 1000;

/// One item, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MissionItem {
    /// Climb over the present place.
    Takeoff {
        /// Height above the floor, m.
        height_m: f64,
    },
    /// Fly to a point and stay.
    Waypoint {
        /// Earth frame, m.
        pos_E_m: Vec3<E>,
        /// How long to stay, s; infinite: until told otherwise.
        hold_s: f64,
        /// Distance at which it counts as reached, m.
        acceptance_m: Option<f64>,
        /// Yaw from room north, rad.
        yaw_rad: Option<f64>,
    },
    /// The place of take-off, as some clients write it into item 0. Nothing is flown.
    Home,
    /// Go on with another item.
    Jump {
        /// Its index.
        to: u16,
        /// How often; `None`: always.
        times: Option<u32>,
    },
    /// Stay for a time; infinite: until told otherwise.
    Delay {
        /// How long, s.
        duration_s: f64,
    },
    /// Speed of the setpoint on the legs that follow.
    Speed {
        /// m/s; `None`: back to the configured one.
        speed_mps: Option<f64>,
    },
    /// Turn.
    Yaw {
        /// From room north, or from the yaw in force, rad.
        yaw_rad: f64,
        /// Whether it counts from the yaw in force.
        relative: bool,
    },
    /// Rock roll, pitch or thrust, for what it shows of the inner loop and the wings.
    Doublet(Doublet),
    /// Hold a tilt, for what the speed that it gathers tells of drag.
    Tilt(TiltStep),
    /// Stay until the battery is down to a voltage.
    UntilVoltage {
        /// V.
        supply_v: f64,
        /// Longest stay, s.
        limit_s: f64,
    },
    /// Back over the place of take-off and land.
    Return,
    /// Land; at a point if given.
    Land {
        /// Earth frame, m; only the horizontal part counts.
        pos_E_m: Option<Vec3<E>>,
    },
}

impl MissionItem {
    /// Where it leads to, N and E, m.
    pub(crate) fn place_NE_m(&self) -> Option<[f64; 2]> {
        match self {
            MissionItem::Waypoint { pos_E_m, .. }
            | MissionItem::Land { pos_E_m: Some(pos_E_m) } => Some([pos_E_m.x(), pos_E_m.y()]),
            _ => None,
        }
    }
}

/// Volume that positions must lie in, Earth frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Volume {
    /// Lowest and highest north coordinate, m.
    pub north_m: [f64; 2],
    /// Lowest and highest east coordinate, m.
    pub east_m: [f64; 2],
    /// Highest height above the floor, m.
    pub height_m: f64,
}

/// Lowest height of a point to fly to, m. Below it the floor may carry the vehicle while the
/// position loop is closed, and nothing would notice: landing is what goes lower.
pub const LOWEST_M: f64 = 0.2;

/// From the point that is tracked to the ends of the wings, m: half the span of 0.49 m (VEHICLE.md).
pub(crate) const RADIUS_M: f64 = 0.25;

impl Volume {
    /// Whether a position lies inside.
    pub fn contains(&self, pos_E_m: Vec3<E>) -> bool {
        self.contains_over(pos_E_m)
            && (LOWEST_M..=self.height_m.max(LOWEST_M)).contains(&-pos_E_m.z())
    }

    /// Whether a position lies inside at some height.
    pub fn contains_over(&self, pos_E_m: Vec3<E>) -> bool {
        (self.north_m[0]..=self.north_m[1]).contains(&pos_E_m.x())
            && (self.east_m[0]..=self.east_m[1]).contains(&pos_E_m.y())
    }

    /// How far it is from a coordinate to the edge in the direction of a velocity, m, at least 0.
    pub fn way_to_edge_m(&self, axis: usize, at_m: f64, vel_mps: f64) -> f64 {
        let [low, high] = match axis {
            0 => self.north_m,
            1 => self.east_m,
            _ => [-self.height_m.max(LOWEST_M), -LOWEST_M],
        };
        (if vel_mps < 0.0 { at_m - low } else { high - at_m }).max(0.0)
    }

    /// The nearest position inside.
    pub fn clamp(&self, pos_E_m: Vec3<E>) -> Vec3<E> {
        Vec3::new(
            pos_E_m.x().clamp(self.north_m[0], self.north_m[1]),
            pos_E_m.y().clamp(self.east_m[0], self.east_m[1]),
            pos_E_m.z().clamp(-self.height_m.max(LOWEST_M), -LOWEST_M),
        )
    }
}

/// A stored item as it goes back to a client: exactly what was uploaded.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredItem {
    /// As uploaded.
    pub wire: MISSION_ITEM_INT_DATA,
    /// As checked.
    pub item: MissionItem,
}

/// The mission that is in force.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mission {
    /// Items in order.
    pub items: Vec<StoredItem>,
    /// Changes with every upload, never 0 while there are items: the protocol's opaque id.
    pub id: u32,
}

impl Mission {
    /// Height of the first take-off, if the mission starts with one.
    pub fn takeoff_height_m(&self) -> Option<f64> {
        self.items.iter().find_map(|stored| match stored.item {
            MissionItem::Takeoff { height_m } => Some(height_m),
            _ => None,
        })
    }

    /// Replaces all items.
    pub fn replace(&mut self, items: Vec<StoredItem>) {
        self.id = plan_id(items.iter().map(|stored| &stored.wire));
        self.items = items;
    }
}

/// FNV-1a over what defines the items: the same plan has the same id after a restart. 0: no items.
pub(crate) fn plan_id<'a>(items: impl Iterator<Item = &'a MISSION_ITEM_INT_DATA>) -> u32 {
    let mut hash = None;
    for w in items {
        let mut eat = |bytes: &[u8]| {
            let start = hash.unwrap_or(0x811c_9dc5_u32);
            hash = Some(
                bytes
                    .iter()
                    .fold(start, |hash, byte| (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193)),
            );
        };
        for p in [w.param1, w.param2, w.param3, w.param4, w.z] {
            eat(&p.to_bits().to_le_bytes());
        }
        eat(&w.x.to_le_bytes());
        eat(&w.y.to_le_bytes());
        eat(&u32::from(w.command).to_le_bytes());
        eat(&[w.frame]);
    }
    hash.map_or(0, |hash| hash.max(1))
}
