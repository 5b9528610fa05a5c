//! What holds a flight beside its mission: the fence and the rally points in force, and how the fence holds it back.

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;

use haltere_core::control::Command;
use haltere_core::estimate::{Estimate, Health};
use haltere_core::geo::LocalOrigin;
use haltere_core::time::HostTime;

use super::Flight;
use super::fence::{Fence, Guarded, KEEP_M};
use super::mission::{MissionItem, StoredItem};
use super::modes::{Event, Mode};
use crate::out::Out;
use crate::out::voice::Severity;

/// The fence has let go when it did not hold the vehicle back for this long, s: at the border that comes and
/// goes with the noise of the estimate.
const HELD_OVER_S: f64 = 1.0;
/// A return that is held back for this long lands, s: before it has lost its course over it.
const HELD_LANDS_S: f64 = 3.0;

/// The lists in force beside the mission itself.
#[derive(Debug)]
pub(crate) struct Plans {
    pub fence_items: Vec<MISSION_ITEM_INT_DATA>,
    pub fence_id: u32,
    pub fence: Fence,
    pub rally_items: Vec<MISSION_ITEM_INT_DATA>,
    pub rally_id: u32,
    /// Where the room was when items were turned into it.
    pub origin: Option<LocalOrigin>,
    /// Why the mission may not be flown.
    pub mission_is_barred: Option<String>,
    /// Where the vehicle was last inside the fence, N and E, m.
    pub refuge_m: [f64; 2],
    /// Since when the fence holds the vehicle back, and when it last did.
    pub held_back: Option<(HostTime, HostTime)>,
}

impl Plans {
    pub fn new(origin: LocalOrigin) -> Self {
        Self {
            fence_items: Vec::new(),
            fence_id: 0,
            fence: Fence::default(),
            rally_items: Vec::new(),
            rally_id: 0,
            origin: Some(origin),
            mission_is_barred: None,
            refuge_m: [0.0; 2],
            held_back: None,
        }
    }

    /// Ids of fence and rally points, as MISSION_CURRENT tells them.
    pub fn ids(&self) -> (u32, u32) {
        (self.fence_id, self.rally_id)
    }
}

impl Flight {
    pub(crate) fn warn_of_barred_mission(&self, at: HostTime, out: &mut Out) {
        if let Some(why) = self.plans.mission_is_barred.clone() {
            out.say(at, Severity::Warning, why);
        }
    }

    /// The fence has the last word on what the controller is asked for. A leg that it bars ends in Hold; a
    /// return, on which somebody relies to come down, lands when it has hung there for a while.
    pub(crate) fn keep_inside_fence(
        &mut self,
        at: HostTime,
        estimate: &Estimate,
        command: &mut Command,
        out: &mut Out,
    ) -> Option<Event> {
        let plans = &mut self.plans;
        let guarded = plans.fence.guard(command, estimate, plans.refuge_m);
        let follows = matches!(self.mode, Mode::Offboard | Mode::Manual);
        if guarded != Some(Guarded::HeldBack) && !(follows && guarded.is_some()) {
            let is_over = |last| at.seconds_since(last) > HELD_OVER_S;
            plans.held_back = plans.held_back.filter(|(_, last)| !is_over(*last));
            return None;
        }
        let (since, _) = plans.held_back.unwrap_or((at, at));
        if plans.held_back.replace((since, at)).is_none() {
            let pos = estimate.pos_E_m;
            let text = format!("held back by the fence at N {:.2} E {:.2} m", pos.x(), pos.y());
            out.say(at, Severity::Warning, text);
        }
        if matches!(self.mode, Mode::Mission | Mode::Goto) {
            Some(Event::HoldAsked)
        } else {
            (at.seconds_since(since) > HELD_LANDS_S).then_some(Event::NoWayHome)
        }
    }

    pub(crate) fn warn_of_lost_refuges(&self, at: HostTime, out: &mut Out) {
        let fence = &self.plans.fence;
        let names = std::iter::once("home".to_owned())
            .chain((0..).map(|seq: usize| format!("rally point {seq}")));
        // On the floor home is wherever the next take-off will be, unless it was set by hand.
        let is_home_open = !self.guidance.home_is_set() && !self.mode.has_thrust();
        let forbidden: Vec<String> = names
            .zip(self.guidance.refuges_NE_m())
            .skip(usize::from(is_home_open))
            .filter(|(_, place)| !fence.contains(*place))
            .map(|(name, [north_m, east_m])| {
                format!("no return to {name}, N {north_m:.2} E {east_m:.2} m: the fence forbids it")
            })
            .collect();
        for text in forbidden {
            out.say(at, Severity::Warning, text);
        }
    }

    /// Looks whether the mission still lies inside the fence.
    pub(crate) fn bar_mission(&mut self) {
        let barred = leg_outside(&self.mission.items, &self.plans.fence);
        self.plans.mission_is_barred = barred.map(|seq| {
            format!(
                "mission barred: item {seq} or the way to it is outside the fence",
                seq = seq.saturating_add(1)
            )
        });
    }

    /// Why the mission cannot begin here: the fence lies between the vehicle and its first place.
    pub(crate) fn first_leg_is_barred(&self, estimate: &Estimate) -> Option<String> {
        let mut rest = self.mission.items.iter().skip(usize::from(self.guidance.current_item));
        let (seq, first) = rest.find_map(|item| Some((item.wire.seq, item.item.place_NE_m()?)))?;
        // Nobody knows yet where it stands: the leg is looked at when it begins.
        if estimate.health == Health::NotAligned {
            return None;
        }
        let pos = estimate.pos_E_m;
        let is_free = self.plans.fence.allows_way([pos.x(), pos.y()], first);
        (!is_free).then(|| {
            format!(
                "mission refused: the fence bars the straight way from here to item {seq}",
                seq = seq.saturating_add(1)
            )
        })
    }

    /// Why the vehicle may not fly straight to a point.
    pub(crate) fn fence_bars(&self, point: [f64; 2], estimate: &Estimate) -> Option<String> {
        let fence = &self.plans.fence;
        let here = estimate.pos_E_m;
        let [north_m, east_m] = point;
        if !fence.allows(point) {
            return Some(format!(
                "N {north_m:.2} E {east_m:.2} m is outside the fence, or within {KEEP_M} m of its border"
            ));
        }
        let way_is_free = fence.allows_way([here.x(), here.y()], point);
        (!way_is_free)
            .then(|| format!("the fence bars the straight way to N {north_m:.2} E {east_m:.2} m"))
    }
}

/// The first item that lies outside the fence, or to which the straight way leaves it.
pub(crate) fn leg_outside(items: &[StoredItem], fence: &Fence) -> Option<u16> {
    if fence.is_empty() {
        return None;
    }
    let mut before: Option<[f64; 2]> = None;
    for stored in items {
        let next = match stored.item {
            // Where the jump leads: the next place from there on.
            MissionItem::Jump { to, .. } => {
                items.iter().skip(usize::from(to)).find_map(|next| next.item.place_NE_m())
            }
            _ => stored.item.place_NE_m(),
        };
        let Some(next) = next else { continue };
        if !fence.allows(next) || !fence.allows_way(before.unwrap_or(next), next) {
            return Some(stored.wire.seq);
        }
        if !matches!(stored.item, MissionItem::Jump { .. }) {
            before = Some(next);
        }
    }
    None
}
