//! The link to the inner-loop board: discovery, streams, time, checks, mode, arming.
//!
//! Nothing a board streams is taken for granted, nothing it acknowledges is believed: rates are
//! measured, parameters read back, modes and arming confirmed by its heartbeat, and the setpoint in
//! force compared with the one that was sent. What differs between firmwares is in `profile` and
//! `rules`; docs/BOARDS.md says what was seen of them.

pub(crate) mod armed;
mod arming;
pub(crate) mod checks;
mod clock;
pub(crate) mod control;
mod crtp;
mod encoding;
mod events;
mod instances;
pub(crate) mod lateness;
pub(crate) mod news;
mod orders;
mod pace;
pub(crate) mod peers;
pub(crate) mod profile;
mod response;
mod rules;
mod sensors;
mod speakers;
mod streams;
mod target;
mod timing;

use haltere_dialect::mav::haltere::{
    AUTOPILOT_VERSION_DATA, COMMAND_ACK_DATA, HEARTBEAT_DATA, MavAutopilot, MavCmd, MavMessage,
    MavModeFlag, MavResult, MavState, MavType,
};
use haltere_dialect::mav::known;
use haltere_dialect::mav_stream::{MavFrame, heartbeat_of};

use haltere_core::drops::{DropReason, Drops};
use haltere_core::frames::{B, E, Rot};
use haltere_core::time::HostTime;

use super::crazyflie::{Crazyflie, Told};
use crate::config::BoardProfile;
use crate::input::LinkId;
use crate::out::output::{Address, Outbox};

use armed::{ArmedWord, Said};
use arming::{Arming, Outcome};
use checks::Checks;
use clock::BoardClock;
use control::Control;
use encoding::Encoding;
use events::Events;
use instances::{Instances, Kind};
use lateness::{LATE_S, Lateness};
use news::BoardNews;
use pace::Pace;
use profile::Firmware;
use response::Response;
use sensors::{SLOW_SETS, SlowFields, TextJoiner};
use speakers::Speakers;
use streams::Streams;
use target::TargetWatch;

/// Component id of an onboard computer (MAV_COMP_ID_ONBOARD_COMPUTER).
const OWN_COMPONENT: u8 = 191;
/// The same of a second one (MAV_COMP_ID_ONBOARD_COMPUTER2): a shadow stands beside the companion that flies.
const SHADOW_COMPONENT: u8 = 192;
/// Component id of an autopilot (MAV_COMP_ID_AUTOPILOT1).
const BOARD_COMPONENT: u8 = 1;
/// MAV_AUTOPILOT_INVALID: a component that is no autopilot.
const INVALID_AUTOPILOT: u8 = 8;
/// MAV_STATE: below standby a board is still booting or calibrating.
const STATE_STANDBY: u8 = 3;
const STATE_UNINIT: u8 = 0;

/// TIMESYNC, and questions that an answer may still come to: 1.6 s of them at 10 Hz.
const TIMESYNC_ID: u32 = 111;
const SYNC_KEPT: usize = 16;

const SECOND_US: i64 = 1_000_000;
/// The capability word is asked for so often, µs, and so many times; then the firmware's habit holds.
const VERSION_RETRY_US: i64 = 700_000;
const VERSION_TRIES: u32 = 6;

/// How the link is to be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct LinkConfig {
    pub profile: BoardProfile,
    /// Whether wrong parameters of the board may be set.
    pub set_parameters: bool,
    /// Whether we only watch beside another companion.
    pub shadow: bool,
}

/// State of the link.
#[derive(Debug)]
pub(crate) struct BoardLink {
    config: LinkConfig,
    system_id: Option<u8>,
    firmware: Firmware,
    /// The newest heartbeat.
    beat: Option<HEARTBEAT_DATA>,
    armed: ArmedWord,
    last_heard: Option<HostTime>,
    speakers: Speakers,
    clock: BoardClock,
    pace: Pace,
    lateness: Lateness,
    newest: Newest,
    response: Response,
    sync: Sync,
    next_heartbeat: HostTime,
    streams: Streams,
    checks: Checks,
    version: VersionAsked,
    control: Control,
    target: TargetWatch,
    arming: Arming,
    /// Since when setpoints have been sent without a gap, and the last one.
    streaming: Option<(HostTime, HostTime)>,
    /// We fly it: its mode must be ours.
    held: bool,
    /// Our heartbeat is withheld, so that its own failsafe acts.
    mute: bool,
    slow: [SlowFields; SLOW_SETS],
    /// Which of several are flown on, by [`Kind`].
    instances: [Instances; Kind::COUNT],
    events: Events,
    text: TextJoiner,
    stranger: Option<Stranger>,
    crtp: Crtp,
}

/// What the board sent last, as it was sent.
#[derive(Debug, Clone, Copy, Default)]
struct Newest {
    /// Stamp of the newest sample.
    stamped_at: HostTime,
    /// The newest sample of the IMU: its stamp, its sensor, what it says.
    imu: Option<(u64, u8, [[f32; 3]; 2])>,
    /// The newest pressure that is none.
    odd_pressure: Option<(f64, HostTime)>,
}

/// When its time was asked for.
#[derive(Debug, Clone, Copy)]
struct Sync {
    sent_us: [u64; SYNC_KEPT],
    next_at: HostTime,
    last_at: HostTime,
}

/// How often its version was asked for, and when it is again.
#[derive(Debug, Clone, Copy)]
struct VersionAsked {
    tries: u32,
    next_at: HostTime,
}

/// A board that speaks CRTP.
#[derive(Debug, Default)]
struct Crtp {
    /// Where it is one, in place of all that is MAVLink's here.
    board: Option<Box<Crazyflie>>,
    /// What it has told, until it is taken in.
    told: Vec<Told>,
    /// How often its clock began anew.
    restarts: u32,
}

/// Somebody else on the board's link, as its newest heartbeat says.
#[derive(Debug, Clone, Copy)]
struct Stranger {
    system_id: u8,
    component_id: u8,
    is_autopilot: bool,
    armed: bool,
    at: HostTime,
}

impl BoardLink {
    pub fn new(config: LinkConfig, at: HostTime) -> Self {
        let is_crazyflie = config.profile == BoardProfile::Crazyflie;
        Self {
            config,
            system_id: None,
            firmware: if is_crazyflie { Firmware::Crazyflie } else { Firmware::Generic },
            beat: None,
            armed: ArmedWord::default(),
            last_heard: None,
            speakers: Speakers::default(),
            clock: BoardClock::default(),
            pace: Pace::default(),
            lateness: Lateness::default(),
            newest: Newest::default(),
            response: Response::default(),
            sync: Sync { sent_us: [0; SYNC_KEPT], next_at: at, last_at: at },
            next_heartbeat: at,
            streams: Streams::new(Firmware::Generic, at),
            checks: Checks::new(Firmware::Generic, 1, false, at),
            version: VersionAsked { tries: 0, next_at: at },
            control: Control::default(),
            target: TargetWatch::default(),
            arming: Arming::default(),
            streaming: None,
            held: false,
            mute: false,
            slow: Default::default(),
            instances: Default::default(),
            events: Events::default(),
            text: TextJoiner::default(),
            stranger: None,
            crtp: Crtp { board: is_crazyflie.then(Box::default), ..Crtp::default() },
        }
    }

    /// Who else speaks on the link of a board that does not, for people: the way out may lie there.
    pub fn other_speaker(&self, at: HostTime) -> String {
        let heard = |s: &Stranger| at.seconds_since(s.at) < peers::GONE_S;
        let Some(other) = self.stranger.filter(heard) else { return String::new() };
        let Stranger { system_id, component_id, is_autopilot, armed, .. } = other;
        let what = match (is_autopilot, armed) {
            (false, _) => ", which is no autopilot",
            (true, true) => ", armed, which is not taken for the board before it is disarmed",
            (true, false) => "",
        };
        format!("; system {system_id}, component {component_id} speaks on its link{what}")
    }

    /// The newest pressure that is neither in hPa nor in Pa, as it was sent.
    pub fn odd_pressure(&self) -> Option<(f64, HostTime)> {
        self.newest.odd_pressure
    }

    /// Its system id, once it was found.
    pub fn system_id(&self) -> Option<u8> {
        self.system_id
    }

    /// What it is taken for.
    pub fn firmware(&self) -> Firmware {
        self.firmware
    }

    /// Whether a message is one that we fly by and asked the board for, or part of our talk with it. What motors are
    /// told is for people as well.
    pub fn is_own_stream(&self, msg_id: u32) -> bool {
        msg_id == TIMESYNC_ID
            || (msg_id != 0 && !streams::is_servos(msg_id) && self.streams.is_ours(msg_id))
    }

    /// Whether it is taken for armed: one heartbeat that denies it changes nothing yet.
    pub fn is_armed(&self) -> bool {
        self.armed.is_armed()
    }

    /// Whether somebody here has asked it to disarm since it was last asked to arm.
    pub fn was_told_to_disarm(&self) -> bool {
        self.armed.was_told_to_disarm()
    }

    /// Whether the newest heartbeat says that it is armed.
    fn says_armed(&self) -> bool {
        self.beat.as_ref().is_some_and(says_armed)
    }

    /// How often its clock began anew.
    pub fn clock_restarts(&self) -> u32 {
        self.clock.restarts().max(self.crtp.restarts)
    }

    /// One sigma of the offset of its clock, s.
    pub fn std_clock_s(&self) -> Option<f64> {
        self.clock.std_s()
    }

    /// How long after a tilt was asked for its attitude shows it, s, where that can be told.
    pub fn response_lag_s(&self) -> Option<f64> {
        self.response.lag_s()
    }

    /// How late its link is.
    pub fn lateness(&self) -> &Lateness {
        &self.lateness
    }

    /// Time since anything came from the board, s.
    pub fn silence_s(&self, at: HostTime) -> Option<f64> {
        self.last_heard.map(|t| at.seconds_since(t))
    }

    /// Why it must not be armed, for people: rates, parameters, vehicle type, line.
    pub fn refusal(&self, at: HostTime) -> Option<String> {
        if let Some(crazyflie) = &self.crtp.board {
            return crazyflie.refusal().or_else(|| self.slow_radio());
        }
        if let Some(slow) = self.streams.slow() {
            return Some(slow);
        }
        if !self.firmware.is_real() {
            return self.too_slow(LATE_S);
        }
        let beat = self.beat.as_ref()?;
        let claimed = Firmware::from_autopilot(beat.autopilot);
        if claimed != self.firmware {
            return Some(format!(
                "board.profile is \"{}\", but the board says it is \"{}\" (autopilot {}): write \
                 \"auto\"",
                self.firmware.name(),
                claimed.name(),
                beat.autopilot
            ));
        }
        if let Some(why) = self.checks.refusal(at) {
            return Some(why);
        }
        if !self.firmware.passes_thrust_to(beat.mavtype) {
            return Some(format!(
                "board says vehicle type {}, to which PX4 gives no thrust: set MAV_TYPE to 2 and \
                 restart the board",
                beat.mavtype
            ));
        }
        // PX4 says 0 while the checks of the mode fail that it happens to be in (seen with 1.16.1: HOLD, without a
        // position), and passes them in ours; of its start it says nothing.
        let of_its_mode = self.firmware == Firmware::Px4 && beat.system_status == STATE_UNINIT;
        if beat.system_status < STATE_STANDBY && !of_its_mode {
            return Some(format!("board is still starting (state {})", beat.system_status));
        }
        self.too_slow(pace::SLOW_S)
    }

    fn too_slow(&self, most_s: f64) -> Option<String> {
        let median_s = self.pace.median_s().filter(|s| *s > most_s)?;
        Some(format!(
            "board answers after {:.0} ms, at most {:.0}: its line is too slow for what it \
             carries, 921600 baud are needed",
            median_s * 1e3,
            most_s * 1e3
        ))
    }

    /// Whether the board is in the mode in which it obeys, and flies what we send.
    pub fn obeys(&self) -> bool {
        !self.control.is_away() && !self.target.is_ignored()
    }

    /// Whether it has been in another mode than ours for longer than its grace.
    pub fn has_lost_control(&self) -> bool {
        self.control.is_lost()
    }

    /// Whether it is known not to fly what it is sent.
    pub fn ignores_setpoints(&self) -> bool {
        self.target.is_ignored()
    }

    /// Thrust that was sent, and the one that it says is in force.
    pub fn thrust_sent_and_in_force(&self) -> [f64; 2] {
        [self.target.sent_thrust_frac(), self.target.board_thrust_frac]
    }

    /// The setpoint that the board tells it flies to, whoever sent it: attitude in its own frame, and thrust.
    pub fn target_in_force(&self, at: HostTime) -> Option<(Rot<E, B>, f64)> {
        self.target.in_force(at)
    }

    /// Whether thrust that was sent has come back in its ATTITUDE_TARGET; always for a board that has
    /// none.
    pub fn shows_our_thrust(&self, at: HostTime) -> bool {
        !self.firmware.is_real() || self.target.is_in_force(at)
    }

    /// Time that its motors take to spool up, s: as its parameter says, else as usual.
    pub fn spool_s(&self) -> f64 {
        let told = rules::SPOOL_NAMES.iter().find_map(|name| self.checks.value(name));
        // No spool-up of this class takes longer than the range of a sane parameter.
        told.filter(|s| (0.0..=5.0).contains(s)).unwrap_or(self.firmware.spool_s())
    }

    /// Whether another board with its number speaks on its line.
    pub fn second_speaks(&self, at: HostTime) -> bool {
        self.speakers.second_speaks(at)
    }

    /// How long the board goes on with the last setpoint, s, before it flies by itself: as its parameter says, else as
    /// usual.
    pub fn gives_up_s(&self) -> f64 {
        let told = rules::TIMEOUT_NAMES.iter().find_map(|name| self.checks.value(name));
        told.filter(|s| (0.05..=5.0).contains(s)).unwrap_or(self.firmware.gives_up_s())
    }

    /// The link was opened again: whatever the board knew of us is gone. Unless it flies, it may
    /// even be another board.
    pub fn restart(&mut self, at: HostTime) {
        if let Some(crazyflie) = &mut self.crtp.board {
            crazyflie.restart();
        }
        if !self.is_armed() {
            self.system_id = None;
        }
        self.speakers = Speakers::default();
        self.clock = BoardClock::default();
        self.pace = Pace::default();
        self.lateness = Lateness::default();
        self.response = Response::default();
        self.sync.next_at = at;
        self.next_heartbeat = at;
        self.streams.restart(at);
    }

    /// It is gone, and another one speaks.
    pub fn replaced(&mut self, at: HostTime) {
        self.armed = ArmedWord::default();
        self.beat = None;
        self.restart(at);
        self.streams.forget(at);
    }

    /// The board has restarted: it forgot what it was asked for, and may have other parameters.
    fn rebooted(&mut self, at: HostTime, news: &mut Vec<BoardNews>) {
        self.streams.forget(at);
        self.pace = Pace::default();
        self.begin_checks(at);
        if self.firmware.is_real() {
            let text = "board has restarted: it is asked and checked anew".to_owned();
            news.push(BoardNews::Notice { warning: true, text });
        }
    }

    fn begin_checks(&mut self, at: HostTime) {
        let system_id = self.system_id.unwrap_or(1);
        self.checks = Checks::new(self.firmware, system_id, self.config.set_parameters, at);
        (self.version.tries, self.version.next_at) = (0, at);
    }

    /// Whether this is who we are to the board.
    pub fn is_own_address(&self, (system_id, component_id): (u8, u8)) -> bool {
        self.own_address() == Some(Address { system_id, component_id })
    }

    fn own_component(&self) -> u8 {
        if self.config.shadow { SHADOW_COMPONENT } else { OWN_COMPONENT }
    }

    fn own_address(&self) -> Option<Address> {
        self.system_id.map(|system_id| Address { system_id, component_id: self.own_component() })
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
        if let Some(beat) = heartbeat_of(frame) {
            // A ground station or another companion on the same wire is not the board.
            let is_autopilot =
                header.component_id == BOARD_COMPONENT && beat.autopilot != INVALID_AUTOPILOT;
            if !is_autopilot || self.system_id.is_some_and(|known| known != header.system_id) {
                self.stranger = Some(Stranger {
                    system_id: header.system_id,
                    component_id: header.component_id,
                    is_autopilot,
                    armed: says_armed(&beat),
                    at,
                });
            }
            if !is_autopilot {
                drops.add(DropReason::MavWrongPeer, 1);
                return;
            }
            if self.system_id.is_none() {
                self.found(at, header.system_id, &beat, news);
            }
        }
        if self.system_id != Some(header.system_id) || header.component_id != BOARD_COMPONENT {
            let waits = self.system_id.is_none() && header.component_id == BOARD_COMPONENT;
            drops.add(
                if waits { DropReason::MavBeforeHeartbeat } else { DropReason::MavWrongPeer },
                1,
            );
            return;
        }
        let Some(missing) = self.speakers.note(at, header.sequence) else {
            drops.add(DropReason::MavWrongPeer, 1);
            return;
        };
        drops.add(DropReason::MavSequenceGap, u64::from(missing));
        if let Some(silent_s) = self.silence_s(at).filter(|s| *s > 0.5) {
            news.push(BoardNews::Back { silent_s });
        }
        self.last_heard = Some(at);
        self.streams.note(header.msg_id);
        if let Some(beat) = heartbeat_of(frame) {
            self.heartbeat(at, beat, news);
            return;
        }
        match frame.decode() {
            Ok(message) => self.message(at, &message, out, drops, news),
            Err(_) => drops.add(DropReason::MavUndecodable, 1),
        }
    }

    fn found(
        &mut self,
        at: HostTime,
        system_id: u8,
        beat: &HEARTBEAT_DATA,
        news: &mut Vec<BoardNews>,
    ) {
        self.system_id = Some(system_id);
        self.instances = Default::default();
        let firmware = Firmware::in_force(self.config.profile, beat.autopilot);
        if firmware != self.firmware {
            self.firmware = firmware;
            self.streams = Streams::new(firmware, at);
        }
        self.begin_checks(at);
        news.push(BoardNews::Found { system_id, firmware });
        let claimed = Firmware::from_autopilot(beat.autopilot);
        if firmware == Firmware::Generic && claimed.is_real() {
            let text = format!(
                "board says it is \"{}\" and is flown as \"generic\", unchecked, as board.profile \
                 says",
                claimed.name()
            );
            news.push(BoardNews::Notice { warning: true, text });
        }
    }

    fn heartbeat(&mut self, at: HostTime, beat: HEARTBEAT_DATA, news: &mut Vec<BoardNews>) {
        let armed = says_armed(&beat);
        let custom_mode = beat.custom_mode;
        self.beat = Some(beat);
        match self.armed.heartbeat(at, armed) {
            Some(Said::Armed) => news.push(BoardNews::Armed(true)),
            Some(Said::Disarmed) => news.push(BoardNews::Armed(false)),
            Some(Said::Doubt) if !self.was_told_to_disarm() => news.push(BoardNews::Doubt),
            Some(Said::ArmedAgain { denials }) => news.push(BoardNews::ArmedAgain { denials }),
            Some(Said::Doubt) | None => {}
        }
        if let Some(mode) = self.firmware.control_mode() {
            let change = self.control.heartbeat(at, mode, custom_mode, self.held);
            news.extend(change.map(BoardNews::Mode));
        }
        let outcome = self.arming.heartbeat(at, armed);
        report(outcome, news);
    }

    pub(crate) fn ack(&mut self, at: HostTime, m: &COMMAND_ACK_DATA, news: &mut Vec<BoardNews>) {
        // An answer that is not known is none that was hoped for.
        let result = known(m.result).unwrap_or(MavResult::MAV_RESULT_FAILED);
        match known(m.command) {
            Some(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL) => {
                self.streams.answered(at, result == MavResult::MAV_RESULT_ACCEPTED);
            }
            Some(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM) => {
                let disarms = self.arming.is_disarming();
                let outcome = self.arming.answer(at, result, self.says_armed());
                report(outcome, news);
                let accepted = result == MavResult::MAV_RESULT_ACCEPTED;
                if disarms && accepted && self.armed.disarm_acknowledged() {
                    news.push(BoardNews::Armed(false));
                }
            }
            Some(MavCmd::MAV_CMD_INJECT_FAILURE) if result != MavResult::MAV_RESULT_IN_PROGRESS => {
                news.push(BoardNews::PassedOnAnswer(result));
            }
            // The answer to a mode command is no sign of anything.
            _ => {}
        }
    }

    pub(crate) fn version(&mut self, at: HostTime, m: &AUTOPILOT_VERSION_DATA) {
        self.version.tries = VERSION_TRIES;
        if self.firmware.is_real() {
            self.checks.set_encoding(Encoding::from_capabilities(m.capabilities.bits()), at);
        }
    }

    /// Work that is due at this time: heartbeat, time, streams, checks, repeated commands.
    pub fn tick(&mut self, at: HostTime, out: &mut Outbox, news: &mut Vec<BoardNews>) {
        self.lateness.tick(at);
        if self.crtp.board.is_some() {
            return self.tick_packets(at, out, news);
        }
        self.streams.measure(at);
        // Spoken from the first moment on: a board behind `udpout` answers only who speaks first.
        let speaker =
            Address { system_id: self.system_id.unwrap_or(1), component_id: self.own_component() };
        let due = at >= self.next_heartbeat;
        if due {
            self.next_heartbeat = at.offset_us(SECOND_US);
        }
        if due && !self.mute {
            let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
                custom_mode: 0,
                mavtype: MavType::MAV_TYPE_ONBOARD_CONTROLLER as u8,
                autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID as u8,
                base_mode: MavModeFlag::empty(),
                system_status: MavState::MAV_STATE_ACTIVE as u8,
                mavlink_version: 3,
            });
            out.message(LinkId::Board, speaker, &beat);
        }
        let Some(own) = self.own_address() else { return };
        self.ask_time(at, own, out);
        if let Some((msg_id, interval_us)) = self.streams.ask(at) {
            let params = [msg_id as f32, interval_us as f32];
            self.send_numbers(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, params, 0, out);
        }
        if self.firmware.is_real() {
            self.ask_version(at, out);
            if let Some(request) = self.checks.ask(at, self.is_armed(), news) {
                out.message(LinkId::Board, own, &request);
            }
        }
        self.watch(at, out, news);
        self.proceed_arming(at, out, news);
    }

    fn ask_version(&mut self, at: HostTime, out: &mut Outbox) {
        if self.version.tries < VERSION_TRIES && at >= self.version.next_at {
            self.version.tries += 1;
            self.version.next_at = at.offset_us(VERSION_RETRY_US);
            // AUTOPILOT_VERSION.
            self.send_numbers(MavCmd::MAV_CMD_REQUEST_MESSAGE, [148.0, 0.0], 0, out);
        }
    }
}

/// Whether a frame is one of a board: its heartbeat, or anything else of the board with this system id.
pub(crate) fn speaks_as_board(frame: &MavFrame<'_>, system_id: Option<u8>) -> bool {
    let is_one = |beat: HEARTBEAT_DATA| beat.autopilot != INVALID_AUTOPILOT;
    frame.header.component_id == BOARD_COMPONENT
        && heartbeat_of(frame).map_or(system_id == Some(frame.header.system_id), is_one)
}

/// Whether a heartbeat says that its sender is armed.
pub(crate) fn says_armed(beat: &HEARTBEAT_DATA) -> bool {
    beat.base_mode.contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED)
}

fn report(outcome: Option<Outcome>, news: &mut Vec<BoardNews>) {
    if let Some(Outcome { arm, accepted, why }) = outcome {
        news.push(BoardNews::ArmAnswer { arm, accepted, why });
    }
}
