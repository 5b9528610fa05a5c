//! Clocks of DW1000 radios, to a fraction of a tick over hours.
//!
//! A tick is 15.65 ps; minutes hold 1e13 of them, so whole ticks are integers and only remainders
//! and skews are floating point.

use haltere_dialect::lps::TICK_HZ;

/// Ticks of true time in one microsecond: 63897.6.
pub const TICKS_PER_US: f64 = TICK_HZ * 1e-6;
/// Ticks of true time in ten microseconds: a whole number.
const TICKS_PER_10_US: i64 = 638_976;

/// An instant on some clock: whole ticks and a remainder in [0, 1].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ticks {
    /// Whole ticks.
    pub whole: i64,
    /// Remainder.
    pub part: f64,
}

impl Ticks {
    /// True time since the start.
    pub fn from_us(us: u64) -> Self {
        let tens = us.cast_signed() / 10;
        let rest = (us % 10) as f64 * TICKS_PER_US;
        Self { whole: tens * TICKS_PER_10_US, part: 0.0 }.later(rest)
    }

    /// Moved by a number of ticks small enough for a float.
    #[inline]
    pub fn later(self, ticks: f64) -> Self {
        let part = self.part + ticks;
        // Rounds towards zero, so one less for what is below it: `floor` is a call on plain x86-64.
        let whole = part as i64 - i64::from(part < 0.0);
        Self { whole: self.whole + whole, part: part - whole as f64 }
    }

    /// Ticks from `earlier` to `self`.
    #[inline]
    pub fn since(self, earlier: Self) -> f64 {
        (self.whole - earlier.whole) as f64 + (self.part - earlier.part)
    }

    /// Nearest whole tick.
    #[inline]
    pub fn rounded(self) -> i64 {
        self.whole + i64::from(self.part >= 0.5)
    }
}

/// A free-running clock: `local = local₀ + (t - t₀) (1 + skew)`.
#[derive(Debug, Clone)]
pub struct Clock {
    epoch: Ticks,
    local: Ticks,
    skew: f64,
}

impl Clock {
    /// Shows `local` at true time 0.
    pub fn new(local: i64) -> Self {
        Self {
            epoch: Ticks { whole: 0, part: 0.0 },
            local: Ticks { whole: local, part: 0.0 },
            skew: 0.0,
        }
    }

    /// Changes the rate from true time `t` on.
    pub fn set_skew(&mut self, t: Ticks, skew: f64) {
        self.local = self.at(t);
        self.epoch = t;
        self.skew = skew;
    }

    /// What it shows at true time `t`.
    #[inline]
    pub fn at(&self, t: Ticks) -> Ticks {
        let elapsed = t.whole - self.epoch.whole;
        let remainder = t.part - self.epoch.part;
        let gained = self.skew * (elapsed as f64 + remainder);
        Ticks { whole: self.local.whole + elapsed, part: self.local.part }.later(remainder + gained)
    }

    /// True time at which it shows `local`.
    #[inline]
    pub fn when(&self, local: Ticks) -> Ticks {
        let shown = local.whole - self.local.whole;
        let remainder = local.part - self.local.part;
        let lost = (shown as f64 + remainder) * self.skew / (1.0 + self.skew);
        Ticks { whole: self.epoch.whole + shown, part: self.epoch.part }.later(remainder - lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_when_inverts_at_after_an_hour_of_drift() {
        let mut clock = Clock::new(123_456_789);
        for minute in 0..60u64 {
            let t = Ticks::from_us(minute * 60_000_000);
            clock.set_skew(t, 1e-6 * (3.0 + minute as f64 * 0.01));
        }
        let t = Ticks::from_us(3_600_000_001).later(0.25);
        let back = clock.when(clock.at(t));
        // A hundredth of a tick is 0.05 mm.
        assert!(back.since(t).abs() < 0.01, "{}", back.since(t));
        let gained = clock.at(t).since(t) - 123_456_789.0;
        assert!((gained / t.since(Ticks::from_us(0)) - 3.295e-6).abs() < 1e-8);
    }

    #[test]
    fn prop_microseconds_are_exact() {
        assert_eq!(Ticks::from_us(2000), Ticks { whole: 127_795_200, part: 0.0 });
        let t = Ticks::from_us(3);
        assert!((t.whole as f64 + t.part - 191_692.8).abs() < 1e-9);
    }
}
