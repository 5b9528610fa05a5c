//! What the taps saw, as figures: gaps between setpoints, and the way from UWB to setpoint.

use super::stalls::Stalls;
use super::tap::Passed;

/// Values in order of size, ms.
#[derive(Debug, Default, Clone)]
pub struct Sorted(Vec<f64>);

impl Sorted {
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        Self(values)
    }

    /// Value that this share does not exceed; NaN of nothing.
    pub fn at(&self, share: f64) -> f64 {
        let last = self.0.len().saturating_sub(1);
        self.0.get((share * last as f64).round() as usize).copied().unwrap_or(f64::NAN)
    }

    pub fn count(&self) -> usize {
        self.0.len()
    }

    /// How many are larger.
    pub fn beyond(&self, limit: f64) -> usize {
        self.0.iter().filter(|v| **v > limit).count()
    }

    /// Share that is not larger.
    pub fn share_within(&self, limit: f64) -> f64 {
        1.0 - self.beyond(limit) as f64 / self.count().max(1) as f64
    }

    /// Takes others in.
    pub fn join(&mut self, other: Self) {
        self.0.extend(other.0);
        self.0.sort_by(f64::total_cmp);
    }
}

/// Of one flight.
#[derive(Debug, Default, Clone)]
pub struct Wire {
    /// Between setpoints, ms.
    pub gaps_ms: Sorted,
    /// The same without the time for which a processor of this computer stood still.
    pub own_gaps_ms: Sorted,
    /// From the last byte of the tag's chunk to the next setpoint, ms.
    pub latency_ms: Sorted,
    /// The same without the time for which a processor stood still.
    pub own_latency_ms: Sorted,
}

impl Wire {
    /// Between two times, µs, in which the vehicle flew.
    pub fn of(passed: &Passed, stalls: &Stalls, from_us: u64, to_us: u64) -> Self {
        let within = |all: &[u64]| -> Vec<u64> {
            all.iter().copied().filter(|t| (from_us..=to_us).contains(t)).collect()
        };
        let (tag, setpoints) = (within(&passed.tag_us), within(&passed.setpoints_us));
        let ms = |from: u64, to: u64| to.saturating_sub(from) as f64 * 1e-3;
        let gaps = setpoints.windows(2).map(|w| ms(w[0], w[1])).collect();
        let own = |w: &[u64]| ms(w[0] + stalls.stood_us(w[0], w[1]), w[1]);
        let own_gaps = setpoints.windows(2).map(own).collect();
        let next = |t: u64| setpoints.get(setpoints.partition_point(|s| *s < t)).copied();
        let way = |t: u64| next(t).map(|to| (ms(t, to), ms(t + stalls.stood_us(t, to), to)));
        let (latency, own_latency) = tag.iter().filter_map(|t| way(*t)).unzip();
        Self {
            gaps_ms: Sorted::of(gaps),
            own_gaps_ms: Sorted::of(own_gaps),
            latency_ms: Sorted::of(latency),
            own_latency_ms: Sorted::of(own_latency),
        }
    }

    pub fn join(&mut self, other: Self) {
        self.gaps_ms.join(other.gaps_ms);
        self.own_gaps_ms.join(other.own_gaps_ms);
        self.latency_ms.join(other.latency_ms);
        self.own_latency_ms.join(other.own_latency_ms);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_gaps_and_latency_are_of_the_flight_alone() {
        let passed = Passed {
            tag_us: vec![500, 10_500, 14_000, 29_000, 31_000],
            setpoints_us: vec![1_000, 11_000, 20_000, 30_000, 90_000],
        };
        let stalls = Stalls::of(vec![[12_000, 15_000], [80_000, 85_000]]);
        let wire = Wire::of(&passed, &stalls, 10_000, 40_000);
        assert_eq!((wire.own_gaps_ms.at(0.0), wire.own_gaps_ms.at(1.0)), (6.0, 10.0));
        assert_eq!(wire.gaps_ms.count(), 2);
        assert_eq!((wire.gaps_ms.at(0.0), wire.gaps_ms.at(1.0)), (9.0, 10.0));
        // The last chunk is followed by no setpoint of this flight.
        assert_eq!(wire.latency_ms.count(), 3);
        assert_eq!((wire.latency_ms.at(0.0), wire.latency_ms.at(1.0)), (0.5, 6.0));
        assert_eq!(wire.latency_ms.beyond(1.0), 1);
        assert!((wire.latency_ms.share_within(1.0) - 2.0 / 3.0).abs() < 1e-12);
        assert_eq!(wire.own_latency_ms.at(1.0), 5.0);
        assert!(Sorted::default().at(0.5).is_nan());
    }
}
