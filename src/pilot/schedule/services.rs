//! The services for stations, as far as they need other parts: what is due, and what the disk has answered.

use haltere_dialect::mav::haltere::{MavCmd, MavResult};

use haltere_core::time::HostTime;

use super::act::Act;
use crate::out::voice::Severity;
use crate::stations::services::budget::Bucket;
use crate::stations::services::kept::Kept;
use crate::stations::services::{FileFault, PARAMETERS_TICKET, Purpose};
use crate::view::around;

impl Act<'_> {
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
        self.flight.event_tick(&around!(self, at), self.out);
        self.stations.fence_tick(at, self.flight, self.estimate);
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
            self.stations.parameter_tick(link, &mut budget, self.out);
            self.stations.log_tick(at, link, &mut budget, self.out);
            self.stations.ftp_tick(at, link, &mut budget, self.out);
            self.stations.services.buckets.push((link, bucket));
            self.stations.settle(n, self.out);
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
            self.stations.parameters_told(at, result, bytes, self.out);
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
                self.out.acknowledge(client, MavCmd::MAV_CMD_PREFLIGHT_STORAGE as u16, answer);
                self.out.say(at, Severity::Info, text);
            }
            (Purpose::LoadPlan(plan), Ok(())) => self.plan_restored(at, plan, bytes),
            // Nothing was kept.
            (Purpose::LoadPlan(_), Err(FileFault::NotFound | FileFault::Off)) => {}
            (Purpose::LoadPlan(plan), Err(fault)) => {
                let why = String::from_utf8_lossy(bytes);
                let why = if why.is_empty() { fault.words().into() } else { why };
                self.stations.note_lost(at, Kept::Plan(plan), &why, self.out);
            }
            (Purpose::Ftp(job), result) => {
                self.stations.ftp_answer(at, job, result, bytes, self.out)
            }
            (Purpose::Logs(job), result) => {
                self.stations.log_answer(at, job, result, bytes, self.out)
            }
            (Purpose::Program(job), result) => self.program_answer(at, job, result, bytes),
        }
    }
}
