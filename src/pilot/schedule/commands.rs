//! Commands of stations that concern several parts, or none of them; what moves the vehicle is in `motion`.

use haltere_dialect::mav::haltere::{
    MavResult, SET_GPS_GLOBAL_ORIGIN_DATA, SET_HOME_POSITION_DATA,
};

use haltere_core::time::HostTime;

use super::act::{Act, Heard};
use crate::flight::modes::{Event, Mode};
use crate::flight::place::room_from_deg;
use crate::flight::place::{Location, WIRE_DEG};
use crate::flight::shown_modes::SHOWN_MODES;
use crate::out::voice::Severity;
use crate::stations::commands::{Answer, Asker, Awaits, Request, refuse};
use crate::stations::identity::{available_mode, standard_mode};
use crate::stations::mission_transfer::Client;
use crate::stations::streams;
use crate::view::around;

/// AVAILABLE_MODES and MESSAGE_INTERVAL, which REQUEST_MESSAGE asks for with a second number.
const AVAILABLE_MODES_ID: f64 = 435.0;
const MESSAGE_INTERVAL_ID: f64 = 244.0;

impl Act<'_> {
    /// MAV_CMD_INJECT_FAILURE: passed on to a board that stands disarmed, whose answer is the answer. What flies, who
    /// ever flies it, is not broken through us: a simulator has an endpoint of its own for that.
    pub(crate) fn inject_failure(&mut self, at: HostTime, request: &Request) -> Answer {
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
    pub(crate) fn cancel(&mut self, at: HostTime, client: Client, command: u16) {
        let is_theirs = |a: &Asker| (a.client, a.command as u16) == (client, command);
        let Some(index) = self.stations.askers.iter().position(is_theirs) else { return };
        let asker = self.stations.askers.remove(index);
        // An order to stop the motors stands: nobody can want it half done.
        if asker.awaits == Awaits::Arm && self.flight.mode == Mode::Arming {
            self.fire(at, Event::DisarmAsked);
        }
        self.out.acknowledge(client, command, MavResult::MAV_RESULT_CANCELLED);
    }

    pub(crate) fn do_set_mode(&mut self, at: HostTime, request: &Request) -> Answer {
        use MavResult as R;
        let p = request.params.map(f64::from);
        if p[0].is_nan() || (p[0] as u32) & 1 == 0 {
            return refuse(R::MAV_RESULT_DENIED, "DO_SET_MODE without custom mode flag");
        }
        if !(p[1].is_finite() && p[1] >= 0.0) {
            return refuse(R::MAV_RESULT_DENIED, "DO_SET_MODE without a mode");
        }
        // Both habits (STATIONS.md): main and sub mode, or the whole number.
        let custom = if p[1] < 256.0 {
            let sub = if p[2].is_finite() { p[2] as u32 & 0xFF } else { 0 };
            (p[1] as u32) << 16 | sub << 24
        } else {
            p[1] as u32
        };
        self.set_custom_mode(at, custom)
    }

    pub(crate) fn do_set_standard_mode(&mut self, at: HostTime, request: &Request) -> Answer {
        let number = request.number(0);
        match standard_mode(number) {
            Some(mode) => self.set_custom_mode(at, mode.custom_mode()),
            None => refuse(
                MavResult::MAV_RESULT_FAILED,
                format!(
                    "no standard mode {number}: there are 5 return, 6 mission, 7 land, 8 take-off"
                ),
            ),
        }
    }

    pub(crate) fn start_mission(&mut self, at: HostTime, request: &Request) -> Answer {
        let p = request.params.map(f64::from);
        let last_item = self.last_item(p)?;
        if p[0].is_finite() && p[0] > 0.0 {
            self.set_current_item(p[0])?;
        }
        self.flight.guidance.last_item = last_item;
        self.ask_mission(at)
    }

    pub(crate) fn pause_or_go_on(&mut self, at: HostTime, request: &Request) -> Answer {
        match request.number(0) {
            0.0 => self.ask(at, Event::HoldAsked, &[Mode::Hold]),
            1.0 => self.ask_mission(at),
            other => refuse(
                MavResult::MAV_RESULT_DENIED,
                format!("pause = {other}, allowed 0 to hold or 1 to go on"),
            ),
        }
    }

    pub(crate) fn command_origin(&mut self, at: HostTime, request: &Request) -> Answer {
        match request.location {
            Location::Int { x, y, z, .. } => self.set_origin(at, x, y, z),
            Location::Float { .. } => {
                let result = MavResult::MAV_RESULT_COMMAND_INT_ONLY;
                refuse(result, "origin refused: send COMMAND_INT")
            }
        }
    }

    pub(crate) fn checks_asked(&mut self, at: HostTime, request: &Request) -> bool {
        let result = if self.flight.mode == Mode::Disarmed {
            self.flight.report_checks(&around!(self, at), true, self.out);
            MavResult::MAV_RESULT_ACCEPTED
        } else {
            MavResult::MAV_RESULT_TEMPORARILY_REJECTED
        };
        self.out.acknowledge(request.client(), request.command as u16, result);
        true
    }

    /// SET_MODE.
    pub(crate) fn set_mode(&mut self, heard: &Heard<'_>, custom_mode: u32) {
        let Heard { at, link, .. } = *heard;
        // No acknowledgement in this message: the heartbeat is the answer.
        if let Err((_, why)) = self.set_custom_mode(at, custom_mode) {
            self.out.say(at, Severity::Warning, why);
        }
        self.send_telemetry(at, link, streams::HEARTBEAT);
        self.send_telemetry(at, link, streams::CURRENT_MODE);
    }

    /// MISSION_SET_CURRENT.
    pub(crate) fn set_current(&mut self, heard: &Heard<'_>, seq: u16) {
        if let Err((_, why)) = self.set_current_item(f64::from(seq)) {
            self.out.say(heard.at, Severity::Warning, why);
        }
        self.send_telemetry(heard.at, heard.link, streams::MISSION_CURRENT);
    }

    /// SET_GPS_GLOBAL_ORIGIN.
    pub(crate) fn origin_set(&mut self, heard: &Heard<'_>, m: &SET_GPS_GLOBAL_ORIGIN_DATA) {
        let alt_m = f64::from(m.altitude) * 1e-3;
        if let Err((_, why)) = self.set_origin(heard.at, m.latitude, m.longitude, alt_m) {
            self.out.say(heard.at, Severity::Warning, why);
        }
    }

    /// SET_HOME_POSITION.
    pub(crate) fn home_set(&mut self, heard: &Heard<'_>, m: &SET_HOME_POSITION_DATA) {
        let [lat, lon] = [m.latitude, m.longitude].map(|w| f64::from(w) * WIRE_DEG);
        if let Err((_, why)) = self.set_home(heard.at, room_from_deg(self.origin, lat, lon)) {
            self.out.say(heard.at, Severity::Warning, why);
        }
    }

    /// MAV_CMD_REQUEST_MESSAGE. Refusals are not told to people: stations try many at connecting.
    pub(crate) fn request_message(&mut self, at: HostTime, request: &Request) -> Answer {
        use MavResult as R;
        let (link, p) = (request.link, request.params.map(f64::from));
        if p[0] == MESSAGE_INTERVAL_ID {
            return self.stations.send_interval(link, p[1], self.out);
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
