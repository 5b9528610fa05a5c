//! What comes in from tag and board, and its way to the estimator.

use haltere_dialect::mav::haltere::MavMessage;

use haltere_core::drops::DropReason;
use haltere_core::estimate::Health;
use haltere_core::measure::{BaroSample, BoardAttitude, ImuSample, Tdoa};
use haltere_core::topics::Topic;

use super::Navigation;
use super::pairs::note_pair;
use super::uwb::from_uwb_tdoa;
use crate::config::TagProtocol;
use crate::flight::modes::Mode;
use crate::input::LinkId;
use crate::out::Out;
use crate::out::losses::count_frame;
use crate::out::voice::Severity;
use crate::view::View;

/// Switches the sniffer to binary output (INTERFACES.md section 1a); lost at every reboot.
const SNIFFER_BINARY: &[u8] = b"b";
/// Without a measurement for so long it is sent again, s.
const TAG_SILENCE_S: f64 = 0.4;
/// Heading of the board at alignment, one sigma, rad: a compass indoors.
const STD_BOARD_HEADING_RAD: f64 = 0.1;

impl Navigation {
    /// The tag was connected.
    pub(crate) fn tag_up(&mut self, view: &View<'_>, out: &mut Out) {
        self.tag.engine.reconnected();
        self.tag.mavlink.reconnected();
        self.tag.splitter.flush();
        self.tag.is_up = true;
        self.tag.asked_at = view.at;
        if view.config.tag_protocol == TagProtocol::LpsSniffer {
            out.raw(LinkId::Tag, SNIFFER_BINARY);
        }
        out.say(view.at, Severity::Info, "tag connected".to_owned());
    }

    /// The tag was disconnected.
    pub(crate) fn tag_down(&mut self, view: &View<'_>, out: &mut Out) {
        self.tag.is_up = false;
        out.say(view.at, Severity::Error, "tag disconnected".to_owned());
    }

    /// Bytes of the tag. `fused` hears of each measurement that was.
    pub(crate) fn tag_bytes(
        &mut self,
        view: &View<'_>,
        bytes: &[u8],
        out: &mut Out,
        mut fused: impl FnMut(&Tdoa),
    ) {
        let at = view.at;
        let mut tdoas = std::mem::take(&mut self.tag.tdoas);
        let drops = &mut out.drops[usize::from(LinkId::Tag.number())];
        match view.config.tag_protocol {
            TagProtocol::LpsSniffer => self.tag.engine.tag_bytes(at, bytes, &mut tdoas, drops),
            TagProtocol::Mavlink => {
                self.tag.splitter.push(bytes);
                while let Some(next) = self.tag.splitter.next() {
                    count_frame(drops, &next);
                    let Ok(frame) = next else { continue };
                    if let Ok(MavMessage::UWB_TDOA(m)) = frame.decode() {
                        let (tag, uwb) = (&mut self.tag.mavlink, &view.config.uwb);
                        match from_uwb_tdoa(tag, uwb, view.survey, at, &m, drops) {
                            Ok(tdoa) => tdoas.push(tdoa),
                            Err(reason) => drops.add(reason, 1),
                        }
                    }
                }
            }
            // Its deck speaks on the board's line.
            TagProtocol::Crazyflie => {}
        }
        if !tdoas.is_empty() {
            self.tag.asked_at = at;
        }
        for tdoa in &tdoas {
            self.fuse_tdoa(view, tdoa, out, &mut fused);
        }
        tdoas.clear();
        self.tag.tdoas = tdoas;
    }

    /// A tag that restarted without the port noticing speaks text again. The command is harmless to
    /// one that already speaks binary.
    pub(crate) fn ask_for_binary(&mut self, view: &View<'_>, out: &mut Out) {
        let at = view.at;
        let silent = at.seconds_since(self.tag.asked_at) > TAG_SILENCE_S;
        if self.tag.is_up && silent && view.config.tag_protocol == TagProtocol::LpsSniffer {
            self.tag.asked_at = at;
            out.raw(LinkId::Tag, SNIFFER_BINARY);
        }
    }

    /// A measurement of a deck of the board.
    pub(crate) fn board_tdoa(
        &mut self,
        view: &View<'_>,
        tdoa: &Tdoa,
        out: &mut Out,
        mut fused: impl FnMut(&Tdoa),
    ) {
        if view.config.tag_protocol != TagProtocol::Crazyflie {
            return;
        }
        let place = |id| view.survey.position_E_m(id);
        let reason = match (place(tdoa.anchor_a), place(tdoa.anchor_b)) {
            (Some(a), Some(b)) => {
                let most_m = (b - a).norm() + view.config.uwb.impossible_margin_m;
                (tdoa.distance_diff_m.abs() > most_m).then_some(DropReason::UwbImpossible)
            }
            _ => Some(DropReason::UwbUnknownAnchor),
        };
        match reason {
            Some(reason) => out.lose(LinkId::Tag, reason, 1),
            None => self.fuse_tdoa(view, tdoa, out, &mut fused),
        }
    }

    fn fuse_tdoa(
        &mut self,
        view: &View<'_>,
        tdoa: &Tdoa,
        out: &mut Out,
        fused: &mut impl FnMut(&Tdoa),
    ) {
        let record = self.estimator.tdoa(tdoa);
        if record.fused {
            self.last_fused = Some(tdoa.received_at);
            fused(tdoa);
        }
        self.anchors.note(tdoa);
        if view.stands || view.mode != Mode::Disarmed {
            self.survey_check.note(tdoa, view.mode);
        }
        self.evidence.note_uwb(&record);
        note_pair(&mut self.pairs, &record);
        out.record(|| Topic::Uwb(record));
    }

    /// A sample of the board's IMU. `is_over`: it had waited in a pause.
    pub(crate) fn imu(&mut self, view: &View<'_>, sample: ImuSample, is_over: bool, out: &mut Out) {
        if self.last_imu.is_some_and(|t| sample.valid_at <= t) {
            out.lose(LinkId::Board, DropReason::ImuOutOfOrder, 1);
            return;
        }
        let dt_s = self.last_imu.map_or(0.0, |t| sample.valid_at.seconds_since(t));
        self.last_imu = Some(sample.valid_at);
        self.imu = Some(sample);
        self.repetition.note(&sample);
        let weighed = self.estimator.weighed(&sample);
        // What repeats itself says nothing new, and what waited in a pause is over.
        let repeats = self.repetition.acc_s > 0.0;
        if !repeats && !is_over {
            self.touch.acc_z(weighed.acc_B_mps2.z(), dt_s);
        } else if self.is_numb() {
            self.touch.deaf();
        }
        if let Some(board) = &view.board.attitude {
            self.lying.imu(&weighed, &board.attitude);
        }
        self.estimator.imu(&sample);
        out.record(|| Topic::Imu(sample));
    }

    /// What the board says of its attitude, now and before.
    pub(crate) fn board_attitude(
        &mut self,
        view: &View<'_>,
        before: Option<BoardAttitude>,
        attitude: &BoardAttitude,
    ) {
        self.watch_turn(before, attitude);
        self.estimator.board_vertical(attitude);
        if view.estimate.health == Health::NotAligned {
            let yaw_rad = self.north.room_yaw_rad(attitude.attitude);
            self.estimator.set_initial_heading(yaw_rad, STD_BOARD_HEADING_RAD);
        }
    }

    /// Air pressure, for the estimator and for whoever does not trust the estimate: the height, m, and the time since the
    /// last one, s, where they are known.
    pub(crate) fn baro(&mut self, view: &View<'_>, sample: &BaroSample) -> Option<(f64, f64)> {
        self.estimator.baro(sample);
        let estimate = view.estimate;
        if view.stands && estimate.health == Health::NotAligned {
            return None;
        }
        // The estimate is of the last step.
        let since_s = estimate.at.seconds_since(sample.valid_at);
        let known_m = -estimate.pos_E_m.z() + estimate.vel_E_mps().z() * since_s;
        let dt_s = self.baro_at.map_or(0.0, |t| sample.valid_at.seconds_since(t));
        self.baro_at = Some(sample.valid_at);
        let height_m = self.evidence.note_baro(sample, known_m, view.stands)?;
        Some((height_m, dt_s))
    }
}
