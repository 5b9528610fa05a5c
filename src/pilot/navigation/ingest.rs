//! What comes in from tag and board, and its way to the estimator.

use haltere_dialect::mav::haltere::MavResult;

use super::uwb::from_uwb_tdoa;
use haltere_core::drops::DropReason;
use haltere_core::estimate::Health;
use haltere_core::measure::Tdoa;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;

use crate::Pilot;
use crate::board::link::control::Change;
use crate::board::link::news::BoardNews;
use crate::board::link::speaks_as_board;
use crate::config::TagProtocol;
use crate::flight::modes::{Event, Mode};
use crate::input::LinkId;
use crate::out::voice::Severity;
use crate::stations::commands::Awaits;

/// Switches the sniffer to binary output (INTERFACES.md section 1a); lost at every reboot.
const SNIFFER_BINARY: &[u8] = b"b";
/// Without a measurement for so long it is sent again, s.
const TAG_SILENCE_S: f64 = 0.4;
/// Higher than this by our height the vehicle is in the air, m: from there it falls at 1.4 m/s, and as much more as
/// the height is wrong by near the floor is still no more than 2 m/s.
const AIR_M: f64 = 0.1;
/// Heading of the board at alignment, one sigma, rad: a compass indoors.
const STD_BOARD_HEADING_RAD: f64 = 0.1;

impl Pilot {
    pub(crate) fn link_up(&mut self, at: HostTime, link: LinkId) {
        match link {
            LinkId::Tag => {
                self.navigation.uwb.reconnected();
                self.navigation.mav_tag.reconnected();
                self.navigation.tag_splitter.flush();
                self.navigation.tag_is_up = true;
                self.navigation.tag_asked_at = at;
                if self.config.tag_protocol == TagProtocol::LpsSniffer {
                    self.out.raw(LinkId::Tag, SNIFFER_BINARY);
                }
                self.out.say(at, Severity::Info, "tag connected".to_owned());
            }
            LinkId::Board => {
                // The rest of a frame that was cut off will not come.
                self.board.splitter.flush();
                self.board_frames(at);
                self.board.link.restart(at);
                if self.board.link.system_id().is_none() {
                    self.board.peers.forget();
                }
            }
            LinkId::Ground(n) => {
                let n = usize::from(n);
                if n < self.stations.grounds.len() {
                    self.stations.grounds[n].splitter.flush();
                    self.ground_frames(at, n);
                    self.stations.grounds[n].begin_anew(at);
                    self.out.opens(link, self.stations.grounds[n].wants_events());
                    self.greet(at, link);
                }
            }
        }
    }

    pub(crate) fn link_down(&mut self, at: HostTime, link: LinkId) {
        match link {
            LinkId::Tag => {
                self.navigation.tag_is_up = false;
                self.out.say(at, Severity::Error, "tag disconnected".to_owned());
            }
            LinkId::Board => self.out.say(at, Severity::Error, "board disconnected".to_owned()),
            LinkId::Ground(n) => {
                self.services_forget(link);
                self.station_left(at, n);
            }
        }
    }

    /// The station of a link is gone: what it left behind must hold nobody up.
    fn station_left(&mut self, at: HostTime, n: u8) {
        let Some(ground) = self.stations.grounds.get_mut(usize::from(n)) else { return };
        let link = ground.link;
        if !self.out.is_open(link) {
            return;
        }
        let counts = ground.counts;
        ground.begin_anew(at);
        self.out.closes(link);
        self.stations.askers.retain(|asker| asker.link != link);
        self.out.say(
            at,
            Severity::Info,
            format!(
                "station on link {} left: {} frames received, {} lost, {} sent",
                link.number(),
                counts.received,
                counts.lost,
                counts.sent
            ),
        );
    }

    pub(crate) fn tag_bytes(&mut self, at: HostTime, bytes: &[u8]) {
        let mut tdoas = std::mem::take(&mut self.navigation.tdoas);
        let drops = &mut self.out.drops[usize::from(LinkId::Tag.number())];
        match self.config.tag_protocol {
            TagProtocol::LpsSniffer => self.navigation.uwb.tag_bytes(at, bytes, &mut tdoas, drops),
            TagProtocol::Mavlink => {
                self.navigation.tag_splitter.push(bytes);
                while let Some(next) = self.navigation.tag_splitter.next() {
                    crate::stations::clients::count_frame(drops, &next);
                    let Ok(frame) = next else { continue };
                    if let Ok(haltere_dialect::mav::haltere::MavMessage::UWB_TDOA(m)) =
                        frame.decode()
                    {
                        let (tag, uwb) = (&mut self.navigation.mav_tag, &self.config.uwb);
                        match from_uwb_tdoa(tag, uwb, &self.survey, at, &m, drops) {
                            Ok(tdoa) => tdoas.push(tdoa),
                            Err(reason) => drops.add(reason, 1),
                        }
                    }
                }
            }
        }
        if !tdoas.is_empty() {
            self.navigation.tag_asked_at = at;
        }
        for tdoa in &tdoas {
            self.fuse_tdoa(tdoa);
        }
        tdoas.clear();
        self.navigation.tdoas = tdoas;
    }

    /// A tag that restarted without the port noticing speaks text again. The command is harmless to
    /// one that already speaks binary.
    pub(crate) fn ask_for_binary(&mut self, at: HostTime) {
        let silent = at.seconds_since(self.navigation.tag_asked_at) > TAG_SILENCE_S;
        if self.navigation.tag_is_up
            && silent
            && self.config.tag_protocol == TagProtocol::LpsSniffer
        {
            self.navigation.tag_asked_at = at;
            self.out.raw(LinkId::Tag, SNIFFER_BINARY);
        }
    }

    fn fuse_tdoa(&mut self, tdoa: &Tdoa) {
        let record = self.navigation.estimator.tdoa(tdoa);
        if record.fused {
            self.navigation.last_fused = Some(tdoa.received_at);
            self.flight.resumption.uwb(tdoa.valid_at);
        }
        self.navigation.anchors.note(tdoa);
        if self.flight.is_standing() || self.flight.mode != Mode::Disarmed {
            self.navigation.survey_check.note(tdoa, self.flight.mode);
        }
        self.navigation.evidence.note_uwb(&record);
        crate::stations::telemetry_counts::note_pair(&mut self.navigation.pairs, &record);
        self.out.record(|| Topic::Uwb(record));
    }

    pub(crate) fn board_frames(&mut self, at: HostTime) {
        let mut news = std::mem::take(&mut self.board.news);
        // Taken out while the frames are passed on by the rest of the core.
        let mut splitter = std::mem::take(&mut self.board.splitter);
        while let Some(next) = splitter.next() {
            let drops = &mut self.out.drops[usize::from(LinkId::Board.number())];
            crate::stations::clients::count_frame(drops, &next);
            if let Ok(frame) = next {
                self.give_up_board(at, &frame);
                let drops = &mut self.out.drops[usize::from(LinkId::Board.number())];
                if speaks_as_board(&frame, self.board.link.system_id()) {
                    self.board.peers.board_spoke(at, &frame);
                }
                self.board.link.frame(at, &frame, &mut self.out.outbox, drops, &mut news);
                self.route_from_board(at, &frame);
            }
        }
        self.board.splitter = splitter;
        self.take_board_news(at, news);
    }

    /// Also called from the schedule: time alone can bring news.
    pub(crate) fn take_board_news(&mut self, at: HostTime, mut news: Vec<BoardNews>) {
        for item in news.drain(..) {
            self.board_item(at, item);
        }
        self.board.news = news;
    }

    fn board_item(&mut self, at: HostTime, item: BoardNews) {
        match item {
            BoardNews::Imu(sample) => {
                if self.navigation.last_imu.is_some_and(|t| sample.valid_at <= t) {
                    self.out.lose(LinkId::Board, DropReason::ImuOutOfOrder, 1);
                    return;
                }
                let dt_s =
                    self.navigation.last_imu.map_or(0.0, |t| sample.valid_at.seconds_since(t));
                self.navigation.last_imu = Some(sample.valid_at);
                self.navigation.imu = Some(sample);
                self.navigation.repetition.note(&sample);
                let weighed = self.navigation.estimator.weighed(&sample);
                // What repeats itself says nothing new, and what waited in a pause is over.
                let repeats = self.navigation.repetition.acc_s > 0.0;
                if !repeats && !self.flight.resumption.is_before_its_end(sample.valid_at) {
                    self.navigation.touch.acc_z(weighed.acc_B_mps2.z(), dt_s);
                } else if self.navigation.is_numb() {
                    self.navigation.touch.deaf();
                }
                if let Some(board) = &self.board.attitude {
                    self.navigation.lying.imu(&weighed, &board.attitude);
                }
                self.navigation.estimator.imu(&sample);
                self.out.record(|| Topic::Imu(sample));
            }
            BoardNews::Attitude(attitude) => {
                self.navigation.watch_turn(self.board.attitude, &attitude);
                self.board.attitude = Some(attitude);
                self.board.down.note(&attitude);
                self.navigation.estimator.board_vertical(&attitude);
                if self.estimate.health == Health::NotAligned {
                    let yaw_rad = self.navigation.north.room_yaw_rad(attitude.attitude);
                    self.navigation.estimator.set_initial_heading(yaw_rad, STD_BOARD_HEADING_RAD);
                }
                self.out.record(|| Topic::BoardAttitude(attitude));
            }
            BoardNews::Battery(sample) => {
                self.board.battery = Some(sample);
                let flies = self.flight.mode.has_thrust() && self.flight.mode != Mode::Spool;
                self.flight.supervisor.discharge.note(at, sample.supply_v, flies);
                self.out.record(|| Topic::Battery(sample));
            }
            BoardNews::OtherBattery(other) => self.out.record(|| Topic::OtherBattery(other)),
            BoardNews::Servos(servos) => {
                self.board.servos = Some(servos);
                self.out.record(|| Topic::Servos(servos));
            }
            BoardNews::Baro(sample) => {
                self.board.pressure_pa = Some((sample.pressure_pa, sample.received_at));
                self.navigation.estimator.baro(&sample);
                self.watch_baro(&sample);
                self.out.record(|| Topic::Baro(sample));
            }
            BoardNews::Mag(sample) => {
                self.navigation.estimator.mag(&sample);
                self.out.record(|| Topic::Mag(sample));
            }
            BoardNews::Reference(pose) => {
                self.navigation.estimator.reference(&pose); // fuses only if it is configured to
                self.out.record(|| Topic::Reference(pose));
            }
            BoardNews::Found { system_id, firmware } => {
                let name = firmware.name();
                let text = format!("board found, system id {system_id}, flown as {name}");
                self.out.say(at, Severity::Info, text);
                self.check_board_id(at, system_id);
            }
            BoardNews::Armed(true) => {
                if !self.fire(at, Event::BoardArmed)
                    && self.flight.mode == Mode::Disarmed
                    && !self.config.flight.shadow
                {
                    self.tell_armed_by_others(at);
                }
            }
            BoardNews::Armed(false) => {
                self.fire(at, Event::BoardDisarmed);
            }
            BoardNews::Doubt => {
                let text = "board says that it is disarmed: flown on unless it says so again";
                self.out.say(at, Severity::Warning, text.to_owned());
            }
            BoardNews::ArmedAgain { denials } => self.board_armed_again(at, denials),
            BoardNews::ArmAnswer { arm, accepted, why } => {
                let result = if accepted {
                    MavResult::MAV_RESULT_ACCEPTED
                } else {
                    MavResult::MAV_RESULT_FAILED
                };
                self.answer_askers(Awaits::arming(arm), result);
                if accepted {
                } else if arm {
                    self.out.say(at, Severity::Error, format!("arming failed: {why}"));
                    self.fire(at, Event::ArmFailed);
                } else if self.flight.mode == Mode::Disarming {
                    // On the floor by our own signs, but the board disagrees.
                    self.insist_on_disarming(at, &why);
                } else {
                    self.out.say(at, Severity::Error, format!("disarming failed: {why}"));
                }
            }
            BoardNews::PassedOnAnswer(result) => self.answer_askers(Awaits::PassedOn, result),
            BoardNews::Notice { warning, text } => {
                let severity = if warning { Severity::Warning } else { Severity::Info };
                self.out.say(at, severity, text);
            }
            BoardNews::Mode(change) => self.board_mode_changed(at, change),
            BoardNews::Ignored { ignored, sent_frac, board_frac } => {
                // In the air it is one of the supervisor's conditions.
                if ignored && self.flight.mode == Mode::Spool {
                    let text = format!(
                        "board does not fly our setpoints: thrust {board_frac:.2} in force, \
                         {sent_frac:.2} sent"
                    );
                    self.out.say(at, Severity::Critical, text);
                    self.fire(at, Event::SetpointsIgnored);
                }
            }
            BoardNews::Text { severity, text } => {
                self.say_as_board(at, severity, &text);
            }
            BoardNews::Back { silent_s } => {
                let flies = self.flight.mode.has_thrust() || self.flight.mode == Mode::Yielded;
                self.note_pause(at, silent_s);
                if silent_s > self.config.limits.board_loss_s && flies {
                    self.flight.supervisor.heard.board_gap_s = Some(silent_s);
                }
            }
        }
    }

    /// Somebody else armed it, or we were restarted in flight. We send no setpoint into a flight that we did
    /// not start: the board's own failsafe holds.
    fn tell_armed_by_others(&mut self, at: HostTime) {
        let text = "board is armed, but not by us: no setpoints are sent";
        self.out.say(at, Severity::Critical, text.to_owned());
    }

    /// The board denied to be armed and says again that it is. One word that was wrong is forgiven in the air, where
    /// to stop is a fall. Else a person's switch may be behind it, who stands beside the vehicle by now.
    fn board_armed_again(&mut self, at: HostTime, denials: u32) {
        let told_to = self.board.link.was_told_to_disarm();
        if told_to || matches!(self.flight.mode, Mode::Disarmed | Mode::Disarming) {
            return; // It is being disarmed, which goes on.
        }
        let flies = self.flight.mode.has_thrust()
            && self.flight.mode != Mode::Spool
            && self.is_in_the_air();
        if flies && denials <= 1 && !self.board.link.is_away() {
            let text = "board says that it is armed after all: flown on";
            self.out.say(at, Severity::Warning, text.to_owned());
        } else if flies || self.flight.mode == Mode::Yielded {
            self.fire(at, Event::BoardDisarmed);
            self.tell_armed_by_others(at);
        } else {
            let text = "board was disarmed on the floor and is armed again, not by us";
            self.out.say(at, Severity::Critical, text.to_owned());
            self.fire(at, Event::DisarmAsked);
        }
    }

    /// Whether the vehicle is off the floor by our height, or on a way down that has not found it: that ends on the floor
    /// soon, and motors that stop half a metre above it are a fall.
    fn is_in_the_air(&self) -> bool {
        if matches!(self.flight.mode, Mode::Land | Mode::Descend) && !self.navigation.touch.stands {
            return true;
        }
        let height_m = match self.flight.mode {
            Mode::Descend => self.flight.supervisor.descent.height_m,
            _ => self.height_above_floor_m(),
        };
        height_m > AIR_M
    }

    fn board_mode_changed(&mut self, at: HostTime, change: Change) {
        let firmware = self.board.link.firmware();
        let ours = firmware.control_mode().map_or("", |m| m.name);
        match change {
            // One of the supervisor's conditions; at once, or one more setpoint would be sent.
            Change::Lost(_) => self.walk_conditions(at),
            Change::CameBack(mode) => {
                let text =
                    format!("board was in {} and came back to {ours}", firmware.mode_name(mode));
                self.out.say(at, Severity::Warning, text);
            }
            Change::Regained => {
                if self.fire(at, Event::ControlBack)
                    && std::mem::take(&mut self.flight.land_when_back)
                {
                    self.fire(at, Event::LandAsked);
                }
            }
            Change::NotGranted => {
                let text = format!(
                    "board does not go to {ours}, it stays in {}",
                    self.board.link.mode_name()
                );
                self.out.say(at, Severity::Error, text);
            }
        }
    }

    fn say_as_board(&mut self, at: HostTime, severity: u8, text: &str) {
        let level = match severity {
            0..=2 => Severity::Critical,
            3 => Severity::Error,
            4 => Severity::Warning,
            _ => Severity::Info,
        };
        if level == Severity::Critical || self.out.may_echo(at) {
            self.out.say(at, level, format!("board: {text}"));
        }
    }
}
