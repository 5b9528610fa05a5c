//! Puts the tag's time on the host's clock, from one-way stamps.
//!
//! # Model
//!
//! A byte that left the tag at tag time x is read at host time h = x + a + b·x + delay, delay ≥ 0
//! with a hard floor and long tails (USB frames, scheduling, stalls). So the line under all points
//! (x, h − x) that lies closest to them is the clock; an average would follow the load of the
//! machine. The least point of every half second is kept for 16 s; the line is the edge of their
//! lower convex hull above the mean of x, which is the best line under all points in the sum of
//! distances (Moon, Skelly, Towsley 1999, linear programming estimate).
//!
//! | symbol | unit | meaning |
//! |---|---|---|
//! | x | µs | tag time since the first observation |
//! | a | µs | offset, the least delay included: one-way stamps cannot tell the two apart |
//! | b | 1 | skew, within ±400 ppm |
//!
//! What comes later than that line by more than [`OLD_S`] is old: a line that holds everything up for so long is no
//! clock, however long it lasts, and nothing of it moves the map.
//!
//! Starts anew when the tag's time jumps (reboot). Left out: drift of the skew within 16 s, which
//! at 0.01 ppm/s is 1 µs.

use haltere_core::time::{HostTime, TagTime};

/// One least point is kept for each span of this length, µs.
const BUCKET_US: f64 = 500_000.0;
/// Kept points: 16 s.
const BUCKETS: usize = 32;
/// Points before a skew is believed: 2 s.
const POINTS_FOR_SKEW: usize = 5;
/// Largest skew, tag crystal against host crystal.
const MAX_SKEW: f64 = 400e-6;
/// Bytes cannot be early: by this much below the line, or back in tag time, the tag has rebooted.
const RESTART_EARLY_US: f64 = 50_000.0;
/// When even the least delay of a bucket is this much over the line…
const LATE_US: f64 = 20_000.0;
/// …for so many buckets in a row (4 s), the line is wrong, not the delays.
const RESTART_AFTER_LATE: u32 = 8;
/// Bytes this much later than the least delay are old, s: a room is left in a second by what was true so long ago, the
/// loops lose their phase at 0.2 s, and USB, radios and schedulers of a computer in order hold nothing up for longer.
const OLD_S: f64 = 0.15;
/// One sigma of the least delay that hides in the offset, s: a USB frame.
const STD_LEAST_DELAY_S: f64 = 0.5e-3;
/// One sigma of the skew while none is known: two crystals of some 30 ppm.
const STD_SKEW_UNKNOWN: f64 = 50e-6;

#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Point {
    x_us: f64,
    y_us: f64,
}

/// The map.
#[derive(Debug, Clone, Default)]
pub struct TagClock {
    origin: Option<(TagTime, HostTime)>,
    offset_us: f64,
    skew: f64,
    /// Least point of each closed bucket, oldest first.
    points: [Point; BUCKETS],
    len: usize,
    open: Option<(f64, Point)>,
    last_x_us: f64,
    late_buckets: u32,
    spread_us: f64,
}

impl TagClock {
    /// Nothing known.
    pub fn new() -> Self {
        Self::default()
    }

    /// Forgets everything: the tag has rebooted.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// Bytes stamped `tag` by the tag were read at `received_at`.
    pub fn observe(&mut self, tag: TagTime, received_at: HostTime) {
        let Some((x_us, y_us)) = self.coordinates(tag, received_at) else {
            return self.start(tag, received_at);
        };
        let below_us = self.offset_us + self.skew * x_us - y_us;
        if below_us > RESTART_EARLY_US || x_us < self.last_x_us - RESTART_EARLY_US {
            return self.start(tag, received_at);
        }
        self.last_x_us = self.last_x_us.max(x_us);
        self.offset_us -= below_us.max(0.0);
        let point = Point { x_us, y_us };
        match &mut self.open {
            Some((since_us, least)) if x_us - *since_us < BUCKET_US => {
                if y_us - self.skew * x_us < least.y_us - self.skew * least.x_us {
                    *least = point;
                }
            }
            open => {
                let closed = open.replace((x_us, point));
                if let Some((_, least)) = closed {
                    self.close(least, tag, received_at);
                }
            }
        }
    }

    /// Host time of a tag time; `None` before the first observation.
    pub fn host(&self, tag: TagTime) -> Option<HostTime> {
        let (tag_0, host_0) = self.origin?;
        let x_us = tag.seconds_since(tag_0) * 1e6;
        let host_us = x_us + self.offset_us + self.skew * x_us;
        Some(host_0.offset_us(host_us.round() as i64))
    }

    /// Whether bytes stamped `tag` that were read at `received_at` are old: later than the least delay allows.
    pub fn is_old(&self, tag: TagTime, received_at: HostTime) -> bool {
        self.host(tag).is_some_and(|at| received_at.seconds_since(at) > OLD_S)
    }

    /// One sigma of [`host`](Self::host), s; `None` before the first observation.
    pub fn std_s(&self) -> Option<f64> {
        self.origin?;
        let skew_s =
            if self.len < POINTS_FOR_SKEW { STD_SKEW_UNKNOWN * self.last_x_us * 1e-6 } else { 0.0 };
        let spread_s = self.spread_us * 1e-6;
        Some((STD_LEAST_DELAY_S.powi(2) + spread_s.powi(2) + skew_s.powi(2)).sqrt())
    }

    /// Rate of the host's clock over the tag's, minus one, in ppm; `None` while unknown.
    pub fn skew_ppm(&self) -> Option<f64> {
        (self.len >= POINTS_FOR_SKEW).then_some(self.skew * 1e6)
    }

    fn start(&mut self, tag: TagTime, received_at: HostTime) {
        *self = Self { origin: Some((tag, received_at)), ..Self::default() };
        self.open = Some((0.0, Point::default()));
    }

    fn coordinates(&self, tag: TagTime, received_at: HostTime) -> Option<(f64, f64)> {
        let (tag_0, host_0) = self.origin?;
        let x_us = tag.seconds_since(tag_0) * 1e6;
        Some((x_us, received_at.seconds_since(host_0) * 1e6 - x_us))
    }

    fn close(&mut self, least: Point, tag: TagTime, received_at: HostTime) {
        let late_us = least.y_us - self.offset_us - self.skew * least.x_us;
        if late_us > OLD_S * 1e6 {
            return;
        }
        self.late_buckets = if late_us > LATE_US { self.late_buckets + 1 } else { 0 };
        if self.late_buckets >= RESTART_AFTER_LATE {
            return self.start(tag, received_at);
        }
        if self.len == BUCKETS {
            self.points.rotate_left(1);
            self.len -= 1;
        }
        if let Some(slot) = self.points.get_mut(self.len) {
            *slot = least;
            self.len += 1;
        }
        self.fit();
    }

    fn fit(&mut self) {
        let points = self.points.get(..self.len).unwrap_or_default();
        let n = points.len() as f64;
        if points.len() >= POINTS_FOR_SKEW {
            let mean_us = points.iter().map(|p| p.x_us).sum::<f64>() / n;
            self.skew = hull_slope(points, mean_us).clamp(-MAX_SKEW, MAX_SKEW);
        }
        let over = |p: &Point| p.y_us - self.skew * p.x_us;
        self.offset_us = points.iter().map(over).fold(f64::INFINITY, f64::min);
        self.spread_us = points.iter().map(over).sum::<f64>() / n - self.offset_us;
    }
}

/// Slope of the lower convex hull above `at_us`; points ascend in x.
fn hull_slope(points: &[Point], at_us: f64) -> f64 {
    let slope = |a: &Point, b: &Point| (b.y_us - a.y_us) / (b.x_us - a.x_us).max(1.0);
    let mut hull = [Point::default(); BUCKETS];
    let mut len = 0usize;
    for point in points {
        while let Some([.., a, b]) = hull.get(..len)
            && slope(a, point) <= slope(a, b)
        {
            len -= 1;
        }
        if let Some(slot) = hull.get_mut(len) {
            *slot = *point;
            len += 1;
        }
    }
    let edges = hull.get(..len).unwrap_or_default();
    edges
        .windows(2)
        .find_map(|edge| match edge {
            [a, b] if b.x_us >= at_us => Some(slope(a, b)),
            _ => None,
        })
        .unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt as _, SeedableRng as _};
    use rand_xoshiro::Xoshiro256PlusPlus;

    /// Feeds `seconds` of packets every 2.1 ms whose delay has a floor of 0.3 ms, an exponential
    /// tail of 2 ms and a stall of 300 ms now and then. Returns the worst error in the last half.
    fn worst_error_us(clock: &mut TagClock, skew: f64, tag_start: u64, host_start: u64) -> f64 {
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(3);
        let mut worst_us = 0.0f64;
        let mut last_host_us = 0.0f64;
        let mut stall_until_us = 0.0f64;
        for i in 0..14_000u32 {
            let t_us = f64::from(i) * 2100.5;
            if rng.random_bool(0.0005) {
                stall_until_us = t_us + 300_000.0;
            }
            let delay_us = 300.0 - 2000.0 * rng.random::<f64>().max(1e-9).ln();
            let host_us = (t_us + delay_us).max(stall_until_us).max(last_host_us);
            last_host_us = host_us;
            let tag = TagTime::from_us(tag_start + (t_us * (1.0 + skew)) as u64);
            let received_at = HostTime::from_us(host_start + host_us as u64);
            clock.observe(tag, received_at);
            let mapped = clock.host(tag).unwrap();
            assert!(mapped <= received_at.offset_us(1));
            if i > 7_000 {
                let error_us = mapped.as_us() as f64 - (host_start as f64 + t_us + 300.0);
                worst_us = worst_us.max(error_us.abs());
            }
        }
        worst_us
    }

    #[test]
    fn prop_jitter_and_stalls_do_not_move_the_map() {
        for skew in [-80e-6, 0.0, 60e-6] {
            let mut clock = TagClock::new();
            let worst_us = worst_error_us(&mut clock, skew, 5_000_000, 90_000_000);
            println!("skew {:5.0} ppm: worst error {worst_us:.0} us", skew * 1e6);
            assert!(worst_us < 100.0, "{worst_us} us");
            assert!((clock.skew_ppm().unwrap() + skew * 1e6).abs() < 15.0);
            assert!(clock.std_s().unwrap() < 1e-3);
        }
    }

    #[test]
    fn prop_reboots_forward_and_back_start_anew() {
        for tag_start in [0, 3_000_000_000] {
            let mut clock = TagClock::new();
            worst_error_us(&mut clock, 20e-6, 60_000_000, 90_000_000);
            let worst_us = worst_error_us(&mut clock, 20e-6, tag_start, 130_000_000);
            assert!(worst_us < 100.0, "{worst_us} us");
        }
    }

    #[test]
    fn regress_a_line_that_becomes_late_is_old_for_good() {
        let mut clock = TagClock::new();
        worst_error_us(&mut clock, 20e-6, 60_000_000, 90_000_000);
        let mut old = |late_us: u64, from_s: u64| {
            let stamps = |n: u64| 60_000_000 + from_s * 1_000_000 + n * 2_000;
            (0..10_000).all(|n| {
                let tag = TagTime::from_us(stamps(n));
                let received_at = HostTime::from_us(stamps(n) + 30_000_000 + late_us);
                clock.observe(tag, received_at);
                clock.is_old(tag, received_at)
            })
        };
        assert!(old(1_000_000, 30), "a minute later what was true a second ago is still that");
        assert!(old(250_000, 60));
        assert!(!old(30_000, 90), "a line that is in order again is used again");
    }

    #[test]
    fn prop_a_line_that_is_too_early_is_given_up() {
        let mut clock = TagClock::new();
        worst_error_us(&mut clock, 0.0, 60_000_000, 90_000_000);
        // The tag's time steps back by less than a reboot would: all is 40 ms late from now on.
        let worst_us = worst_error_us(&mut clock, 0.0, 60_000_000 + 14_000 * 2_100, 119_540_000);
        assert!(worst_us < 100.0, "{worst_us} us");
    }
}
