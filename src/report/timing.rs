//! How regular the control step was: times between steps, and lateness of the wake-ups.

use haltere_core::time::HostTime;

/// Period of the control step, µs: the schedule of the core.
const PERIOD_US: u64 = 10_000;
/// Bins of a histogram; what is beyond the last is counted in it.
const BINS: usize = 60;

/// Counts by size.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Histogram {
    /// Begin of the first bin, ms.
    pub low_ms: f64,
    /// Width of a bin, ms.
    pub width_ms: f64,
    /// Counts.
    pub counts: Vec<u64>,
    /// Values counted.
    pub total: u64,
    /// Value that 50, 99 and 100 percent do not exceed, ms.
    pub percentiles_ms: [f64; 3],
}

impl Histogram {
    fn of(mut values_ms: Vec<f64>, low_ms: f64, least_width_ms: f64) -> Option<Self> {
        values_ms.retain(|v| v.is_finite());
        values_ms.sort_by(f64::total_cmp);
        let (n, last) = (values_ms.len(), *values_ms.last()?);
        let at = |share: f64| values_ms[((n - 1) as f64 * share).round() as usize];
        // The worst one in a thousand may share the last bin: it is told in words.
        let reach = (at(0.999) - low_ms).max(0.0) * 1.2;
        let width_ms = (reach / BINS as f64).max(least_width_ms);
        let mut counts = vec![0; BINS];
        for value in &values_ms {
            let bin = ((value - low_ms) / width_ms).floor().clamp(0.0, (BINS - 1) as f64);
            counts[bin as usize] += 1;
        }
        let percentiles_ms = [at(0.5), at(0.99), last];
        Some(Self { low_ms, width_ms, counts, total: n as u64, percentiles_ms })
    }

    /// Outline of the bars, counts as decimal logarithms: one count stands above the axis.
    pub fn outline(&self) -> Vec<[f64; 2]> {
        let mut points = Vec::new();
        for (i, count) in self.counts.iter().enumerate() {
            let a = self.low_ms + self.width_ms * i as f64;
            let y = if *count == 0 { NOTHING } else { (*count as f64).log10() };
            points.extend([[a, y], [a + self.width_ms, y]]);
        }
        points
    }
}

/// Where a bin without a count stands on the axis of logarithms.
pub(super) const NOTHING: f64 = -0.5;

/// Times between control steps.
pub(super) fn periods(steps: &[HostTime]) -> Option<Histogram> {
    let values: Vec<f64> = steps.windows(2).map(|w| w[1].seconds_since(w[0]) * 1e3).collect();
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    Histogram::of(values, (least - 0.1).clamp(0.0, 10.0), 0.02)
}

/// How late the core was woken for its steps. They are due on a grid from its start; a wake-up before
/// the next due time is none for a step.
pub(super) fn lateness(start: HostTime, wakes: &[HostTime]) -> Option<Histogram> {
    // A damaged log may claim any time, the largest too: behind it nothing is due.
    let mut due_us = start.as_us().checked_add(PERIOD_US);
    let mut values = Vec::new();
    for wake in wakes.iter().map(|wake| wake.as_us()).filter(|wake| *wake >= start.as_us()) {
        let Some(late_us) = due_us.and_then(|due_us| wake.checked_sub(due_us)) else { continue };
        values.push(late_us as f64 * 1e-3);
        due_us = wake.checked_add(PERIOD_US - late_us % PERIOD_US);
    }
    // Of a part of a log the first wake-up is no lateness.
    let first = values.first().copied();
    if first.is_some_and(|late_ms| late_ms > 1e3) {
        values.remove(0);
    }
    Histogram::of(values, 0.0, 0.02)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_lateness_is_against_the_grid() {
        let at = HostTime::from_us;
        let wakes = [10_100, 20_300, 25_000, 30_000, 52_000, 60_000].map(|us| at(1_000_000 + us));
        let found = lateness(at(1_000_000), &wakes).unwrap();
        // 0.1, 0.3, (early: none), 0.0, 12.0 late for 40 ms, 0.0 for 60 ms.
        assert_eq!(found.total, 5);
        assert_eq!(found.percentiles_ms, [0.1, 12.0, 12.0]);
        assert_eq!(found.counts.iter().sum::<u64>(), 5);
        assert_eq!(lateness(at(0), &[]), None);
    }

    /// A damaged log may claim any time: the next due time lay beyond the largest.
    #[test]
    fn regress_nothing_is_due_behind_the_largest_time() {
        let at = HostTime::from_us;
        assert_eq!(lateness(at(u64::MAX), &[at(u64::MAX)]), None);
        let found = lateness(at(0), &[at(u64::MAX - 1), at(u64::MAX)]);
        assert_eq!(found, None, "the first wake-up of a part is no lateness");
        let found = lateness(at(u64::MAX - 25_000), &[at(u64::MAX - 14_000), at(u64::MAX)]);
        assert_eq!(found.map(|f| f.total), Some(2));
    }

    #[test]
    fn prop_periods_are_counted() {
        let steps: Vec<_> = (0..1000).map(|i| HostTime::from_us(10_000 * i)).collect();
        let found = periods(&steps).unwrap();
        assert_eq!((found.total, found.percentiles_ms), (999, [10.0; 3]));
        assert_eq!(periods(&steps[..1]), None);
        assert!(found.outline().iter().flatten().all(|v| v.is_finite()));
    }
}
