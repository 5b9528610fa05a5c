//! What a flight by a program came to: glue judges its log on the floor, the verdict goes to stations
//! as texts and as NAMED_VALUE_FLOAT.
//!
//! It begins by itself when a program that was loaded by name has been flown and the vehicle is
//! disarmed, or by `MAV_CMD_USER_4` with param1 = -1, which is then answered with its progress until it
//! is done. COMMAND_CANCEL ends it, and so does arming: nothing computes beside a flight.

use haltere_dialect::mav::haltere::{
    COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult, NAMED_VALUE_FLOAT_DATA,
};

use haltere_core::time::HostTime;

use super::Purpose;
use super::files::{FileFault, FileTask};
use crate::Pilot;
use crate::flight::modes::Mode;
use crate::out::Out;
use crate::out::voice::Severity;
use crate::stations::Stations;
use crate::stations::mission_transfer::Client;

/// Param1 of `MAV_CMD_USER_4` that asks for a judgement.
pub const ASKED_BY: f32 = -1.0;
/// So long after a flight it is judged, µs: what is said of the landing is in its log by then.
const SETTLE_US: i64 = 3_000_000;
/// Period of asking how far it is, µs.
const POLL_US: i64 = 1_000_000;
/// Progress is told to people in steps of this, percent.
const TELL_PERCENT: u8 = 10;
/// Most lines of a verdict.
const MOST_LINES: usize = 24;

/// One line of a verdict.
#[derive(Debug, Clone, PartialEq)]
pub enum Told {
    /// For people.
    Text(String),
    /// A number with a name of at most 10 characters.
    Value(String, f32),
}

/// How far a judgement is.
#[derive(Debug, Clone, PartialEq)]
pub enum Judgement {
    /// At work.
    Running {
        /// Of what it does now.
        percent: u8,
        /// What it does now.
        what: String,
    },
    /// Done.
    Done(Vec<Told>),
}

impl Judgement {
    /// As the answer of a [`FileTask::Judge`].
    pub fn encode(&self) -> Vec<u8> {
        let one_line = |text: &str| text.replace(['\n', '\t'], " ");
        let text = match self {
            Judgement::Running { percent, what } => {
                format!("running\t{percent}\t{}", one_line(what))
            }
            Judgement::Done(lines) => {
                lines.iter().fold("done".to_owned(), |all, line| match line {
                    Told::Text(text) => format!("{all}\ntext\t{}", one_line(text)),
                    Told::Value(name, value) => {
                        format!("{all}\nvalue\t{}\t{value}", one_line(name))
                    }
                })
            }
        };
        text.into_bytes()
    }

    /// Reads it back. `None`: that is no such answer.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let text = std::str::from_utf8(bytes).ok()?;
        let mut lines = text.lines();
        let head = lines.next()?;
        if head == "done" {
            let told = |line: &str| {
                let (kind, rest) = line.split_once('\t')?;
                match kind {
                    "text" => Some(Told::Text(rest.to_owned())),
                    "value" => {
                        let (name, value) = rest.split_once('\t')?;
                        Some(Told::Value(name.to_owned(), value.parse().ok()?))
                    }
                    _ => None,
                }
            };
            return Some(Judgement::Done(lines.filter_map(told).take(MOST_LINES).collect()));
        }
        let (percent, what) = head.strip_prefix("running\t")?.split_once('\t')?;
        Some(Judgement::Running { percent: percent.parse().ok()?, what: what.to_owned() })
    }
}

/// A judgement under way.
#[derive(Debug)]
struct Running {
    name: String,
    /// Who asked; `None`: it began by itself.
    asker: Option<Client>,
    next_poll: HostTime,
    is_asked: bool,
    told: (String, u8),
}

/// State of the service.
#[derive(Debug, Default)]
pub(crate) struct Judge {
    /// The program that was loaded last, with the id of its mission.
    program: Option<(u32, String)>,
    /// The program of the newest flight.
    flown: Option<String>,
    /// When that ended.
    flown_until: HostTime,
    /// It is to be judged when the vehicle is disarmed.
    is_due: bool,
    running: Option<Running>,
}

impl Judge {
    /// Whether no flight is judged, or is to be.
    pub fn is_idle(&self) -> bool {
        !self.is_due && self.running.is_none()
    }
}

impl Out {
    fn judge_progress(&mut self, client: Client, progress: u8) {
        let message = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command: MavCmd::MAV_CMD_USER_4 as u16,
            result: MavResult::MAV_RESULT_IN_PROGRESS as u8,
            progress,
            result_param2: 0,
            target_system: client.peer.0,
            target_component: client.peer.1,
        });
        self.message(client.link, &message);
    }
}

impl Stations {
    fn begin_judging(&mut self, at: HostTime, asker: Option<Client>, delay_us: i64) {
        let Some(name) = self.services.judge.flown.clone() else { return };
        self.services.judge.running = Some(Running {
            name,
            asker,
            next_poll: at.offset_us(delay_us),
            is_asked: false,
            told: (String::new(), 0),
        });
    }

    /// Ends a judgement that is under way. `false`: there is none.
    fn end_judging(&mut self, at: HostTime, why: &str, out: &mut Out) -> bool {
        let Some(running) = self.services.judge.running.take() else { return false };
        // If it is refused there is nothing to stop.
        let _ = self.services.desk.ask(FileTask::StopJudging, Purpose::StopJudging, at);
        if let Some(client) = running.asker {
            let result = MavResult::MAV_RESULT_CANCELLED;
            out.service_ack(client, MavCmd::MAV_CMD_USER_4, result);
        }
        out.say(at, Severity::Info, format!("judging {} stopped: {why}", running.name));
        true
    }

    /// COMMAND_CANCEL for what this service does. `true`: it was that.
    pub(crate) fn cancel_judging(&mut self, at: HostTime, command: u16, out: &mut Out) -> bool {
        command == MavCmd::MAV_CMD_USER_4 as u16 && self.end_judging(at, "cancelled", out)
    }

    /// Glue says how far it is.
    pub(crate) fn judge_answer(
        &mut self,
        at: HostTime,
        result: Result<(), FileFault>,
        bytes: &[u8],
        out: &mut Out,
    ) {
        let Some(running) = &mut self.services.judge.running else { return };
        running.is_asked = false;
        let judgement = match result {
            Ok(()) => Judgement::decode(bytes),
            Err(FileFault::Busy) => return, // the landing is not on the disk yet
            Err(fault) => {
                let Some(running) = self.services.judge.running.take() else { return };
                let why = match std::str::from_utf8(bytes) {
                    Ok(why) if !why.is_empty() => why.to_owned(),
                    _ => fault.words().to_owned(),
                };
                if let Some(client) = running.asker {
                    let result = MavResult::MAV_RESULT_FAILED;
                    out.service_ack(client, MavCmd::MAV_CMD_USER_4, result);
                }
                // Nobody asked, and nobody can judge this program: no news.
                if running.asker.is_some() || !matches!(fault, FileFault::NotFound | FileFault::Off)
                {
                    let text = format!("{} not judged: {why}", running.name);
                    out.say(at, Severity::Warning, text);
                }
                return;
            }
        };
        match judgement {
            None => {}
            Some(Judgement::Running { percent, what }) => {
                self.judging_goes_on(at, percent, what, out)
            }
            Some(Judgement::Done(lines)) => self.judging_is_done(at, lines, out),
        }
    }

    fn judging_goes_on(&mut self, at: HostTime, percent: u8, what: String, out: &mut Out) {
        let Some(running) = &mut self.services.judge.running else { return };
        let asker = running.asker;
        let (told, told_percent) = &running.told;
        let news = *told != what || percent >= told_percent.saturating_add(TELL_PERCENT);
        if news {
            let text = format!("judging {}: {what} {percent} %", running.name);
            running.told = (what, percent);
            out.say(at, Severity::Info, text);
        }
        if let Some(client) = asker {
            out.judge_progress(client, percent.min(100));
        }
    }

    fn judging_is_done(&mut self, at: HostTime, lines: Vec<Told>, out: &mut Out) {
        let Some(running) = self.services.judge.running.take() else { return };
        for line in lines {
            match line {
                Told::Text(text) => {
                    out.say(at, Severity::Info, format!("{}: {text}", running.name));
                }
                Told::Value(name, value) => {
                    let message = MavMessage::NAMED_VALUE_FLOAT(NAMED_VALUE_FLOAT_DATA {
                        time_boot_ms: (at.as_us() / 1000) as u32,
                        value,
                        name: name.as_str().into(),
                    });
                    out.tell_all(&message);
                }
            }
        }
        if let Some(client) = running.asker {
            out.service_ack(client, MavCmd::MAV_CMD_USER_4, MavResult::MAV_RESULT_ACCEPTED);
        }
    }
}

impl Pilot {
    /// A program is in force as the mission.
    pub(crate) fn program_is_loaded(&mut self, name: &str) {
        self.stations.services.judge.program = Some((self.flight.mission.id, name.to_owned()));
    }

    /// The program that the mission in force is, if it is one.
    pub(crate) fn program_in_force(&self) -> Option<&str> {
        let (id, name) = self.stations.services.judge.program.as_ref()?;
        (*id == self.flight.mission.id).then_some(name)
    }

    /// `MAV_CMD_USER_4` with param1 = -1.
    pub(crate) fn judge_command(&mut self, at: HostTime, client: Client) {
        let judge = &mut self.stations.services.judge;
        // One that began by itself is joined.
        if let Some(running) = &mut judge.running
            && running.asker.is_none_or(|asker| asker == client)
        {
            running.asker = Some(client);
            let percent = running.told.1;
            return self.out.judge_progress(client, percent);
        }
        let refusal = match &judge.flown {
            _ if judge.running.is_some() => Some("somebody waits for a judgement already"),
            None => Some("no program was flown: load one by its name and fly it"),
            Some(_) if self.flight.mode != Mode::Disarmed => {
                Some("flights are judged on the floor")
            }
            Some(_) => None,
        };
        if let Some(why) = refusal {
            let result = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
            self.out.service_ack(client, MavCmd::MAV_CMD_USER_4, result);
            self.out.say(at, Severity::Warning, format!("judging refused: {why}"));
            return;
        }
        self.stations.begin_judging(at, Some(client), 0);
        self.out.judge_progress(client, 0);
    }

    /// Once a control step.
    pub(crate) fn judge_tick(&mut self, at: HostTime) {
        if self.flight.mode == Mode::Mission {
            if let Some(name) = self.program_in_force() {
                let name = name.to_owned();
                self.stations.services.judge.flown = Some(name);
                self.stations.services.judge.is_due = true;
            } else {
                self.stations.services.judge.flown = None;
            }
        }
        if self.flight.mode != Mode::Disarmed {
            self.stations.services.judge.flown_until = at;
            self.stations.end_judging(at, "the vehicle is armed", &mut self.out);
            return;
        }
        if std::mem::take(&mut self.stations.services.judge.is_due) {
            // With what is said of the landing.
            self.stations.services.judge.flown_until = at;
            if self.config.judge_programs {
                self.stations.begin_judging(at, None, SETTLE_US);
            }
        }
        let Some(running) = &mut self.stations.services.judge.running else { return };
        if running.is_asked || at < running.next_poll {
            return;
        }
        running.is_asked = true;
        running.next_poll = at.offset_us(POLL_US);
        let (program, flown_until) =
            (running.name.clone(), self.stations.services.judge.flown_until);
        let task = FileTask::Judge { program, flown_until };
        if let Err((fault, _)) = self.stations.services.desk.ask(task, Purpose::Judge, at) {
            self.stations.judge_answer(at, Err(fault), &[], &mut self.out);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_judgements_come_back_as_they_were() {
        for judgement in [
            Judgement::Running { percent: 37, what: "bank".to_owned() },
            Judgement::Done(Vec::new()),
            Judgement::Done(vec![
                Told::Text("drag: 4.00 1/s, a\u{b1}b".to_owned()),
                Told::Value("KX".to_owned(), -0.125),
            ]),
        ] {
            assert_eq!(Judgement::decode(&judgement.encode()), Some(judgement));
        }
        assert_eq!(Judgement::decode(b"running\t300\tx"), None);
        assert_eq!(Judgement::decode(b"\xff"), None);
        assert_eq!(Judgement::decode(b""), None);
        let spread = Judgement::Done(vec![Told::Text("a\nvalue\tX\t1".to_owned())]);
        let one = Judgement::Done(vec![Told::Text("a value X 1".to_owned())]);
        assert_eq!(Judgement::decode(&spread.encode()), Some(one));
    }
}
