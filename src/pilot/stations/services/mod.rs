//! Services for ground stations: parameters, plans, files, logs, programs.
//!
//! Each is a file of its own. All are pure: what they want from a disk goes out as a [`FileRequest`]
//! and comes back as an input. What they send on their own initiative is paced by `budget`.

mod border;
mod budget;
mod crc32;
pub(crate) mod fence_status;
pub(crate) mod files;
mod ftp;
mod ftp_path;
mod ftp_stream;
pub(crate) mod ftp_wire;
mod judge;
mod kept;
mod logs;
mod metadata;
mod param_pack;
mod parameter_list;
mod parameter_table;
mod parameters;
mod plan_file;
mod plan_force;
mod plan_wire;
mod plans;
mod programs;

pub use crc32::crc32;
pub use files::{
    FileFault, FileName, FileRequest, FileTask, Folder, MOST_MISSION_BYTES, PARAMETERS_TICKET, Plan,
};
pub use judge::{Judgement, Told};
pub use metadata::markdown as parameter_page;
pub use parameter_table::{Parameter, all as all_parameters, find as find_parameter};
pub use plan_file::{decode as decode_plan, encode as encode_plan};

use haltere_dialect::mav::haltere::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult};
use haltere_dialect::mav::known;

use haltere_core::control::Command;
use haltere_core::time::HostTime;

use super::mission_transfer::Client;
use crate::Pilot;
use crate::config::PilotConfig;
use crate::flight::fence::Guarded;
use crate::flight::modes::{Event, Mode};
use crate::input::LinkId;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::stations::Stations;

use budget::Bucket;
use fence_status::FenceWatch;
use files::FileDesk;
use ftp::Ftp;
use judge::Judge;
use kept::{Kept, Lost};
use logs::Logs;
use metadata::Metadata;
use parameters::Parameters;
use plans::Plans;

/// Message ids that are sent on request.
const COMPONENT_INFORMATION_ID: f32 = 395.0;
const COMPONENT_METADATA_ID: f32 = 397.0;
/// `MAV_CMD_PREFLIGHT_STORAGE`, param1: reset to the configuration files.
const STORAGE_RESET: f32 = 2.0;
/// Param1 of the same: read, write. Every value is kept as soon as it is set.
const STORAGE_READ_WRITE: [f32; 2] = [0.0, 1.0];

/// The fence has let go when it did not hold the vehicle back for this long, s: at the border that comes and
/// goes with the noise of the estimate.
const HELD_OVER_S: f64 = 1.0;
/// A return that is held back for this long lands, s: before it has lost its course over it.
const HELD_LANDS_S: f64 = 3.0;

/// What an answer of the disk is for.
#[derive(Debug)]
enum Purpose {
    Parameter(&'static str),
    Forget(Client),
    SavePlan(Plan),
    LoadPlan(Plan),
    Ftp(ftp::Job),
    Logs(logs::Job),
    Program(programs::Job),
    Judge,
    StopJudging,
}

/// State of the services.
#[derive(Debug)]
pub(crate) struct Services {
    desk: FileDesk<Purpose>,
    buckets: Vec<(LinkId, Bucket)>,
    parameters: Parameters,
    metadata: Metadata,
    pub plans: Plans,
    ftp: Ftp,
    logs: Logs,
    fence_watch: FenceWatch,
    judge: Judge,
    lost: Lost,
    has_begun: bool,
}

impl Services {
    pub fn new(config: &PilotConfig) -> Self {
        Self {
            desk: FileDesk::new(config.store),
            buckets: Vec::new(),
            parameters: Parameters::new(config),
            metadata: Metadata::new(),
            plans: Plans::new(Some(config.origin.in_force())),
            ftp: Ftp::default(),
            logs: Logs::default(),
            fence_watch: FenceWatch::default(),
            judge: Judge::default(),
            lost: Lost::default(),
            has_begun: false,
        }
    }

    /// As stations have set it.
    pub fn settings(&self) -> &PilotConfig {
        &self.parameters.wanted
    }

    /// Whether nobody waits for anything, and nobody must be told of anything that is missing.
    pub fn is_quiet(&self, at: HostTime) -> bool {
        self.desk.is_idle()
            && self.parameters.is_idle()
            && self.plans.is_idle(at)
            && self.ftp.is_idle()
            && self.logs.is_idle()
            && self.judge.is_idle()
            && self.lost.is_nothing()
    }
}

/// Whom a message is for, of the services' own.
fn target(message: &MavMessage) -> Option<(u8, u8)> {
    macro_rules! targets {
        ($($name:ident)*) => {
            match message {
                $(MavMessage::$name(m) => Some((m.target_system, m.target_component)),)*
                _ => None,
            }
        };
    }
    targets! {
        PARAM_REQUEST_LIST PARAM_REQUEST_READ PARAM_SET PARAM_EXT_SET
        MISSION_COUNT MISSION_ITEM MISSION_ITEM_INT MISSION_REQUEST MISSION_REQUEST_INT
        MISSION_REQUEST_LIST MISSION_REQUEST_PARTIAL_LIST MISSION_WRITE_PARTIAL_LIST
        MISSION_CLEAR_ALL MISSION_ACK MISSION_SET_CURRENT
        FILE_TRANSFER_PROTOCOL
        LOG_REQUEST_LIST LOG_REQUEST_DATA LOG_REQUEST_END LOG_ERASE REQUEST_EVENT
        COMMAND_LONG COMMAND_INT
    }
}

impl Out {
    fn service_ack(&mut self, client: Client, command: MavCmd, result: MavResult) {
        let message = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command: command as u16,
            result: result as u8,
            progress: 0,
            result_param2: 0,
            target_system: client.peer.0,
            target_component: client.peer.1,
        });
        self.message(client.link, &message);
    }
}

impl Stations {
    /// A link is gone: nothing is sent to it any more.
    pub(crate) fn services_forget(&mut self, link: LinkId) {
        self.services.plans.transfer.cancel_link(link);
        self.ftp_forget(link);
        self.logs_forget(link);
        self.services.buckets.retain(|(l, _)| *l != link);
    }
}

impl Pilot {
    /// Hands a client's message to the service that it is for. `true`: it was one of theirs.
    pub(crate) fn service_message(
        &mut self,
        at: HostTime,
        link: LinkId,
        peer: (u8, u8),
        message: &MavMessage,
    ) -> bool {
        let Some((system, component)) = target(message) else { return false };
        let for_us = (system == 0 || system == self.out.own.system_id)
            && (component == 0 || component == self.out.own.component_id);
        if !for_us {
            return false;
        }
        let client = Client { link, peer };
        match message {
            MavMessage::FILE_TRANSFER_PROTOCOL(m) => {
                self.ftp_message(at, client, &m.payload);
                true
            }
            MavMessage::REQUEST_EVENT(m) => {
                self.out.events_again(link, peer, m);
                true
            }
            MavMessage::COMMAND_LONG(m) => {
                let params = [m.param1, m.param2];
                self.service_command(at, client, m.command, params)
            }
            MavMessage::COMMAND_INT(m) => {
                let params = [m.param1, m.param2];
                self.service_command(at, client, m.command, params)
            }
            _ => {
                self.parameter_message(at, link, peer, message)
                    || self.plan_message(at, client, message)
                    || self.log_message(at, client, message)
            }
        }
    }

    /// The commands that belong to services.
    fn service_command(
        &mut self,
        at: HostTime,
        client: Client,
        number: u16,
        [param1, param2]: [f32; 2],
    ) -> bool {
        use MavResult as R;
        let Some(command) = known(number) else { return false };
        let result = match command {
            MavCmd::MAV_CMD_REQUEST_MESSAGE if param1 == COMPONENT_METADATA_ID => {
                let message = self.stations.services.metadata.message(at);
                self.out.message(client.link, &message);
                R::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_REQUEST_MESSAGE if param1 == COMPONENT_INFORMATION_ID => {
                let message = self.stations.services.metadata.older_message(at);
                self.out.message(client.link, &message);
                R::MAV_RESULT_ACCEPTED
            }
            MavCmd::MAV_CMD_PREFLIGHT_STORAGE => {
                if param1 == STORAGE_RESET {
                    let purpose = Purpose::Forget(client);
                    match self.stations.services.desk.ask(FileTask::ForgetParameters, purpose, at) {
                        Ok(()) => return true,
                        Err((fault, _)) => {
                            self.out.say(at, Severity::Warning, fault.words().to_owned());
                            R::MAV_RESULT_FAILED
                        }
                    }
                } else if STORAGE_READ_WRITE.contains(&param1) {
                    R::MAV_RESULT_ACCEPTED
                } else {
                    R::MAV_RESULT_DENIED
                }
            }
            MavCmd::MAV_CMD_RUN_PREARM_CHECKS => {
                if self.flight.mode == Mode::Disarmed {
                    self.report_checks(at, true);
                    R::MAV_RESULT_ACCEPTED
                } else {
                    R::MAV_RESULT_TEMPORARILY_REJECTED
                }
            }
            MavCmd::MAV_CMD_USER_4 => {
                return self.program_command(at, client, param1, param2);
            }
            _ => return false,
        };
        self.out.service_ack(client, command, result);
        true
    }

    /// Once a control step: what is due, and what was begun.
    pub(crate) fn service_tick(&mut self, at: HostTime) {
        if !self.stations.services.has_begun {
            self.stations.services.has_begun = true;
            self.stations.restore_plans(at);
        }
        while let Some(purpose) = self.stations.services.desk.overdue(at) {
            self.take_answer(at, purpose, Err(FileFault::TimedOut), &[]);
        }
        self.plan_tick(at);
        self.event_tick(at);
        self.stations.fence_tick(at, &self.flight, &self.estimate);
        self.judge_tick(at);
        for n in 0..self.stations.grounds.len() {
            let link = self.stations.grounds[n].link;
            if !self.out.is_open(link) {
                continue;
            }
            let line_Bps = self.stations.line_Bps(link);
            let buckets = &mut self.stations.services.buckets;
            let mut bucket = match buckets.iter().position(|(l, _)| *l == link) {
                Some(index) => buckets.swap_remove(index).1,
                None => Bucket::default(),
            };
            let mut budget = bucket.step(line_Bps, !self.stations.grounds[n].is_full);
            self.partial_tick(link, &mut budget);
            self.stations.parameter_tick(link, &mut budget, &mut self.out);
            self.stations.log_tick(at, link, &mut budget, &mut self.out);
            self.stations.ftp_tick(at, link, &mut budget, &mut self.out);
            self.stations.services.buckets.push((link, bucket));
            self.stations.settle(n, &mut self.out);
        }
    }

    /// The disk has answered.
    pub(crate) fn file_answer(
        &mut self,
        at: HostTime,
        ticket: u32,
        result: Result<(), FileFault>,
        bytes: &[u8],
    ) {
        if ticket == PARAMETERS_TICKET {
            self.stations.parameters_told(at, result, bytes, &mut self.out);
        } else if let Some(purpose) = self.stations.services.desk.take(ticket) {
            self.take_answer(at, purpose, result, bytes);
        }
    }

    fn take_answer(
        &mut self,
        at: HostTime,
        purpose: Purpose,
        result: Result<(), FileFault>,
        bytes: &[u8],
    ) {
        match (purpose, result) {
            // The file was begun anew, whatever was wrong with it.
            (Purpose::Parameter(_), Ok(())) => self.stations.services.lost.settle(Kept::Parameters),
            (Purpose::SavePlan(_), Ok(())) => {}
            (Purpose::Parameter(name), Err(fault)) => self.out.parameter_not_kept(at, name, fault),
            (Purpose::SavePlan(plan), Err(fault)) => self.out.plan_not_kept(at, plan, fault),
            (Purpose::Forget(client), result) => {
                if result.is_ok() {
                    self.stations.services.lost.settle(Kept::Parameters);
                }
                let (answer, text) = match result {
                    Ok(()) => (
                        MavResult::MAV_RESULT_ACCEPTED,
                        "parameters are those of the configuration after a restart".to_owned(),
                    ),
                    Err(fault) => (MavResult::MAV_RESULT_FAILED, fault.words().to_owned()),
                };
                self.out.service_ack(client, MavCmd::MAV_CMD_PREFLIGHT_STORAGE, answer);
                self.out.say(at, Severity::Info, text);
            }
            (Purpose::LoadPlan(plan), Ok(())) => self.plan_restored(at, plan, bytes),
            // Nothing was kept.
            (Purpose::LoadPlan(_), Err(FileFault::NotFound | FileFault::Off)) => {}
            (Purpose::LoadPlan(plan), Err(fault)) => {
                let why = String::from_utf8_lossy(bytes);
                let why = if why.is_empty() { fault.words().into() } else { why };
                self.stations.note_lost(at, Kept::Plan(plan), &why, &mut self.out);
            }
            (Purpose::Ftp(job), result) => {
                self.stations.ftp_answer(at, job, result, bytes, &mut self.out)
            }
            (Purpose::Logs(job), result) => {
                self.stations.log_answer(at, job, result, bytes, &mut self.out)
            }
            (Purpose::Judge, result) => {
                self.stations.judge_answer(at, result, bytes, &mut self.out)
            }
            (Purpose::StopJudging, _) => {}
            (Purpose::Program(job), result) => self.program_answer(at, job, result, bytes),
        }
    }

    /// Yields the tasks for the disk, in order, and forgets them.
    pub fn drain_file_requests(&mut self, take: impl FnMut(FileRequest)) {
        self.stations.services.desk.drain().for_each(take);
    }

    /// The fence has the last word on what the controller is asked for. A leg that it bars ends in Hold; a
    /// return, on which somebody relies to come down, lands when it has hung there for a while.
    pub(crate) fn keep_inside_fence(&mut self, at: HostTime, command: &mut Command) {
        let plans = &mut self.stations.services.plans;
        let guarded = plans.fence.guard(command, &self.estimate, plans.refuge_m);
        let follows = matches!(self.flight.mode, Mode::Offboard | Mode::Manual);
        if guarded != Some(Guarded::HeldBack) && !(follows && guarded.is_some()) {
            let is_over = |last| at.seconds_since(last) > HELD_OVER_S;
            plans.held_back = plans.held_back.filter(|(_, last)| !is_over(*last));
            return;
        }
        let (since, _) = plans.held_back.unwrap_or((at, at));
        if plans.held_back.replace((since, at)).is_none() {
            let pos = self.estimate.pos_E_m;
            let text = format!("held back by the fence at N {:.2} E {:.2} m", pos.x(), pos.y());
            self.out.say(at, Severity::Warning, text);
        }
        if matches!(self.flight.mode, Mode::Mission | Mode::Goto) {
            self.fire(at, Event::HoldAsked);
        } else if at.seconds_since(since) > HELD_LANDS_S {
            self.fire(at, Event::NoWayHome);
        }
    }

    /// Why the vehicle may not be armed where it stands.
    pub(crate) fn fence_forbids(&self) -> Option<String> {
        let pos = self.estimate.pos_E_m;
        let inside = self.stations.services.plans.fence.contains([pos.x(), pos.y()]);
        (!inside).then(|| format!("outside the fence at N {:.2} E {:.2} m", pos.x(), pos.y()))
    }
}
