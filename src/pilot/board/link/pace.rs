//! How long the board takes to answer: a line that is asked for more than it carries gets slower and
//! slower before anything is lost (seen: 90 ms at 115200 baud, 4 ms at 921600).

/// Newest round trips that are looked at; their median counts.
const WINDOW: usize = 5;
/// A median beyond this is slow whatever it was before, s: ten control periods of dead time would be
/// more than the loops stand.
pub(crate) const SLOW_S: f64 = 0.060;
/// A median beyond this is slow if it is so many times the best, s.
const GROWN_S: f64 = 0.025;
const GROWN_FACTOR: f64 = 4.0;
/// It is well again below this share of the limit that was broken.
const WELL_SHARE: f64 = 0.6;

/// Follows the round trips.
#[derive(Debug, Default)]
pub(crate) struct Pace {
    trips_s: [f64; WINDOW],
    count: usize,
    best_s: Option<f64>,
    slow: bool,
}

impl Pace {
    /// Median of the newest round trips, s. `None`: too few.
    pub fn median_s(&self) -> Option<f64> {
        if self.count < WINDOW {
            return None;
        }
        let mut sorted = self.trips_s;
        sorted.sort_by(f64::total_cmp);
        Some(sorted[WINDOW / 2])
    }

    /// Best round trip since the link was opened, s.
    pub fn best_s(&self) -> Option<f64> {
        self.best_s
    }

    /// An answered question. `Some`: the line has just become slow, or well again.
    pub fn note(&mut self, trip_s: f64) -> Option<bool> {
        if !(trip_s.is_finite() && trip_s >= 0.0) {
            return None;
        }
        self.trips_s[self.count % WINDOW] = trip_s;
        self.count += 1;
        let best_s = self.best_s.map_or(trip_s, |b| b.min(trip_s));
        self.best_s = Some(best_s);
        let median_s = self.median_s()?;
        let limit_s = SLOW_S.min(GROWN_S.max(GROWN_FACTOR * best_s));
        let was = self.slow;
        if median_s > limit_s {
            self.slow = true;
        } else if median_s < WELL_SHARE * limit_s {
            self.slow = false;
        }
        (self.slow != was).then_some(self.slow)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changes(pace: &mut Pace, trips_ms: &[f64]) -> Vec<bool> {
        trips_ms.iter().filter_map(|t| pace.note(t * 1e-3)).collect()
    }

    #[test]
    fn prop_growth_is_noticed_once_and_single_delays_are_not() {
        let mut pace = Pace::default();
        assert!(changes(&mut pace, &[4.0; 20]).is_empty());
        assert!(changes(&mut pace, &[4.0, 90.0, 4.0, 4.0, 120.0, 4.0, 4.0, 90.0, 4.0]).is_empty());
        assert_eq!(changes(&mut pace, &[20.0, 50.0, 90.0, 90.0, 90.0, 90.0]), [true]);
        assert_eq!(changes(&mut pace, &[4.0; 6]), [false]);
    }

    #[test]
    fn prop_a_line_that_was_always_slow_is_told_and_a_radio_is_not() {
        assert_eq!(changes(&mut Pace::default(), &[90.0; 10]), [true]);
        assert!(changes(&mut Pace::default(), &[22.0; 10]).is_empty());
        assert!(changes(&mut Pace::default(), &[f64::NAN, -1.0]).is_empty());
    }
}
