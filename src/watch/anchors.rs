//! How well each anchor does lately: measurements, share that the filter took, residuals.

use std::collections::{BTreeMap, VecDeque};

use serde::Serialize;

use haltere_core::measure::AnchorId;
use haltere_core::time::HostTime;
use haltere_core::topics::UwbRecord;

/// Length of a stretch of time, µs, and how many are looked back on.
const STRETCH_US: u64 = 500_000;
const STRETCHES: usize = 4;

/// What is counted of an anchor; a difference counts for both of its anchors.
#[derive(Debug, Clone, Copy, Default)]
struct Count {
    heard: u32,
    fused: u32,
    innovation2_m2: f64,
    ratio: f64,
}

/// An anchor as shown.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(super) struct Quality {
    /// Its number.
    pub id: u8,
    /// Differences with it in a second.
    pub hz: f64,
    /// Share of them that the filter took, 0 to 1.
    pub used: f64,
    /// Root mean square of measured minus predicted, m.
    pub rms_m: f64,
    /// Mean of the test ratio; above 1 the gate rejects.
    pub ratio: f64,
}

/// The last two seconds of all anchors.
#[derive(Debug, Default)]
pub(super) struct Anchors(VecDeque<(u64, BTreeMap<u8, Count>)>);

impl Anchors {
    /// A measurement and its fate.
    pub(super) fn take(&mut self, at: HostTime, record: &UwbRecord) {
        let number = at.as_us() / STRETCH_US;
        if self.0.back().is_none_or(|(newest, _)| *newest < number) {
            self.0.push_back((number, BTreeMap::new()));
        }
        self.forget(at);
        let Some((_, counts)) = self.0.back_mut() else { return };
        for anchor in [record.tdoa.anchor_a, record.tdoa.anchor_b] {
            let count = counts.entry(anchor.0).or_default();
            count.heard += 1;
            count.fused += u32::from(record.fused);
            let innovation2_m2 = record.innovation_m * record.innovation_m;
            if innovation2_m2.is_finite() && record.test_ratio.is_finite() {
                count.innovation2_m2 += innovation2_m2;
                count.ratio += record.test_ratio;
            }
        }
    }

    /// Lets old stretches go.
    pub(super) fn forget(&mut self, now: HostTime) {
        let number = now.as_us() / STRETCH_US;
        while self.0.front().is_some_and(|(n, _)| n + (STRETCHES as u64) <= number) {
            self.0.pop_front();
        }
    }

    /// Whether an anchor was heard lately.
    pub(super) fn hears(&self, anchor: AnchorId) -> bool {
        self.0.iter().any(|(_, counts)| counts.contains_key(&anchor.0))
    }

    /// All that were heard lately.
    pub(super) fn quality(&self) -> Vec<Quality> {
        let mut sums = BTreeMap::<u8, Count>::new();
        for (id, count) in self.0.iter().flat_map(|(_, counts)| counts) {
            let sum = sums.entry(*id).or_default();
            sum.heard += count.heard;
            sum.fused += count.fused;
            sum.innovation2_m2 += count.innovation2_m2;
            sum.ratio += count.ratio;
        }
        let span_s = STRETCH_US as f64 * 1e-6 * self.0.len().max(1) as f64;
        let quality = |(id, sum): (u8, Count)| {
            let heard = f64::from(sum.heard.max(1));
            Quality {
                id,
                hz: f64::from(sum.heard) / span_s,
                used: f64::from(sum.fused) / heard,
                rms_m: (sum.innovation2_m2 / heard).sqrt(),
                ratio: sum.ratio / heard,
            }
        };
        sums.into_iter().map(quality).collect()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use haltere_core::measure::Tdoa;

    pub(in crate::watch) fn record(a: u8, b: u8, innovation_m: f64, fused: bool) -> UwbRecord {
        let at = HostTime::from_us(0);
        UwbRecord {
            tdoa: Tdoa {
                valid_at: at,
                received_at: at,
                anchor_a: AnchorId(a),
                anchor_b: AnchorId(b),
                distance_diff_m: 0.0,
                std_m: None,
            },
            innovation_m,
            var_innovation_m2: 0.01,
            test_ratio: 0.5,
            fused,
        }
    }

    #[test]
    fn prop_rates_shares_and_residuals_are_those_of_the_last_two_seconds() {
        let mut anchors = Anchors::default();
        for n in 0..2000_u64 {
            // 100 Hz for 20 s; in the last two seconds with twice the residual, a quarter rejected.
            let at = HostTime::from_us(n * 10_000);
            let late = n >= 1800;
            anchors.take(at, &record(1, 2, if late { 0.2 } else { 0.1 }, !late || n % 4 != 0));
        }
        let [one, two] = anchors.quality()[..] else { panic!("{:?}", anchors.quality()) };
        assert_eq!((one.id, two.id), (1, 2));
        assert!((one.hz - 100.0).abs() < 1.0 && (one.used - 0.75).abs() < 0.01, "{one:?}");
        assert!((one.rms_m - 0.2).abs() < 1e-9 && (two.ratio - 0.5).abs() < 1e-9, "{one:?}");
        assert!(anchors.hears(AnchorId(1)) && !anchors.hears(AnchorId(3)));
        // NaN of a broken measurement does not spoil the others.
        anchors.take(HostTime::from_us(19_999_999), &record(1, 2, f64::NAN, false));
        assert!(anchors.quality()[0].rms_m.is_finite());
        anchors.forget(HostTime::from_us(40_000_000));
        assert!(anchors.quality().is_empty());
    }
}
