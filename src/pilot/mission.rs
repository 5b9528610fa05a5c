//! Missions in local coordinates: items as checked types, and their wire form.

use haltere_dialect::mav::haltere::{
    MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavMissionResult, MavMissionType,
};

use crate::frames::{E, Vec3};

use super::excitation::Doublet;
use super::tilt_step::{Envelope, TiltStep};

/// Most items of a mission. Bounds what a peer can make us store.
pub const MOST_ITEMS: usize = 1000;

/// `MAV_FRAME_LOCAL_NED` in `MISSION_ITEM_INT` counts x and y in 0.1 mm.
const LOCAL_SCALE: f64 = 1e-4;

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
        /// How long to stay, s.
        hold_s: f64,
        /// Distance at which it counts as reached, m.
        acceptance_m: Option<f64>,
        /// Yaw from room north, rad.
        yaw_rad: Option<f64>,
    },
    /// Stay for a time.
    Delay {
        /// How long, s.
        duration_s: f64,
    },
    /// Speed of the setpoint on the legs that follow.
    Speed {
        /// m/s; `None`: back to the configured one.
        speed_mps: Option<f64>,
    },
    /// Turn to a yaw from room north.
    Yaw {
        /// rad.
        yaw_rad: f64,
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

/// Highest voltage that can be waited for, V: as for `limits.battery_low_v`.
const HIGHEST_WAIT_V: f64 = 30.0;

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

/// NaN on the wire means "not given".
fn given(value: f32) -> Option<f64> {
    value.is_finite().then_some(f64::from(value))
}

/// Checks an uploaded item. The error is what the protocol answers, and a sentence for people.
pub fn from_wire(
    item: &MISSION_ITEM_INT_DATA,
    envelope: &Envelope,
) -> Result<MissionItem, (MavMissionResult, String)> {
    use MavMissionResult as R;
    let seq = item.seq;
    let volume = &envelope.volume;
    let positioned = matches!(
        item.command,
        MavCmd::MAV_CMD_NAV_WAYPOINT | MavCmd::MAV_CMD_NAV_LAND | MavCmd::MAV_CMD_NAV_TAKEOFF
    );
    let local = item.frame == MavFrame::MAV_FRAME_LOCAL_NED;
    if positioned && !local {
        return Err((
            R::MAV_MISSION_UNSUPPORTED_FRAME,
            format!("item {seq}: frame {:?} not supported, use LOCAL_NED", item.frame),
        ));
    }
    let landing = item.command == MavCmd::MAV_CMD_NAV_LAND;
    let pos_E_m = || {
        let pos = Vec3::<E>::new(
            f64::from(item.x) * LOCAL_SCALE,
            f64::from(item.y) * LOCAL_SCALE,
            f64::from(item.z),
        );
        let inside = if landing { volume.contains_over(pos) } else { volume.contains(pos) };
        if pos.is_finite() && inside {
            Ok(pos)
        } else {
            Err((
                R::MAV_MISSION_INVALID,
                format!(
                    "item {seq}: N {:.2} E {:.2} height {:.2} m is outside N {:.1} to {:.1}, \
                     E {:.1} to {:.1}, height {LOWEST_M} to {:.1} m",
                    pos.x(),
                    pos.y(),
                    -pos.z(),
                    volume.north_m[0],
                    volume.north_m[1],
                    volume.east_m[0],
                    volume.east_m[1],
                    volume.height_m
                ),
            ))
        }
    };
    let in_range = |value: f64, low: f64, high: f64, result, what: &str, unit: &str| {
        if (low..=high).contains(&value) {
            Ok(value)
        } else {
            Err((result, format!("item {seq}: {what} = {value}, allowed {low} to {high} {unit}")))
        }
    };
    match item.command {
        MavCmd::MAV_CMD_NAV_TAKEOFF => {
            let height_m = in_range(
                -f64::from(item.z),
                0.3,
                volume.height_m,
                R::MAV_MISSION_INVALID_PARAM7,
                "take-off height",
                "m",
            )?;
            Ok(MissionItem::Takeoff { height_m })
        }
        MavCmd::MAV_CMD_NAV_WAYPOINT => Ok(MissionItem::Waypoint {
            pos_E_m: pos_E_m()?,
            hold_s: in_range(
                given(item.param1).unwrap_or(0.0),
                0.0,
                3600.0,
                R::MAV_MISSION_INVALID_PARAM1,
                "hold time",
                "s",
            )?,
            acceptance_m: match given(item.param2) {
                Some(radius_m) if radius_m > 0.0 => Some(in_range(
                    radius_m,
                    0.05,
                    5.0,
                    R::MAV_MISSION_INVALID_PARAM2,
                    "acceptance radius",
                    "m",
                )?),
                _ => None,
            },
            yaw_rad: given(item.param4).map(f64::to_radians),
        }),
        MavCmd::MAV_CMD_NAV_LAND => {
            // A zero point is what clients send for "here".
            let here = item.x == 0 && item.y == 0;
            let pos = if here { None } else { Some(pos_E_m()?) };
            Ok(MissionItem::Land { pos_E_m: pos })
        }
        MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => Ok(MissionItem::Return),
        MavCmd::MAV_CMD_NAV_DELAY | MavCmd::MAV_CMD_NAV_LOITER_TIME => Ok(MissionItem::Delay {
            duration_s: in_range(
                given(item.param1).unwrap_or(0.0),
                0.0,
                3600.0,
                R::MAV_MISSION_INVALID_PARAM1,
                "time",
                "s",
            )?,
        }),
        MavCmd::MAV_CMD_DO_CHANGE_SPEED => Ok(MissionItem::Speed {
            speed_mps: match given(item.param2) {
                Some(speed) if speed > 0.0 => Some(in_range(
                    speed,
                    0.05,
                    20.0,
                    R::MAV_MISSION_INVALID_PARAM2,
                    "speed",
                    "m/s",
                )?),
                _ => None,
            },
        }),
        MavCmd::MAV_CMD_CONDITION_YAW => Ok(MissionItem::Yaw {
            yaw_rad: in_range(
                given(item.param1).unwrap_or(0.0),
                -360.0,
                360.0,
                R::MAV_MISSION_INVALID_PARAM1,
                "yaw",
                "deg",
            )?
            .to_radians(),
        }),
        MavCmd::MAV_CMD_USER_1 => {
            let [axis, amplitude, half_s] = [item.param1, item.param2, item.param3].map(f64::from);
            Doublet::from_params(axis, amplitude, half_s)
                .map(MissionItem::Doublet)
                .map_err(|why| (R::MAV_MISSION_INVALID, format!("item {seq}: doublet: {why}")))
        }
        MavCmd::MAV_CMD_USER_2 => {
            let params = [item.param1, item.param2, item.param3, item.param4].map(f64::from);
            TiltStep::from_params(params, f64::from(item.z))
                .and_then(|step| step.check(envelope).map(|()| MissionItem::Tilt(step)))
                .map_err(|why| (R::MAV_MISSION_INVALID, format!("item {seq}: tilt: {why}")))
        }
        MavCmd::MAV_CMD_USER_3 => Ok(MissionItem::UntilVoltage {
            supply_v: in_range(
                f64::from(item.param1),
                envelope.battery_critical_v,
                HIGHEST_WAIT_V,
                R::MAV_MISSION_INVALID_PARAM1,
                "voltage",
                "V; below, the vehicle lands by itself",
            )?,
            limit_s: match given(item.param2) {
                Some(limit_s) if limit_s > 0.0 => in_range(
                    limit_s,
                    1.0,
                    3600.0,
                    R::MAV_MISSION_INVALID_PARAM2,
                    "longest time",
                    "s",
                )?,
                _ => 3600.0,
            },
        }),
        other => Err((R::MAV_MISSION_UNSUPPORTED, format!("item {seq}: {other:?} not supported"))),
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
        self.id = if items.is_empty() { 0 } else { fingerprint(&items) };
        self.items = items;
    }
}

/// FNV-1a over what defines the items: the same plan has the same id after a restart.
fn fingerprint(items: &[StoredItem]) -> u32 {
    let mut hash = 0x811c_9dc5_u32;
    let mut eat = |bytes: &[u8]| {
        for byte in bytes {
            hash = (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193);
        }
    };
    for stored in items {
        let w = &stored.wire;
        for p in [w.param1, w.param2, w.param3, w.param4, w.z] {
            eat(&p.to_bits().to_le_bytes());
        }
        eat(&w.x.to_le_bytes());
        eat(&w.y.to_le_bytes());
        eat(&(w.command as u32).to_le_bytes());
        eat(&[w.frame as u8]);
    }
    hash.max(1)
}

/// Whether a mission type is the plan itself (fence and rally points have lists of their own).
pub fn is_plan(mission_type: MavMissionType) -> bool {
    mission_type == MavMissionType::MAV_MISSION_TYPE_MISSION
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume() -> Envelope {
        let volume = Volume { north_m: [-5.0, 5.0], east_m: [-5.0, 5.0], height_m: 3.0 };
        Envelope::new(volume, &Default::default(), 6.0)
    }

    fn waypoint() -> MISSION_ITEM_INT_DATA {
        MISSION_ITEM_INT_DATA {
            command: MavCmd::MAV_CMD_NAV_WAYPOINT,
            frame: MavFrame::MAV_FRAME_LOCAL_NED,
            x: 10_000,
            y: -20_000,
            z: -1.5,
            param1: 2.0,
            param4: f32::NAN,
            ..Default::default()
        }
    }

    #[test]
    fn prop_local_items_are_read_in_metres() {
        assert_eq!(
            from_wire(&waypoint(), &volume()),
            Ok(MissionItem::Waypoint {
                pos_E_m: Vec3::new(1.0, -2.0, -1.5),
                hold_s: 2.0,
                acceptance_m: None,
                yaw_rad: None,
            })
        );
    }

    #[test]
    fn prop_refusals_name_the_item_and_the_reason() {
        let check = |item: MISSION_ITEM_INT_DATA, result, says: &str| {
            let (got, text) = from_wire(&item, &volume()).unwrap_err();
            assert_eq!(got, result);
            assert!(text.contains(says), "{text}");
        };
        use MavMissionResult as R;
        // What MAVProxy and QGroundControl send for a local frame: scaled by 1e7, 1000 times too far.
        let scaled = MISSION_ITEM_INT_DATA { x: 10_000_000, seq: 3, ..waypoint() };
        check(scaled, R::MAV_MISSION_INVALID, "item 3: N 1000.00");
        let global = MISSION_ITEM_INT_DATA { frame: MavFrame::MAV_FRAME_GLOBAL_INT, ..waypoint() };
        check(global, R::MAV_MISSION_UNSUPPORTED_FRAME, "use LOCAL_NED");
        let nan = MISSION_ITEM_INT_DATA { z: f32::NAN, ..waypoint() };
        check(nan, R::MAV_MISSION_INVALID, "height NaN");
        let roi = MISSION_ITEM_INT_DATA { command: MavCmd::MAV_CMD_DO_SET_ROI, ..waypoint() };
        check(roi, R::MAV_MISSION_UNSUPPORTED, "not supported");
        let floor = MISSION_ITEM_INT_DATA { z: 0.0, ..waypoint() };
        check(floor, R::MAV_MISSION_INVALID, "height 0.2 to 3.0 m");
        // A landing place lies on the floor.
        let land =
            MISSION_ITEM_INT_DATA { command: MavCmd::MAV_CMD_NAV_LAND, z: 0.0, ..waypoint() };
        assert!(from_wire(&land, &volume()).is_ok());
    }

    #[test]
    fn prop_id_follows_the_content() {
        let stored = |wire: MISSION_ITEM_INT_DATA| StoredItem {
            item: from_wire(&wire, &volume()).unwrap(),
            wire,
        };
        let mut mission = Mission::default();
        mission.replace(vec![stored(waypoint())]);
        let first = mission.id;
        mission.replace(vec![stored(MISSION_ITEM_INT_DATA { x: 10_001, ..waypoint() })]);
        assert_ne!(mission.id, first);
        mission.replace(vec![]);
        assert_eq!(mission.id, 0);
    }
}
