//! TDOA of the Loco deck's log: the last value of eight consecutive pairs, fresh where it has changed.
//!
//! `tdoa2.d7-0` is |tag − anchor 0| − |tag − anchor 7|. A value carries neither time nor count; one that comes anew and is
//! equal by chance, 1 to 4 % of them, is not seen. It was made at any moment of the period before its row: the mean of
//! that, half a period, is subtracted from its time. Its spread, a period / √12, is 6 mm at 1 m/s, where the noise is 50
//! and more: it is left out.

use haltere_core::measure::{AnchorId, Tdoa};
use haltere_core::time::HostTime;

/// Anchors of TDoA2.
const ANCHORS: u8 = 8;

/// Follows the values.
#[derive(Debug, Default)]
pub(crate) struct LoggedTdoa {
    last: [Option<f64>; ANCHORS as usize],
}

impl LoggedTdoa {
    /// A row: what has changed since the last. The first value of each pair may be of any age, and is only kept.
    pub fn row(
        &mut self,
        [valid_at, received_at]: [HostTime; 2],
        values_m: [f64; ANCHORS as usize],
        period_s: f64,
        mut fresh: impl FnMut(Tdoa),
    ) {
        let made_at = valid_at.offset_us((-0.5e6 * period_s) as i64);
        for (b, (value_m, last)) in (0..ANCHORS).zip(values_m.into_iter().zip(&mut self.last)) {
            if !value_m.is_finite() {
                continue;
            }
            if last.replace(value_m).is_none_or(|last_m| last_m == value_m) {
                continue;
            }
            fresh(Tdoa {
                valid_at: made_at,
                received_at,
                anchor_a: AnchorId((b + ANCHORS - 1) % ANCHORS),
                anchor_b: AnchorId(b),
                distance_diff_m: value_m,
                std_m: None,
            });
        }
    }

    /// A pause, or another board: what is kept is old.
    pub fn forget(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_only_what_changed_is_fresh_and_its_age_is_subtracted() {
        let at = HostTime::from_us(5_000_000);
        let (mut logged, mut seen) = (LoggedTdoa::default(), Vec::new());
        let mut values_m = [0.5, 1.0, -1.0, 0.25, 2.0, -2.0, 0.0, 3.0];
        let of = 0.01;
        logged.row([at, at], values_m, of, |tdoa| seen.push(tdoa));
        logged.row([at, at], values_m, of, |tdoa| seen.push(tdoa));
        assert_eq!(seen, []);
        (values_m[0], values_m[3], values_m[5]) = (0.51, 0.26, f64::NAN);
        logged.row([at, at], values_m, of, |tdoa| seen.push(tdoa));
        let pairs: Vec<_> = seen.iter().map(|t| (t.anchor_a.0, t.anchor_b.0)).collect();
        assert_eq!(pairs, [(7, 0), (2, 3)]);
        assert_eq!(seen[0].valid_at, at.offset_us(-5_000));
        seen.clear();
        logged.forget();
        logged.row([at, at], [9.0; ANCHORS as usize], of, |tdoa| seen.push(tdoa));
        assert_eq!(seen, [], "after a pause nobody knows how old it is");
    }
}
