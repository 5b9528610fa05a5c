//! The line between board and companion: what waits, what is late, what is cut.

use super::Plant;
use crate::board::SlowLine;
use crate::effects::{Cargo, Delivery};
use crate::faults::{FaultKind, off_phase};
use crate::line_noise::NoisyLine;

/// The lines of tag and board, and what has come out of them.
#[derive(Debug)]
pub(super) struct Wires {
    pub from_tag: NoisyLine,
    pub from_board: NoisyLine,
    pub to_board: NoisyLine,
    pub to_board_line: Option<SlowLine>,
    pub tag_out: Vec<u8>,
    pub board_out: Vec<u8>,
}

impl Wires {
    /// Silent ones, by the board's speed of the line; `tag_out`: what the tag has said already.
    pub fn new(seed: u64, board_baud: u32, tag_out: Vec<u8>) -> Self {
        Self {
            from_tag: NoisyLine::new(seed, "fault-from-tag"),
            from_board: NoisyLine::new(seed, "fault-from-board"),
            to_board: NoisyLine::new(seed, "fault-to-board"),
            to_board_line: SlowLine::new(board_baud),
            tag_out,
            board_out: Vec::with_capacity(4096),
        }
    }
}

impl Plant {
    pub(super) fn hear_companion(&mut self, now_us: u64) {
        self.scratch.clear();
        self.wires.to_board.receive(now_us, &mut self.scratch);
        if self.scratch.is_empty() {
            return;
        }
        let bytes = std::mem::take(&mut self.scratch);
        let mut answers = Vec::new(); // filled only by commands, which are rare
        let (s, bank) = (&self.state, &mut self.bank);
        self.board.receive(now_us, &bytes, s, bank, &mut answers, &mut self.requests);
        self.scratch = bytes;
        if !answers.is_empty() {
            self.board.line_delay_s(now_us, answers.len());
            self.scratch.clear();
            self.scratch.extend_from_slice(&answers);
            self.post_from_board(now_us);
        }
        for fault in std::mem::take(&mut self.requests.faults) {
            // Orders over MAVLink carry fixed values that are always in range.
            let _ = self.inject(fault);
        }
    }

    /// Sends `scratch` to the companion.
    pub(super) fn post_from_board(&mut self, now_us: u64) {
        if self.scratch.is_empty() {
            return;
        }
        let mut delivery = Delivery { cargo: Cargo::FromBoard, delay_s: 0.0, lost: false };
        self.bank.link(&self.state, &mut delivery);
        delivery.delay_s += self.board.line_delay_s(now_us, 0);
        if !delivery.lost && self.board_link_up() {
            self.wires.from_board.send(now_us, delivery.delay_s, &self.scratch);
        }
    }

    pub(super) fn board_link_up(&self) -> bool {
        self.is_up(self.broken.board_link)
    }

    pub(super) fn to_board_up(&self) -> bool {
        self.is_up(self.broken.to_board)
    }

    fn is_up(&self, (kind, since_s): (FaultKind, f64)) -> bool {
        match kind {
            FaultKind::Healthy => true,
            FaultKind::Intermittent => !off_phase(self.state.t_s - since_s),
            _ => false,
        }
    }

    /// Time that the companion's bytes wait on their way on a line of finite speed, s.
    pub(super) fn companion_line_delay_s(&mut self, bytes: usize) -> f64 {
        let t_s = self.t_us() as f64 * 1e-6;
        let Some(line) = &mut self.wires.to_board_line else { return 0.0 };
        line.takes(t_s, bytes);
        line.delay_s()
    }
}
