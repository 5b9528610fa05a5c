//! The mission protocol: lists go up and down, and are put in force by `plan_force`.

use haltere_dialect::mav::haltere::{
    MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MavMessage, MavMissionResult,
};

use haltere_core::time::HostTime;

use super::act::Act;
use crate::flight::mission_items::{Room, from_wire};
use crate::flight::modes::{Event, Mode};
use crate::input::LinkId;
use crate::out::voice::Severity;
use crate::stations::mission_transfer::{Client, Progress, Upload, ack};
use crate::stations::services::Plan;
use crate::stations::services::budget::Budget;
use crate::stations::services::kept::Kept;
use crate::stations::services::plan_wire::to_float;
use crate::stations::services::plans::{ALL, PartialList, most_items, name_of, plan_of};

/// A MISSION_ITEM_INT on the wire, bytes.
const ITEM_BYTES: usize = 50;
/// Partial lists under way.
const MOST_PARTIAL: usize = 8;

impl Act<'_> {
    /// MISSION_WRITE_PARTIAL_LIST.
    pub(crate) fn write_partial(
        &mut self,
        at: HostTime,
        client: Client,
        mission_type: u8,
        [first, last]: [i16; 2],
    ) {
        let have = plan_of(mission_type).map_or(0, |plan| self.plan_len(plan)) as i32;
        let (first, last) = (i32::from(first), i32::from(last));
        if first < 0 || last < first || first > have {
            let why = format!("partial list {first} to {last}: the list has {have} items");
            let result = MavMissionResult::MAV_MISSION_INVALID_SEQUENCE;
            self.out.refuse_plan(at, client, mission_type, result, &why);
        } else {
            let count = (last - first + 1).unsigned_abs() as usize;
            let first = first.unsigned_abs() as u16;
            self.upload_begins(at, client, mission_type, first, count, true);
        }
    }

    /// MISSION_REQUEST_LIST.
    pub(crate) fn count_plan(&mut self, at: HostTime, client: Client, mission_type: u8) {
        let Some(plan) = plan_of(mission_type) else {
            self.out.refuse_type(at, client, mission_type);
            return;
        };
        let answer = MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
            count: self.plan_len(plan) as u16,
            target_system: client.peer.0,
            target_component: client.peer.1,
            mission_type,
            opaque_id: self.plan_id(plan),
        });
        self.out.message(client.link, &answer);
    }

    /// MISSION_REQUEST_PARTIAL_LIST.
    pub(crate) fn request_partial(
        &mut self,
        client: Client,
        mission_type: u8,
        [first, last]: [i16; 2],
    ) {
        let have = plan_of(mission_type).map_or(0, |plan| self.plan_len(plan)) as i32;
        let first = i32::from(first);
        // -1 is the end of the list.
        let last = if last == -1 { have - 1 } else { i32::from(last) };
        if first < 0 || last < first || last >= have {
            let result = MavMissionResult::MAV_MISSION_INVALID_SEQUENCE;
            let answer = ack(client.peer, mission_type, result, 0);
            self.out.message(client.link, &answer);
        } else {
            let partial = &mut self.stations.services.plans.partial;
            partial.retain(|list| list.client != client);
            if partial.len() == MOST_PARTIAL {
                partial.remove(0);
            }
            partial.push(PartialList {
                client,
                mission_type,
                next: first.unsigned_abs() as u16,
                last: last.unsigned_abs() as u16,
            });
        }
    }

    /// Repeats requests, and goes on with lists.
    pub(crate) fn plan_tick(&mut self, at: HostTime) {
        let progress = self.stations.services.plans.transfer.tick(at);
        self.upload_progress(at, progress);
        let here = [self.estimate.pos_E_m.x(), self.estimate.pos_E_m.y()];
        if self.flight.plans.fence.contains(here) {
            self.flight.plans.refuge_m = here;
        }
        let origin = self.local_origin();
        if origin != self.flight.plans.origin && self.flight.mode != Mode::Mission {
            self.flight.plans.origin = origin;
            self.derive_anew(at);
        }
        if self.flight.mode == Mode::Mission
            && let Some(why) = self.flight.plans.mission_is_barred.clone()
        {
            self.fire(at, Event::HoldAsked);
            self.out.say(at, Severity::Warning, why);
        }
    }

    /// Sends what was asked for in part.
    pub(crate) fn partial_tick(&mut self, link: LinkId, budget: &mut Budget<'_>) {
        let lists = &mut self.stations.services.plans.partial;
        let Some(index) = lists.iter().position(|list| list.client.link == link) else { return };
        let mut list = lists.swap_remove(index);
        while list.next <= list.last && budget.take(ITEM_BYTES) {
            self.send_item(list.client, list.mission_type, list.next, false);
            list.next += 1;
        }
        if list.next <= list.last {
            self.stations.services.plans.partial.push(list);
        }
    }

    pub(crate) fn plan_items(&self, plan: Plan) -> Vec<MISSION_ITEM_INT_DATA> {
        match plan {
            Plan::Mission => self.flight.mission.items.iter().map(|s| s.wire.clone()).collect(),
            Plan::Fence => self.flight.plans.fence_items.clone(),
            Plan::Rally => self.flight.plans.rally_items.clone(),
        }
    }

    pub(crate) fn plan_len(&self, plan: Plan) -> usize {
        match plan {
            Plan::Mission => self.flight.mission.items.len(),
            Plan::Fence => self.flight.plans.fence_items.len(),
            Plan::Rally => self.flight.plans.rally_items.len(),
        }
    }

    fn plan_id(&self, plan: Plan) -> u32 {
        match plan {
            Plan::Mission => self.flight.mission.id,
            Plan::Fence => self.flight.plans.fence_id,
            Plan::Rally => self.flight.plans.rally_id,
        }
    }

    pub(crate) fn send_item(&mut self, client: Client, mission_type: u8, seq: u16, float: bool) {
        let index = usize::from(seq);
        let stored = match plan_of(mission_type) {
            Some(Plan::Mission) => self.flight.mission.items.get(index).map(|stored| &stored.wire),
            Some(Plan::Fence) => self.flight.plans.fence_items.get(index),
            Some(Plan::Rally) => self.flight.plans.rally_items.get(index),
            None => None,
        };
        let is_mission = plan_of(mission_type) == Some(Plan::Mission);
        let answer = match stored {
            Some(item) => {
                let item = MISSION_ITEM_INT_DATA {
                    seq,
                    target_system: client.peer.0,
                    target_component: client.peer.1,
                    current: u8::from(is_mission && seq == self.flight.guidance.current_item),
                    mission_type,
                    ..item.clone()
                };
                if float {
                    MavMessage::MISSION_ITEM(to_float(&item))
                } else {
                    MavMessage::MISSION_ITEM_INT(item)
                }
            }
            None => {
                let result = MavMissionResult::MAV_MISSION_INVALID_SEQUENCE;
                ack(client.peer, mission_type, result, 0)
            }
        };
        self.out.message(client.link, &answer);
    }

    /// Why a list cannot be replaced now.
    pub(crate) fn plan_is_locked(&self, plan: Plan) -> Option<&'static str> {
        match plan {
            Plan::Mission | Plan::Fence if self.flight.flies_mission() => {
                Some("mission in flight, hold first")
            }
            Plan::Rally if self.flight.mode == Mode::Return => Some("returning, hold first"),
            _ => None,
        }
    }

    pub(crate) fn upload_begins(
        &mut self,
        at: HostTime,
        client: Client,
        mission_type: u8,
        first: u16,
        count: usize,
        partial: bool,
    ) {
        use MavMissionResult as R;
        let Some(plan) = plan_of(mission_type) else {
            self.out.refuse_type(at, client, mission_type);
            return;
        };
        let most = most_items(plan);
        if let Some(why) = self.plan_is_locked(plan) {
            self.out.refuse_plan(at, client, mission_type, R::MAV_MISSION_DENIED, why);
        } else if self.stations.services.plans.transfer.is_taken_by_other(client) {
            let why = "another client is uploading";
            self.out.refuse_plan(at, client, mission_type, R::MAV_MISSION_DENIED, why);
        } else if usize::from(first) + count > most {
            let why = format!("{count} items, at most {most} allowed");
            self.out.refuse_plan(at, client, mission_type, R::MAV_MISSION_NO_SPACE, &why);
        } else if count == 0 {
            self.stations.services.plans.transfer.cancel(client);
            let items = Vec::new();
            self.upload_ends(at, Upload { client, mission_type, first, partial, items });
        } else {
            let transfer = &mut self.stations.services.plans.transfer;
            let count = count as u16;
            let progress = transfer.begin(client, mission_type, first, count, partial, at);
            self.upload_progress(at, progress);
        }
    }

    pub(crate) fn upload_item(
        &mut self,
        at: HostTime,
        client: Client,
        item: MISSION_ITEM_INT_DATA,
        float: bool,
    ) {
        let is_mission = plan_of(item.mission_type) == Some(Plan::Mission);
        let transfer = &self.stations.services.plans.transfer;
        if is_mission && transfer.wants(client, item.mission_type, item.seq) {
            // Refused at once: nobody wants to wait for the rest of it.
            let room =
                Room { envelope: &self.flight.guidance.envelope, origin: self.local_origin() };
            if let Err((result, why)) = from_wire(&item, &room) {
                self.stations.services.plans.transfer.cancel(client);
                self.out.refuse_plan(at, client, item.mission_type, result, &why);
                return;
            }
        }
        let progress = self.stations.services.plans.transfer.item(client, item, float, at);
        self.upload_progress(at, progress);
    }

    fn upload_progress(&mut self, at: HostTime, progress: Progress) {
        match progress {
            Progress::Nothing => {}
            Progress::Answer(client, message) => self.out.message(client.link, &message),
            Progress::GivenUp(client, message, why) => {
                self.out.message(client.link, &message);
                self.out.say(at, Severity::Warning, why);
            }
            Progress::Complete(upload) => self.upload_ends(at, upload),
        }
    }

    fn upload_ends(&mut self, at: HostTime, upload: Upload) {
        let Some(plan) = plan_of(upload.mission_type) else { return };
        let mut items = upload.items.clone();
        if upload.partial {
            let mut all = self.plan_items(plan);
            let first = usize::from(upload.first).min(all.len());
            let end = (first + items.len()).min(all.len());
            all.splice(first..end, items);
            items = all;
        }
        // It may have been started while its successor was on the way.
        let result = match self.plan_is_locked(plan) {
            Some(why) => Err((MavMissionResult::MAV_MISSION_DENIED, why.to_owned())),
            None => self.take_plan(plan, items),
        };
        let Client { link, peer } = upload.client;
        let answer = match result {
            Ok(()) => {
                self.stations.services.lost.settle(Kept::Plan(plan));
                self.stations.sent_a_mission |= plan == Plan::Mission;
                let accepted = MavMissionResult::MAV_MISSION_ACCEPTED;
                let answer = ack(peer, upload.mission_type, accepted, self.plan_id(plan));
                self.out.message(link, &answer);
                let text = format!("{} of {} items in force", name_of(plan), self.plan_len(plan));
                self.out.say(at, Severity::Info, text);
                self.keep_plan(at, plan);
                self.flight.warn_of_barred_mission(at, self.out);
                if plan == Plan::Fence {
                    self.heed_fence(at);
                }
                answer
            }
            Err((result, why)) => {
                self.out.refuse_plan(at, upload.client, upload.mission_type, result, &why)
            }
        };
        self.stations.services.plans.transfer.finish(&upload, answer, at);
    }

    pub(crate) fn clear_plans(&mut self, at: HostTime, client: Client, mission_type: u8) {
        use MavMissionResult as R;
        let plans = match plan_of(mission_type) {
            Some(plan) => vec![plan],
            None if mission_type == ALL => vec![Plan::Mission, Plan::Fence, Plan::Rally],
            None => {
                self.out.refuse_type(at, client, mission_type);
                return;
            }
        };
        if let Some(why) = plans.iter().find_map(|plan| self.plan_is_locked(*plan)) {
            self.out.refuse_plan(at, client, mission_type, R::MAV_MISSION_DENIED, why);
            return;
        }
        for plan in plans {
            self.stations.services.lost.settle(Kept::Plan(plan));
            if self.plan_len(plan) > 0 && self.take_plan(plan, Vec::new()).is_ok() {
                self.out.say(at, Severity::Info, format!("{} cleared", name_of(plan)));
            }
            self.keep_plan(at, plan);
        }
        let answer = ack(client.peer, mission_type, R::MAV_MISSION_ACCEPTED, 0);
        self.out.message(client.link, &answer);
    }
}
