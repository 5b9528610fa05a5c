//! Plans in force: the whole of a list checked, taken over, kept over a restart.

use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavMissionResult};

use haltere_core::geo::LocalOrigin;
use haltere_core::time::HostTime;

use super::act::Act;
use crate::flight::awaited::Next;
use crate::flight::fence::{Fence, KEEP_M};
use crate::flight::mission::{MOST_ITEMS, MissionItem, StoredItem, plan_id};
use crate::flight::mission_items::{Refusal, Room, from_wire, is_global, place_E_m};
use crate::flight::modes::{Event, Mode};
use crate::flight::plans::leg_outside;
use crate::flight::rally;
use crate::out::voice::Severity;
use crate::stations::services::files::{FileFault, FileTask, Plan};
use crate::stations::services::kept::Kept;
use crate::stations::services::plans::{name_of, type_of};
use crate::stations::services::{Purpose, plan_file};

impl Act<'_> {
    /// Another fence is in force: what it leaves of a leg under way, and of the places to return to.
    pub(crate) fn heed_fence(&mut self, at: HostTime) {
        self.flight.warn_of_lost_refuges(at, self.out);
        let guidance = &mut self.flight.guidance;
        let estimate = &*self.estimate;
        let [here, goal] = [estimate.pos_E_m, guidance.goal_E_m()].map(|p| [p.x(), p.y()]);
        let fence = &self.flight.plans.fence;
        if fence.allows_way(here, goal) {
            return;
        }
        match self.flight.mode {
            Mode::Goto => {
                self.out.say(
                    at,
                    Severity::Warning,
                    "the fence bars the rest of the leg".to_owned(),
                );
                self.fire(at, Event::HoldAsked);
            }
            // To another place, if there is one.
            Mode::Return => guidance.enter(Mode::Return, estimate, fence, at),
            _ => {}
        }
    }

    /// Checks a list whole and puts it in force.
    pub(crate) fn take_plan(
        &mut self,
        plan: Plan,
        mut items: Vec<MISSION_ITEM_INT_DATA>,
    ) -> Result<(), Refusal> {
        for (seq, item) in items.iter_mut().enumerate() {
            item.seq = seq as u16;
            item.mission_type = type_of(plan);
        }
        let origin = self.local_origin();
        match plan {
            Plan::Mission => {
                let room = Room { envelope: &self.flight.guidance.envelope, origin };
                let stored = items
                    .into_iter()
                    .map(|wire| from_wire(&wire, &room).map(|item| StoredItem { wire, item }))
                    .collect::<Result<Vec<_>, _>>()?;
                check_jumps(&stored)?;
                if let Some(seq) = leg_outside(&stored, &self.flight.plans.fence) {
                    let why = format!(
                        "item {seq}: it, or the way to it, is outside the fence, or within \
                         {KEEP_M} m of its border",
                        seq = seq.saturating_add(1)
                    );
                    return Err((MavMissionResult::MAV_MISSION_INVALID, why));
                }
                self.flight.mission.replace(stored);
                self.flight.guidance.new_mission();
                self.flight.plans.mission_is_barred = None;
                if self.flight.mission.items.is_empty()
                    && self.flight.guidance.next == Next::Mission
                    && !self.flight.mode.has_thrust()
                {
                    self.flight.call_off_lift_off();
                }
            }
            Plan::Fence => {
                let places = places(&items, origin.as_ref())?;
                let fence = Fence::from_items(&items, &places)?;
                let here = [self.estimate.pos_E_m.x(), self.estimate.pos_E_m.y()];
                if self.flight.mode.has_thrust() && !fence.contains(here) {
                    let why = format!(
                        "the vehicle flies outside of it, at N {:.2} E {:.2}",
                        here[0], here[1]
                    );
                    return Err((MavMissionResult::MAV_MISSION_DENIED, why));
                }
                self.flight.plans.fence_id = plan_id(items.iter());
                self.flight.plans.fence_items = items;
                self.flight.plans.fence = fence;
                self.flight.plans.refuge_m = here;
                self.flight.bar_mission();
            }
            Plan::Rally => {
                let places = places(&items, origin.as_ref())?;
                let volume = self.flight.guidance.volume();
                let fence = &self.flight.plans.fence;
                rally::check(&items, &places, volume, fence)?;
                self.flight.guidance.set_rally_points(places);
                self.flight.plans.rally_id = plan_id(items.iter());
                self.flight.plans.rally_items = items;
            }
        }
        Ok(())
    }

    /// The room has moved on the globe: items given in global frames are elsewhere in it.
    pub(crate) fn derive_anew(&mut self, at: HostTime) {
        for plan in [Plan::Fence, Plan::Rally, Plan::Mission] {
            let items = self.plan_items(plan);
            if !items.iter().any(|item| is_global(item.frame)) {
                continue;
            }
            if let Err((_, why)) = self.take_plan(plan, items) {
                let text = format!("{} no longer fits the room: {why}", name_of(plan));
                self.out.say(at, Severity::Warning, text.clone());
                match plan {
                    Plan::Mission => self.flight.plans.mission_is_barred = Some(text),
                    // Kept as it was: a fence that is elsewhere is better than none.
                    Plan::Fence | Plan::Rally => {}
                }
            }
        }
    }

    pub(crate) fn keep_plan(&mut self, at: HostTime, plan: Plan) {
        let items = self.plan_items(plan);
        let bytes = if items.is_empty() { Vec::new() } else { plan_file::encode(&items) };
        let task = FileTask::SavePlan(plan, bytes);
        match self.stations.services.desk.ask(task, Purpose::SavePlan(plan), at) {
            // Nothing is kept by configuration: no reason to complain at every upload.
            Ok(()) | Err((FileFault::Off, _)) => {}
            Err((fault, _)) => self.out.plan_not_kept(at, plan, fault),
        }
    }

    pub(crate) fn plan_restored(&mut self, at: HostTime, plan: Plan, bytes: &[u8]) {
        // Somebody was faster, or there is nothing.
        if bytes.is_empty() || self.plan_len(plan) > 0 || self.flight.mode.has_thrust() {
            return;
        }
        let taken = plan_file::decode(bytes)
            .and_then(|items| self.take_plan(plan, items).map_err(|(_, why)| why));
        match taken {
            Ok(()) => {
                let text = format!("{} of {} items restored", name_of(plan), self.plan_len(plan));
                self.out.say(at, Severity::Info, text);
                if plan == Plan::Fence {
                    self.heed_fence(at);
                }
            }
            Err(why) => self.stations.note_lost(at, Kept::Plan(plan), &why, self.out),
        }
    }

    /// A list from a file takes the way of an upload.
    pub(crate) fn load_mission(
        &mut self,
        at: HostTime,
        items: Vec<MISSION_ITEM_INT_DATA>,
    ) -> Result<usize, String> {
        if let Some(why) = self.plan_is_locked(Plan::Mission) {
            return Err(why.to_owned());
        }
        if items.len() > MOST_ITEMS {
            return Err(format!("{} items, at most {MOST_ITEMS} allowed", items.len()));
        }
        self.take_plan(Plan::Mission, items).map_err(|(_, why)| why)?;
        self.stations.sent_a_mission = true;
        self.stations.services.lost.settle(Kept::Plan(Plan::Mission));
        self.keep_plan(at, Plan::Mission);
        Ok(self.flight.mission.items.len())
    }
}

/// Places of items that all have one, N and E, m.
fn places(
    items: &[MISSION_ITEM_INT_DATA],
    origin: Option<&LocalOrigin>,
) -> Result<Vec<[f64; 2]>, Refusal> {
    items
        .iter()
        .map(|item| {
            // Fences of some planners carry frame 0, 3 or 5; a place is all that counts.
            let pos = place_E_m(&MISSION_ITEM_INT_DATA { z: 0.0, ..item.clone() }, origin)?;
            let farthest_m = 10_000.0;
            if pos.x().abs().max(pos.y().abs()) > farthest_m {
                let (seq, north, east) = (item.seq, pos.x(), pos.y());
                let why = format!(
                    "item {seq}: N {north:.0} E {east:.0} m is more than {farthest_m} m away: is \
                     the origin set? (frame {:?})",
                    item.frame,
                    seq = seq.saturating_add(1)
                );
                return Err((MavMissionResult::MAV_MISSION_INVALID, why));
            }
            Ok([pos.x(), pos.y()])
        })
        .collect()
}

fn check_jumps(items: &[StoredItem]) -> Result<(), Refusal> {
    let count = items.len();
    for stored in items {
        if let MissionItem::Jump { to, .. } = stored.item
            && usize::from(to) >= count
        {
            let seq = stored.wire.seq;
            let why = format!(
                "item {seq}: jumps to {to}, the mission has {count} items",
                seq = seq.saturating_add(1),
                to = to.saturating_add(1)
            );
            return Err((MavMissionResult::MAV_MISSION_INVALID_PARAM1, why));
        }
    }
    Ok(())
}
