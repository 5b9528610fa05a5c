//! The clock of this computer, and sleeping until a point on it.

use rustix::io::Errno;
use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

use haltere_core::time::HostTime;

/// Now, monotonic.
pub fn now() -> HostTime {
    let now = clock_gettime(ClockId::Monotonic);
    // Counted from boot: neither part is ever negative.
    let s = u64::try_from(now.tv_sec).unwrap_or(0);
    let ns = u64::try_from(now.tv_nsec).unwrap_or(0);
    HostTime::from_us(s.saturating_mul(1_000_000).saturating_add(ns / 1000))
}

/// Wall clock, microseconds since 1970 UTC.
pub fn unix_us() -> i64 {
    let now = clock_gettime(ClockId::Realtime);
    now.tv_sec.saturating_mul(1_000_000).saturating_add(now.tv_nsec / 1000)
}

/// Returns at `deadline`, at once if it has passed. Absolute: time lost before the call does not
/// add up.
pub fn sleep_until(deadline: HostTime) {
    let us = deadline.as_us();
    let request = Timespec {
        tv_sec: i64::try_from(us / 1_000_000).unwrap_or(i64::MAX),
        tv_nsec: i64::try_from(us % 1_000_000 * 1000).unwrap_or(0),
    };
    while let Err(Errno::INTR) = clock_nanosleep_absolute(ClockId::Monotonic, &request) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_sleep_ends_after_its_deadline() {
        let deadline = now().offset_us(3_000);
        sleep_until(deadline);
        assert!(now() >= deadline);
        sleep_until(HostTime::from_us(0));
    }
}
