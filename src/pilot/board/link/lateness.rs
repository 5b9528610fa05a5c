//! How late the link to the board is, both ways together.
//!
//! Two witnesses. **Round trips** of TIMESYNC: whatever they take is missing in the loops, in whichever
//! direction it was lost. **Ages** of stamped samples: what comes late is seen with the first of them, but a
//! clock of the board that jumped looks the same. So in any doubt the board is asked for its time ten times a
//! second: a clock that jumped is known anew before the doubt has lasted long enough.
//!
//! Half of what the two directions differ by is in the clock's offset and so in the ages: round trips alone say
//! what the sum is, and a link that was late in one direction from its beginning is known by them.

use haltere_core::time::HostTime;

/// A link that takes longer than this there and back is late, s. The loops lose their phase at 0.15 s more
/// than they have (`control::margins`: 54 deg at 6.2 rad/s, vertical, full battery); 80 ms towards the board
/// were flown and are diagnosed (effect T2), and answer within 87.
pub(crate) const LATE_S: f64 = 0.1;
/// It is well again below this share of that.
const WELL_SHARE: f64 = 0.6;
/// Round trips in a row that show it.
const TRIPS: usize = 3;
/// Samples must be old for so long, s: a question and its answer fit in, and another if one is lost.
const AGED_S: f64 = 0.15;
/// A stamp that is older is wrong, not late, s: a silence of so long is another condition.
const OLDEST_S: f64 = 2.0;
/// A question without an answer is a doubt until this, s: some boards answer none.
const FORGOTTEN_S: f64 = 1.0;

/// Follows both witnesses.
#[derive(Debug, Default)]
pub(crate) struct Lateness {
    /// Newest round trips, s, the newest last.
    trips_s: [f64; TRIPS],
    trips: usize,
    /// The first question since the last answer.
    asked_at: Option<HostTime>,
    /// Since when every sample has been old.
    aged_since: Option<HostTime>,
    /// Age of the newest sample, s.
    age_s: f64,
    is_late: bool,
}

impl Lateness {
    /// The board was asked for its time.
    pub fn asked(&mut self, at: HostTime) {
        self.asked_at.get_or_insert(at);
    }

    /// It answered after so long.
    pub fn answered(&mut self, trip_s: f64) {
        self.asked_at = None;
        self.trips_s.rotate_left(1);
        self.trips_s[TRIPS - 1] = trip_s;
        self.trips = (self.trips + 1).min(TRIPS);
    }

    /// A sample came that was true so long ago by the board's clock.
    pub fn sample(&mut self, at: HostTime, age_s: f64) {
        if !(-OLDEST_S..OLDEST_S).contains(&age_s) {
            return;
        }
        self.age_s = age_s;
        if age_s <= LATE_S {
            self.aged_since = None;
        } else {
            self.aged_since.get_or_insert(at);
        }
    }

    /// The board's clock is another: ages begin anew.
    pub fn clock_restarted(&mut self) {
        self.aged_since = None;
    }

    /// What time brings.
    pub fn tick(&mut self, at: HostTime) {
        let aged = self.aged_since.is_some_and(|t| at.seconds_since(t) >= AGED_S);
        let slow = self.trips == TRIPS && self.trips_s.iter().all(|s| *s > LATE_S);
        let well = self.aged_since.is_none() && self.newest_s() < WELL_SHARE * LATE_S;
        self.is_late = aged || slow || (self.is_late && !well);
    }

    /// Whether it is late.
    pub fn is_late(&self) -> bool {
        self.is_late
    }

    /// Whether the board's time has to be asked for at once.
    pub fn is_in_doubt(&self, at: HostTime) -> bool {
        let waits =
            self.asked_at.is_some_and(|t| (LATE_S..FORGOTTEN_S).contains(&at.seconds_since(t)));
        self.is_late || self.aged_since.is_some() || self.newest_s() > LATE_S || waits
    }

    /// How long an order takes to be seen in what comes back while it is late, s; 0 where it is not.
    pub fn latency_s(&self) -> f64 {
        let most_s = self.trips_s.iter().copied().fold(self.age_s, f64::max);
        if self.is_late { most_s.min(FORGOTTEN_S) } else { 0.0 }
    }

    /// How old the newest sample was when it came over a late link, s; 0 where none is late.
    pub fn age_s(&self) -> f64 {
        if self.is_late { self.age_s.max(0.0) } else { 0.0 }
    }

    fn newest_s(&self) -> f64 {
        self.trips_s[TRIPS - 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: u64) -> HostTime {
        HostTime::from_us(1_000_000 + ms * 1000)
    }

    /// Round trips of 4 ms, then samples of these ages every 4 ms from `from_ms` on; when it is late, ms.
    fn ages(age_s: impl Fn(u64) -> f64, until_ms: u64) -> Option<u64> {
        let mut lateness = Lateness::default();
        (0..3).for_each(|_| lateness.answered(0.004));
        (0..until_ms).step_by(4).find(|ms| {
            lateness.sample(at(*ms), age_s(*ms));
            lateness.tick(at(*ms));
            lateness.is_late()
        })
    }

    #[test]
    fn prop_old_samples_are_late_and_a_burst_is_not() {
        assert_eq!(ages(|_| 0.005, 2000), None);
        assert_eq!(ages(|ms| if ms < 400 { 0.005 } else { 0.3 }, 2000), Some(552));
        // One delivery in ten is 0.1 s late and holds up what is behind it.
        assert_eq!(ages(|ms| 0.1 - 0.001 * (ms % 100) as f64, 2000), None);
        // A backlog that is read at once ends with what is new.
        assert_eq!(ages(|ms| if (100..220).contains(&ms) { 0.4 } else { 0.005 }, 2000), None);
        // A stamp that stands still says nothing.
        assert_eq!(ages(|ms| 0.005 + if ms > 100 { 3.0 } else { 0.0 }, 2000), None);
    }

    #[test]
    fn prop_round_trips_show_it_whichever_direction_is_slow() {
        let mut lateness = Lateness::default();
        for (trip_s, late) in [
            (0.004, false),
            (0.3, false),
            (0.3, false),
            (0.004, false),
            (0.15, false),
            (0.15, false),
            (0.15, true),
            (0.08, true),
            (0.02, false),
        ] {
            lateness.answered(trip_s);
            lateness.tick(at(0));
            assert_eq!(lateness.is_late(), late, "{trip_s}");
            assert_eq!(lateness.latency_s() > 0.0, late);
        }
    }

    #[test]
    fn prop_in_doubt_it_is_asked_and_a_board_that_never_answers_is_left_alone() {
        let mut lateness = Lateness::default();
        assert!(!lateness.is_in_doubt(at(0)));
        lateness.asked(at(0));
        assert!(!lateness.is_in_doubt(at(90)) && lateness.is_in_doubt(at(120)));
        assert!(!lateness.is_in_doubt(at(1100)));
        lateness.answered(0.2);
        assert!(lateness.is_in_doubt(at(1200)));
        lateness.answered(0.004);
        assert!(!lateness.is_in_doubt(at(1200)));
    }
}
