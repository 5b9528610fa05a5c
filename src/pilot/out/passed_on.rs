//! Frames that were passed on in the last moments: what comes again has gone in a circle.
//!
//! A bridge that joins two endpoints, such as a router that sends everything everywhere, gives back on one what it
//! got on the other. Frames of one sender differ by their sequence number, so within a second the same bytes are the
//! same frame; a little less is taken, for those who send one heartbeat a second without counting. The table is of
//! fixed size and older entries give way: a frame that is forgotten goes round once more.

use haltere_dialect::mav_stream::MavFrame;

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

use super::Out;
use crate::input::LinkId;

/// Frames that are remembered, a power of two: the most that one station may send in a second, twice.
const SLOTS: usize = 4096;
/// A frame that comes again within this time is the same one, s. Its sender counts to 256 before it repeats a number; one
/// that does not count sends its heartbeat once a second, give or take what the line delays.
const AGAIN_S: f64 = 0.8;

/// The frames, by their hash.
#[derive(Debug)]
pub(crate) struct PassedOn(Box<[Option<(u64, HostTime)>]>);

impl PassedOn {
    pub fn new() -> Self {
        Self(vec![None; SLOTS].into_boxed_slice())
    }

    /// Whether this one was passed on a moment ago.
    pub fn is_again(&self, at: HostTime, frame: &[u8]) -> bool {
        let hash = hash(frame);
        let slot = self.0.get(slot(hash)).copied().flatten();
        slot.is_some_and(|(known, last)| known == hash && at.seconds_since(last) < AGAIN_S)
    }

    /// It is passed on now.
    pub fn note(&mut self, at: HostTime, frame: &[u8]) {
        let hash = hash(frame);
        if let Some(slot) = self.0.get_mut(slot(hash)) {
            *slot = Some((hash, at));
        }
    }
}

impl Out {
    /// Books that a frame went to somebody, or came once more after that.
    pub(crate) fn note_passed(
        &mut self,
        at: HostTime,
        from: LinkId,
        frame: &MavFrame<'_>,
        again: bool,
        passed: bool,
    ) {
        match (again, passed) {
            (true, _) => self.lose(from, DropReason::MavAgain, 1),
            (false, true) => self.passed_on.note(at, frame.raw),
            (false, false) => {}
        }
    }
}

fn slot(hash: u64) -> usize {
    // The upper half is mixed best.
    (hash >> 32) as usize % SLOTS
}

/// FNV-1a, 64 bits: the same in every build, so that a log replays alike.
fn hash(bytes: &[u8]) -> u64 {
    let step = |hash: u64, byte: &u8| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3);
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_frame_is_known_for_a_moment_and_the_table_does_not_grow() {
        let at = |ms: u64| HostTime::from_us(1_000_000 + ms * 1000);
        let mut passed = PassedOn::new();
        assert!(!passed.is_again(at(0), b"one"));
        passed.note(at(0), b"one");
        assert!(passed.is_again(at(0), b"one") && passed.is_again(at(799), b"one"));
        assert!(!passed.is_again(at(801), b"one") && !passed.is_again(at(0), b"two"));
        for n in 0..20_000_u32 {
            passed.note(at(1), &n.to_le_bytes());
            assert!(passed.is_again(at(1), &n.to_le_bytes()));
        }
        assert_eq!(passed.0.len(), SLOTS);
        // What a bridge gives back within some frames is known, whatever else goes by.
        let mut known = 0;
        for n in 0..2000_u32 {
            passed.note(at(2), &(n + 50_000).to_le_bytes());
            known += u32::from(passed.is_again(at(2), &(n.max(30) + 49_970).to_le_bytes()));
        }
        assert!(known > 1900, "{known}");
    }
}
