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
pub(crate) mod parameters;
mod plan_file;
mod plan_force;
pub(crate) mod plan_wire;
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

use haltere_core::control::Command;
use haltere_core::time::HostTime;

use super::commands::Request;
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

/// Message ids that are sent on request, as a command names them.
const COMPONENT_INFORMATION_ID: f32 = 395.0;
const COMPONENT_METADATA_ID: f32 = 397.0;
/// `MAV_CMD_PREFLIGHT_STORAGE`, param1: reset to the configuration files.
pub(crate) const STORAGE_RESET: f32 = 2.0;
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

impl Out {
    pub(crate) fn service_ack(&mut self, client: Client, command: MavCmd, result: MavResult) {
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
    /// MAV_CMD_REQUEST_MESSAGE of what lies among the files. `false`: it asks for something else.
    pub(crate) fn metadata_asked(&self, at: HostTime, request: &Request, out: &mut Out) -> bool {
        let metadata = &self.services.metadata;
        let message = match request.params[0] {
            COMPONENT_METADATA_ID => metadata.message(at),
            COMPONENT_INFORMATION_ID => metadata.older_message(at),
            _ => return false,
        };
        out.message(request.link, &message);
        out.service_ack(request.client(), request.command, MavResult::MAV_RESULT_ACCEPTED);
        true
    }

    /// MAV_CMD_PREFLIGHT_STORAGE.
    pub(crate) fn storage_asked(&mut self, at: HostTime, request: &Request, out: &mut Out) -> bool {
        let (client, param1) = (request.client(), request.params[0]);
        let result = if param1 == STORAGE_RESET {
            match self.services.desk.ask(FileTask::ForgetParameters, Purpose::Forget(client), at) {
                Ok(()) => return true,
                Err((fault, _)) => {
                    out.say(at, Severity::Warning, fault.words().to_owned());
                    MavResult::MAV_RESULT_FAILED
                }
            }
        } else if STORAGE_READ_WRITE.contains(&param1) {
            MavResult::MAV_RESULT_ACCEPTED
        } else {
            MavResult::MAV_RESULT_DENIED
        };
        out.service_ack(client, request.command, result);
        true
    }

    /// A link is gone: nothing is sent to it any more.
    pub(crate) fn services_forget(&mut self, link: LinkId) {
        self.services.plans.transfer.cancel_link(link);
        self.ftp_forget(link);
        self.logs_forget(link);
        self.services.buckets.retain(|(l, _)| *l != link);
    }
}

impl Pilot {
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
