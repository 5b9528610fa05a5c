//! The mission protocol: mission, fence and rally points, up and down.
//!
//! What is new is put in force whole or not at all, and kept over a restart. While a mission is
//! flown, neither it nor its fence can be replaced: hold first.

use haltere_dialect::mav::haltere::{MavMessage, MavMissionResult, MavMissionType};

use haltere_core::time::HostTime;

use super::Purpose;
use super::files::{FileFault, FileTask, Plan};
use crate::flight::fence::MOST_CORNERS;
use crate::flight::mission::MOST_ITEMS;
use crate::flight::rally;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::stations::Stations;
use crate::stations::mission_transfer::{Client, MissionTransfer, ack};

/// A list that was asked for in part, and is sent unasked.
#[derive(Debug)]
pub(crate) struct PartialList {
    pub(crate) client: Client,
    pub(crate) mission_type: u8,
    pub(crate) next: u16,
    pub(crate) last: u16,
}

/// Uploads and partial lists under way; what is in force belongs to the flight.
#[derive(Debug, Default)]
pub(crate) struct Plans {
    pub transfer: MissionTransfer,
    pub(crate) partial: Vec<PartialList>,
}

impl Plans {
    /// Whether nobody uploads or reads a list.
    pub fn is_idle(&self, at: HostTime) -> bool {
        self.transfer.is_idle(at) && self.partial.is_empty()
    }
}

/// The list behind a mission type.
pub(crate) fn plan_of(mission_type: u8) -> Option<Plan> {
    [Plan::Mission, Plan::Fence, Plan::Rally].into_iter().find(|p| type_of(*p) == mission_type)
}

/// All three lists, for who clears them.
pub(crate) const ALL: u8 = MavMissionType::MAV_MISSION_TYPE_ALL as u8;

pub(crate) fn type_of(plan: Plan) -> u8 {
    let mission_type = match plan {
        Plan::Mission => MavMissionType::MAV_MISSION_TYPE_MISSION,
        Plan::Fence => MavMissionType::MAV_MISSION_TYPE_FENCE,
        Plan::Rally => MavMissionType::MAV_MISSION_TYPE_RALLY,
    };
    mission_type as u8
}

pub(crate) fn name_of(plan: Plan) -> &'static str {
    match plan {
        Plan::Mission => "mission",
        Plan::Fence => "fence",
        Plan::Rally => "rally points",
    }
}

pub(crate) fn most_items(plan: Plan) -> usize {
    match plan {
        Plan::Mission => MOST_ITEMS,
        Plan::Fence => MOST_CORNERS,
        Plan::Rally => rally::MOST_POINTS,
    }
}

impl Out {
    pub(crate) fn plan_not_kept(&mut self, at: HostTime, plan: Plan, fault: FileFault) {
        let text = format!("{} is lost at a restart: {}", name_of(plan), fault.words());
        self.say(at, Severity::Warning, text);
    }

    pub(crate) fn refuse_plan(
        &mut self,
        at: HostTime,
        client: Client,
        mission_type: u8,
        result: MavMissionResult,
        why: &str,
    ) -> MavMessage {
        let answer = ack(client.peer, mission_type, result, 0);
        self.message(client.link, &answer);
        let what = plan_of(mission_type).map_or("plan", name_of);
        self.say(at, Severity::Warning, format!("{what} refused: {why}"));
        answer
    }

    /// A list that does not exist was asked for, or all three at once.
    pub(crate) fn refuse_type(&mut self, at: HostTime, client: Client, mission_type: u8) {
        let why = format!(
            "mission_type = {mission_type}, allowed 0 mission, 1 fence, 2 rally points; to clear, 255 \
             all"
        );
        let result = MavMissionResult::MAV_MISSION_UNSUPPORTED;
        self.refuse_plan(at, client, mission_type, result, &why);
    }
}

impl Stations {
    /// Asks for what was kept.
    pub(crate) fn restore_plans(&mut self, at: HostTime) {
        // Rally points first: a fence that came later does not undo them, it leaves them out.
        for plan in [Plan::Rally, Plan::Fence, Plan::Mission] {
            // Nothing kept, nothing restored.
            let _ = self.services.desk.ask(FileTask::LoadPlan(plan), Purpose::LoadPlan(plan), at);
        }
    }
}
