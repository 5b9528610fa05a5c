//! A world that the core can be flown in: tag, board and truth, and nothing of how they come about.

use crate::{Plant, Truth};

/// Everything outside the companion: bytes in, bytes out, truth on the side.
///
/// [`Plant`] is the nominal one. Another world shares no physics with it and is what a diagnosis
/// is checked on.
pub trait World {
    /// Advances to this simulated time, µs; it never goes back.
    fn advance_to(&mut self, t_us: u64);
    /// Bytes of the tag since the caller cleared them.
    fn tag_output(&mut self) -> &mut Vec<u8>;
    /// Bytes of the board since the caller cleared them.
    fn board_output(&mut self) -> &mut Vec<u8>;
    /// Bytes to the tag.
    fn tag_input(&mut self, bytes: &[u8]);
    /// Bytes to the board.
    fn board_input(&mut self, bytes: &[u8]);
    /// What really is.
    fn truth(&self) -> Truth;
}

impl World for Plant {
    fn advance_to(&mut self, t_us: u64) {
        Plant::advance_to(self, t_us);
    }
    fn tag_output(&mut self) -> &mut Vec<u8> {
        Plant::tag_output(self)
    }
    fn board_output(&mut self) -> &mut Vec<u8> {
        Plant::board_output(self)
    }
    fn tag_input(&mut self, bytes: &[u8]) {
        Plant::tag_input(self, bytes);
    }
    fn board_input(&mut self, bytes: &[u8]) {
        Plant::board_input(self, bytes);
    }
    fn truth(&self) -> Truth {
        Plant::truth(self)
    }
}
