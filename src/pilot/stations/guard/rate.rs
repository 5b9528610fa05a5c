//! How much one link may bring in: a bucket that fills with time.

use haltere_core::time::HostTime;

/// The bucket holds what this time brings, s: a burst that long passes whole.
const DEPTH_S: f64 = 1.0;
/// It holds at least one read of a stream or one datagram of any sane sender, bytes.
const LEAST_DEPTH_BYTES: f64 = 8192.0;

/// What a link may bring in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateLimit {
    /// Frames in a second.
    pub frames_per_s: f64,
    /// Bytes in a second.
    pub bytes_per_s: f64,
}

/// What is left of one of them.
#[derive(Debug, Clone)]
pub(super) struct Bucket {
    per_s: f64,
    depth: f64,
    level: f64,
    filled_at: Option<HostTime>,
}

impl Bucket {
    pub fn of_frames(limit: &RateLimit) -> Self {
        Self::new(limit.frames_per_s, 1.0)
    }

    pub fn of_bytes(limit: &RateLimit) -> Self {
        Self::new(limit.bytes_per_s, LEAST_DEPTH_BYTES)
    }

    fn new(per_s: f64, least_depth: f64) -> Self {
        let depth = (per_s * DEPTH_S).max(least_depth);
        Self { per_s, depth, level: depth, filled_at: None }
    }

    /// Takes so much out. `false`: it does not hold so much, and nothing is taken.
    pub fn take(&mut self, at: HostTime, amount: f64) -> bool {
        let passed_s = self.filled_at.map_or(0.0, |t| at.seconds_since(t).max(0.0));
        self.filled_at = Some(self.filled_at.map_or(at, |t| t.max(at)));
        self.level = (self.level + passed_s * self.per_s).min(self.depth);
        let enough = self.level >= amount;
        if enough {
            self.level -= amount;
        }
        enough
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_burst_passes_and_then_only_the_rate() {
        let mut bucket = Bucket::of_frames(&RateLimit { frames_per_s: 100.0, bytes_per_s: 1e6 });
        let at = |ms: u64| HostTime::from_us(ms * 1000);
        let passed = (0..500).filter(|_| bucket.take(at(0), 1.0)).count();
        assert_eq!(passed, 100);
        // Ten seconds of a flood of 1000 frames/s.
        let passed = (1..=10_000).filter(|ms| bucket.take(at(*ms), 1.0)).count();
        assert!((995..=1001).contains(&passed), "{passed}");
        // A clock that goes back fills nothing.
        assert!(!bucket.take(at(0), 2.0));
    }

    #[test]
    fn prop_any_single_read_fits_an_empty_link() {
        let mut bucket = Bucket::of_bytes(&RateLimit { frames_per_s: 1.0, bytes_per_s: 100.0 });
        assert!(bucket.take(HostTime::from_us(0), LEAST_DEPTH_BYTES));
        assert!(!bucket.take(HostTime::from_us(0), 1.0));
    }
}
