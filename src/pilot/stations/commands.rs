//! What a command of a client is, and how it is answered: at once, or when the board has.

use haltere_dialect::mav::command_ack;
use haltere_dialect::mav::haltere::{MESSAGE_INTERVAL_DATA, MavCmd, MavMessage, MavResult};

use haltere_core::time::HostTime;

use super::Stations;
use super::mission_transfer::Client;
use crate::flight::place::Location;
use crate::input::LinkId;
use crate::out::Out;
use crate::out::voice::Severity;

/// Clients that wait for the board are told so after this time, s: half of what the most impatient
/// waits for an answer (STATIONS.md: MAVSDK 0.5 s; most of ours come within 20 ms).
const IN_PROGRESS_AFTER_S: f64 = 0.25;
/// … and again so often, s: a board whose sensors settle takes half a minute, and our own client waits
/// 20 s for the next word.
const IN_PROGRESS_AGAIN_S: f64 = 5.0;
/// A command that was passed on is answered for the board after this time, s: most clients ask again or give up by then.
const PASSED_ON_FOR_S: f64 = 3.0;
/// Most clients that wait for the board's answer at once.
const MOST_ASKERS: usize = 8;

/// What the board has to answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Awaits {
    Arm,
    Disarm,
    /// A command that was passed on.
    PassedOn,
}

impl Awaits {
    pub fn arming(arm: bool) -> Self {
        if arm { Self::Arm } else { Self::Disarm }
    }
}

/// Who waits for the answer of the board.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Asker {
    pub client: Client,
    /// What is answered.
    pub command: MavCmd,
    pub awaits: Awaits,
    pub since: HostTime,
    /// How often it was told that it takes its time.
    pub words: u32,
}

/// A command, from either message.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Request {
    pub link: LinkId,
    pub peer: (u8, u8),
    pub command: MavCmd,
    pub params: [f32; 4],
    /// The last three fields.
    pub location: Location,
}

impl Request {
    /// A parameter, from 0 to 3.
    pub fn number(&self, index: usize) -> f64 {
        self.params.get(index).map_or(f64::NAN, |param| f64::from(*param))
    }

    /// Who asks.
    pub fn client(&self) -> Client {
        Client { link: self.link, peer: self.peer }
    }
}

/// A refusal: the result, and what people are told.
pub(crate) type Refusal = (MavResult, String);

/// Answer to a command.
pub(crate) type Answer = Result<MavResult, Refusal>;

pub(crate) fn refuse(result: MavResult, text: impl Into<String>) -> Answer {
    Err((result, text.into()))
}

impl Out {
    pub(crate) fn acknowledge(&mut self, client: Client, command: u16, result: MavResult) {
        self.message(client.link, &command_ack(client.peer, command, result));
    }
}

impl Stations {
    /// A client waits for the board. Asked again it waits once.
    pub(crate) fn wait_for_board(&mut self, at: HostTime, request: &Request, awaits: Awaits) {
        let (client, command) = (request.client(), request.command);
        self.askers.retain(|a| a.client != client || a.awaits != awaits);
        if self.askers.len() < MOST_ASKERS {
            let asker = Asker { client, command, awaits, since: at, words: 0 };
            self.askers.push(asker);
        }
    }

    /// The board has answered what clients wait for.
    pub(crate) fn answer_askers(&mut self, awaits: Awaits, result: MavResult, out: &mut Out) {
        let askers = std::mem::take(&mut self.askers);
        for asker in askers {
            if asker.awaits == awaits {
                out.acknowledge(asker.client, asker.command as u16, result);
            } else {
                self.askers.push(asker);
            }
        }
    }

    /// A board that does not know a command need not answer it.
    fn give_up_passed_on(&mut self, at: HostTime, out: &mut Out) {
        let late =
            |a: &Asker| a.awaits == Awaits::PassedOn && at.seconds_since(a.since) > PASSED_ON_FOR_S;
        if self.askers.iter().any(late) {
            self.answer_askers(Awaits::PassedOn, MavResult::MAV_RESULT_FAILED, out);
            out.say(at, Severity::Warning, "board does not answer a command".to_owned());
        }
    }

    /// Tells clients that wait that they have to.
    pub(crate) fn soothe_askers(&mut self, at: HostTime, out: &mut Out) {
        self.give_up_passed_on(at, out);
        for i in 0..self.askers.len() {
            let asker = self.askers[i];
            let due_s = IN_PROGRESS_AFTER_S + IN_PROGRESS_AGAIN_S * f64::from(asker.words);
            if at.seconds_since(asker.since) > due_s {
                self.askers[i].words += 1;
                let result = MavResult::MAV_RESULT_IN_PROGRESS;
                out.acknowledge(asker.client, asker.command as u16, result);
            }
        }
    }

    pub(crate) fn send_interval(&mut self, link: LinkId, msg_id: f64, out: &mut Out) -> Answer {
        // The casts saturate; NaN is 0.
        let id = if msg_id >= 0.0 { msg_id as u32 } else { u32::MAX };
        let interval_us = self.ground_mut(link).map_or(0, |g| g.streams.interval_us(id));
        let message = MavMessage::MESSAGE_INTERVAL(MESSAGE_INTERVAL_DATA {
            message_id: id as u16,
            interval_us,
        });
        out.message(link, &message);
        Ok(MavResult::MAV_RESULT_ACCEPTED)
    }
    pub(crate) fn set_interval(
        &mut self,
        at: HostTime,
        request: &Request,
        out: &mut Out,
    ) -> Answer {
        let p = request.params.map(f64::from);
        let is_asked = p[0] >= 0.0 && p[1].is_finite();
        if let Some(ground) = self.ground_mut(request.link).filter(|_| is_asked)
            && ground.streams.set_interval(p[0] as u32, p[1], at)
        {
            out.sends_events(request.link, ground.wants_events());
            Ok(MavResult::MAV_RESULT_ACCEPTED)
        } else {
            refuse(MavResult::MAV_RESULT_DENIED, format!("no stream of message {}", p[0]))
        }
    }
}
