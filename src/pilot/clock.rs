//! Time of the core: its own clock, which never goes back, the steps by it, and the calendar.

use haltere_core::time::HostTime;

/// Period of the control step, µs: 100 Hz as in the source.
pub(crate) const CONTROL_PERIOD_US: i64 = 10_000;
/// A clock that goes back by more than this has jumped, s: stamps of one moment come from several threads.
pub(crate) const BACK_S: f64 = 0.05;

/// Where the core stands in time.
#[derive(Debug)]
pub(crate) struct Clock {
    pub(crate) now: HostTime,
    pub(crate) next_tick: HostTime,
    pub(crate) last_tick: Option<HostTime>,
    pub(crate) control_steps: u64,
    pub(crate) deadline_misses: u64,
    pub(crate) next_health: HostTime,
    pub(crate) steady: SteadyClock,
    /// The calendar: the core is told it now and then, for stations that want to know the date.
    pub(crate) calendar: Option<Calendar>,
}

impl Clock {
    pub(crate) fn new(at: HostTime) -> Self {
        Self {
            now: at,
            next_tick: at.offset_us(CONTROL_PERIOD_US),
            last_tick: None,
            control_steps: 0,
            deadline_misses: 0,
            next_health: at,
            steady: SteadyClock::default(),
            calendar: None,
        }
    }
}

/// The clock of the glue, which should never go back, made into one that does not.
///
/// Where it goes back nevertheless, the core's own time goes on from where it was: otherwise the control
/// loop would stand still until the clock has caught up.
#[derive(Debug, Default)]
pub(crate) struct SteadyClock {
    /// Core's time minus the glue's, µs.
    ahead_us: i64,
}

impl SteadyClock {
    /// The core's time for one of the glue. `wakes`: the stamp is the present of the core's own thread, and
    /// no older one can come before it. The second value is by how much the clock went back, s.
    pub fn steady(&mut self, at: HostTime, now: HostTime, wakes: bool) -> (HostTime, Option<f64>) {
        let steady = at.offset_us(self.ahead_us);
        let back_s = now.seconds_since(steady);
        if !wakes || back_s < BACK_S {
            return (steady.max(now), None);
        }
        self.ahead_us = self.ahead_us.saturating_add((back_s * 1e6).round() as i64);
        (now, Some(back_s))
    }

    /// The glue's time for one of the core.
    pub fn outside(&self, at: HostTime) -> HostTime {
        at.offset_us(self.ahead_us.saturating_neg())
    }
}

/// What the calendar said, and when.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Calendar {
    pub told_at: HostTime,
    /// Since 1970-01-01 UTC, µs.
    pub told_unix_us: i64,
}

impl Calendar {
    /// Since 1970-01-01 UTC, µs; 0 before that.
    pub fn unix_us(self, at: HostTime) -> u64 {
        let since_us = at.as_us().saturating_sub(self.told_at.as_us());
        u64::try_from(self.told_unix_us).unwrap_or(0).saturating_add(since_us)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn us(us: u64) -> HostTime {
        HostTime::from_us(us)
    }

    #[test]
    fn prop_a_clock_that_goes_back_does_not_stop_time() {
        let mut clock = SteadyClock::default();
        let now = us(10_000_000);
        // An older stamp of another thread is no jump.
        assert_eq!(clock.steady(us(9_900_000), now, false), (now, None));
        let (at, back_s) = clock.steady(us(4_000_000), now, true);
        assert_eq!((at, back_s), (now, Some(6.0)));
        // From here on time passes as it does outside.
        assert_eq!(clock.steady(us(4_010_000), now, true), (us(10_010_000), None));
        assert_eq!(clock.outside(us(10_020_000)), us(4_020_000));
    }

    #[test]
    fn prop_every_way_of_time_is_monotone() {
        let mut clock = SteadyClock::default();
        let mut now = us(1_000_000);
        let mut random = 12345_u64;
        for _ in 0..100_000 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            let at = us((random >> 30) % 20_000_000);
            let (next, _) = clock.steady(at, now, random & 1 == 0);
            assert!(next >= now);
            now = next;
        }
    }
}
