//! Missions as stations keep them: QGroundControl's `.plan` (JSON: mission, fence, rally points) and the older
//! `.waypoints` (text, `QGC WPL 110`), as the items that a station would upload. Pure: text in, items out.
//!
//! Where the formats are described: QGroundControl's developer guide, "Plan File Format"; MAVLink's guide, "File
//! Formats". What of a file is not taken is a remark, never silence.

use std::path::Path;

use haltere_core::geo::{Geodetic, LocalOrigin};
use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavMissionType};
use haltere_dialect::mav::{LOCAL_PER_M, known, name_of};
use haltere_pilot::mission_file::{Command, Item, MissionFile};
use num_traits::FromPrimitive as _;
use serde_json::{Value, json};

/// First words of the older format.
const WAYPOINTS: &str = "QGC WPL";
/// Its version.
const WAYPOINTS_VERSION: &str = "110";
/// Columns of a line of it.
const COLUMNS: usize = 12;
/// Degrees of latitude and longitude count in 1e-7 (MISSION_ITEM_INT).
const GLOBAL_SCALE: f64 = 1e7;
/// More items than any vehicle takes; `count` of the protocol has 16 bits.
const MOST_ITEMS: usize = 10_000;

/// What a station's file holds, in wire form. Addressed to nobody yet.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlanFile {
    /// The mission.
    pub mission: Vec<MISSION_ITEM_INT_DATA>,
    /// The fence; empty: the file has none.
    pub fence: Vec<MISSION_ITEM_INT_DATA>,
    /// Rally points; empty: the file has none.
    pub rally: Vec<MISSION_ITEM_INT_DATA>,
    /// What was left out, in words.
    pub remarks: Vec<String>,
}

impl PlanFile {
    /// Whether a file is of a station, by its name or its text, and no mission file of ours.
    pub fn is_one(name: &Path, text: &str) -> bool {
        let text = plain(text);
        let named = |ending| name.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
        if named("plan") || named("waypoints") {
            return true;
        }
        text.starts_with('{') || text.starts_with(WAYPOINTS)
    }

    /// Reads either format.
    pub fn parse(text: &str) -> Result<Self, String> {
        let text = plain(text);
        let mut file = match () {
            () if text.starts_with(WAYPOINTS) => waypoints(text)?,
            () if text.starts_with('{') => plan(text)?,
            () => {
                return Err(format!(
                    "neither a plan (JSON with `\"fileType\": \"Plan\"`) nor a list of waypoints (`{WAYPOINTS} \
                     {WAYPOINTS_VERSION}` in its first line)"
                ));
            }
        };
        for (items, kind) in [
            (&mut file.mission, MavMissionType::MAV_MISSION_TYPE_MISSION),
            (&mut file.fence, MavMissionType::MAV_MISSION_TYPE_FENCE),
            (&mut file.rally, MavMissionType::MAV_MISSION_TYPE_RALLY),
        ] {
            if items.len() > MOST_ITEMS {
                return Err(format!(
                    "{} items of one kind, allowed up to {MOST_ITEMS}",
                    items.len()
                ));
            }
            for (seq, item) in items.iter_mut().enumerate() {
                item.seq = u16::try_from(seq).unwrap_or(u16::MAX);
                item.mission_type = kind as u8;
                item.autocontinue = 1;
                item.current =
                    u8::from(seq == 0 && kind == MavMissionType::MAV_MISSION_TYPE_MISSION);
            }
        }
        if file.mission.is_empty() && file.fence.is_empty() && file.rally.is_empty() {
            return Err("holds no mission item, no fence and no rally point".to_owned());
        }
        Ok(file)
    }

    /// Whether the mission ends on the floor.
    pub fn lands(&self) -> bool {
        let ends = [
            MavCmd::MAV_CMD_NAV_LAND,
            MavCmd::MAV_CMD_NAV_LAND_LOCAL,
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH,
        ]
        .map(|command| command as u16);
        self.mission.last().is_some_and(|item| ends.contains(&item.command))
    }

    /// For scripts: the three lists in the numbers of MISSION_ITEM_INT; a parameter that is not given is null.
    pub fn json(&self) -> Value {
        let item = |item: &MISSION_ITEM_INT_DATA| {
            json!({
                "frame": item.frame,
                "command": item.command,
                "params": [item.param1, item.param2, item.param3, item.param4],
                "x": item.x,
                "y": item.y,
                "z": item.z,
            })
        };
        let list = |items: &[MISSION_ITEM_INT_DATA]| items.iter().map(item).collect::<Vec<_>>();
        json!({
            "mission": list(&self.mission),
            "fence": list(&self.fence),
            "rally": list(&self.rally),
        })
    }

    /// The mission as one of our own files, its places around `origin`: for who flies without a station.
    pub fn to_mission(&self, origin: &LocalOrigin) -> Result<MissionFile, String> {
        if self.mission.is_empty() {
            return Err("holds no mission item".to_owned());
        }
        let items = self
            .mission
            .iter()
            .map(|item| to_item(item, origin).map_err(|why| format!("item {}: {why}", item.seq)));
        let mission = MissionFile { items: items.collect::<Result<_, _>>()? };
        // The bounds of a mission file hold for what comes from another.
        let text = toml::to_string(&mission).map_err(|e| e.to_string())?;
        MissionFile::parse(&text)
    }
}

/// Without a byte order mark, and without what stands before the first word.
fn plain(text: &str) -> &str {
    text.trim_start_matches('\u{feff}').trim_start()
}

/// Numbers of an item before they are checked, NaN where none is given.
struct Numbers {
    frame: f64,
    command: f64,
    params: [f64; 7],
}

impl Numbers {
    fn item(&self) -> Result<MISSION_ITEM_INT_DATA, String> {
        let whole = |v: f64| (v.fract() == 0.0 && (0.0..65_536.0).contains(&v)).then_some(v as u32);
        let frame = whole(self.frame)
            .and_then(MavFrame::from_u32)
            .ok_or_else(|| format!("frame {}: MAVLink knows none of this number", self.frame))?;
        let command = whole(self.command).and_then(MavCmd::from_u32).ok_or_else(|| {
            format!("command {}: MAVLink knows none of this number", self.command)
        })?;
        let [p1, p2, p3, p4, x, y, z] = self.params;
        let narrow = |name: &str, v: f64| {
            let narrow = v as f32;
            if v.is_nan() || narrow.is_finite() {
                Ok(narrow)
            } else {
                Err(format!("{name} = {v}, which no item can carry"))
            }
        };
        let (x_name, y_name, scale, most) = match frame {
            MavFrame::MAV_FRAME_MISSION => ("param5", "param6", 1.0, [f64::from(i32::MAX); 2]),
            frame if is_global(frame) => ("latitude", "longitude", GLOBAL_SCALE, [90.0, 180.0]),
            _ => ("x", "y", LOCAL_PER_M, [100_000.0; 2]),
        };
        let place = |name: &str, v: f64, most: f64| {
            // Not given is "here", which is zero on the wire.
            let v = if v.is_nan() { 0.0 } else { v };
            if (-most..=most).contains(&v) {
                Ok((v * scale).round() as i32)
            } else {
                Err(format!("{name} = {v}, allowed {} to {most}", -most))
            }
        };
        Ok(MISSION_ITEM_INT_DATA {
            frame: frame as u8,
            command: command as u16,
            param1: narrow("param1", p1)?,
            param2: narrow("param2", p2)?,
            param3: narrow("param3", p3)?,
            param4: narrow("param4", p4)?,
            x: place(x_name, x, most[0])?,
            y: place(y_name, y, most[1])?,
            z: narrow("altitude", if z.is_nan() { 0.0 } else { z })?,
            ..Default::default()
        })
    }
}

#[allow(deprecated)] // files of older stations have them
fn is_global(frame: MavFrame) -> bool {
    use MavFrame as F;
    matches!(
        frame,
        F::MAV_FRAME_GLOBAL
            | F::MAV_FRAME_GLOBAL_INT
            | F::MAV_FRAME_GLOBAL_RELATIVE_ALT
            | F::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
            | F::MAV_FRAME_GLOBAL_TERRAIN_ALT
            | F::MAV_FRAME_GLOBAL_TERRAIN_ALT_INT
    )
}

/// Numbers of the items that jump, before their places in the file become places in the mission.
fn jump_to(
    item: &mut MISSION_ITEM_INT_DATA,
    place: impl Fn(f32) -> Option<usize>,
) -> Result<(), String> {
    if item.command == MavCmd::MAV_CMD_DO_JUMP as u16 {
        let to = item.param1;
        let place =
            place(to).ok_or_else(|| format!("jumps to {to}, which is no item of the file"))?;
        item.param1 = place as f32;
    }
    Ok(())
}

/// The older format.
fn waypoints(text: &str) -> Result<PlanFile, String> {
    let mut lines = text.lines().enumerate().map(|(n, line)| (n + 1, line.trim()));
    let head = lines.next().map_or("", |(_, line)| line);
    let version = head.strip_prefix(WAYPOINTS).unwrap_or_default().trim();
    if version != WAYPOINTS_VERSION {
        return Err(format!(
            "line 1: `{WAYPOINTS} {version}`, `{WAYPOINTS} {WAYPOINTS_VERSION}` is read"
        ));
    }
    let mut file = PlanFile::default();
    let mut home = 0;
    for (n, line) in lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#')) {
        let at = |why: String| format!("line {n}: {why}");
        let cells: Vec<&str> = line.split_whitespace().collect();
        let numbers = cells
            .iter()
            .map(|cell| cell.parse::<f64>().map_err(|_| at(format!("`{cell}` is no number"))))
            .collect::<Result<Vec<f64>, String>>()?;
        let [index, _, frame, command, p1, p2, p3, p4, x, y, z, _] = numbers[..] else {
            return Err(at(format!("{} columns, {COLUMNS} make an item", cells.len())));
        };
        let due = (file.mission.len() + home) as f64;
        if index != due {
            return Err(at(format!("item {index}, {due} is due: items stand in their order")));
        }
        let numbers = Numbers { frame, command, params: [p1, p2, p3, p4, x, y, z] };
        let item = numbers.item().map_err(at)?;
        // The first line of such files is the home position, a waypoint above sea level.
        if index == 0.0
            && item.command == MavCmd::MAV_CMD_NAV_WAYPOINT as u16
            && item.frame == MavFrame::MAV_FRAME_GLOBAL as u8
        {
            home = 1;
            file.remarks.push("its line 0 is the home position, which is not flown to".to_owned());
            continue;
        }
        file.mission.push(item);
    }
    let count = file.mission.len();
    for (seq, item) in file.mission.iter_mut().enumerate() {
        let place = |to: f32| (0..count).find(|place| (place + home) as f32 == to);
        jump_to(item, place).map_err(|why| format!("item {}: {why}", seq + home))?;
    }
    Ok(file)
}

/// QGroundControl's format.
fn plan(text: &str) -> Result<PlanFile, String> {
    let root: Value = serde_json::from_str(text).map_err(|e| format!("no JSON: {e}"))?;
    let kind = root.get("fileType").and_then(Value::as_str).unwrap_or("none");
    if kind != "Plan" {
        return Err(format!("fileType {kind}: not a plan (`\"fileType\": \"Plan\"`) of a station"));
    }
    if let Some(version) = root.get("version").filter(|v| v.as_u64() != Some(1)) {
        return Err(format!("version {version}, plans of version 1 are read"));
    }
    let mut file = PlanFile::default();
    mission(&root, &mut file)?;
    fence(&root, &mut file)?;
    let points = list(root.get("rallyPoints").and_then(|r| r.get("points")), "rallyPoints.points")?;
    for (n, point) in points.iter().enumerate() {
        let place = format!("rallyPoints.points[{n}]");
        let [x, y, z] = numbers(point, &place)?;
        file.rally.push(item(MavCmd::MAV_CMD_NAV_RALLY_POINT, RELATIVE, 0.0, [x, y, z], &place)?);
    }
    Ok(file)
}

const RELATIVE: MavFrame = MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT;
const NOTHING: [Value; 0] = [];

/// A list, which may be missing.
fn list<'a>(value: Option<&'a Value>, place: &str) -> Result<&'a [Value], String> {
    match value {
        None | Some(Value::Null) => Ok(&NOTHING),
        Some(Value::Array(all)) => Ok(all),
        Some(other) => Err(format!("{place} = {}, a list is due", short(other))),
    }
}

/// As many numbers; `null` is not given.
fn numbers<const N: usize>(value: &Value, place: &str) -> Result<[f64; N], String> {
    let all = list(Some(value), place)?;
    let mut out = [f64::NAN; N];
    if all.len() != N {
        return Err(format!("{place}: {} numbers, {N} are due", all.len()));
    }
    for (n, (slot, value)) in out.iter_mut().zip(all).enumerate() {
        *slot = match value {
            Value::Null => f64::NAN,
            value => value.as_f64().ok_or_else(|| {
                format!("{place}[{n}] = {}, a number or null is due", short(value))
            })?,
        };
    }
    Ok(out)
}

/// A value in an error, not all of it.
fn short(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(40) {
        Some((end, _)) => format!("{}…", text.get(..end).unwrap_or_default()),
        None => text,
    }
}

fn item(
    command: MavCmd,
    frame: MavFrame,
    param1: f64,
    [x, y, z]: [f64; 3],
    place: &str,
) -> Result<MISSION_ITEM_INT_DATA, String> {
    if x.is_nan() || y.is_nan() {
        return Err(format!("{place}: latitude and longitude are due"));
    }
    let params = [param1, 0.0, 0.0, 0.0, x, y, z];
    let numbers =
        Numbers { frame: f64::from(frame as u32), command: f64::from(command as u32), params };
    numbers.item().map_err(|why| format!("{place}: {why}"))
}

fn mission(root: &Value, file: &mut PlanFile) -> Result<(), String> {
    let items = list(root.get("mission").and_then(|m| m.get("items")), "mission.items")?;
    let mut ids = Vec::new();
    for (n, item) in items.iter().enumerate() {
        let place = format!("mission.items[{n}]");
        match item.get("type").and_then(Value::as_str) {
            Some("SimpleItem") => simple(item, &place, file, &mut ids)?,
            // What a pattern was drawn as stands beside the items that it flies.
            Some("ComplexItem") => {
                let name = item.get("complexItemType").and_then(Value::as_str).unwrap_or("unnamed");
                let flown = item.get("TransectStyleComplexItem").and_then(|t| t.get("Items"));
                let Some(flown) = flown else {
                    return Err(format!(
                        "{place}: a pattern `{name}`, which holds no items of its own; draw its waypoints singly"
                    ));
                };
                for (k, item) in list(Some(flown), &place)?.iter().enumerate() {
                    simple(item, &format!("{place} ({name}).Items[{k}]"), file, &mut ids)?;
                }
            }
            other => {
                let found = other.unwrap_or("none");
                return Err(format!("{place}.type = {found}, allowed SimpleItem or ComplexItem"));
            }
        }
    }
    for (seq, item) in file.mission.iter_mut().enumerate() {
        let place = |to: f32| ids.iter().position(|id| *id == f64::from(to));
        jump_to(item, place).map_err(|why| format!("mission item {seq}: {why}"))?;
    }
    Ok(())
}

fn simple(
    item: &Value,
    place: &str,
    file: &mut PlanFile,
    ids: &mut Vec<f64>,
) -> Result<(), String> {
    let number = |key: &str| {
        item.get(key)
            .and_then(Value::as_f64)
            .ok_or_else(|| format!("{place}.{key}: a number is due"))
    };
    let Some(params) = item.get("params") else {
        return Err(format!("{place}.params: seven numbers are due"));
    };
    let numbers = Numbers {
        frame: number("frame")?,
        command: number("command")?,
        params: numbers(params, &format!("{place}.params"))?,
    };
    file.mission.push(numbers.item().map_err(|why| format!("{place}: {why}"))?);
    ids.push(item.get("doJumpId").and_then(Value::as_f64).unwrap_or(ids.len() as f64 + 1.0));
    Ok(())
}

fn fence(root: &Value, file: &mut PlanFile) -> Result<(), String> {
    let Some(fence) = root.get("geoFence") else { return Ok(()) };
    let inclusion = |shape: &Value| shape.get("inclusion").and_then(Value::as_bool).unwrap_or(true);
    for (n, circle) in list(fence.get("circles"), "geoFence.circles")?.iter().enumerate() {
        let place = format!("geoFence.circles[{n}]");
        let drawn = circle.get("circle").unwrap_or(circle);
        let [x, y] =
            numbers(drawn.get("center").unwrap_or(&Value::Null), &format!("{place}.center"))?;
        let radius_m = drawn
            .get("radius")
            .and_then(Value::as_f64)
            .ok_or_else(|| format!("{place}.radius: a number is due"))?;
        let command = match inclusion(circle) {
            true => MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
            false => MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
        };
        file.fence.push(item(command, MavFrame::MAV_FRAME_GLOBAL, radius_m, [x, y, 0.0], &place)?);
    }
    for (n, polygon) in list(fence.get("polygons"), "geoFence.polygons")?.iter().enumerate() {
        let place = format!("geoFence.polygons[{n}]");
        let command = match inclusion(polygon) {
            true => MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
            false => MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
        };
        corners(polygon.get("polygon"), &place, command, file)?;
    }
    // Version 1 had one polygon, to be stayed in.
    let inside = MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION;
    corners(fence.get("polygon"), "geoFence.polygon", inside, file)?;
    if fence.get("breachReturn").is_some_and(|point| !point.is_null()) {
        file.remarks.push(
            "its breach return point is not used: the vehicle is stopped before a fence".to_owned(),
        );
    }
    Ok(())
}

fn corners(
    polygon: Option<&Value>,
    place: &str,
    command: MavCmd,
    file: &mut PlanFile,
) -> Result<(), String> {
    let all = list(polygon, place)?;
    for (k, corner) in all.iter().enumerate() {
        let place = format!("{place}[{k}]");
        let [x, y] = numbers(corner, &place)?;
        let count = all.len() as f64;
        file.fence.push(item(command, MavFrame::MAV_FRAME_GLOBAL, count, [x, y, 0.0], &place)?);
    }
    Ok(())
}

/// An item as one of a mission file.
#[allow(deprecated)] // as above
fn to_item(item: &MISSION_ITEM_INT_DATA, origin: &LocalOrigin) -> Result<Item, String> {
    let frame = known(item.frame);
    let global = frame.is_some_and(is_global);
    let given = |v: f32| v.is_finite().then_some(f64::from(v));
    let above_sea =
        matches!(frame, Some(MavFrame::MAV_FRAME_GLOBAL | MavFrame::MAV_FRAME_GLOBAL_INT));
    let base_m = origin.place().alt_m;
    let z = f64::from(item.z);
    let height_m = match frame {
        Some(MavFrame::MAV_FRAME_LOCAL_NED) => -z,
        _ if above_sea => z - base_m,
        _ => z,
    };
    let position_m = || match frame {
        Some(MavFrame::MAV_FRAME_LOCAL_NED) => {
            let [north_m, east_m] = [item.x, item.y].map(|v| f64::from(v) / LOCAL_PER_M);
            Ok([north_m, east_m, height_m])
        }
        _ if global => {
            let place = Geodetic::from_e7(item.x, item.y, base_m)
                .ok_or_else(|| format!("{} {} is not on the globe", item.x, item.y))?;
            let at = origin.to_local(&place);
            Ok([at.x(), at.y(), height_m])
        }
        _ => Err(format!("frame {} is not known here", name_of::<MavFrame>(item.frame))),
    };
    let yaw_deg = |deg: f64| match global {
        true => origin.room_yaw_rad(deg.to_radians()).to_degrees(),
        false => deg,
    };
    let here = item.x == 0 && item.y == 0;
    let unflown = || {
        let name = name_of::<MavCmd>(item.command);
        format!("{name} is nothing that is flown without a station")
    };
    let command = known(item.command).ok_or_else(unflown)?;
    Ok(match command {
        MavCmd::MAV_CMD_NAV_TAKEOFF => {
            Item { height_m: Some(height_m), ..Item::new(Command::Takeoff) }
        }
        MavCmd::MAV_CMD_NAV_WAYPOINT | MavCmd::MAV_CMD_NAV_LOITER_TIME => Item {
            position_m: Some(position_m()?),
            hold_s: given(item.param1).filter(|s| *s > 0.0),
            acceptance_m: given(item.param2)
                .filter(|m| *m > 0.0 && command == MavCmd::MAV_CMD_NAV_WAYPOINT),
            yaw_deg: given(item.param4)
                .filter(|_| command == MavCmd::MAV_CMD_NAV_WAYPOINT)
                .map(yaw_deg),
            ..Item::new(Command::Waypoint)
        },
        MavCmd::MAV_CMD_NAV_LAND if here => Item::new(Command::Land),
        MavCmd::MAV_CMD_NAV_LAND => {
            let [north_m, east_m, _] = position_m()?;
            Item { position_m: Some([north_m, east_m, 0.0]), ..Item::new(Command::Land) }
        }
        MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => Item::new(Command::Return),
        MavCmd::MAV_CMD_NAV_DELAY | MavCmd::MAV_CMD_CONDITION_DELAY => {
            Item { duration_s: given(item.param1), ..Item::new(Command::Delay) }
        }
        MavCmd::MAV_CMD_DO_CHANGE_SPEED => {
            Item { speed_mps: given(item.param2), ..Item::new(Command::Speed) }
        }
        MavCmd::MAV_CMD_CONDITION_YAW if item.param4 == 0.0 || item.param4.is_nan() => {
            Item { yaw_deg: given(item.param1), ..Item::new(Command::Yaw) }
        }
        _ => return Err(unflown()),
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const PLAN: &str = r#"{ "fileType": "Plan", "version": 1, "groundStation": "QGroundControl",
        "mission": { "version": 2, "items": [
            { "type": "SimpleItem", "command": 22, "frame": 3, "doJumpId": 1, "autoContinue": true,
              "params": [0, 0, 0, null, 47.3977, 8.5456, 1.2] },
            { "type": "ComplexItem", "complexItemType": "survey", "TransectStyleComplexItem": { "Items": [
                { "type": "SimpleItem", "command": 16, "frame": 3, "doJumpId": 2,
                  "params": [2, 0, 0, null, 47.39771, 8.54561, 1.5] } ] } },
            { "type": "SimpleItem", "command": 177, "frame": 2, "doJumpId": 3, "params": [2, 3, 0, 0, 0, 0, 0] },
            { "type": "SimpleItem", "command": 20, "frame": 2, "doJumpId": 4, "params": [0, 0, 0, 0, 0, 0, 0] } ] },
        "geoFence": { "version": 2, "breachReturn": [47.3977, 8.5456, 1],
            "circles": [ { "inclusion": false, "circle": { "center": [47.39772, 8.5456], "radius": 0.5 } } ],
            "polygons": [ { "inclusion": true, "polygon": [[47.3976, 8.5455], [47.3978, 8.5455], [47.3978, 8.5457]] } ] },
        "rallyPoints": { "version": 2, "points": [[47.39770, 8.54560, 1.0]] } }"#;

    #[test]
    fn regress_plans_of_stations_are_read_with_fence_and_rally_points() {
        let ours = "[[item]]\ncommand = \"land\"\n";
        let named = |name: &str, text| PlanFile::is_one(Path::new(name), text);
        assert!(named("a", PLAN) && named("a.toml", PLAN) && !named("a.toml", ours));
        // What its name calls a plan and is none was read as TOML.
        for (name, text) in [("a.plan", ""), ("a.PLAN", "[1, 2]"), ("a.waypoints", ours)] {
            assert!(named(name, text));
            assert!(PlanFile::parse(text).unwrap_err().starts_with("neither a plan"), "{name}");
        }
        let file = PlanFile::parse(&format!("\u{feff}{PLAN}")).unwrap();
        let commands: Vec<u32> = file.mission.iter().map(|item| item.command as u32).collect();
        assert_eq!(commands, [22, 16, 177, 20]);
        let takeoff = &file.mission[0];
        assert_eq!((takeoff.x, takeoff.y, takeoff.z), (473_977_000, 85_456_000, 1.2));
        assert!(takeoff.param4.is_nan() && takeoff.current == 1 && takeoff.frame == RELATIVE as u8);
        assert_eq!(file.mission[2].param1, 1.0, "jumps go to places in the mission, not to ids");
        let fence: Vec<_> = file.fence.iter().map(|i| (i.command as u32, i.param1)).collect();
        assert_eq!(fence, [(5004, 0.5), (5001, 3.0), (5001, 3.0), (5001, 3.0)]);
        assert_eq!((file.rally.len(), file.rally[0].command as u32), (1, 5100));
        assert!(file.remarks[0].contains("breach return"), "{:?}", file.remarks);
        // For scripts.
        let told = file.json();
        let first = &told["mission"][0];
        assert_eq!(
            (&first["command"], &first["x"], &first["params"][3]),
            (&json!(22), &json!(473_977_000), &Value::Null)
        );
        assert_eq!(
            (told["fence"].as_array().unwrap().len(), &told["rally"][0]["command"]),
            (4, &json!(5100))
        );
    }

    #[test]
    fn regress_waypoints_are_read_and_home_is_not_flown_to() {
        let text = "QGC WPL 110\r\n0\t1\t0\t16\t0\t0\t0\t0\t0.5\t0.5\t584\t1\r\n\
                    1\t0\t3\t22\t0\t0\t0\t0\t0.50001\t0.50001\t1.2\t1\r\n\
                    2\t0\t2\t177\t1\t2\t0\t0\t0\t0\t0\t1\r\n";
        let file = PlanFile::parse(text).unwrap();
        assert_eq!(file.mission.len(), 2);
        assert_eq!((file.mission[0].seq, file.mission[0].x), (0, 5_000_100));
        assert_eq!(file.mission[1].param1, 0.0, "line 1 is item 0");
        assert!(file.remarks[0].contains("home"));
    }

    #[test]
    fn prop_refusals_name_place_and_what_is_allowed() {
        let line = |l: &str| format!("QGC WPL 110\n{l}\n");
        for (text, says) in [
            ("QGC WPL 120\n".to_owned(), "`QGC WPL 110` is read"),
            (line("0 1 3 16 0 0"), "line 2: 6 columns, 12"),
            (line("0 1 3 16 0 0 0 x 1 1 1 1"), "line 2: `x` is no number"),
            (line("3 1 3 16 0 0 0 0 1 1 1 1"), "line 2: item 3, 0 is due"),
            (line("0 1 3 9999 0 0 0 0 1 1 1 1"), "command 9999"),
            (line("0 1 99 16 0 0 0 0 1 1 1 1"), "frame 99"),
            (line("0 1 3 16 0 0 0 0 91 1 1 1"), "latitude = 91, allowed -90 to 90"),
            (line("0 1 3 16 1e300 0 0 0 1 1 1 1"), "param1"),
            (line("0 1 2 177 7 1 0 0 0 0 0 1"), "item 0: jumps to 7"),
            ("{}".to_owned(), "fileType none"),
            ("{ \"fileType\": ".to_owned(), "no JSON"),
            (r#"{"fileType":"Plan","mission":{"items":[]}}"#.to_owned(), "no mission item"),
            (
                PLAN.replace("[0, 0, 0, null, 47.3977", "[0, 0, \"a\", null, 47.3977"),
                "mission.items[0].params[2] = \"a\"",
            ),
            (PLAN.replace("\"radius\": 0.5", "\"radius\": null"), "geoFence.circles[0].radius"),
            (PLAN.replace("TransectStyleComplexItem", "Other"), "a pattern `survey`"),
        ] {
            let why = PlanFile::parse(&text).unwrap_err();
            assert!(why.contains(says), "{says}: {why}");
        }
    }

    #[test]
    fn prop_a_station_s_mission_becomes_one_of_ours_around_the_origin() {
        let place = Geodetic::from_deg(47.3977, 8.5456, 400.0).unwrap();
        let origin = LocalOrigin::new(place, 0.0).unwrap();
        let plan = PLAN.replace("\"command\": 177", "\"command\": 93");
        let mission = PlanFile::parse(&plan).unwrap().to_mission(&origin).unwrap();
        assert_eq!(mission.items[0].height_m, Some(f64::from(1.2_f32)));
        let [north_m, east_m, height_m] = mission.items[1].position_m.unwrap();
        assert!(
            (north_m - 1.11).abs() < 0.02 && (east_m - 0.75).abs() < 0.02,
            "{north_m} {east_m}"
        );
        assert_eq!((height_m, mission.items[1].hold_s), (1.5, Some(2.0)));
        let why = PlanFile::parse(PLAN).unwrap().to_mission(&origin).unwrap_err();
        assert!(why.contains("item 2") && why.contains("DO_JUMP"), "{why}");
    }

    proptest! {
        #[test]
        fn prop_no_text_panics(cut in 0..PLAN.len(), with in "\\PC{0,4}", tail in 0..20usize) {
            let cut = (0..=cut).rev().find(|i| PLAN.is_char_boundary(*i)).unwrap_or(0);
            let rest = PLAN.get(cut + tail..).unwrap_or_default();
            let origin = LocalOrigin::zero();
            for text in [format!("{}{with}{rest}", &PLAN[..cut]), format!("QGC WPL 110\n0 1 3 16 {with} 0 0 0 1 1 {cut} 1")] {
                if let Ok(file) = PlanFile::parse(&text) {
                    let _ = file.to_mission(&origin);
                }
            }
        }
    }
}
