//! Whose a frame is where two boards with one number speak on one line: every board counts its own frames.
//!
//! A router that joins two lines, or a radio that hears both, gives their frames one after the other. Read as one board it
//! stands and flies at once. The number of a frame (MAVLink's `seq`, modulo 256) goes on from the last one of its sender:
//! a frame that does not go on where ours was, while ours goes on, is another's. Two that begin to speak with the same
//! number are one to it: eight in 256.

use haltere_core::time::HostTime;

use super::peers::GONE_S;

/// So many frames a second a line carries at most: 921600 baud with frames of 46 bytes.
const MOST_HZ: f64 = 2000.0;
/// Datagrams overtake each other by no more frames. Assumed: pairs that are swapped, and one of them lost.
const OVERTAKEN: i8 = 4;
/// Ours is silent after this time, s: it speaks hundreds of times a second.
const SILENT_S: f64 = 0.05;
/// The other is believed when so many of its frames have followed one another. Assumed: one that overtakes is no second board, and by
/// chance a number follows in one of 256.
const FOLLOWED: u32 = 3;

/// One count of frames.
#[derive(Debug, Clone, Copy)]
struct Count {
    newest: u8,
    at: HostTime,
    /// Frames that followed one another.
    followed: u32,
}

impl Count {
    /// How far a number lies from the next one.
    fn ahead(&self, sequence: u8) -> i8 {
        sequence.wrapping_sub(self.newest).wrapping_sub(1).cast_signed()
    }

    fn goes_on(&self, at: HostTime, sequence: u8) -> bool {
        let most = f64::from(OVERTAKEN) + MOST_HZ * at.seconds_since(self.at).max(0.0);
        (-OVERTAKEN..).contains(&self.ahead(sequence)) && f64::from(self.ahead(sequence)) <= most
    }

    fn take(&mut self, at: HostTime, sequence: u8) {
        (self.newest, self.at, self.followed) = (sequence, at, self.followed.saturating_add(1));
    }
}

/// The counts of the board and of another one on its line.
#[derive(Debug, Default)]
pub(crate) struct Speakers {
    ours: Option<Count>,
    other: Option<Count>,
    /// Where ours was before it left numbers out, where it went on, and when it did.
    before: Option<(u8, u8, HostTime)>,
    /// When ours last went on beside the other.
    beside: Option<HostTime>,
}

impl Speakers {
    /// A frame. `Some`: it is the board's, after so many that are missing. `None`: it is another's, or may be.
    pub fn note(&mut self, at: HostTime, sequence: u8) -> Option<u8> {
        self.other.take_if(|other| at.seconds_since(other.at) > GONE_S);
        let Some(ours) = &mut self.ours else {
            self.ours = Some(Count { newest: sequence, at, followed: 0 });
            return Some(0);
        };
        let ahead = ours.ahead(sequence);
        let after_all = |(before, _, left_at): &mut (u8, u8, HostTime)| {
            ahead != 0
                && sequence == before.wrapping_add(1)
                && at.seconds_since(*left_at) < SILENT_S
        };
        let believed = self.other.as_mut().filter(|other| other.followed >= FOLLOWED);
        if let Some((_, first, _)) = self.before.take_if(after_all) {
            // Nothing was missing: what seemed to go on was overtaken, or another's, if that goes on as well.
            let followed =
                self.other.filter(|other| other.ahead(first) == 0).map_or(0, |o| o.followed + 1);
            self.other = Some(Count { followed, ..*ours });
            *ours = Count { newest: sequence, at, ..*ours };
            return Some(0);
        }
        if let Some(other) = believed.filter(|other| ahead != 0 && other.ahead(sequence) == 0) {
            other.take(at, sequence);
        } else if sequence == 0 || ours.goes_on(at, sequence) {
            // A board that begins anew counts from 0, at once or after a while.
            if ahead != 0 {
                self.before = Some((ours.newest, sequence, at));
            }
            ours.take(at, sequence);
            if self.other.is_some_and(|other| other.followed >= FOLLOWED) {
                self.beside = Some(at);
            }
            return Some(ahead.max(0).cast_unsigned());
        } else if let Some(other) = self.other.as_mut().filter(|o| o.goes_on(at, sequence)) {
            other.take(at, sequence);
        } else {
            self.other = Some(Count { newest: sequence, at, followed: 0 });
        }
        self.begun_anew(at, ahead.max(0).cast_unsigned())
    }

    /// Ours is silent while another one speaks: a board that has begun anew, or of which more was lost than is told from
    /// that.
    fn begun_anew(&mut self, at: HostTime, missing: u8) -> Option<u8> {
        let patience_s = if self.second_speaks(at) { GONE_S } else { SILENT_S };
        self.ours.take_if(|ours| at.seconds_since(ours.at) > patience_s)?;
        *self = Self { ours: self.other, ..Self::default() };
        Some(missing)
    }

    /// Whether another one speaks beside ours.
    pub fn second_speaks(&self, at: HostTime) -> bool {
        self.other.is_some() && self.beside.is_some_and(|b| at.seconds_since(b) < GONE_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames of each of two boards, turn by turn, so many a step of 10 ms: which of them are taken for ours.
    fn hear(from: [u8; 2], each: [u64; 2], steps: u64) -> (Speakers, [u32; 2], HostTime) {
        let mut speakers = Speakers::default();
        let (mut next, mut heard, mut at) = (from, [0, 0], HostTime::from_us(0));
        for step in 0..steps {
            for board in [0, 1] {
                for n in 0..each[board] + step % 3 {
                    at = HostTime::from_us(
                        1_000_000 + step * 10_000 + n * 500 + board as u64 * 5000,
                    );
                    // The second begins after a second.
                    if board == 1 && step < 100 {
                        continue;
                    }
                    heard[board] += u32::from(speakers.note(at, next[board]).is_some());
                    next[board] = next[board].wrapping_add(1);
                }
            }
        }
        (speakers, heard, at)
    }

    #[test]
    fn prop_two_boards_on_one_line_are_told_apart_wherever_the_second_begins() {
        // Each sends 7000 and 6300.
        let apart = |from| {
            let (speakers, heard, at) = hear([0, from], [6, 6], 1000);
            speakers.second_speaks(at) && heard[0] > 6900 && heard[1] < 70
        };
        let mixed: Vec<u8> = (0..=255).filter(|from| !apart(*from)).collect();
        // Where its first number happens to be the next of ours nothing tells them apart.
        assert!(mixed.len() <= 8, "{mixed:?}");
    }

    #[test]
    fn regress_frames_that_overtake_each_other_are_all_heard() {
        let mut speakers = Speakers::default();
        let mut at_us = 0;
        for pair in 0..2000_u32 {
            let swapped = pair % 7 == 0 || pair % 50 < 2;
            for n in if swapped { [1, 0] } else { [0, 1] } {
                at_us += 1500;
                let sequence = (2 * pair + n).to_le_bytes()[0];
                assert!(speakers.note(HostTime::from_us(at_us), sequence).is_some(), "{pair}");
                assert!(!speakers.second_speaks(HostTime::from_us(at_us)), "{pair}");
            }
        }
    }

    #[test]
    fn prop_a_lone_board_is_heard_through_losses_pauses_and_new_beginnings() {
        let mut speakers = Speakers::default();
        let mut lost = 0;
        let (mut at_us, mut sequence) = (1_000_000, 0_u8);
        for n in 0_u32..20_000 {
            at_us += 2000;
            match n % 4000 {
                // A burst of losses, a pause, a reboot.
                1000 => sequence = sequence.wrapping_add(100),
                2000 => at_us += 2_000_000,
                3000 => sequence = 0,
                _ => {}
            }
            sequence = sequence.wrapping_add(1 + u8::from(n % 50 == 0));
            let at = HostTime::from_us(at_us);
            lost += u32::from(speakers.note(at, sequence).is_none());
            assert!(!speakers.second_speaks(at), "{n}");
        }
        // 50 ms of 500 frames a second, twice in 4000.
        assert!(lost <= 5 * 2 * 26, "{lost}");
    }
}
