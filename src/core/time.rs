//! Time: three clocks that do not subtract from one another.
//!
//! All stamps are whole microseconds. A span inside one function is `dt_s: f64`.

/// Time of this computer: monotonic, microseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct HostTime(u64);

/// Time of the inner-loop board since its boot, microseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct FcTime(u64);

/// Time of the UWB tag, microseconds, unwrapped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct TagTime(u64);

macro_rules! clock {
    ($name:ident) => {
        impl $name {
            /// From microseconds.
            pub const fn from_us(us: u64) -> Self {
                Self(us)
            }
            /// In microseconds.
            pub const fn as_us(self) -> u64 {
                self.0
            }
            /// Seconds from `earlier` to `self`; negative when `earlier` is later.
            pub fn seconds_since(self, earlier: Self) -> f64 {
                self.0.wrapping_sub(earlier.0).cast_signed() as f64 * 1e-6
            }
            /// Moved by `us`, stopping at the ends of the range.
            pub const fn offset_us(self, us: i64) -> Self {
                Self(self.0.saturating_add_signed(us))
            }
        }
    };
}
clock!(HostTime);
clock!(FcTime);
clock!(TagTime);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_spans_are_signed() {
        let a = HostTime::from_us(1_000_000);
        let b = a.offset_us(-250_000);
        assert_eq!(b.seconds_since(a), -0.25);
        assert_eq!(a.seconds_since(b), 0.25);
        assert_eq!(HostTime::from_us(5).offset_us(-10), HostTime::from_us(0));
    }
}
