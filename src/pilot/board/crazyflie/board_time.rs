//! The board's milliseconds, of which a row of its log carries 24 bits.

use haltere_dialect::crtp::log::TIME_BITS;

const SPAN_MS: u64 = 1 << TIME_BITS;
/// Rows of different blocks may stand in another order than their times; what falls behind by more has restarted, ms.
const BACK_MS: u64 = 1_000;

/// What a stamp is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stamp {
    /// Milliseconds since the board's first that was heard began its span.
    At(u64),
    /// The same of a board that has started anew.
    Restarted(u64),
}

/// Unwraps them.
#[derive(Debug, Default)]
pub(crate) struct BoardTime {
    newest_ms: Option<u64>,
}

impl BoardTime {
    /// The time of a row.
    pub fn unwrap(&mut self, time_ms: u32) -> Stamp {
        let low = u64::from(time_ms) % SPAN_MS;
        let Some(newest_ms) = self.newest_ms else {
            self.newest_ms = Some(low);
            return Stamp::At(low);
        };
        let ahead_ms = (low + SPAN_MS - newest_ms % SPAN_MS) % SPAN_MS;
        let behind_ms = SPAN_MS - ahead_ms;
        if ahead_ms < SPAN_MS / 2 {
            self.newest_ms = Some(newest_ms + ahead_ms);
            Stamp::At(newest_ms + ahead_ms)
        } else if behind_ms <= BACK_MS && behind_ms <= newest_ms {
            Stamp::At(newest_ms - behind_ms)
        } else {
            self.newest_ms = Some(low);
            Stamp::Restarted(low)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_time_goes_on_over_the_end_of_its_bits_and_a_restart_is_told() {
        let mut time = BoardTime::default();
        let end = (SPAN_MS - 5) as u32;
        assert_eq!(time.unwrap(end), Stamp::At(SPAN_MS - 5));
        assert_eq!(time.unwrap(5), Stamp::At(SPAN_MS + 5));
        assert_eq!(time.unwrap(end), Stamp::At(SPAN_MS - 5), "a row of another block");
        assert_eq!(time.unwrap(15), Stamp::At(SPAN_MS + 15));
        assert_eq!(time.unwrap(600_000), Stamp::At(SPAN_MS + 600_000));
        assert_eq!(time.unwrap(400), Stamp::Restarted(400));
        assert_eq!(time.unwrap(410), Stamp::At(410));
    }
}
