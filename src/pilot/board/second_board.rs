//! Bytes on the board's link by their sender: the board's own, those of a second one, and the way from one address
//! to another.

use haltere_dialect::mav_stream::{MavFrame, MavSplitter, heartbeat_of};

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

use super::Board;
use super::link::peers::{Late, Peers};
use super::link::{BoardLink, says_armed, speaks_as_board};
use crate::flight::modes::Mode;
use crate::input::LinkId;
use crate::out::Out;
use crate::out::losses::count_frame;
use crate::out::voice::Severity;

/// What came on the board's link.
#[derive(Debug)]
pub(crate) enum Came {
    /// Nothing of the board's.
    Nothing,
    /// Bytes of the board.
    Frames,
    /// The board speaks from a new address: what it had said there already, and what has come since.
    Moved { late: Late, splitter: MavSplitter },
}

impl Board {
    /// Takes bytes of its link in, of which the sender was told.
    pub(crate) fn bytes(&mut self, at: HostTime, mode: Mode, bytes: &[u8], out: &mut Out) -> Came {
        if self.link.is_crazyflie() {
            let drops = &mut out.drops[usize::from(LinkId::Board.number())];
            self.link.packets(at, bytes, &mut out.outbox, drops, &mut self.news);
            return Came::Frames;
        }
        match self.peers.other(at) {
            Ok(None) => {
                self.bytes_at = at;
                self.splitter.push(bytes);
                Came::Frames
            }
            Ok(Some(index)) => self.other_bytes((at, mode), index, bytes, out),
            Err(()) => {
                out.lose(LinkId::Board, DropReason::MavWrongPeer, 1);
                Came::Nothing
            }
        }
    }

    /// Bytes of somebody else than the board, who may be the board at a new address.
    fn other_bytes(
        &mut self,
        (at, mode): (HostTime, Mode),
        index: usize,
        bytes: &[u8],
        out: &mut Out,
    ) -> Came {
        let Some(other) = self.peers.other_mut(index) else { return Came::Nothing };
        let mut splitter = std::mem::take(&mut other.splitter);
        splitter.push(bytes);
        while let Some(next) = splitter.next() {
            count_frame(out.drops_of(LinkId::Board), &next);
            let Ok(frame) = next else { continue };
            if !speaks_as_board(&frame, self.link.system_id()) {
                // Until a heartbeat tells who the board is, all that it says is early.
                let reason = match self.link.system_id() {
                    Some(_) => DropReason::MavWrongPeer,
                    None => DropReason::MavBeforeHeartbeat,
                };
                out.lose(LinkId::Board, reason, 1);
                continue;
            }
            self.peers.other_spoke(at, index, &frame);
            if !self.is_new_address((at, mode), index, &frame, out) {
                continue;
            }
            // The rest of what was cut off at the old address will not come.
            self.splitter = MavSplitter::new();
            // What it said while nobody knew who it is: half of it are IMU samples, without which a turn goes unseen.
            return Came::Moved { late: self.peers.bind(index), splitter };
        }
        if let Some(other) = self.peers.other_mut(index) {
            other.splitter = splitter;
        }
        Came::Nothing
    }

    /// Reads the frames that have come. `pass_on` may send each to others.
    pub(crate) fn frames(
        &mut self,
        at: HostTime,
        mode: Mode,
        out: &mut Out,
        mut pass_on: impl FnMut(&BoardLink, &MavFrame<'_>, &mut Out),
    ) {
        // Taken out while the frames are answered.
        let mut splitter = std::mem::take(&mut self.splitter);
        while let Some(next) = splitter.next() {
            count_frame(out.drops_of(LinkId::Board), &next);
            let Ok(frame) = next else { continue };
            self.give_up(at, mode, &frame, out);
            if speaks_as_board(&frame, self.link.system_id()) {
                self.peers.board_spoke(at, &frame);
            }
            let drops = &mut out.drops[usize::from(LinkId::Board.number())];
            self.link.frame(at, &frame, &mut out.outbox, drops, &mut self.news);
            pass_on(&self.link, &frame, out);
        }
        self.splitter = splitter;
    }

    /// What is due to it by time: heartbeats, questions, orders. A shadow keeps back what arms or moves.
    pub(crate) fn tick(&mut self, at: HostTime, out: &mut Out) {
        self.link.tick(at, &mut out.outbox, &mut self.news);
    }

    /// Counts the frames of those who were forgotten.
    pub(crate) fn count_forgotten(&mut self, out: &mut Out) {
        let forgotten = self.peers.take_forgotten();
        if forgotten > 0 {
            out.lose(LinkId::Board, DropReason::MavWrongPeer, forgotten);
        }
    }

    /// The silence of the board, s.
    pub(crate) fn silence_s(&self, at: HostTime) -> f64 {
        self.link.silence_s(at).unwrap_or(f64::INFINITY)
    }

    /// Whether it is we who do not listen to the board yet, at the address that it seems to speak from by now.
    pub(crate) fn is_moving(&self, at: HostTime) -> bool {
        self.peers.is_moving(at, self.silence_s(at))
    }

    /// A second board that speaks on the link of the first, for people.
    pub(crate) fn second(&self, at: HostTime) -> Option<String> {
        let system_id = self.link.system_id()?;
        if self.link.second_speaks(at) {
            return Some(format!(
                "a second board with system id {system_id} speaks on the line of ours"
            ));
        }
        let first = self.peers.board()?;
        let second = self.peers.second(at, system_id, self.silence_s(at))?;
        Some(format!(
            "a second board with system id {system_id} speaks at {second}, beside ours at {first}"
        ))
    }

    /// A board that is disarmed and silent loses its place to another system that speaks on its line, disarmed: a
    /// stray heartbeat that came first must not be the board for ever, nor the number that a board had before.
    fn give_up(&mut self, at: HostTime, mode: Mode, frame: &MavFrame<'_>, out: &mut Out) {
        let Some(was) = self.link.system_id().filter(|id| *id != frame.header.system_id) else {
            return;
        };
        let disarmed = heartbeat_of(frame).is_some_and(|beat| !says_armed(&beat));
        let rests = mode == Mode::Disarmed && !self.link.is_armed();
        let gone = Peers::is_gone(self.silence_s(at));
        if disarmed && rests && gone && speaks_as_board(frame, None) {
            self.link.replaced(at);
            let now = frame.header.system_id;
            let text = format!(
                "board with system id {was} is silent, another one speaks: system id {now}"
            );
            out.say(at, Severity::Warning, text);
        }
    }

    /// Who else speaks where a board is missed, for people.
    fn other_speaker(&self, at: HostTime) -> String {
        match self.peers.speaker(at) {
            Some((system, address)) => format!("; system {system} speaks at {address}"),
            None => self.link.other_speaker(at),
        }
    }

    /// Why nothing arms with a board that was not found, or says nothing for so long, s.
    pub(crate) fn missing(&self, at: HostTime, silent_s: Option<f64>) -> String {
        if self.link.is_crazyflie() && silent_s.is_none() {
            return "no Crazyflie answers: switch it on, end other clients, look at board.address"
                .to_owned();
        }
        let other = self.other_speaker(at);
        match (silent_s, self.link.system_id()) {
            (Some(s), Some(id)) if !other.is_empty() => {
                format!("board silent for {s:.1} s (system {id}){other}")
            }
            (Some(s), _) => format!("board silent for {s:.1} s{other}"),
            (None, _) => format!("no board found on its link{other}"),
        }
    }

    /// Whether the board is where this frame came from, from now on: it was not found yet, it is the same one behind
    /// another port, or it is gone, nothing flies, and another one is there that is disarmed.
    fn is_new_address(
        &mut self,
        (at, mode): (HostTime, Mode),
        index: usize,
        frame: &MavFrame<'_>,
        out: &mut Out,
    ) -> bool {
        let silent_s = self.silence_s(at);
        let beat = heartbeat_of(frame);
        let Some(was) = self.peers.board() else { return beat.is_some() };
        let Some(now) = self.peers.other_mut(index).map(|other| other.address) else {
            return false;
        };
        if self.link.system_id() == Some(frame.header.system_id)
            && self.peers.is_same_board(index, silent_s)
        {
            let text =
                format!("board speaks from {now} now, no more from {was}: the same by its clock");
            out.say(at, Severity::Warning, text);
            return true;
        }
        let rests = matches!(mode, Mode::Disarmed | Mode::Disarming);
        if rests && Peers::is_gone(silent_s) && beat.is_some_and(|beat| !says_armed(&beat)) {
            self.link.replaced(at);
            let text = format!("board at {was} is gone, another one speaks from {now}");
            out.say(at, Severity::Warning, text);
            return true;
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use haltere_dialect::mav::haltere::{
        HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavType,
    };
    use haltere_dialect::mav_stream;

    use super::*;
    use crate::Pilot;
    use crate::config::PilotConfig;
    use crate::input::Input;
    use haltere_core::frames::Vec3;
    use haltere_core::measure::AnchorId;
    use haltere_core::survey::Survey;

    fn pilot() -> Pilot {
        let corner = |i: u8| {
            let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
            (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
        };
        let survey = Survey::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
        Pilot::new(PilotConfig::default(), survey, at(0.0))
    }

    fn at(s: f64) -> HostTime {
        HostTime::from_us(1_000_000 + (s * 1e6) as u64)
    }

    fn beat(pilot: &mut Pilot, s: f64, system: u8, armed: bool, autopilot: MavAutopilot) {
        let flags = [MavModeFlag::empty(), MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED];
        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            base_mode: flags[usize::from(armed)],
            mavtype: MavType::MAV_TYPE_QUADROTOR as u8,
            autopilot: autopilot as u8,
            ..Default::default()
        });
        let mut bytes = Vec::new();
        mav_stream::encode(&mut bytes, system, 1, 0, &message);
        pilot.handle(at(s), Input::Bytes { link: LinkId::Board, bytes: &bytes });
        pilot.handle(at(s), Input::Wake);
        pilot.drain_output(|_, _| {});
        pilot.drain_topics(|_| {});
    }

    const GENERIC: MavAutopilot = MavAutopilot::MAV_AUTOPILOT_GENERIC;

    #[test]
    fn regress_a_stray_heartbeat_or_a_former_number_is_not_the_board_for_ever() {
        // Another vehicle is heard once, before the board begins to speak on the same line.
        let mut pilot = pilot();
        beat(&mut pilot, 0.0, 7, false, GENERIC);
        assert_eq!(pilot.board.link.system_id(), Some(7));
        for second in [1.0, 2.0] {
            beat(&mut pilot, second, 1, false, GENERIC);
            assert_eq!(pilot.board.link.system_id(), Some(7), "{second}");
        }
        let why = pilot.board.missing(at(2.0), Some(2.0));
        assert_eq!(
            why,
            "board silent for 2.0 s (system 7); system 1, component 1 speaks on its link"
        );
        for second in [3.0, 4.0] {
            beat(&mut pilot, second, 1, false, GENERIC);
            assert_eq!(pilot.board.link.system_id(), Some(1), "{second}");
        }
        // The number that was changed on the advice about routing.
        for second in [4.9, 5.9, 6.9, 7.9] {
            beat(&mut pilot, second, 2, false, GENERIC);
        }
        assert_eq!(pilot.board.link.system_id(), Some(2));
    }

    #[test]
    fn prop_an_armed_board_keeps_its_place_and_the_refusal_names_who_speaks() {
        let mut pilot = super::tests::pilot();
        beat(&mut pilot, 0.0, 7, true, GENERIC);
        beat(&mut pilot, 0.5, 7, true, GENERIC);
        for second in [4.0, 5.0] {
            beat(&mut pilot, second, 1, false, GENERIC);
        }
        assert_eq!(pilot.board.link.system_id(), Some(7));
        let why = pilot.board.missing(at(5.0), Some(4.5));
        assert!(why.ends_with("(system 7); system 1, component 1 speaks on its link"), "{why}");
        // Nor is an armed one taken in the place of another.
        let mut pilot = super::tests::pilot();
        beat(&mut pilot, 0.0, 7, false, GENERIC);
        beat(&mut pilot, 5.0, 1, true, GENERIC);
        assert_eq!(pilot.board.link.system_id(), Some(7));
        assert!(pilot.board.missing(at(5.0), Some(5.0)).contains("armed"));
        // Who is no board at all is named as that.
        let mut pilot = super::tests::pilot();
        beat(&mut pilot, 0.0, 255, false, MavAutopilot::MAV_AUTOPILOT_INVALID);
        let why = pilot.board.missing(at(0.1), None);
        let wanted = "no board found on its link; system 255, component 1 speaks on its link, which is \
                      no autopilot";
        assert_eq!(why, wanted);
        assert_eq!(pilot.board.missing(at(9.0), None), "no board found on its link");
    }
}
