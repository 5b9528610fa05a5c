//! What the board is told: arming, its mode, setpoints, commands that are passed on.

use haltere_dialect::mav::command_long;
use haltere_dialect::mav::haltere::{
    AttitudeTargetTypemask as TargetMask, MavCmd, MavMessage, SET_ATTITUDE_TARGET_DATA,
};

use haltere_core::frames::{B, E, Rot};
use haltere_core::time::HostTime;

use super::arming::{Seen, Send};
use super::news::BoardNews;
use super::profile::Firmware;
use super::{BOARD_COMPONENT, BoardLink, report};
use crate::input::LinkId;
use crate::out::output::Outbox;

/// `param1` of MAV_CMD_DO_SET_MODE: the mode is a custom one.
const CUSTOM_MODE: f32 = 1.0;
/// A pause between setpoints that counts as a gap in the stream, s.
const GAP_S: f64 = 0.2;

impl BoardLink {
    /// Asks the board to arm or disarm. A forced disarm works in the air.
    pub fn command_arm(&mut self, arm: bool, force: bool, at: HostTime) {
        self.armed.ordered(arm);
        match &mut self.crtp.board {
            Some(crazyflie) => crazyflie.command_arm(arm, force, at),
            None => self.arming.begin(self.firmware, arm, force, at),
        }
    }

    /// The same, after a moment: it has just refused.
    pub fn command_arm_later(&mut self, arm: bool, force: bool, at: HostTime) {
        if self.crtp.board.is_some() {
            return self.command_arm(arm, force, at);
        }
        self.armed.ordered(arm);
        self.arming.begin_later(self.firmware, arm, force, at);
    }

    /// Whether an arm or disarm command still waits for its answer or its confirmation.
    pub fn is_commanding(&self) -> bool {
        match &self.crtp.board {
            Some(crazyflie) => crazyflie.is_commanding(),
            None => self.arming.is_under_way(),
        }
    }

    /// Nobody here began this flight: an armed board is left to its own failsafe. ArduPilot lands when it hears our
    /// heartbeat no more, so a companion that comes back in flight must not speak as if it were in charge. A
    /// mode of a remote control is not touched by that.
    pub fn leave_to_itself(&mut self, stranger: bool) {
        let mode = self.control.custom_mode();
        let in_our_mode =
            mode.zip(self.firmware.control_mode()).is_some_and(|(n, m)| n & m.mask == m.value);
        // A shadow's heartbeat must not stand for that of the companion that flies, whatever the mode.
        let watched = in_our_mode || self.config.shadow;
        self.mute = stranger && self.is_armed() && watched && self.firmware == Firmware::ArduPilot;
    }

    /// Whether the board flies for us from now on, so that its mode must stay ours.
    pub fn hold_control(&mut self, held: bool) {
        if held == self.held {
            return;
        }
        self.held = held;
        if !held {
            self.control.let_go();
            self.target.reset();
        }
    }

    /// Whether it is not in the mode in which it obeys, however shortly, though we count on it.
    pub fn is_away(&self) -> bool {
        self.control.is_away()
    }

    /// Asks for the mode again, in the air, after it was lost.
    pub fn retake(&mut self, at: HostTime) {
        self.control.retake(at);
    }

    /// Whether setpoints are to be streamed because control is being asked for.
    pub fn is_retaking(&self) -> bool {
        self.control.is_retaking()
    }

    /// Name of the mode that the board is in, for people.
    pub fn mode_name(&self) -> String {
        let number = self.control.custom_mode().unwrap_or(0);
        self.firmware.mode_name(number)
    }

    /// Follows mode and setpoint in force.
    pub(super) fn watch(&mut self, at: HostTime, out: &mut Outbox, news: &mut Vec<BoardNews>) {
        let Some(mode) = self.firmware.control_mode() else { return };
        let (ask, change) = self.control.tick(at, mode);
        if ask {
            self.ask_mode(out);
        }
        news.extend(change.map(BoardNews::Mode));
        self.watch_target(at, news);
    }

    /// Follows the setpoint in force.
    pub(super) fn watch_target(&mut self, at: HostTime, news: &mut Vec<BoardNews>) {
        if !self.held {
            return;
        }
        let patience_s = self.spool_s() + self.firmware.held_after_arming_s();
        if let Some(ignored) = self.target.tick(at, patience_s) {
            news.push(BoardNews::Ignored {
                ignored,
                sent_frac: self.target.sent_thrust_frac(),
                board_frac: self.target.board_thrust_frac,
            });
        }
    }

    /// The board tells the setpoint that it flies to.
    pub(super) fn attitude_target(&mut self, at: HostTime, q: [f32; 4], thrust: f32) {
        if let Some(attitude) = Rot::from_wxyz(q.map(f64::from))
            && thrust.is_finite()
        {
            self.target.heard(at, attitude, f64::from(thrust));
        }
    }

    pub(super) fn proceed_arming(
        &mut self,
        at: HostTime,
        out: &mut Outbox,
        news: &mut Vec<BoardNews>,
    ) {
        let has_mode = self.firmware.control_mode().is_some();
        let streaming_s = match self.streaming {
            Some((since, last)) if at.seconds_since(last) < GAP_S => at.seconds_since(since),
            _ => 0.0,
        };
        let seen = Seen {
            armed: self.says_armed(),
            streaming_s,
            mode_s: self.control.ours_since().map(|t| at.seconds_since(t)),
            has_mode,
        };
        let (send, outcome) = self.arming.tick(at, self.firmware, seen);
        match send {
            Send::Nothing => {}
            Send::Mode => self.ask_mode(out),
            Send::Arm(params, confirmation) => {
                let command = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
                self.send_numbers(command, params, confirmation, out);
            }
        }
        report(outcome, news);
    }

    fn ask_mode(&mut self, out: &mut Outbox) {
        let (Some(own), Some(mode)) = (self.own_address(), self.firmware.control_mode()) else {
            return;
        };
        let [main, sub] = mode.command;
        let params = [CUSTOM_MODE, main, sub];
        let command = MavCmd::MAV_CMD_DO_SET_MODE;
        out.message(
            LinkId::Board,
            own,
            &command_long((own.system_id, BOARD_COMPONENT), command, &params, 0),
        );
    }

    /// Sends one attitude and thrust setpoint, attitude in the board's own frame.
    ///
    /// type_mask 7: the three body rates are ignored, the only mask that boards read alike
    /// (BOARDS.md rule 1).
    pub fn send_setpoint(
        &mut self,
        at: HostTime,
        attitude: Rot<E, B>,
        thrust_frac: f64,
        out: &mut Outbox,
    ) {
        if let Some(crazyflie) = &mut self.crtp.board {
            let thrust_frac = crazyflie.setpoint(at, attitude, thrust_frac, out);
            self.response.asked(at, attitude, thrust_frac);
            return self.target.sent(at, attitude, thrust_frac);
        }
        let Some(own) = self.own_address() else { return };
        let since = match self.streaming {
            Some((since, last)) if at.seconds_since(last) < GAP_S => since,
            _ => at,
        };
        self.streaming = Some((since, at));
        self.response.asked(at, attitude, thrust_frac);
        if self.firmware.is_real() {
            self.target.sent(at, attitude, thrust_frac);
        }
        let target = MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
            time_boot_ms: (at.as_us() / 1000) as u32,
            // Unit length to the last bit of the float: ArduPilot drops what is off by 1e-3.
            q: attitude.to_wxyz().map(|c| c as f32),
            body_roll_rate: 0.0,
            body_pitch_rate: 0.0,
            body_yaw_rate: 0.0,
            thrust: thrust_frac as f32,
            target_system: own.system_id,
            target_component: BOARD_COMPONENT,
            type_mask: TargetMask::ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
                | TargetMask::ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
                | TargetMask::ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE,
            thrust_body: [0.0; 3],
        });
        out.message(LinkId::Board, own, &target);
    }

    /// Passes a client's command on.
    pub fn send_command(&self, command: MavCmd, params: [f32; 7], out: &mut Outbox) {
        let Some(own) = self.own_address() else { return };
        out.message(
            LinkId::Board,
            own,
            &command_long((own.system_id, BOARD_COMPONENT), command, &params, 0),
        );
    }

    /// A command of two numbers.
    pub(super) fn send_numbers(
        &self,
        command: MavCmd,
        [a, b]: [f32; 2],
        confirmation: u8,
        out: &mut Outbox,
    ) {
        let Some(own) = self.own_address() else { return };
        let to = (own.system_id, BOARD_COMPONENT);
        let message = command_long(to, command, &[a, b], confirmation);
        out.message(LinkId::Board, own, &message);
    }
}
