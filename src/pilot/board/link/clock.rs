//! The board's clock: an offset learned from TIMESYNC round trips, with its uncertainty.
//!
//! A request leaves at host time `s`, the board stamps it `b`, the answer is read at `r`. If both
//! ways took equally long, `b` was true at `(s + r) / 2`; the truth lies within half the round
//! trip. Round trips that are slow against the fastest recent one are not used: their error is
//! one-sided queueing.

use haltere_core::time::{FcTime, HostTime};

/// Round trips kept to know the fastest recent one.
const WINDOW: usize = 32;
/// A round trip may exceed the fastest recent one by this factor and this much, µs. Tuned on the
/// spread of BOARDS.md rule 11: 0.3 to 3.9 ms median, 1.8 to 6.5 ms at 95 %.
const SLOW_FACTOR: i64 = 2;
const SLOW_MARGIN_US: i64 = 1_000;
/// Answers later than this belong to a request that is long forgotten, µs.
const STALE_US: i64 = 1_000_000;
/// An offset that moved by more than this is another clock: the board rebooted, µs.
const JUMP_US: i64 = 50_000;
/// Good round trips until the offset counts as locked.
const LOCK_COUNT: u32 = 10;
/// Share of each new offset once locked: 100 ppm of drift at 1 Hz then leaves 1 ms of lag.
const GAIN: f64 = 0.1;

/// Maps board time to host time.
#[derive(Debug, Default)]
pub(crate) struct BoardClock {
    round_trips_us: [i64; WINDOW],
    seen: usize,
    /// Board time minus host time, µs.
    offset_us: Option<f64>,
    good: u32,
    fastest_us: i64,
    restarts: u32,
}

impl BoardClock {
    /// Takes one answered request in. `false`: not used.
    pub fn round_trip(&mut self, sent: HostTime, board: FcTime, received: HostTime) -> bool {
        let sent_us = sent.as_us().cast_signed();
        let trip_us = received.as_us().cast_signed().saturating_sub(sent_us);
        if !(0..=STALE_US).contains(&trip_us) {
            return false;
        }
        self.round_trips_us[self.seen % WINDOW] = trip_us;
        self.seen += 1;
        let known = &self.round_trips_us[..self.seen.min(WINDOW)];
        self.fastest_us = known.iter().copied().min().unwrap_or(trip_us);
        if trip_us > self.fastest_us.saturating_mul(SLOW_FACTOR).saturating_add(SLOW_MARGIN_US) {
            return false;
        }
        let middle_us = sent_us.saturating_add(trip_us / 2);
        let Some(board_us) = i64::try_from(board.as_us()).ok() else { return false };
        let measured_us = board_us.saturating_sub(middle_us) as f64;
        match self.offset_us {
            Some(offset_us) if (measured_us - offset_us).abs() < JUMP_US as f64 => {
                self.good += 1;
                // A running mean until locked, then a slow follower.
                let gain = GAIN.max(1.0 / f64::from(self.good));
                self.offset_us = Some(offset_us + gain * (measured_us - offset_us));
            }
            // The truth lies within half the round trip: a line that has become late is no other clock, and says
            // little about one that is known.
            Some(offset_us)
                if self.is_locked()
                    && trip_us > 2 * JUMP_US
                    && (measured_us - offset_us).abs() < (JUMP_US + trip_us / 2) as f64 =>
            {
                return false;
            }
            before => {
                self.restarts += u32::from(before.is_some());
                self.offset_us = Some(measured_us);
                self.good = 1;
                self.seen = 1;
                self.round_trips_us[0] = trip_us;
                self.fastest_us = trip_us;
            }
        }
        true
    }

    /// How often the board's clock has jumped: it was restarted.
    pub fn restarts(&self) -> u32 {
        self.restarts
    }

    /// Enough round trips to trust the offset.
    pub fn is_locked(&self) -> bool {
        self.good >= LOCK_COUNT
    }

    /// Host time of a board stamp. `None` until the first round trip.
    pub fn to_host(&self, board: FcTime) -> Option<HostTime> {
        let offset_us = self.offset_us?;
        let host_us = board.as_us() as f64 - offset_us;
        (host_us >= 0.0).then(|| HostTime::from_us(host_us.round() as u64))
    }

    /// One sigma of the offset, s: half the fastest round trip, taken as two sigma.
    pub fn std_s(&self) -> Option<f64> {
        self.offset_us.map(|_| self.fastest_us as f64 * 0.25e-6)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Board clock ahead of ours by 5 s and fast by `ppm`; `delays` are out and back, µs.
    fn run(ppm: f64, delays: impl Iterator<Item = (u64, u64)>) -> (BoardClock, u64) {
        let mut clock = BoardClock::default();
        let mut t_us = 1_000_000;
        for (out, back) in delays {
            let board_us = 5_000_000 + ((t_us + out) as f64 * (1.0 + ppm * 1e-6)) as u64;
            clock.round_trip(
                HostTime::from_us(t_us),
                FcTime::from_us(board_us),
                HostTime::from_us(t_us + out + back),
            );
            t_us += 100_000;
        }
        (clock, t_us)
    }

    #[test]
    fn prop_symmetric_delay_gives_the_offset() {
        let (clock, t_us) = run(0.0, (0..40).map(|_| (700, 700)));
        assert!(clock.is_locked());
        let host = clock.to_host(FcTime::from_us(5_000_000 + t_us)).unwrap();
        assert_eq!(host.as_us(), t_us);
    }

    #[test]
    fn prop_queueing_on_one_way_is_kept_out() {
        let delays = (0..200).map(|i| (300, if i % 3 == 0 { 300 } else { 9_000 }));
        let (clock, t_us) = run(20.0, delays);
        let board_us = 5_000_000 + (t_us as f64 * (1.0 + 20e-6)) as u64;
        let error_us =
            clock.to_host(FcTime::from_us(board_us)).unwrap().as_us() as f64 - t_us as f64;
        assert!(error_us.abs() < 150.0, "{error_us}");
    }

    #[test]
    fn regress_a_line_that_becomes_late_is_no_other_clock() {
        for (out, back) in [(300_000, 700), (700, 300_000), (200_000, 400_000)] {
            let delays = (0..240).map(|i| if i < 40 { (700, 700) } else { (out, back) });
            let (clock, t_us) = run(0.0, delays);
            assert_eq!(clock.restarts(), 0, "{out} {back}");
            let host = clock.to_host(FcTime::from_us(5_000_000 + t_us)).unwrap();
            assert!(host.as_us().abs_diff(t_us) < 50_000, "{out} {back}");
        }
    }

    #[test]
    fn regress_reboot_is_followed_at_once() {
        let (mut clock, t_us) = run(0.0, (0..40).map(|_| (500, 500)));
        clock.round_trip(
            HostTime::from_us(t_us),
            FcTime::from_us(2_000),
            HostTime::from_us(t_us + 1_000),
        );
        assert!(!clock.is_locked());
        assert_eq!(clock.to_host(FcTime::from_us(2_000)).unwrap().as_us(), t_us + 500);
    }
}
