//! The calendar: the core is told it now and then, for stations that want to know the date.

use haltere_core::time::HostTime;

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
