//! Bytes on the board's link by their sender: the board's own, those of a second one, and the way from one address
//! to another.

use core::net::SocketAddr;

use haltere_dialect::mav_stream::{MavFrame, MavSplitter, heartbeat_of};

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

use super::link::peers::Peers;
use super::link::{says_armed, speaks_as_board};
use crate::Pilot;
use crate::flight::modes::Mode;
use crate::input::LinkId;
use crate::out::voice::Severity;

impl Pilot {
    /// Where the board is, if its link has many ends and it was found: nothing is to be sent to others.
    pub fn board_address(&self) -> Option<SocketAddr> {
        self.board.peers.board()
    }

    pub(crate) fn board_bytes(&mut self, at: HostTime, bytes: &[u8]) {
        match self.board.peers.other(at) {
            Ok(None) => {
                self.board.bytes_at = at;
                self.board.splitter.push(bytes);
                self.board_frames(at);
            }
            Ok(Some(index)) => self.other_bytes(at, index, bytes),
            Err(()) => self.out.lose(LinkId::Board, DropReason::MavWrongPeer, 1),
        }
        let forgotten = self.board.peers.take_forgotten();
        if forgotten > 0 {
            self.out.lose(LinkId::Board, DropReason::MavWrongPeer, forgotten);
        }
    }

    /// The silence of the board, s.
    fn board_silence_s(&self, at: HostTime) -> f64 {
        self.board.link.silence_s(at).unwrap_or(f64::INFINITY)
    }

    /// Whether it is we who do not listen to the board yet, at the address that it seems to speak from by now.
    pub(crate) fn board_is_moving(&self, at: HostTime) -> bool {
        self.board.peers.is_moving(at, self.board_silence_s(at))
    }

    /// A second board that speaks on the link of the first, for people.
    pub(crate) fn second_board(&self, at: HostTime) -> Option<String> {
        let first = self.board.peers.board()?;
        let system_id = self.board.link.system_id()?;
        let second = self.board.peers.second(at, system_id, self.board_silence_s(at))?;
        Some(format!(
            "a second board with system id {system_id} speaks at {second}, beside ours at {first}"
        ))
    }

    /// A board that is disarmed and silent loses its place to another system that speaks on its line, disarmed: a
    /// stray heartbeat that came first must not be the board for ever, nor the number that a board had before.
    pub(crate) fn give_up_board(&mut self, at: HostTime, frame: &MavFrame<'_>) {
        let Some(was) = self.board.link.system_id().filter(|id| *id != frame.header.system_id)
        else {
            return;
        };
        let disarmed = heartbeat_of(frame).is_some_and(|beat| !says_armed(&beat));
        let rests = self.flight.mode == Mode::Disarmed && !self.board.link.is_armed();
        let gone = Peers::is_gone(self.board_silence_s(at));
        if disarmed && rests && gone && speaks_as_board(frame, None) {
            self.board.link.replaced(at);
            let now = frame.header.system_id;
            let text = format!(
                "board with system id {was} is silent, another one speaks: system id {now}"
            );
            self.out.say(at, Severity::Warning, text);
        }
    }

    /// Who else speaks where a board is missed, for people.
    fn other_speaker(&self, at: HostTime) -> String {
        match self.board.peers.speaker(at) {
            Some((system, address)) => format!("; system {system} speaks at {address}"),
            None => self.board.link.other_speaker(at),
        }
    }

    /// Why nothing arms with a board that was not found, or says nothing for so long, s.
    pub(crate) fn board_missing(&self, at: HostTime, silent_s: Option<f64>) -> String {
        let other = self.other_speaker(at);
        match (silent_s, self.board.link.system_id()) {
            (Some(s), Some(id)) if !other.is_empty() => {
                format!("board silent for {s:.1} s (system {id}){other}")
            }
            (Some(s), _) => format!("board silent for {s:.1} s{other}"),
            (None, _) => format!("no board found on its link{other}"),
        }
    }

    /// Bytes of somebody else than the board, who may be the board at a new address.
    fn other_bytes(&mut self, at: HostTime, index: usize, bytes: &[u8]) {
        let Some(other) = self.board.peers.other_mut(index) else { return };
        let mut splitter = std::mem::take(&mut other.splitter);
        splitter.push(bytes);
        while let Some(next) = splitter.next() {
            crate::out::losses::count_frame(self.out.drops_of(LinkId::Board), &next);
            let Ok(frame) = next else { continue };
            if !speaks_as_board(&frame, self.board.link.system_id()) {
                self.out.lose(LinkId::Board, DropReason::MavWrongPeer, 1);
                continue;
            }
            self.board.peers.other_spoke(at, index, &frame);
            if !self.is_new_address(at, index, &frame) {
                continue;
            }
            // The rest of what was cut off at the old address will not come.
            self.board.splitter = MavSplitter::new();
            // What it said while nobody knew who it is: half of it are IMU samples, without which a turn goes unseen.
            let late = self.board.peers.bind(index);
            for (came_at, frame) in late.frames() {
                self.board.splitter.push(frame);
                self.board_frames(came_at);
            }
            self.board.splitter = splitter;
            self.board.bytes_at = at;
            return self.board_frames(at);
        }
        if let Some(other) = self.board.peers.other_mut(index) {
            other.splitter = splitter;
        }
    }

    /// Whether the board is where this frame came from, from now on: it was not found yet, it is the same one behind
    /// another port, or it is gone, nothing flies, and another one is there that is disarmed.
    fn is_new_address(&mut self, at: HostTime, index: usize, frame: &MavFrame<'_>) -> bool {
        let silent_s = self.board_silence_s(at);
        let beat = heartbeat_of(frame);
        let Some(was) = self.board.peers.board() else { return beat.is_some() };
        let Some(now) = self.board.peers.other_mut(index).map(|other| other.address) else {
            return false;
        };
        if self.board.link.system_id() == Some(frame.header.system_id)
            && self.board.peers.is_same_board(index, silent_s)
        {
            let text =
                format!("board speaks from {now} now, no more from {was}: the same by its clock");
            self.out.say(at, Severity::Warning, text);
            return true;
        }
        let rests = matches!(self.flight.mode, Mode::Disarmed | Mode::Disarming);
        if rests && Peers::is_gone(silent_s) && beat.is_some_and(|beat| !says_armed(&beat)) {
            self.board.link.replaced(at);
            let text = format!("board at {was} is gone, another one speaks from {now}");
            self.out.say(at, Severity::Warning, text);
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
        let why = pilot.board_missing(at(2.0), Some(2.0));
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
        let why = pilot.board_missing(at(5.0), Some(4.5));
        assert!(why.ends_with("(system 7); system 1, component 1 speaks on its link"), "{why}");
        // Nor is an armed one taken in the place of another.
        let mut pilot = super::tests::pilot();
        beat(&mut pilot, 0.0, 7, false, GENERIC);
        beat(&mut pilot, 5.0, 1, true, GENERIC);
        assert_eq!(pilot.board.link.system_id(), Some(7));
        assert!(pilot.board_missing(at(5.0), Some(5.0)).contains("armed"));
        // Who is no board at all is named as that.
        let mut pilot = super::tests::pilot();
        beat(&mut pilot, 0.0, 255, false, MavAutopilot::MAV_AUTOPILOT_INVALID);
        let why = pilot.board_missing(at(0.1), None);
        let wanted = "no board found on its link; system 255, component 1 speaks on its link, which is \
                      no autopilot";
        assert_eq!(why, wanted);
        assert_eq!(pilot.board_missing(at(9.0), None), "no board found on its link");
    }
}
