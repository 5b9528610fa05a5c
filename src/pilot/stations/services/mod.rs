//! Services for ground stations: parameters, plans, files, logs, programs.
//!
//! Each is a file of its own, as far as it needs no other part; the rest stands in the folder of the schedule. All are
//! pure: what they want from a disk goes out as a [`FileRequest`] and comes back as an input. What they send on their
//! own initiative is paced by `budget`.

pub(crate) mod budget;
mod crc32;
pub(crate) mod fence_status;
pub(crate) mod files;
pub(crate) mod ftp;
mod ftp_path;
mod ftp_stream;
pub(crate) mod ftp_wire;
pub(crate) mod kept;
pub(crate) mod logs;
mod metadata;
mod param_pack;
mod parameter_list;
mod parameter_table;
pub(crate) mod parameters;
pub(crate) mod plan_file;
pub(crate) mod plan_wire;
pub(crate) mod plans;
pub(crate) mod programs;

pub use crc32::crc32;
pub use files::{
    FileFault, FileName, FileRequest, FileTask, Folder, MOST_MISSION_BYTES, PARAMETERS_TICKET, Plan,
};
pub(crate) use metadata::long as said_of_parameter;
pub use parameter_table::{Parameter, all as all_parameters, find as find_parameter};
pub use plan_file::{decode as decode_plan, encode as encode_plan};

use haltere_dialect::mav::haltere::MavResult;

use haltere_core::time::HostTime;

use super::commands::Request;
use super::mission_transfer::Client;
use crate::config::PilotConfig;
use crate::input::LinkId;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::stations::Stations;

use budget::Bucket;
use fence_status::FenceWatch;
use files::FileDesk;
use ftp::Ftp;
use kept::Lost;
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

/// What an answer of the disk is for.
#[derive(Debug)]
pub(crate) enum Purpose {
    Parameter(&'static str),
    Forget(Client),
    SavePlan(Plan),
    LoadPlan(Plan),
    Ftp(ftp_stream::Job),
    Logs(logs::Job),
    Program(programs::Job),
}

/// State of the services.
#[derive(Debug)]
pub(crate) struct Services {
    pub(crate) desk: FileDesk<Purpose>,
    pub(crate) buckets: Vec<(LinkId, Bucket)>,
    pub(crate) parameters: Parameters,
    pub(crate) metadata: Metadata,
    pub plans: Plans,
    pub(crate) ftp: Ftp,
    pub(crate) logs: Logs,
    pub(crate) fence_watch: FenceWatch,
    /// The program that was loaded last, with the id of its mission.
    pub(crate) program: Option<(u32, String)>,
    pub(crate) lost: Lost,
    pub(crate) has_begun: bool,
}

impl Services {
    pub fn new(config: &PilotConfig) -> Self {
        Self {
            desk: FileDesk::new(config.store),
            buckets: Vec::new(),
            parameters: Parameters::new(config),
            metadata: Metadata::new(),
            plans: Plans::default(),
            ftp: Ftp::default(),
            logs: Logs::default(),
            fence_watch: FenceWatch::default(),
            program: None,
            lost: Lost::default(),
            has_begun: false,
        }
    }

    /// As stations have set it.
    pub fn settings(&self) -> &PilotConfig {
        &self.parameters.wanted
    }

    /// The program that a mission is, if it is one.
    pub fn program_in_force(&self, mission_id: u32) -> Option<&str> {
        let (id, name) = self.program.as_ref()?;
        (*id == mission_id).then_some(name)
    }

    /// Whether nobody waits for anything, and nobody must be told of anything that is missing.
    pub fn is_quiet(&self, at: HostTime) -> bool {
        self.desk.is_idle()
            && self.parameters.is_idle()
            && self.plans.is_idle(at)
            && self.ftp.is_idle()
            && self.logs.is_idle()
            && self.lost.is_nothing()
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
        out.acknowledge(request.client(), request.command as u16, MavResult::MAV_RESULT_ACCEPTED);
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
        out.acknowledge(client, request.command as u16, result);
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
