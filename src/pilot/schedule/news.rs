//! What the board has told, and which part takes it.

use haltere_dialect::mav::haltere::MavResult;

use haltere_core::frames::{U, Vec3, survey_from_earth};
use haltere_core::measure::{AnchorId, Tdoa};
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;

use super::act::Act;
use crate::board::link::control::Change;
use crate::board::link::news::BoardNews;
use crate::board::second_board::Came;
use crate::flight::modes::{Event, Mode};
use crate::out::voice::Severity;
use crate::stations::commands::Awaits;
use crate::view::view;

/// Higher than this by our height the vehicle is in the air, m: from there it falls at 1.4 m/s, and as much more as
/// the height is wrong by near the floor is still no more than 2 m/s.
const AIR_M: f64 = 0.1;
/// Anchors that say they stand farther than this from where they were surveyed are told, m.
const ANCHOR_OFF_M: f64 = 0.1;

impl Act<'_> {
    pub(crate) fn board_bytes(&mut self, at: HostTime, bytes: &[u8]) {
        let mode = self.flight.mode;
        match self.board.bytes(at, mode, bytes, self.out) {
            Came::Nothing => {}
            Came::Frames => self.board_frames(at),
            Came::Moved { late, splitter } => {
                for (came_at, frame) in late.frames() {
                    self.board.splitter.push(frame);
                    self.board_frames(came_at);
                }
                self.board.splitter = splitter;
                self.board.bytes_at = at;
                self.board_frames(at);
            }
        }
        self.board.count_forgotten(self.out);
    }

    pub(crate) fn board_frames(&mut self, at: HostTime) {
        let (routing, stations) = (self.config.routing, &mut *self.stations);
        self.board.frames(at, self.flight.mode, self.out, |link, frame, out| {
            stations.route_from_board(at, routing, link, frame, out);
        });
        self.take_board_news(at);
    }

    /// Also called from the schedule: time alone can bring news.
    pub(crate) fn take_board_news(&mut self, at: HostTime) {
        let mut news = std::mem::take(&mut self.board.news);
        for item in news.drain(..) {
            self.board_item(at, item);
        }
        self.board.news = news;
    }

    fn board_item(&mut self, at: HostTime, item: BoardNews) {
        match item {
            BoardNews::Imu(sample) => {
                let is_over = self.flight.resumption.is_before_its_end(sample.valid_at);
                self.navigation.imu(&view!(self, at), sample, is_over, self.out);
            }
            BoardNews::Attitude(attitude) => {
                let before = self.board.attitude.replace(attitude);
                self.board.down.note(&attitude);
                self.navigation.board_attitude(&view!(self, at), before, &attitude);
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
                if let Some((height_m, dt_s)) = self.navigation.baro(&view!(self, at), &sample) {
                    let above_m = height_m - self.config.flight.gear_height_m;
                    self.flight.resume_at_height(sample.valid_at, above_m);
                    if self.flight.mode == Mode::Descend {
                        self.flight.supervisor.descent.baro(height_m, dt_s);
                    }
                }
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
            BoardNews::Tdoa(tdoa) => self.board_tdoa(at, &tdoa),
            BoardNews::Anchors(told_m) => self.compare_anchors(at, &told_m),
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
                self.arm_answered(at, arm, accepted, &why)
            }
            BoardNews::PassedOnAnswer(result) => {
                self.stations.answer_askers(Awaits::PassedOn, result, self.out)
            }
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

    /// A deck of the board is the tag.
    fn board_tdoa(&mut self, at: HostTime, tdoa: &Tdoa) {
        let view = view!(self, at);
        let resumption = &mut self.flight.resumption;
        let fused = |tdoa: &Tdoa| resumption.uwb(tdoa.valid_at);
        self.navigation.board_tdoa(&view, tdoa, self.out, fused);
    }

    /// Anchors say where they stand: the survey may be of another room, or an anchor was moved. We fly by the survey.
    fn compare_anchors(&mut self, at: HostTime, told_m: &[Option<[f32; 3]>; 8]) {
        let mut off = Vec::new();
        for (id, told_m) in (0..).zip(told_m) {
            let Some(surveyed) = self.survey.position_E_m(AnchorId(id)) else { continue };
            let Some(told_m) = told_m.map(|of| Vec3::<U>::from_array(of.map(f64::from))) else {
                continue;
            };
            let off_m = (survey_from_earth(surveyed) - told_m).norm();
            if off_m > ANCHOR_OFF_M {
                off.push(format!("{id} by {off_m:.1} m"));
            }
        }
        if !off.is_empty() {
            let text = format!(
                "anchors say that they stand elsewhere than the survey has them: {}; flown by the survey",
                off.join(", ")
            );
            self.out.say(at, Severity::Warning, text);
        }
    }

    /// The board has answered an order to arm or to disarm.
    fn arm_answered(&mut self, at: HostTime, arm: bool, accepted: bool, why: &str) {
        let result =
            if accepted { MavResult::MAV_RESULT_ACCEPTED } else { MavResult::MAV_RESULT_FAILED };
        self.stations.answer_askers(Awaits::arming(arm), result, self.out);
        if accepted {
        } else if arm {
            self.out.say(at, Severity::Error, format!("arming failed: {why}"));
            self.fire(at, Event::ArmFailed);
        } else if self.flight.mode == Mode::Disarming {
            // On the floor by our own signs, but the board disagrees.
            self.flight.insist_on_disarming(at, why, self.out, self.wishes);
            self.grant(at);
        } else {
            self.out.say(at, Severity::Error, format!("disarming failed: {why}"));
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
