//! The item of the mission that is in force: what it asks for, and when it is done.

use super::{Carrot, Guidance, News, Now};
use crate::flight::mission::{Mission, MissionItem};
use crate::flight::modes::Event;
use haltere_core::frames::{E, Vec3, wrap_pi_rad};

/// Time constant of the average of the voltage that is waited for, and the least time of the wait, s: as for an empty
/// battery. The present voltage trembles with the thrust, by a tenth of a volt and more.
const VOLTAGE_FOR_S: f64 = 2.0;

impl Guidance {
    /// Works on the item in force: one item a step.
    pub(super) fn mission_step(&mut self, mission: &Mission, now: &Now<'_>, news: &mut News) {
        let Now { estimate, at, .. } = *now;
        let is_past = self.last_item.is_some_and(|last| self.current_item > last);
        let stored = mission.items.get(usize::from(self.current_item));
        let Some(stored) = stored.filter(|_| !is_past) else {
            self.last_item = None;
            news.event = Some(Event::MissionDone);
            return;
        };
        let first_look = !self.item_started;
        self.item_started = true;
        if std::mem::take(&mut self.jumped) && !self.carrot.has_arrived() {
            self.carrot = Carrot::resting(self.carrot.pos_E_m);
        }
        if first_look && let Some(to) = stored.item.place_NE_m() {
            // A jump leads from anywhere to anywhere.
            let from = self.carrot.pos_E_m;
            if !now.fence.allows_way([from.x(), from.y()], to) {
                let item = self.current_item;
                news.warning = Some(format!(
                    "item {item}: the fence bars the straight way to it",
                    item = item.saturating_add(1)
                ));
                news.event = Some(Event::HoldAsked);
                return;
            }
        }
        let near = |target: Vec3<E>, radius_m: f64| (estimate.pos_E_m - target).norm() < radius_m;
        let default_radius_m = self.config.acceptance_radius_m;
        let done = match stored.item {
            MissionItem::Takeoff { height_m } => {
                if first_look {
                    let here = self.carrot.pos_E_m;
                    self.fly_to(Vec3::new(here.x(), here.y(), -height_m), None);
                }
                self.carrot.has_arrived() && near(self.carrot.target_E_m, default_radius_m)
            }
            MissionItem::Waypoint { pos_E_m, hold_s, acceptance_m, yaw_rad } => {
                if first_look {
                    self.fly_to(pos_E_m, yaw_rad);
                }
                let radius_m = acceptance_m.unwrap_or(default_radius_m);
                let there = self.arrived_at.is_some()
                    || (self.carrot.has_arrived() && near(self.carrot.target_E_m, radius_m));
                if there && self.arrived_at.is_none() {
                    news.reached = Some(self.current_item);
                }
                there && self.arrived_since_s(at) >= hold_s
            }
            MissionItem::Delay { duration_s } => {
                if first_look {
                    self.arrived_at = None;
                }
                self.arrived_since_s(at) >= duration_s
            }
            MissionItem::Speed { speed_mps } => {
                self.set_leg_speed(speed_mps);
                true
            }
            MissionItem::Yaw { yaw_rad, relative } => {
                let base_rad = if relative { self.yaw_rad } else { 0.0 };
                self.yaw_rad = wrap_pi_rad(base_rad + yaw_rad);
                true
            }
            MissionItem::Home => true,
            MissionItem::Jump { to, times } => {
                if self.may_jump(self.current_item, times) {
                    self.current_item = to;
                    self.item_started = false;
                    self.arrived_at = None;
                    return;
                }
                true
            }
            MissionItem::Doublet(doublet) => {
                if first_look {
                    self.arrived_at = None;
                }
                let elapsed_s = self.arrived_since_s(at);
                news.doublet = Some((doublet, elapsed_s));
                elapsed_s >= doublet.length_s()
            }
            MissionItem::Tilt(step) => {
                if first_look {
                    self.tilt = None;
                }
                self.tilt_step(&step, now, news)
            }
            MissionItem::UntilVoltage { supply_v, limit_s } => {
                self.wait_for_voltage(supply_v, limit_s, first_look, now, news)
            }
            MissionItem::Return => {
                news.event = Some(Event::ReturnAsked);
                self.landing = true;
                false
            }
            MissionItem::Land { pos_E_m } => {
                if first_look && let Some(pos) = pos_E_m {
                    let height = self.carrot.pos_E_m.z();
                    self.fly_to(Vec3::new(pos.x(), pos.y(), height), None);
                }
                let there = pos_E_m.is_none()
                    || (self.carrot.has_arrived()
                        && near(self.carrot.target_E_m, 2.0 * default_radius_m));
                if there {
                    news.event = Some(Event::MissionLands);
                    self.landing = true;
                }
                false
            }
        };
        if done {
            let told = matches!(stored.item, MissionItem::Waypoint { .. });
            // A step that was refused was not reached.
            if !told && !std::mem::take(&mut self.refused) {
                news.reached = Some(self.current_item);
            }
            self.current_item += 1;
            self.item_started = false;
            self.arrived_at = None;
        }
    }

    /// Stays until the battery is down to a voltage; `true` when it is, or when the time is over.
    fn wait_for_voltage(
        &mut self,
        wanted_v: f64,
        limit_s: f64,
        first_look: bool,
        now: &Now<'_>,
        news: &mut News,
    ) -> bool {
        if first_look {
            self.wait_since = now.at;
            self.waited_v = None;
        }
        let item = self.current_item;
        let waited_s = now.at.seconds_since(self.wait_since);
        if waited_s > limit_s {
            let found = now.supply_v.map_or("no voltage".to_owned(), |v| format!("{v:.2} V"));
            news.warning = Some(format!(
                "item {item}: {found} after {limit_s:.0} s, wanted {wanted_v:.2} V",
                item = item.saturating_add(1)
            ));
            return true;
        }
        let Some(v) = now.supply_v else { return false };
        let waited_v = self.waited_v.get_or_insert(v);
        *waited_v += (v - *waited_v) * now.dt_s / (VOLTAGE_FOR_S + now.dt_s);
        waited_s >= VOLTAGE_FOR_S && *waited_v <= wanted_v
    }

    /// Whether a jump is to be made once more; counts it.
    fn may_jump(&mut self, item: u16, times: Option<u32>) -> bool {
        let made = match self.jumps_made.iter_mut().find(|(i, _)| *i == item) {
            Some((_, made)) => made,
            None => {
                self.jumps_made.push((item, 0));
                // Bounded: there is one entry an item.
                match self.jumps_made.last_mut() {
                    Some((_, made)) => made,
                    None => return false,
                }
            }
        };
        let more = times.is_none_or(|times| *made < times);
        *made = made.saturating_add(1);
        more
    }
}
