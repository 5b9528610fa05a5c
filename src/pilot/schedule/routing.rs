//! Frames of stations for others: to other stations, and where wanted to the board.

use haltere_dialect::mav::haltere::{MavCmd, MavMessage};
use haltere_dialect::mav::known;
use haltere_dialect::mav_stream::MavFrame;

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

use super::act::Act;
use super::said;
use crate::flight::arming::SHADOW_WORDS;
use crate::flight::modes::Mode;
use crate::input::LinkId;
use crate::out::voice::Severity;
use crate::stations::clients::is_command;
use crate::stations::endpoint::Routing;
use crate::stations::routing::routed_board;

/// Command and first parameter; `None`: no command. `Some(None)`: one that the dialect does not know.
fn command_of(frame: &MavFrame<'_>, message: Option<&MavMessage>) -> Option<Option<(MavCmd, f32)>> {
    match message {
        Some(MavMessage::COMMAND_LONG(m)) => Some(known(m.command).map(|c| (c, m.param1))),
        Some(MavMessage::COMMAND_INT(m)) => Some(known(m.command).map(|c| (c, m.param1))),
        _ => is_command(frame.header.msg_id).then_some(None),
    }
}

impl Act<'_> {
    /// Said once when a board is found that cannot be told from us.
    pub(crate) fn check_board_id(&mut self, at: HostTime, system_id: u8) {
        if self.config.routing == Routing::Board && system_id == self.out.own.system_id {
            let text = format!(
                "routing to the board refused: its system id is {system_id}, ours too; give it \
                 another (PX4: MAV_SYS_ID, ArduPilot: SYSID_THISMAV), or set ground.routing = \
                 \"stations\""
            );
            self.out.say(at, Severity::Error, text);
        }
    }

    /// Passes on a frame of a station, before it is looked at. `target`: system and component, 0 for
    /// everyone. Whether it went to anybody, now or a moment ago.
    pub(crate) fn route_from_ground(
        &mut self,
        at: HostTime,
        index: usize,
        frame: &MavFrame<'_>,
        message: Option<&MavMessage>,
        target: (u8, u8),
    ) -> bool {
        let sender = (frame.header.system_id, frame.header.component_id);
        let ours = (self.out.own.system_id, self.out.own.component_id);
        // How full the radio of one line is says nothing about others.
        let of_line = matches!(message, Some(MavMessage::RADIO_STATUS(_)));
        if self.config.routing == Routing::Off || of_line || sender == ours || target == ours {
            return false;
        }
        let again = self.out.passed_on.is_again(at, frame.raw);
        let mut passed =
            self.stations.route_to_stations(Some(index), frame, target, again, self.out);
        passed |= !again && self.route_to_board(at, index, frame, message, target);
        self.out.note_passed(at, self.stations.grounds[index].link, frame, again, passed);
        again || passed
    }

    /// Passes a frame of a station on to the board. Whether it went.
    fn route_to_board(
        &mut self,
        at: HostTime,
        index: usize,
        frame: &MavFrame<'_>,
        message: Option<&MavMessage>,
        target: (u8, u8),
    ) -> bool {
        let sender = (frame.header.system_id, frame.header.component_id);
        let Some(board) = routed_board(self.config.routing, &self.board.link, self.out) else {
            return false;
        };
        if target.0 != 0 && target.0 != board {
            return false;
        }
        // Nobody speaks to the board in our name, nor for whom we would not listen to ourselves.
        let link = self.stations.grounds[index].link;
        let claims_us = self.board.link.is_own_address(sender);
        let looks = message.is_some_and(|m| said::looks(frame.header.msg_id, m));
        if claims_us || !self.stations.may_say(link, sender.0, looks) {
            self.out.lose(link, DropReason::NotPermitted, 1);
            return false;
        }
        let shadow = self.config.flight.shadow;
        if shadow || self.is_kept_from_board(frame, message) {
            // What is for everyone is for us first.
            if target.0 == board {
                self.out.lose(LinkId::Board, DropReason::MavWrongPeer, 1);
                let why = if shadow { SHADOW_WORDS } else { "the companion is in control" };
                let text = format!("a frame for the board was not passed on: {why}");
                self.out.refuse_setpoint(at, self.stations.grounds[index].link, text);
            }
            return false;
        }
        self.out.raw(LinkId::Board, frame.raw);
        true
    }

    /// Whether a frame must not reach the board now. Of commands only those pass, while we steer, that ask for
    /// something: one that nobody thought of is kept back. What breaks the board never reaches one that is armed.
    fn is_kept_from_board(&self, frame: &MavFrame<'_>, message: Option<&MavMessage>) -> bool {
        let command = command_of(frame, message);
        if let Some(Some((MavCmd::MAV_CMD_INJECT_FAILURE, _))) = command
            && self.board.link.is_armed()
        {
            return true;
        }
        if self.flight.mode == Mode::Disarmed {
            return false;
        }
        match command {
            Some(Some((command, param1))) => self.steers(command, param1),
            Some(None) => true,
            None => {
                message.is_some() && said::row(frame.header.msg_id).is_some_and(|row| row.steers)
            }
        }
    }
}
