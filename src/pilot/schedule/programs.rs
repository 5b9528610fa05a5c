//! Programs by name: missions that lie in a file, or that are built in.
//!
//! `MAV_CMD_USER_4`, param1 = 0: names all, each with its number, as STATUSTEXT. Param1 = number:
//! loads that one as the mission; it is started like any other. Files of `/missions` (MAVLink FTP)
//! come first, in the order of their names, then what is built in.

use haltere_dialect::mav::haltere::{MavCmd, MavResult};

use haltere_core::time::HostTime;

use super::act::Act;
use crate::out::voice::Severity;
use crate::stations::mission_transfer::Client;
use crate::stations::services::files::{FileFault, FileTask};
use crate::stations::services::programs::Job;
use crate::stations::services::{Purpose, plan_file};

/// Most programs that are named.
const MOST_NAMES: usize = 64;
/// Steps in which progress is told.
const QUARTERS: usize = 4;

impl Act<'_> {
    pub(crate) fn program_command(&mut self, at: HostTime, client: Client, number: f32) {
        let job = if number == 0.0 {
            Job::Names(client)
        } else if number.fract() == 0.0 && (1.0..=MOST_NAMES as f32).contains(&number) {
            Job::Number(client, number as u16)
        } else {
            self.out.acknowledge(
                client,
                MavCmd::MAV_CMD_USER_4 as u16,
                MavResult::MAV_RESULT_DENIED,
            );
            let text = format!("program {number}: allowed 0 (names all) to {MOST_NAMES}");
            self.out.say(at, Severity::Warning, text);
            return;
        };
        // An empty name asks for the names.
        self.program_ask(at, FileTask::LoadProgram(String::new()), job);
    }

    /// Tells people how far a program is, at every quarter.
    pub(crate) fn tell_program_progress(&mut self, at: HostTime, seq: u16) {
        let count = self.flight.mission.items.len();
        let quarter = |items: usize| QUARTERS * items / count.max(1);
        let done = usize::from(seq) + 1;
        let Some(name) = self.stations.services.program_in_force(self.flight.mission.id) else {
            return;
        };
        if quarter(done) > quarter(done - 1) {
            let percent = quarter(done) * 100 / QUARTERS;
            let text = format!("program {name}: {percent} %, item {done} of {count} done");
            self.out.say(at, Severity::Info, text);
        }
    }

    fn program_ask(&mut self, at: HostTime, task: FileTask, job: Job) {
        if let Err((fault, Purpose::Program(job))) =
            self.stations.services.desk.ask(task, Purpose::Program(job), at)
        {
            self.program_answer(at, job, Err(fault), &[]);
        }
    }

    pub(crate) fn program_answer(
        &mut self,
        at: HostTime,
        job: Job,
        result: Result<(), FileFault>,
        bytes: &[u8],
    ) {
        let (client, outcome) = match (job, result) {
            (Job::Names(client), Ok(())) => {
                let names = names(bytes);
                for (n, name) in names.iter().enumerate() {
                    self.out.say(at, Severity::Info, format!("program {}: {name}", n + 1));
                }
                (client, Ok(format!("{} programs", names.len())))
            }
            (Job::Number(client, number), Ok(())) => {
                let names = names(bytes);
                match names.get(usize::from(number) - 1) {
                    Some(name) => {
                        let task = FileTask::LoadProgram(name.clone());
                        self.program_ask(at, task, Job::Load(client, name.clone()));
                        return;
                    }
                    None => (client, Err(format!("program {number}: there are {}", names.len()))),
                }
            }
            (Job::Load(client, name), Ok(())) => {
                let outcome = plan_file::decode(bytes)
                    .and_then(|items| self.load_mission(at, items))
                    .map(|count| {
                        self.stations.services.program =
                            Some((self.flight.mission.id, name.clone()));
                        format!("program {name}: mission of {count} items in force")
                    })
                    .map_err(|why| format!("program {name} refused: {why}"));
                (client, outcome)
            }
            (Job::Load(client, name), Err(FileFault::Nonsense)) => {
                let why = String::from_utf8_lossy(bytes);
                (client, Err(format!("program {name} refused: {why}")))
            }
            (Job::Names(client) | Job::Number(client, _) | Job::Load(client, _), Err(fault)) => {
                (client, Err(format!("programs: {}", fault.words())))
            }
        };
        let (answer, severity, text) = match outcome {
            Ok(text) => (MavResult::MAV_RESULT_ACCEPTED, Severity::Info, text),
            Err(text) => (MavResult::MAV_RESULT_FAILED, Severity::Warning, text),
        };
        self.out.acknowledge(client, MavCmd::MAV_CMD_USER_4 as u16, answer);
        self.out.say(at, severity, text);
    }
}

/// The lines of an answer.
fn names(bytes: &[u8]) -> Vec<String> {
    let text = String::from_utf8_lossy(bytes);
    text.lines().take(MOST_NAMES).map(str::to_owned).collect()
}
