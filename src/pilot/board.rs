//! The link to the inner-loop board, profile `generic`: discovery, streams, time, arming.
//!
//! Nothing a board streams is taken for granted: every stream is asked for, its rate measured,
//! and asked for again when it falls short (a reboot forgets all of them).

use haltere_dialect::mav::haltere::AttitudeTargetTypemask as TargetMask;
use haltere_dialect::mav::haltere::{
    COMMAND_ACK_DATA, COMMAND_LONG_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavMessage,
    MavModeFlag, MavResult, MavState, MavType, SET_ATTITUDE_TARGET_DATA, TIMESYNC_DATA,
};
use haltere_dialect::mav_stream::{MavFrame, heartbeat_fields};

use crate::drops::{DropReason, Drops};
use crate::frames::{B, E, Rot};
use crate::measure::{BaroSample, BatterySample, BoardAttitude, ImuSample, ReferencePose};
use crate::time::{FcTime, HostTime};

use super::LinkId;
use super::board_sensors::TextJoiner;
use super::clock::BoardClock;
use super::output::{Address, Outbox};

/// Component id of an onboard computer (MAV_COMP_ID_ONBOARD_COMPUTER).
const OWN_COMPONENT: u8 = 191;
/// Component id of an autopilot (MAV_COMP_ID_AUTOPILOT1).
const BOARD_COMPONENT: u8 = 1;
/// Magic number that forces a disarm in the air (common.xml, MAV_CMD_COMPONENT_ARM_DISARM).
const FORCE_DISARM: f32 = 21196.0;

/// TIMESYNC.
const TIMESYNC_ID: u32 = 111;

const SECOND_US: i64 = 1_000_000;
/// TIMESYNC: 10 Hz until locked, then 1 Hz (INTERFACES.md section 2).
const SYNC_FAST_US: i64 = 100_000;
const SYNC_SLOW_US: i64 = SECOND_US;
/// An unanswered command is sent again after this time, µs, this many times.
const COMMAND_RETRY_US: i64 = 400_000;
const COMMAND_TRIES: u32 = 5;
/// After an accepted arm command the heartbeat must show it within this time, µs: it comes at 1 Hz.
const CONFIRM_US: i64 = 2_500_000;

/// What the board link has to tell the core.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum BoardNews {
    Imu(ImuSample),
    Attitude(BoardAttitude),
    Battery(BatterySample),
    Baro(BaroSample),
    Reference(ReferencePose),
    Found {
        system_id: u8,
    },
    Armed(bool),
    /// The board's answer to our arm or disarm command.
    ArmAnswer {
        arm: bool,
        accepted: bool,
        why: String,
    },
    Text {
        severity: u8,
        text: String,
    },
    /// The board was silent for so long, s, and is back.
    Back {
        silent_s: f64,
    },
}

/// A stream that we need, with the messages that can carry it, best first.
#[derive(Debug)]
struct Need {
    candidates: &'static [u32],
    chosen: usize,
    ask_hz: f64,
    least_hz: f64,
    count: u32,
    rate_hz: f64,
    next_ask: HostTime,
}

impl Need {
    fn new(candidates: &'static [u32], ask_hz: f64, least_hz: f64) -> Self {
        Self {
            candidates,
            chosen: 0,
            ask_hz,
            least_hz,
            count: 0,
            rate_hz: 0.0,
            next_ask: HostTime::default(),
        }
    }
}

/// HIGHRES_IMU, SCALED_IMU, RAW_IMU.
const IMU_IDS: &[u32] = &[105, 26, 27];
/// ATTITUDE_QUATERNION, ATTITUDE.
const ATTITUDE_IDS: &[u32] = &[31, 30];
/// BATTERY_STATUS, SYS_STATUS.
const BATTERY_IDS: &[u32] = &[147, 1];

#[derive(Debug, Clone, Copy)]
struct ArmCommand {
    arm: bool,
    force: bool,
    tries: u32,
    next_try: HostTime,
    /// Set once the board accepted: until when its heartbeat must agree.
    confirm_until: Option<HostTime>,
}

/// State of the link.
#[derive(Debug)]
pub(super) struct BoardLink {
    system_id: Option<u8>,
    armed: bool,
    last_heard: Option<HostTime>,
    last_sequence: Option<u8>,
    clock: BoardClock,
    sync_sent_us: [u64; 8],
    next_sync: HostTime,
    next_heartbeat: HostTime,
    needs: [Need; 3],
    asking: Option<(usize, HostTime)>,
    rate_window_start: HostTime,
    arm_command: Option<ArmCommand>,
    pub(super) text: TextJoiner,
}

impl BoardLink {
    pub fn new(at: HostTime) -> Self {
        Self {
            system_id: None,
            armed: false,
            last_heard: None,
            last_sequence: None,
            clock: BoardClock::default(),
            sync_sent_us: [0; 8],
            next_sync: at,
            next_heartbeat: at,
            needs: [
                // Rates of INTERFACES.md section 2.
                Need::new(IMU_IDS, 250.0, 100.0),
                Need::new(ATTITUDE_IDS, 100.0, 50.0),
                Need::new(BATTERY_IDS, 10.0, 2.0),
            ],
            asking: None,
            rate_window_start: at,
            arm_command: None,
            text: TextJoiner::default(),
        }
    }

    /// Its system id, once it was found.
    pub fn system_id(&self) -> Option<u8> {
        self.system_id
    }

    /// Whether a message is one that we asked the board for, or part of our talk with it.
    pub fn is_own_stream(&self, msg_id: u32) -> bool {
        msg_id == TIMESYNC_ID || self.needs.iter().any(|n| n.candidates[n.chosen] == msg_id)
    }

    pub fn is_armed(&self) -> bool {
        self.armed
    }

    pub fn clock(&self) -> &BoardClock {
        &self.clock
    }

    /// Time since anything came from the board, s.
    pub fn silence_s(&self, at: HostTime) -> Option<f64> {
        self.last_heard.map(|t| at.seconds_since(t))
    }

    /// Streams that are slower than the least rate, as text for people.
    pub fn slow_streams(&self) -> Option<String> {
        let slow = self.needs.iter().find(|need| need.rate_hz < need.least_hz)?;
        Some(format!(
            "board sends message {} at {:.0} Hz, at least {:.0} needed",
            slow.candidates[slow.chosen], slow.rate_hz, slow.least_hz
        ))
    }

    pub(super) fn takes_battery_from_sys_status(&self) -> bool {
        BATTERY_IDS[self.needs[2].chosen] == 1
    }

    fn own_address(&self) -> Option<Address> {
        self.system_id.map(|system_id| Address { system_id, component_id: OWN_COMPONENT })
    }

    /// The link was opened again: whatever the board knew of us is gone. Unless it flies, it may
    /// even be another board.
    pub fn restart(&mut self, at: HostTime) {
        if !self.armed {
            self.system_id = None;
        }
        self.last_sequence = None;
        self.clock = BoardClock::default();
        self.next_sync = at;
        self.next_heartbeat = at;
        self.asking = None;
        for need in &mut self.needs {
            need.next_ask = at;
        }
    }

    /// One frame from the board.
    pub fn frame(
        &mut self,
        at: HostTime,
        frame: &MavFrame<'_>,
        out: &mut Outbox,
        drops: &mut Drops,
        news: &mut Vec<BoardNews>,
    ) {
        let header = frame.header;
        if let Some(beat) = heartbeat_fields(frame) {
            // A ground station or another companion on the same wire is not the board.
            if header.component_id != BOARD_COMPONENT || beat.autopilot == INVALID_AUTOPILOT {
                drops.add(DropReason::MavWrongPeer, 1);
                return;
            }
            if self.system_id.is_none() {
                self.system_id = Some(header.system_id);
                news.push(BoardNews::Found { system_id: header.system_id });
            }
        }
        if self.system_id != Some(header.system_id) || header.component_id != BOARD_COMPONENT {
            drops.add(DropReason::MavWrongPeer, 1);
            return;
        }
        if let Some(last) = self.last_sequence {
            let missing = header.sequence.wrapping_sub(last).wrapping_sub(1);
            // Half the ring or more is a reboot or a reordered frame, not a loss.
            if missing < 128 {
                drops.add(DropReason::MavSequenceGap, u64::from(missing));
            }
        }
        self.last_sequence = Some(header.sequence);
        if let Some(silent_s) = self.silence_s(at).filter(|s| *s > 0.5) {
            news.push(BoardNews::Back { silent_s });
        }
        self.last_heard = Some(at);
        for need in &mut self.needs {
            if need.candidates[need.chosen] == header.msg_id {
                need.count += 1;
            }
        }
        if let Some(beat) = heartbeat_fields(frame) {
            let armed = beat.base_mode & MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED.bits() != 0;
            if armed != self.armed {
                self.armed = armed;
                news.push(BoardNews::Armed(armed));
            }
            self.take_heartbeat_as_answer(at, news);
            return;
        }
        match frame.decode() {
            Ok(message) => self.message(at, &message, out, drops, news),
            Err(_) => drops.add(DropReason::MavUndecodable, 1),
        }
    }

    pub(super) fn timesync(
        &mut self,
        at: HostTime,
        m: &TIMESYNC_DATA,
        out: &mut Outbox,
        drops: &mut Drops,
    ) {
        let Some(own) = self.own_address() else { return };
        if m.tc1 == 0 {
            // A question: echo its time and add ours.
            let answer = MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: at.as_us().cast_signed().saturating_mul(1000),
                ts1: m.ts1,
                target_system: own.system_id,
                target_component: BOARD_COMPONENT,
            });
            out.message(LinkId::Board, own, &answer);
            return;
        }
        // An answer, to one of our last questions.
        let sent_us = u64::try_from(m.ts1 / 1000).unwrap_or(0);
        let board_us = u64::try_from(m.tc1 / 1000).unwrap_or(0);
        match self.sync_sent_us.iter_mut().find(|t| **t == sent_us && sent_us != 0) {
            Some(slot) => {
                *slot = 0;
                self.clock.round_trip(HostTime::from_us(sent_us), FcTime::from_us(board_us), at);
            }
            None => drops.add(DropReason::MavIgnored, 1),
        }
    }

    pub(super) fn ack(&mut self, at: HostTime, m: &COMMAND_ACK_DATA, news: &mut Vec<BoardNews>) {
        match m.command {
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL => {
                let Some((index, _)) = self.asking.take() else { return };
                if !matches!(m.result, MavResult::MAV_RESULT_ACCEPTED) {
                    let need = &mut self.needs[index];
                    need.chosen = (need.chosen + 1) % need.candidates.len();
                    need.next_ask = at;
                }
            }
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM => {
                let Some(command) = &mut self.arm_command else { return };
                match m.result {
                    MavResult::MAV_RESULT_ACCEPTED => {
                        if command.confirm_until.is_none() {
                            command.confirm_until = Some(at.offset_us(CONFIRM_US));
                            news.push(BoardNews::ArmAnswer {
                                arm: command.arm,
                                accepted: true,
                                why: String::new(),
                            });
                        }
                        self.confirm_arming(at, news);
                    }
                    MavResult::MAV_RESULT_IN_PROGRESS => {}
                    refused => {
                        news.push(BoardNews::ArmAnswer {
                            arm: command.arm,
                            accepted: false,
                            why: format!("board answered {refused:?}"),
                        });
                        self.arm_command = None;
                    }
                }
            }
            _ => {}
        }
    }

    /// The acknowledgement may be lost; a heartbeat that shows what was asked says as much.
    fn take_heartbeat_as_answer(&mut self, at: HostTime, news: &mut Vec<BoardNews>) {
        let Some(command) = &mut self.arm_command else { return };
        if command.confirm_until.is_none() && command.tries > 0 && command.arm && self.armed {
            command.confirm_until = Some(at);
            let why = String::new();
            news.push(BoardNews::ArmAnswer { arm: command.arm, accepted: true, why });
        }
        self.confirm_arming(at, news);
    }

    /// Whether an arm or disarm command still waits for its answer or its confirmation.
    pub fn is_commanding(&self) -> bool {
        self.arm_command.is_some()
    }

    /// An arm command is done when the heartbeat agrees, not when it was acknowledged.
    fn confirm_arming(&mut self, at: HostTime, news: &mut Vec<BoardNews>) {
        let Some(command) = self.arm_command else { return };
        let Some(until) = command.confirm_until else { return };
        if self.armed == command.arm {
            self.arm_command = None;
        } else if at > until {
            self.arm_command = None;
            news.push(BoardNews::ArmAnswer {
                arm: command.arm,
                accepted: false,
                why: "board accepted, but its heartbeat does not agree".to_owned(),
            });
        }
    }

    /// Asks the board to arm or disarm. A forced disarm works in the air.
    pub fn command_arm(&mut self, arm: bool, force: bool, at: HostTime) {
        self.arm_command =
            Some(ArmCommand { arm, force, tries: 0, next_try: at, confirm_until: None });
    }

    /// Work that is due at this time: heartbeat, time, streams, repeated commands.
    pub fn tick(&mut self, at: HostTime, out: &mut Outbox, news: &mut Vec<BoardNews>) {
        self.measure_rates(at);
        // Spoken from the first moment on: a board behind `udpout` answers only who speaks first.
        let speaker =
            Address { system_id: self.system_id.unwrap_or(1), component_id: OWN_COMPONENT };
        if at >= self.next_heartbeat {
            self.next_heartbeat = at.offset_us(SECOND_US);
            let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                custom_mode: 0,
                mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER,
                autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID,
                base_mode: MavModeFlag::empty(),
                system_status: MavState::MAV_STATE_ACTIVE,
                mavlink_version: 3,
            });
            out.message(LinkId::Board, speaker, &beat);
        }
        let Some(own) = self.own_address() else { return };
        if at >= self.next_sync {
            let period = if self.clock.is_locked() { SYNC_SLOW_US } else { SYNC_FAST_US };
            self.next_sync = at.offset_us(period);
            self.sync_sent_us.rotate_right(1);
            self.sync_sent_us[0] = at.as_us();
            let question = MavMessage::TIMESYNC(TIMESYNC_DATA {
                tc1: 0,
                ts1: at.as_us().cast_signed().saturating_mul(1000),
                target_system: own.system_id,
                target_component: BOARD_COMPONENT,
            });
            out.message(LinkId::Board, own, &question);
        }
        self.ask_streams(at, own, out);
        self.repeat_arming(at, own, out, news);
    }

    fn measure_rates(&mut self, at: HostTime) {
        let window_s = at.seconds_since(self.rate_window_start);
        if window_s < 1.0 {
            return;
        }
        self.rate_window_start = at;
        for need in &mut self.needs {
            need.rate_hz = f64::from(need.count) / window_s;
            need.count = 0;
            if need.rate_hz < need.least_hz && need.next_ask.seconds_since(at) > 1.0 {
                need.next_ask = at;
            }
        }
    }

    /// One request at a time, because an acknowledgement does not say which message it is for.
    fn ask_streams(&mut self, at: HostTime, own: Address, out: &mut Outbox) {
        if let Some((_, since)) = self.asking {
            if at.seconds_since(since) < 0.5 {
                return;
            }
            self.asking = None;
        }
        let Some(index) = self.needs.iter().position(|need| at >= need.next_ask) else { return };
        let need = &mut self.needs[index];
        // Asked again after 1.5 s if the rate stays short; `measure_rates` brings it forward.
        let again_us = if need.rate_hz < need.least_hz { 3 * SECOND_US / 2 } else { i64::MAX };
        need.next_ask = at.offset_us(again_us);
        self.asking = Some((index, at));
        let request = command_long(
            own.system_id,
            MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL,
            [
                need.candidates[need.chosen] as f32,
                (1e6 / need.ask_hz) as f32,
                0.0,
                0.0,
                0.0,
                0.0,
                0.0,
            ],
            0,
        );
        out.message(LinkId::Board, own, &request);
    }

    fn repeat_arming(
        &mut self,
        at: HostTime,
        own: Address,
        out: &mut Outbox,
        news: &mut Vec<BoardNews>,
    ) {
        self.confirm_arming(at, news);
        let Some(command) = &mut self.arm_command else { return };
        if command.confirm_until.is_some() || at < command.next_try {
            return;
        }
        if command.tries == COMMAND_TRIES {
            news.push(BoardNews::ArmAnswer {
                arm: command.arm,
                accepted: false,
                why: format!("board did not answer {COMMAND_TRIES} times"),
            });
            self.arm_command = None;
            return;
        }
        let force = if command.force { FORCE_DISARM } else { 0.0 };
        let request = command_long(
            own.system_id,
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            [f32::from(u8::from(command.arm)), force, 0.0, 0.0, 0.0, 0.0, 0.0],
            command.tries as u8,
        );
        command.tries += 1;
        command.next_try = at.offset_us(COMMAND_RETRY_US);
        out.message(LinkId::Board, own, &request);
    }

    /// Sends one attitude and thrust setpoint, attitude in the board's own frame.
    ///
    /// type_mask 7: the three body rates are ignored, the only mask that boards read alike
    /// (BOARDS.md rule 1).
    pub fn send_setpoint(
        &self,
        at: HostTime,
        attitude: Rot<E, B>,
        thrust_frac: f64,
        out: &mut Outbox,
    ) {
        let Some(own) = self.own_address() else { return };
        let target = MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
            time_boot_ms: (at.as_us() / 1000) as u32,
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

    /// Passes a fault injection on to a board that understands it (the simulator's does).
    pub fn send_command(&self, command: MavCmd, params: [f32; 7], out: &mut Outbox) {
        let Some(own) = self.own_address() else { return };
        out.message(LinkId::Board, own, &command_long(own.system_id, command, params, 0));
    }
}

/// MAV_AUTOPILOT_INVALID: a component that is no autopilot.
const INVALID_AUTOPILOT: u8 = 8;

fn command_long(
    target_system: u8,
    command: MavCmd,
    params: [f32; 7],
    confirmation: u8,
) -> MavMessage {
    MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        param1: params[0],
        param2: params[1],
        param3: params[2],
        param4: params[3],
        param5: params[4],
        param6: params[5],
        param7: params[6],
        command,
        target_system,
        target_component: BOARD_COMPONENT,
        confirmation,
    })
}
