//! Bytes on the board's link by their sender: the board's own, those of a second one, and the way from one address
//! to another.

use core::net::SocketAddr;

use haltere_dialect::mav_stream::{MavFrame, MavSplitter, heartbeat_fields};

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

use super::board::{Peers, says_armed, speaks_as_board};
use super::modes::Mode;
use super::{LinkId, Pilot, Severity};

impl Pilot {
    /// Where the board is, if its link has many ends and it was found: nothing is to be sent to others.
    pub fn board_address(&self) -> Option<SocketAddr> {
        self.board_peers.board()
    }

    pub(super) fn board_bytes(&mut self, at: HostTime, bytes: &[u8]) {
        match self.board_peers.other(at) {
            Ok(None) => {
                self.board_bytes_at = at;
                self.board_splitter.push(bytes);
                self.board_frames(at);
            }
            Ok(Some(index)) => self.other_bytes(at, index, bytes),
            Err(()) => self.drops_of(LinkId::Board).add(DropReason::MavWrongPeer, 1),
        }
        let forgotten = self.board_peers.take_forgotten();
        if forgotten > 0 {
            self.drops_of(LinkId::Board).add(DropReason::MavWrongPeer, forgotten);
        }
    }

    /// The silence of the board, s.
    fn board_silence_s(&self, at: HostTime) -> f64 {
        self.board.silence_s(at).unwrap_or(f64::INFINITY)
    }

    /// Whether it is we who do not listen to the board yet, at the address that it seems to speak from by now.
    pub(super) fn board_is_moving(&self, at: HostTime) -> bool {
        self.board_peers.is_moving(at, self.board_silence_s(at))
    }

    /// A second board that speaks on the link of the first, for people.
    pub(super) fn second_board(&self, at: HostTime) -> Option<String> {
        let first = self.board_peers.board()?;
        let system_id = self.board.system_id()?;
        let second = self.board_peers.second(at, system_id, self.board_silence_s(at))?;
        Some(format!(
            "a second board with system id {system_id} speaks at {second}, beside ours at {first}"
        ))
    }

    /// Bytes of somebody else than the board, who may be the board at a new address.
    fn other_bytes(&mut self, at: HostTime, index: usize, bytes: &[u8]) {
        let Some(other) = self.board_peers.other_mut(index) else { return };
        let mut splitter = std::mem::take(&mut other.splitter);
        splitter.push(bytes);
        while let Some(next) = splitter.next() {
            super::clients::count_frame(self.drops_of(LinkId::Board), &next);
            let Ok(frame) = next else { continue };
            if !speaks_as_board(&frame, self.board.system_id()) {
                self.drops_of(LinkId::Board).add(DropReason::MavWrongPeer, 1);
                continue;
            }
            self.board_peers.other_spoke(at, index, &frame);
            if !self.is_new_address(at, index, &frame) {
                continue;
            }
            // The rest of what was cut off at the old address will not come.
            self.board_splitter = MavSplitter::new();
            // What it said while nobody knew who it is: half of it are IMU samples, without which a turn goes unseen.
            let late = self.board_peers.bind(index);
            for (came_at, frame) in late.frames() {
                self.board_splitter.push(frame);
                self.board_frames(came_at);
            }
            self.board_splitter = splitter;
            self.board_bytes_at = at;
            return self.board_frames(at);
        }
        if let Some(other) = self.board_peers.other_mut(index) {
            other.splitter = splitter;
        }
    }

    /// Whether the board is where this frame came from, from now on: it was not found yet, it is the same one behind
    /// another port, or it is gone, nothing flies, and another one is there that is disarmed.
    fn is_new_address(&mut self, at: HostTime, index: usize, frame: &MavFrame<'_>) -> bool {
        let silent_s = self.board_silence_s(at);
        let beat = heartbeat_fields(frame);
        let Some(was) = self.board_peers.board() else { return beat.is_some() };
        let Some(now) = self.board_peers.other_mut(index).map(|other| other.address) else {
            return false;
        };
        if self.board.system_id() == Some(frame.header.system_id)
            && self.board_peers.is_same_board(index, silent_s)
        {
            let text =
                format!("board speaks from {now} now, no more from {was}: the same by its clock");
            self.say(at, Severity::Warning, text);
            return true;
        }
        let rests = matches!(self.mode, Mode::Disarmed | Mode::Disarming);
        if rests && Peers::is_gone(silent_s) && beat.is_some_and(|beat| !says_armed(&beat)) {
            self.board.replaced(at);
            let text = format!("board at {was} is gone, another one speaks from {now}");
            self.say(at, Severity::Warning, text);
            return true;
        }
        false
    }
}
