//! What a station knows of the vehicle: what it has told so far.

use std::collections::BTreeMap;

use serde_json::json;

use haltere_dialect::mav::haltere::{HALTERE_LINK_DATA, MavMessage, MavModeFlag};
use haltere_dialect::mav::known;

use haltere_core::drops::DropReason;

pub use haltere_dialect::mav::haltere::MavLandedState as LandedState;

/// What the vehicle has told so far.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Vehicle {
    /// Motors may turn.
    pub armed: bool,
    /// Mode in force, PX4's numbers.
    pub custom_mode: u32,
    /// On the floor or in the air.
    pub landed: LandedState,
    /// Position, local NED, m.
    pub position_m: Option<[f64; 3]>,
    /// Velocity, local NED, m/s.
    pub velocity_mps: Option<[f64; 3]>,
    /// Pack voltage, V.
    pub supply_v: Option<f64>,
    /// What the board told the first eight motors and servos, µs; 0: not in use.
    pub outputs: Option<[u16; 8]>,
    /// Mission item in force.
    pub current: Option<u16>,
    /// Items of that mission; 0: there is none.
    pub items: u16,
    /// Last mission item that was reached.
    pub reached: Option<u16>,
    /// What went over its links to stations, by number.
    pub links: BTreeMap<u8, HALTERE_LINK_DATA>,
    /// What it lost since its start, by link and reason.
    pub drops: BTreeMap<(u8, String), u32>,
}

impl Vehicle {
    /// Height above the origin, m.
    pub fn height_m(&self) -> Option<f64> {
        self.position_m.map(|[_, _, down_m]| -down_m)
    }

    /// Follows what it tells.
    pub(super) fn take(&mut self, message: &MavMessage) {
        match message {
            MavMessage::HEARTBEAT(beat) => {
                self.armed = beat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
                self.custom_mode = beat.custom_mode;
            }
            MavMessage::EXTENDED_SYS_STATE(state) => {
                self.landed =
                    known(state.landed_state).unwrap_or(LandedState::MAV_LANDED_STATE_UNDEFINED);
            }
            MavMessage::LOCAL_POSITION_NED(p) => {
                self.position_m = Some([p.x, p.y, p.z].map(f64::from));
                self.velocity_mps = Some([p.vx, p.vy, p.vz].map(f64::from));
            }
            MavMessage::SYS_STATUS(status) if status.voltage_battery != u16::MAX => {
                self.supply_v = Some(f64::from(status.voltage_battery) * 1e-3);
            }
            MavMessage::SERVO_OUTPUT_RAW(m) if m.port == 0 => {
                self.outputs = Some([
                    m.servo1_raw,
                    m.servo2_raw,
                    m.servo3_raw,
                    m.servo4_raw,
                    m.servo5_raw,
                    m.servo6_raw,
                    m.servo7_raw,
                    m.servo8_raw,
                ]);
            }
            MavMessage::MISSION_CURRENT(current) => {
                self.current = Some(current.seq);
                // "No mission" is written as the largest number.
                self.items = if current.total == u16::MAX { 0 } else { current.total };
            }
            MavMessage::MISSION_ITEM_REACHED(reached) => self.reached = Some(reached.seq),
            MavMessage::HALTERE_LINK(link) => {
                self.links.insert(link.link, link.clone());
            }
            MavMessage::HALTERE_DROPS(drops) => {
                let reason = drops.reason.to_str().unwrap_or("(unreadable)").to_owned();
                self.drops.insert((drops.link, reason), drops.count);
            }
            _ => {}
        }
    }

    /// Name of the mode in force.
    fn mode(&self) -> String {
        let main = self.custom_mode >> 16 & 0xFF;
        match (main, self.custom_mode >> 24) {
            (4, 2) => "takeoff".to_string(),
            (4, 3) => "hold".to_string(),
            (4, 4) => "mission".to_string(),
            (4, 5) => "return".to_string(),
            (4, 6) => "land".to_string(),
            (6, _) => "offboard".to_string(),
            (main, sub) => format!("main {main} sub {sub}"),
        }
    }

    /// For scripts: what [`Vehicle::lines`] says. What was not told is null.
    pub fn json(&self) -> serde_json::Value {
        let links: Vec<_> = self
            .links
            .iter()
            .map(|(number, link)| {
                json!({
                    "link": number,
                    "endpoint": link.endpoint,
                    "own": link.own == 1,
                    "received": link.received,
                    "received_bytes": link.received_bytes,
                    "lost": link.lost,
                    "sent": link.sent,
                    "sent_bytes": link.sent_bytes,
                    "passed_on": link.routed,
                    "waited": link.delayed,
                })
            })
            .collect();
        let drops: Vec<_> = self
            .drops
            .iter()
            .map(|((number, reason), count)| {
                json!({ "link": link_name(*number), "reason": reason, "count": count })
            })
            .collect();
        json!({
            "armed": self.armed,
            "mode": self.mode(),
            "state": landed_name(self.landed),
            "position_NED_m": self.position_m,
            "velocity_NED_mps": self.velocity_mps,
            "battery_v": self.supply_v,
            "outputs_us": self.outputs.filter(are_pulses),
            "outputs_of_65535": self.outputs.filter(|told| !are_pulses(told)),
            "mission_item": self.current,
            "links": links,
            "drops": drops,
        })
    }

    /// For people.
    pub fn lines(&self) -> Vec<String> {
        let known = |value: Option<String>| value.unwrap_or_else(|| "not told".into());
        let mode = self.mode();
        let point = self
            .position_m
            .map(|[n, e, d]| format!("north {n:.2} m, east {e:.2} m, height {:.2} m", -d));
        let mut lines = vec![
            format!("armed:    {}", if self.armed { "yes" } else { "no" }),
            format!("mode:     {mode}"),
            format!("state:    {}", landed_name(self.landed)),
            format!("position: {}", known(point)),
            format!("battery:  {}", known(self.supply_v.map(|v| format!("{v:.2} V")))),
            format!("outputs:  {}", known(self.outputs.map(outputs))),
            format!("mission:  {}", known(self.current.map(|n| item_of(n, self.items)))),
        ];
        for (number, link) in &self.links {
            let own = if link.own == 1 { ", this one" } else { "" };
            lines.push(format!(
                "link {number} (endpoint {}{own}): received {} frames in {} B, lost {}; sent {} in {} B, \
                 {} passed on, {} waited for the line",
                link.endpoint,
                link.received,
                link.received_bytes,
                link.lost,
                link.sent,
                link.sent_bytes,
                link.routed,
                link.delayed,
            ));
        }
        for ((number, reason), count) in &self.drops {
            lines.push(DropReason::in_words(reason, u64::from(*count), &link_name(*number)));
        }
        lines
    }
}

/// Longest and shortest pulse of any servo, us.
const PULSE_US: std::ops::RangeInclusive<u16> = 400..=2600;

/// The item in force, counted from 1.
fn item_of(current: u16, items: u16) -> String {
    match items {
        0 => "none".to_owned(),
        items => format!("item {} of {items}", current.saturating_add(1)),
    }
}

/// Those that are in use, in their order.
fn outputs(told: [u16; 8]) -> String {
    let used = told.iter().rposition(|told| *told != 0).map_or(0, |last| last + 1);
    if used == 0 {
        // Motors that stand: in which unit nobody knows.
        return "0".to_owned();
    }
    let shown: Vec<String> = told.iter().take(used).map(u16::to_string).collect();
    let unit = if are_pulses(&told) { "us" } else { "of 65535" };
    format!("{} {unit}", shown.join(", "))
}

/// Pulses of servos, as the message has them; a Crazyflie tells its motors' share of 65535 in their place.
fn are_pulses(told: &[u16; 8]) -> bool {
    told.iter().all(|told| *told == 0 || PULSE_US.contains(told))
}

/// What the numbers of links in counts of losses stand for.
fn link_name(number: u8) -> String {
    match number {
        0 => "tag".to_owned(),
        1 => "board".to_owned(),
        u8::MAX => "core".to_owned(),
        number => format!("link {number}"),
    }
}

fn landed_name(state: LandedState) -> &'static str {
    match state {
        LandedState::MAV_LANDED_STATE_UNDEFINED => "not told",
        LandedState::MAV_LANDED_STATE_ON_GROUND => "on the ground",
        LandedState::MAV_LANDED_STATE_IN_AIR => "in the air",
        LandedState::MAV_LANDED_STATE_TAKEOFF => "taking off",
        LandedState::MAV_LANDED_STATE_LANDING => "landing",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_scripts_are_told_what_people_are_and_null_where_nothing_was() {
        let silent = Vehicle::default().json();
        assert!(silent["position_NED_m"].is_null() && silent["battery_v"].is_null(), "{silent}");
        let mut told = Vehicle {
            custom_mode: 4 << 16 | 3 << 24,
            position_m: Some([1.0, 2.0, -1.5]),
            landed: LandedState::MAV_LANDED_STATE_IN_AIR,
            outputs: Some([1500, 1640, 1490, 1640, 0, 0, 0, 0]),
            ..Vehicle::default()
        };
        told.drops.insert((1, "bad_checksum".into()), 3);
        told.links.insert(0, HALTERE_LINK_DATA { own: 1, sent: 7, ..Default::default() });
        let json = told.json();
        assert_eq!(json["mode"], "hold");
        assert_eq!(json["state"], "in the air");
        assert_eq!(json["outputs_us"][1], 1640);
        assert!(told.lines().contains(&"outputs:  1500, 1640, 1490, 1640 us".to_owned()));
        assert_eq!(outputs([0, 24_000, 0, 25_100, 0, 0, 0, 0]), "0, 24000, 0, 25100 of 65535");
        assert_eq!(json["position_NED_m"], json!([1.0, 2.0, -1.5]));
        assert_eq!(json["links"][0]["sent"], 7);
        assert_eq!(json["links"][0]["own"], true);
        assert_eq!(
            json["drops"],
            json!([{ "link": "board", "reason": "bad_checksum", "count": 3 }])
        );
        assert!(told.lines().contains(&"lost on board: bad_checksum 3".to_owned()));
    }
}
