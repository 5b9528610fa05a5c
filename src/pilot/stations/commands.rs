//! What clients command, and what they are answered. What moves the vehicle is in `orders`.

use haltere_dialect::mav::haltere::{
    COMMAND_ACK_DATA, MESSAGE_INTERVAL_DATA, MavCmd, MavFrame, MavMessage, MavResult,
};
use haltere_dialect::mav::known;

use haltere_core::time::HostTime;

use super::Stations;
use super::identity::{SHOWN_MODES, available_mode, standard_mode};
use super::streams;
use crate::Pilot;
use crate::flight::arming::SHADOW_WORDS;
use crate::flight::modes::{Event, Mode};
use crate::flight::place::Location;
use crate::flight::shadow;
use crate::input::LinkId;
use crate::out::Out;
use crate::out::voice::Severity;

/// AVAILABLE_MODES and MESSAGE_INTERVAL, which REQUEST_MESSAGE asks for with a second number.
const AVAILABLE_MODES_ID: f64 = 435.0;
const MESSAGE_INTERVAL_ID: f64 = 244.0;
/// Clients that wait for the board are told so after this time, s: half of what the most impatient
/// waits for an answer (GROUND.md: MAVSDK 0.5 s; most of ours come within 20 ms).
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
    pub link: LinkId,
    pub peer: (u8, u8),
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

/// A refusal: the result, and what people are told.
pub(crate) type Refusal = (MavResult, String);

/// Answer to a command.
pub(crate) type Answer = Result<MavResult, Refusal>;

pub(crate) fn refuse(result: MavResult, text: impl Into<String>) -> Answer {
    Err((result, text.into()))
}

impl Out {
    fn send_ack(&mut self, link: LinkId, peer: (u8, u8), command: u16, result: MavResult) {
        // 255: how far it is, nobody knows.
        let progress = if result == MavResult::MAV_RESULT_IN_PROGRESS { u8::MAX } else { 0 };
        let message = MavMessage::COMMAND_ACK(COMMAND_ACK_DATA {
            command,
            result: result as u8,
            progress,
            result_param2: 0,
            target_system: peer.0,
            target_component: peer.1,
        });
        self.message(link, &message);
    }
}

impl Stations {
    /// A client waits for the board. Asked again it waits once.
    pub(crate) fn wait_for_board(&mut self, at: HostTime, request: &Request, awaits: Awaits) {
        let Request { link, peer, command, .. } = *request;
        self.askers.retain(|a| (a.link, a.peer) != (link, peer) || a.awaits != awaits);
        if self.askers.len() < MOST_ASKERS {
            let asker = Asker { link, peer, command, awaits, since: at, words: 0 };
            self.askers.push(asker);
        }
    }

    /// The board has answered what clients wait for.
    pub(crate) fn answer_askers(&mut self, awaits: Awaits, result: MavResult, out: &mut Out) {
        let askers = std::mem::take(&mut self.askers);
        for asker in askers {
            if asker.awaits == awaits {
                out.send_ack(asker.link, asker.peer, asker.command as u16, result);
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
                out.send_ack(asker.link, asker.peer, asker.command as u16, result);
            }
        }
    }

    fn send_interval(&mut self, link: LinkId, msg_id: f64, out: &mut Out) -> Answer {
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
}

impl Pilot {
    /// Does what a client commands, by number, and answers whatever it is.
    pub(crate) fn answer(
        &mut self,
        at: HostTime,
        (link, peer): (LinkId, (u8, u8)),
        number: u16,
        params: [f32; 4],
        location: Location,
    ) {
        let unknown_frame = matches!(
            location,
            Location::Int { frame, .. } if known::<MavFrame>(frame).is_none()
        );
        let answer = match known(number) {
            _ if unknown_frame => Ok(MavResult::MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME),
            Some(command) => self.command(at, &Request { link, peer, command, params, location }),
            None => Ok(MavResult::MAV_RESULT_UNSUPPORTED),
        };
        let (result, why) = match answer {
            Ok(MavResult::MAV_RESULT_IN_PROGRESS) => return, // answered when the board has
            Ok(result) => (result, None),
            Err((result, why)) => (result, Some(why)),
        };
        self.out.send_ack(link, peer, number, result);
        if let Some(why) = why {
            self.out.say(at, Severity::Warning, why);
        }
    }

    /// MAV_CMD_INJECT_FAILURE: passed on to a board that stands disarmed, whose answer is the answer. What flies, who
    /// ever flies it, is not broken through us: a simulator has an endpoint of its own for that.
    fn inject_failure(&mut self, at: HostTime, request: &Request) -> Answer {
        let rejected = MavResult::MAV_RESULT_TEMPORARILY_REJECTED;
        if self.flight.mode != Mode::Disarmed || self.board.link.is_armed() {
            let why = "failure injection refused: the board is armed; a simulator takes it at its own \
                       endpoint";
            return refuse(rejected, why);
        }
        if self.board.link.system_id().is_none() {
            return refuse(rejected, "failure injection refused: no board found on its link");
        }
        if self.stations.askers.iter().any(|asker| asker.awaits == Awaits::PassedOn) {
            return refuse(rejected, "failure injection refused: the last one is not answered yet");
        }
        let [unit, kind, instance, other] = request.params;
        let params = [unit, kind, instance, other, 0.0, 0.0, 0.0];
        self.board.link.send_command(request.command, params, &mut self.out.outbox);
        let text = format!("failure passed on to the board: unit {unit} type {kind}");
        self.out.say(at, Severity::Warning, text);
        self.stations.wait_for_board(at, request, Awaits::PassedOn);
        Ok(MavResult::MAV_RESULT_IN_PROGRESS)
    }

    /// COMMAND_CANCEL: what takes its time is ended, and answered as cancelled. What has been done is
    /// left as it is (common.xml).
    pub(crate) fn cancel(&mut self, at: HostTime, link: LinkId, peer: (u8, u8), command: u16) {
        if self.stations.cancel_judging(at, command, &mut self.out) {
            return;
        }
        let is_theirs = |a: &Asker| (a.link, a.peer, a.command as u16) == (link, peer, command);
        let Some(index) = self.stations.askers.iter().position(is_theirs) else { return };
        let asker = self.stations.askers.remove(index);
        // An order to stop the motors stands: nobody can want it half done.
        if asker.awaits == Awaits::Arm && self.flight.mode == Mode::Arming {
            self.fire(at, Event::DisarmAsked);
        }
        self.out.send_ack(link, peer, command, MavResult::MAV_RESULT_CANCELLED);
    }

    fn command(&mut self, at: HostTime, request: &Request) -> Answer {
        use MavResult as R;
        let p = request.params.map(f64::from);
        if self.config.flight.shadow && shadow::refuses(request.command) {
            return refuse(R::MAV_RESULT_DENIED, format!("refused: {SHADOW_WORDS}"));
        }
        match request.command {
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => self.arm_disarm(at, request),
            MavCmd::MAV_CMD_DO_FLIGHTTERMINATION => self.terminate(at, request),
            MavCmd::MAV_CMD_NAV_TAKEOFF | MavCmd::MAV_CMD_NAV_TAKEOFF_LOCAL => {
                self.command_takeoff(at, request)
            }
            MavCmd::MAV_CMD_NAV_LAND | MavCmd::MAV_CMD_NAV_LAND_LOCAL => {
                self.command_land(at, request)
            }
            // MAVProxy's `land`. Without a landing sequence in the mission a landing begins here.
            MavCmd::MAV_CMD_DO_LAND_START => {
                self.ask(at, Event::LandAsked, &[Mode::Land, Mode::Descend])
            }
            MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => {
                self.ask(at, Event::ReturnAsked, &[Mode::Return])
            }
            MavCmd::MAV_CMD_NAV_LOITER_UNLIM => self.ask(at, Event::HoldAsked, &[Mode::Hold]),
            MavCmd::MAV_CMD_DO_SET_MODE => {
                if p[0].is_nan() || (p[0] as u32) & 1 == 0 {
                    return refuse(R::MAV_RESULT_DENIED, "DO_SET_MODE without custom mode flag");
                }
                if !(p[1].is_finite() && p[1] >= 0.0) {
                    return refuse(R::MAV_RESULT_DENIED, "DO_SET_MODE without a mode");
                }
                // Both habits (GROUND.md): main and sub mode, or the whole number.
                let custom = if p[1] < 256.0 {
                    let sub = if p[2].is_finite() { p[2] as u32 & 0xFF } else { 0 };
                    (p[1] as u32) << 16 | sub << 24
                } else {
                    p[1] as u32
                };
                self.set_custom_mode(at, custom)
            }
            MavCmd::MAV_CMD_DO_SET_STANDARD_MODE => match standard_mode(p[0]) {
                Some(mode) => self.set_custom_mode(at, mode.custom_mode()),
                None => refuse(
                    R::MAV_RESULT_FAILED,
                    format!(
                        "no standard mode {}: there are 5 return, 6 mission, 7 land, 8 take-off",
                        p[0]
                    ),
                ),
            },
            MavCmd::MAV_CMD_MISSION_START => {
                let last_item = self.last_item(p)?;
                if p[0].is_finite() && p[0] > 0.0 {
                    self.set_current_item(p[0])?;
                }
                self.flight.guidance.last_item = last_item;
                self.ask_mission(at)
            }
            MavCmd::MAV_CMD_DO_PAUSE_CONTINUE => match p[0] {
                0.0 => self.ask(at, Event::HoldAsked, &[Mode::Hold]),
                1.0 => self.ask_mission(at),
                other => refuse(
                    R::MAV_RESULT_DENIED,
                    format!("pause = {other}, allowed 0 to hold or 1 to go on"),
                ),
            },
            MavCmd::MAV_CMD_DO_REPOSITION => self.reposition(at, request),
            MavCmd::MAV_CMD_DO_CHANGE_SPEED => self.change_speed(p[1]),
            MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT => {
                self.set_current_item(p[0])?;
                Ok(R::MAV_RESULT_ACCEPTED)
            }
            MavCmd::MAV_CMD_CONDITION_YAW => self.turn(p),
            MavCmd::MAV_CMD_DO_SET_HOME => self.command_home(at, request),
            MavCmd::MAV_CMD_DO_SET_GLOBAL_ORIGIN => match request.location {
                Location::Int { x, y, z, .. } => self.set_origin(at, x, y, z),
                Location::Float { .. } => {
                    refuse(R::MAV_RESULT_COMMAND_INT_ONLY, "origin refused: send COMMAND_INT")
                }
            },
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
                let is_asked = p[0] >= 0.0 && p[1].is_finite();
                if let Some(ground) = self.stations.ground_mut(request.link).filter(|_| is_asked)
                    && ground.streams.set_interval(p[0] as u32, p[1], at)
                {
                    self.out.sends_events(request.link, ground.wants_events());
                    Ok(R::MAV_RESULT_ACCEPTED)
                } else {
                    refuse(R::MAV_RESULT_DENIED, format!("no stream of message {}", p[0]))
                }
            }
            MavCmd::MAV_CMD_GET_MESSAGE_INTERVAL => {
                self.stations.send_interval(request.link, p[0], &mut self.out)
            }
            MavCmd::MAV_CMD_REQUEST_MESSAGE => self.request_message(at, request.link, p),
            MavCmd::MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES => {
                self.send_telemetry(at, request.link, streams::AUTOPILOT_VERSION);
                Ok(R::MAV_RESULT_ACCEPTED)
            }
            MavCmd::MAV_CMD_INJECT_FAILURE => self.inject_failure(at, request),
            _ => Ok(R::MAV_RESULT_UNSUPPORTED),
        }
    }

    /// MAV_CMD_REQUEST_MESSAGE. Refusals are not told to people: stations try many at connecting.
    fn request_message(&mut self, at: HostTime, link: LinkId, p: [f64; 4]) -> Answer {
        use MavResult as R;
        if p[0] == MESSAGE_INTERVAL_ID {
            return self.stations.send_interval(link, p[1], &mut self.out);
        }
        if p[0] == AVAILABLE_MODES_ID {
            let all = p[1] == 0.0;
            let identity = self.stations.identity_on(link);
            let mut sent = false;
            for index in 1..=SHOWN_MODES.len() {
                if let Some(message) = available_mode(index, identity)
                    && (all || p[1] == index as f64)
                {
                    self.out.message(link, &message);
                    sent = true;
                }
            }
            return Ok(if sent { R::MAV_RESULT_ACCEPTED } else { R::MAV_RESULT_DENIED });
        }
        let msg_id = if p[0] >= 0.0 { p[0] as u32 } else { u32::MAX };
        if self.send_telemetry(at, link, msg_id) {
            return Ok(R::MAV_RESULT_ACCEPTED);
        }
        let known =
            self.stations.ground_mut(link).is_some_and(|g| g.streams.interval_us(msg_id) != 0);
        Ok(if known {
            // It has nothing to say yet.
            R::MAV_RESULT_TEMPORARILY_REJECTED
        } else {
            R::MAV_RESULT_UNSUPPORTED
        })
    }
}
