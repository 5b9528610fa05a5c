//! Mission files: a list of `[[item]]` tables in TOML.
//!
//! ```toml
//! [[item]]
//! command = "takeoff"      # climbs over the place it stands on
//! height_m = 1.2
//!
//! [[item]]
//! command = "speed"        # of the setpoint on the legs that follow
//! speed_mps = 0.5          # at or above the controller's limit the setpoint jumps
//!
//! [[item]]
//! command = "waypoint"
//! position_m = [5.0, 5.0, 1.2]   # room north, room east, height above the origin
//! hold_s = 2.0             # optional: how long to stay
//! acceptance_m = 0.3       # optional: distance at which it counts as reached
//! yaw_deg = 0.0            # optional: from room north, clockwise seen from above
//! path = "square"          # optional: name under which reports judge the leg that ends here
//!
//! [[item]]
//! command = "delay"
//! duration_s = 3.0
//!
//! [[item]]
//! command = "doublet"      # a step to one side and the same to the other, added to the setpoint
//! axis = "pitch"           # "roll", "pitch" or "thrust"
//! amplitude = 8.0          # degrees, up to 20; of thrust a share of full throttle, up to 0.2
//! half_s = 0.5             # length of each half, 0.05 to 1.5 s
//!
//! [[item]]
//! command = "tilt"         # holds an angle, height held, and brakes; ends before the fence
//! axis = "pitch"           # "roll" (right side down positive) or "pitch" (nose up positive)
//! angle_deg = -22.0        # 1 to 52 to either side
//! duration_s = 3.0         # longest time, 0.3 to 10 s
//! distance_m = 5.0         # optional: ends when so far from where it began
//! beyond_limit = true      # optional: may exceed control.limits.tilt_deg, in this item alone
//!
//! [[item]]
//! command = "until_voltage" # stays until the battery is down to this
//! supply_v = 7.0
//! limit_s = 300.0          # optional: longest stay
//!
//! [[item]]
//! command = "return"       # back over the place of take-off
//!
//! [[item]]
//! command = "land"         # optional position_m: only north and east count
//! ```

use haltere_dialect::mav::LOCAL_PER_M;
use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavMissionType};
use serde::{Deserialize, Serialize};

use haltere_core::checks::Problems;

/// Farthest coordinate that the wire can carry, with room to spare, m.
const FARTHEST_M: f64 = 1000.0;

/// A mission, as in a file.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MissionFile {
    /// Items in order.
    #[serde(rename = "item", default)]
    pub items: Vec<Item>,
}

/// One item.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Item {
    /// What to do; the keys that go with it follow.
    pub command: Command,
    /// Room north, room east, height above the origin, m.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "three")]
    pub position_m: Option<[f64; 3]>,
    /// Height of a take-off, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_m: Option<f64>,
    /// How long to stay at a waypoint, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hold_s: Option<f64>,
    /// Distance at which a waypoint counts as reached, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub acceptance_m: Option<f64>,
    /// Yaw from room north, degrees, clockwise seen from above.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yaw_deg: Option<f64>,
    /// How long to wait, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub duration_s: Option<f64>,
    /// Speed of the setpoint on the legs that follow, m/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub speed_mps: Option<f64>,
    /// What a doublet rocks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<DoubletAxis>,
    /// Size of a doublet, degrees, or share of full throttle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub amplitude: Option<f64>,
    /// Length of each half of a doublet, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub half_s: Option<f64>,
    /// Angle of a tilt, degrees: roll right side down, pitch nose up.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle_deg: Option<f64>,
    /// Distance at which a tilt ends, m.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub distance_m: Option<f64>,
    /// Whether a tilt may exceed the configured limit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beyond_limit: Option<bool>,
    /// Voltage to wait for, V.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub supply_v: Option<f64>,
    /// Longest wait for it, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit_s: Option<f64>,
    /// Name under which reports judge the leg that ends here.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub path: Option<String>,
}

/// Three numbers, neither more nor fewer: serde takes the first three of more without a word.
fn three<'de, D: serde::Deserializer<'de>>(from: D) -> Result<Option<[f64; 3]>, D::Error> {
    let all = Vec::<f64>::deserialize(from)?;
    let count = all.len();
    let three = all.try_into().map_err(|_| {
        serde::de::Error::custom(format_args!("position_m has {count} numbers, allowed 3"))
    })?;
    Ok(Some(three))
}

/// Commands of a mission file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Command {
    /// Climb over the present place.
    Takeoff,
    /// Fly to a point.
    Waypoint,
    /// Wait.
    Delay,
    /// Change the speed of the setpoint.
    Speed,
    /// Turn.
    Yaw,
    /// Rock roll, pitch or thrust.
    Doublet,
    /// Hold a tilt.
    Tilt,
    /// Wait for a voltage.
    #[serde(rename = "until_voltage")]
    UntilVoltage,
    /// Back over the place of take-off.
    Return,
    /// Land.
    Land,
}

/// What a doublet rocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DoubletAxis {
    /// Roll setpoint.
    Roll,
    /// Pitch setpoint.
    Pitch,
    /// Thrust.
    Thrust,
}

impl Item {
    /// Whether the vehicle stands on the floor when everything that it begins is over.
    pub fn lands(&self) -> bool {
        matches!(self.command, Command::Land | Command::Return)
    }

    /// An item without any optional key.
    pub fn new(command: Command) -> Self {
        Self {
            command,
            position_m: None,
            height_m: None,
            hold_s: None,
            acceptance_m: None,
            yaw_deg: None,
            duration_s: None,
            speed_mps: None,
            axis: None,
            amplitude: None,
            half_s: None,
            angle_deg: None,
            distance_m: None,
            beyond_limit: None,
            supply_v: None,
            limit_s: None,
            path: None,
        }
    }

    /// A waypoint.
    pub fn waypoint(north_m: f64, east_m: f64, height_m: f64) -> Self {
        Self { position_m: Some([north_m, east_m, height_m]), ..Self::new(Command::Waypoint) }
    }

    /// As uploaded. Fields that a command does not use stay zero, those not given are NaN.
    pub fn to_wire(
        &self,
        seq: u16,
        target_system: u8,
        target_component: u8,
    ) -> MISSION_ITEM_INT_DATA {
        let given = |value: Option<f64>| value.map_or(f32::NAN, |v| v as f32);
        let [north_m, east_m, height_m] = self.position_m.unwrap_or_default();
        let mut wire = MISSION_ITEM_INT_DATA {
            seq,
            target_system,
            target_component,
            frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
            mission_type: MavMissionType::MAV_MISSION_TYPE_MISSION as u8,
            autocontinue: 1,
            current: u8::from(seq == 0),
            x: (north_m * LOCAL_PER_M).round() as i32,
            y: (east_m * LOCAL_PER_M).round() as i32,
            z: -height_m as f32,
            ..Default::default()
        };
        let command = match self.command {
            Command::Takeoff => {
                wire.z = -self.height_m.unwrap_or_default() as f32;
                wire.param4 = f32::NAN;
                MavCmd::MAV_CMD_NAV_TAKEOFF
            }
            Command::Waypoint => {
                wire.param1 = self.hold_s.unwrap_or_default() as f32;
                wire.param2 = self.acceptance_m.unwrap_or_default() as f32;
                wire.param4 = given(self.yaw_deg);
                MavCmd::MAV_CMD_NAV_WAYPOINT
            }
            Command::Delay => {
                wire.param1 = given(self.duration_s);
                MavCmd::MAV_CMD_NAV_DELAY
            }
            Command::Speed => {
                wire.param1 = 1.0; // ground speed
                wire.param2 = given(self.speed_mps);
                wire.param3 = -1.0; // no throttle
                MavCmd::MAV_CMD_DO_CHANGE_SPEED
            }
            Command::Yaw => {
                wire.param1 = given(self.yaw_deg);
                MavCmd::MAV_CMD_CONDITION_YAW
            }
            Command::Doublet => {
                wire.param1 = self.axis.map_or(f32::NAN, |axis| f32::from(axis as u8));
                wire.param2 = given(self.amplitude);
                wire.param3 = given(self.half_s);
                MavCmd::MAV_CMD_USER_1
            }
            Command::Tilt => {
                wire.param1 = self.axis.map_or(f32::NAN, |axis| f32::from(axis as u8));
                wire.param2 = given(self.angle_deg);
                wire.param3 = given(self.duration_s);
                wire.param4 = f32::from(u8::from(self.beyond_limit.unwrap_or(false)));
                wire.z = self.distance_m.unwrap_or_default() as f32;
                MavCmd::MAV_CMD_USER_2
            }
            Command::UntilVoltage => {
                wire.param1 = given(self.supply_v);
                wire.param2 = given(self.limit_s);
                MavCmd::MAV_CMD_USER_3
            }
            Command::Return => MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH,
            Command::Land => {
                wire.param4 = f32::NAN;
                MavCmd::MAV_CMD_NAV_LAND
            }
        };
        wire.command = command as u16;
        wire
    }

    /// Says what is missing, too much or out of range.
    fn check(&self, key: &str, problems: &mut Problems) {
        use Command as C;
        let name = match self.command {
            C::UntilVoltage => "until_voltage".to_owned(),
            other => format!("{other:?}").to_lowercase(),
        };
        // Key, whether it is there, commands that need it, commands that may have it.
        let table: [(&str, bool, &[C], &[C]); 16] = [
            ("position_m", self.position_m.is_some(), &[C::Waypoint], &[C::Land]),
            ("height_m", self.height_m.is_some(), &[C::Takeoff], &[]),
            ("hold_s", self.hold_s.is_some(), &[], &[C::Waypoint]),
            ("acceptance_m", self.acceptance_m.is_some(), &[], &[C::Waypoint]),
            ("yaw_deg", self.yaw_deg.is_some(), &[C::Yaw], &[C::Waypoint]),
            ("duration_s", self.duration_s.is_some(), &[C::Delay, C::Tilt], &[]),
            ("speed_mps", self.speed_mps.is_some(), &[C::Speed], &[]),
            ("axis", self.axis.is_some(), &[C::Doublet, C::Tilt], &[]),
            ("amplitude", self.amplitude.is_some(), &[C::Doublet], &[]),
            ("half_s", self.half_s.is_some(), &[C::Doublet], &[]),
            ("angle_deg", self.angle_deg.is_some(), &[C::Tilt], &[]),
            ("distance_m", self.distance_m.is_some(), &[], &[C::Tilt]),
            ("beyond_limit", self.beyond_limit.is_some(), &[], &[C::Tilt]),
            ("supply_v", self.supply_v.is_some(), &[C::UntilVoltage], &[]),
            ("limit_s", self.limit_s.is_some(), &[], &[C::UntilVoltage]),
            ("path", self.path.is_some(), &[], &[C::Waypoint]),
        ];
        for (field, there, needs, may) in table {
            let needed = needs.contains(&self.command);
            if needed && !there {
                problems.say(format!("{key}.{field} is missing, `{name}` needs it"));
            } else if there && !needed && !may.contains(&self.command) {
                problems.say(format!("{key}.{field} does not go with `{name}`, take it out"));
            }
        }
        if self.command == C::Tilt && self.axis == Some(DoubletAxis::Thrust) {
            problems
                .say(format!("{key}.axis = \"thrust\", allowed \"roll\" or \"pitch\" for `tilt`"));
        }
        let mut range = |field: &str, value: Option<f64>, low: f64, high: f64, unit: &str| {
            if let Some(value) = value {
                problems.range(format_args!("{key}.{field}"), value, low..=high, unit);
            }
        };
        if let Some([north_m, east_m, height_m]) = self.position_m {
            range("position_m[0]", Some(north_m), -FARTHEST_M, FARTHEST_M, "m");
            range("position_m[1]", Some(east_m), -FARTHEST_M, FARTHEST_M, "m");
            range("position_m[2]", Some(height_m), 0.0, FARTHEST_M, "m");
        }
        range("height_m", self.height_m, 0.3, FARTHEST_M, "m");
        range("hold_s", self.hold_s, 0.0, 3600.0, "s");
        range("acceptance_m", self.acceptance_m, 0.05, 5.0, "m");
        range("yaw_deg", self.yaw_deg, -360.0, 360.0, "deg");
        range("duration_s", self.duration_s, 0.0, 3600.0, "s");
        range("speed_mps", self.speed_mps, 0.05, 20.0, "m/s");
        range("half_s", self.half_s, 0.05, 1.5, "s");
        range("angle_deg", self.angle_deg, -52.0, 52.0, "deg");
        range("distance_m", self.distance_m, 0.1, FARTHEST_M, "m");
        range("supply_v", self.supply_v, 3.0, 30.0, "V");
        range("limit_s", self.limit_s, 1.0, 3600.0, "s");
        let (most, unit) = match self.axis {
            Some(DoubletAxis::Thrust) => (0.2, "of full throttle"),
            _ => (20.0, "deg"),
        };
        range("amplitude", self.amplitude, -most, most, unit);
    }
}

impl MissionFile {
    /// Parses and checks.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mission: MissionFile = toml::from_str(text).map_err(|e| e.to_string())?;
        let mut problems = Problems::new();
        if mission.items.is_empty() {
            problems.say("no [[item]]: a mission needs at least one");
        }
        for (i, item) in mission.items.iter().enumerate() {
            item.check(&format!("item {}", i + 1), &mut problems);
        }
        problems.into_result().map_err(|p| p.to_string())?;
        Ok(mission)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_items_take_their_wire_form() {
        let mission = MissionFile::parse(
            "[[item]]\ncommand = \"takeoff\"\nheight_m = 1.2\n\
             [[item]]\ncommand = \"waypoint\"\nposition_m = [1.0, -2.5, 1.5]\nhold_s = 2\n",
        )
        .unwrap();
        let takeoff = mission.items[0].to_wire(0, 1, 1);
        assert_eq!((takeoff.command, takeoff.z), (MavCmd::MAV_CMD_NAV_TAKEOFF as u16, -1.2));
        let point = mission.items[1].to_wire(1, 1, 1);
        assert_eq!((point.x, point.y, point.z), (10_000, -25_000, -1.5));
        assert_eq!((point.param1, point.frame), (2.0, MavFrame::MAV_FRAME_LOCAL_NED as u8));
        assert!(point.param4.is_nan());
    }

    #[test]
    fn prop_refusals_name_item_and_key() {
        let says = |text: &str, needed: &str| {
            let why = MissionFile::parse(text).unwrap_err();
            assert!(why.contains(needed), "{why}");
        };
        says("", "no [[item]]");
        says("[[item]]\ncommand = \"waypoint\"", "item 1.position_m is missing");
        says("[[item]]\ncommand = \"land\"\nhold_s = 1", "item 1.hold_s does not go with `land`");
        says(
            "[[item]]\ncommand = \"waypoint\"\nposition_m = [1, 2, 3, 4]",
            "position_m has 4 numbers, allowed 3",
        );
        says("[[item]]\ncommand = \"loop\"", "unknown variant `loop`");
        says("[[item]]\ncommand = \"land\"\nheigth = 1", "unknown field `heigth`");
        says(
            "[[item]]\ncommand = \"takeoff\"\nheight_m = 0.1",
            "item 1.height_m = 0.1, allowed 0.3 to 1000 m",
        );
    }
}
