//! What a station knows of the vehicle: what it has told so far.

use std::collections::BTreeMap;

use haltere_dialect::mav::haltere::{HALTERE_LINK_DATA, MavMessage, MavModeFlag};

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
    /// Mission item in force.
    pub current: Option<u16>,
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
            MavMessage::EXTENDED_SYS_STATE(state) => self.landed = state.landed_state,
            MavMessage::LOCAL_POSITION_NED(p) => {
                self.position_m = Some([p.x, p.y, p.z].map(f64::from));
                self.velocity_mps = Some([p.vx, p.vy, p.vz].map(f64::from));
            }
            MavMessage::SYS_STATUS(status) if status.voltage_battery != u16::MAX => {
                self.supply_v = Some(f64::from(status.voltage_battery) * 1e-3);
            }
            MavMessage::MISSION_CURRENT(current) => self.current = Some(current.seq),
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

    /// For people.
    pub fn lines(&self) -> Vec<String> {
        let known = |value: Option<String>| value.unwrap_or_else(|| "not told".into());
        let main = self.custom_mode >> 16 & 0xFF;
        let mode = match (main, self.custom_mode >> 24) {
            (4, 2) => "takeoff".to_string(),
            (4, 3) => "hold".to_string(),
            (4, 4) => "mission".to_string(),
            (4, 5) => "return".to_string(),
            (4, 6) => "land".to_string(),
            (6, _) => "offboard".to_string(),
            (main, sub) => format!("main {main} sub {sub}"),
        };
        let point = self
            .position_m
            .map(|[n, e, d]| format!("north {n:.2} m, east {e:.2} m, height {:.2} m", -d));
        let mut lines = vec![
            format!("armed:    {}", if self.armed { "yes" } else { "no" }),
            format!("mode:     {mode}"),
            format!("state:    {}", landed_name(self.landed)),
            format!("position: {}", known(point)),
            format!("battery:  {}", known(self.supply_v.map(|v| format!("{v:.2} V")))),
            format!("mission:  item {}", known(self.current.map(|n| n.to_string()))),
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
            let link = match *number {
                0 => "tag".to_owned(),
                1 => "board".to_owned(),
                u8::MAX => "core".to_owned(),
                number => format!("link {number}"),
            };
            lines.push(format!("lost on {link}: {reason} {count}"));
        }
        lines
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
