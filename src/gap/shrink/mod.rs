//! How far a gap shrinks once an effect is added, on flights that were not used for the fit.
//!
//! `D(real, sim) = E |z_r - z_s|² / p`, over pairs of a real and a simulated flight. The floor `F` is
//! what a perfect model would still differ by: with accepted flights of the airframe their own distance to
//! the nominal model, which describes them; else `E |z_s - z_s'|² / p` over pairs of simulated flights
//! at the fitted model. `shrink = (D_before - D_after) / (D_before - F)`. `z`: statistics by a robust sigma,
//! compressed beyond ten of them (`10 asinh(z/10)`), so that one broken statistic is not the whole gap;
//! unknown ones are left out pairwise. Values
//! above one or below zero are not clipped. Intervals: BCa bootstrap over real flights
//! (Efron 1987), with the simulated flights of each as one cluster.

pub mod held_out;
pub mod resize;

use serde::{Deserialize, Serialize};

use crate::normal;
use haltere_model::random::Stream;

/// Resamples of an interval.
const RESAMPLES: usize = 2000;
/// Standardised differences grow like their logarithm from here on.
const LARGE: f64 = 10.0;
/// Fewest accepted flights that make a floor.
const LEAST_HEALTHY: usize = 8;
/// Sigma per median absolute deviation of a normal variable.
const SIGMA_PER_MAD: f64 = 1.4826;

/// One held-out real flight with flights of the same mission, paired seeds before and after.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Paired {
    /// Statistics of the real flight.
    pub real: Vec<f64>,
    /// Nominal simulator, one row per seed.
    pub before: Vec<Vec<f64>>,
    /// With the effect, one row per seed, in the same order.
    pub after: Vec<Vec<f64>>,
    /// Accepted flights of the airframe on the same mission; may be empty.
    pub healthy: Vec<Vec<f64>>,
}

impl Paired {
    /// What a perfect model would still differ by.
    fn floor(&self, scales: &[f64]) -> f64 {
        if self.healthy.len() < LEAST_HEALTHY {
            return among(&self.after, scales);
        }
        mean(self.healthy.iter().map(|h| to_all(h, &self.before, scales)))
    }
}

/// Shrink with its interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Shrink {
    /// Share of the gap that is closed; `None`: the gap is not above its own noise.
    pub value: Option<f64>,
    /// 95 % interval; `None` with fewer than three flights.
    pub interval: Option<[f64; 2]>,
    /// Distance before.
    pub before: f64,
    /// Distance after.
    pub after: f64,
    /// Floor.
    pub floor: f64,
    /// 95 % limit of `D - F` of flights of the model itself.
    pub noise: f64,
}

/// Sigma of every statistic among simulated flights; NaN where it never varies or is unknown.
pub fn scales(rows: &[Vec<f64>]) -> Vec<f64> {
    let width = rows.iter().map(Vec::len).max().unwrap_or(0);
    let scale = |j: usize| {
        let mut known: Vec<f64> =
            rows.iter().filter_map(|r| r.get(j).copied()).filter(|v| v.is_finite()).collect();
        let middle = median(&mut known);
        let mut off: Vec<f64> = known.iter().map(|v| (v - middle).abs()).collect();
        let plain = (off.iter().map(|v| v * v).sum::<f64>() / off.len() as f64).sqrt();
        let robust = SIGMA_PER_MAD * median(&mut off);
        let sigma = if robust > 0.3 * plain { robust } else { plain };
        if sigma > f64::EPSILON * middle.abs() { sigma } else { f64::NAN }
    };
    (0..width).map(scale).collect()
}

/// Medians of every statistic over flights.
pub(crate) fn medians(rows: &[Vec<f64>]) -> Vec<f64> {
    let width = rows.iter().map(Vec::len).max().unwrap_or(0);
    (0..width)
        .map(|j| {
            let mut known: Vec<f64> =
                rows.iter().filter_map(|r| r.get(j).copied()).filter(|v| v.is_finite()).collect();
            median(&mut known)
        })
        .collect()
}

pub(crate) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

/// Mean squared standardised difference of two flights; NaN without a common statistic.
pub fn distance(a: &[f64], b: &[f64], scales: &[f64]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for ((x, y), s) in a.iter().zip(b).zip(scales) {
        let z = (x - y) / s;
        if z.is_finite() {
            sum += compressed(z).powi(2);
            count += 1.0;
        }
    }
    sum / count
}

/// A standardised difference, compressed where it is large: one broken statistic is not the whole gap.
pub(crate) fn compressed(z: f64) -> f64 {
    LARGE * (z / LARGE).asinh()
}

/// Mean distance of one flight to many.
pub(crate) fn to_all(real: &[f64], sims: &[Vec<f64>], scales: &[f64]) -> f64 {
    mean(sims.iter().map(|s| distance(real, s, scales)))
}

/// Mean distance among flights of one model.
fn among(sims: &[Vec<f64>], scales: &[f64]) -> f64 {
    let pairs = sims
        .iter()
        .enumerate()
        .flat_map(|(i, a)| sims.iter().skip(i + 1).map(move |b| distance(a, b, scales)));
    mean(pairs)
}

/// Mean of the finite values; NaN of none.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for v in values.filter(|v| v.is_finite()) {
        sum += v;
        count += 1.0;
    }
    sum / count
}

/// Shrink over all flights. `scales`: [`scales`] of nominal flights; `seed`: of the bootstrap.
pub fn shrink(flights: &[Paired], scales: &[f64], seed: u64) -> Shrink {
    let parts: Vec<[f64; 3]> = flights
        .iter()
        .map(|f| {
            [to_all(&f.real, &f.before, scales), to_all(&f.real, &f.after, scales), f.floor(scales)]
        })
        .filter(|p| p.iter().all(|v| v.is_finite()))
        .collect();
    let total = |k: usize| mean(parts.iter().map(|p| p[k]));
    let (before, after, floor) = (total(0), total(1), total(2));
    let noise = noise(flights, scales, parts.len());
    let ratio = |rows: &[[f64; 3]]| {
        let t = |k: usize| rows.iter().map(|p| p[k]).sum::<f64>();
        (t(0) - t(1)) / (t(0) - t(2))
    };
    let testable = before - floor > noise;
    let interval = (testable && parts.len() >= LEAST_FLIGHTS).then(|| bca(&parts, ratio, seed));
    let value = testable.then(|| ratio(&parts));
    Shrink { value, interval, before, after, floor, noise }
}

/// Fewest flights of an interval.
const LEAST_FLIGHTS: usize = 3;

/// Shrink per channel: `channels` names the places of the statistics of each.
pub fn by_channel(
    flights: &[Paired],
    scales: &[f64],
    channels: &[(String, Vec<usize>)],
    seed: u64,
) -> Vec<(String, Shrink)> {
    channels
        .iter()
        .map(|(name, places)| {
            let only: Vec<f64> = (0..scales.len())
                .map(|j| if places.contains(&j) { scales[j] } else { f64::NAN })
                .collect();
            (name.clone(), shrink(flights, &only, seed))
        })
        .collect()
}

/// Shrink of the named effect by that of the best attainable model.
pub fn efficiency(named: &Shrink, attainable: &Shrink) -> Option<f64> {
    let (named, attainable) = (named.value?, attainable.value?);
    (attainable > 0.0).then_some(named / attainable)
}

/// Control: median shrink of effects that are not the cause.
pub fn wrong_effects(shrinks: &[Shrink]) -> Option<f64> {
    let mut values: Vec<f64> = shrinks.iter().filter_map(|s| s.value).collect();
    (!values.is_empty()).then(|| median(&mut values))
}

/// 95 % limit of the mean of `D - F` over as many flights, when the flights are of the model
/// itself: every accepted flight, or else every simulated one in turn, plays the real one.
fn noise(flights: &[Paired], scales: &[f64], count: usize) -> f64 {
    let mut own: Vec<f64> = Vec::new();
    for f in flights {
        if f.healthy.len() >= LEAST_HEALTHY {
            let floor = f.floor(scales);
            own.extend(f.healthy.iter().map(|h| to_all(h, &f.before, scales) - floor));
            continue;
        }
        let all = among(&f.after, scales);
        for (i, played) in f.after.iter().enumerate() {
            let others = f.after.iter().enumerate().filter(|(k, _)| *k != i);
            own.push(mean(others.map(|(_, s)| distance(played, s, scales))) - all);
        }
    }
    own.retain(|v| v.is_finite());
    own.sort_by(f64::total_cmp);
    let rank = (0.95 * own.len() as f64) as usize;
    let one = own.get(rank.min(own.len().saturating_sub(1))).copied().unwrap_or(f64::INFINITY);
    one / (count.max(1) as f64).sqrt()
}

/// Bias-corrected and accelerated 95 % interval over clusters.
fn bca(parts: &[[f64; 3]], statistic: impl Fn(&[[f64; 3]]) -> f64, seed: u64) -> [f64; 2] {
    let n = parts.len();
    let whole = statistic(parts);
    let mut rng = Stream::new(seed, "shrink");
    let mut drawn: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            let rows: Vec<[f64; 3]> =
                (0..n).map(|_| parts[((rng.uniform() * n as f64) as usize).min(n - 1)]).collect();
            statistic(&rows)
        })
        .filter(|v| v.is_finite())
        .collect();
    drawn.sort_by(f64::total_cmp);
    let below = drawn.iter().filter(|v| **v < whole).count() as f64;
    let m = drawn.len() as f64;
    let bias = normal::quantile((below / m).clamp(0.5 / m, 1.0 - 0.5 / m));
    let left_out: Vec<f64> = (0..n)
        .map(|i| {
            let rows: Vec<[f64; 3]> =
                parts.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, p)| *p).collect();
            statistic(&rows)
        })
        .collect();
    let centre = mean(left_out.iter().copied());
    let sums = left_out.iter().fold((0.0, 0.0), |(a, b), v| {
        let d = centre - v;
        (a + d * d * d, b + d * d)
    });
    let bend = if sums.1 > 0.0 { sums.0 / (6.0 * sums.1.powf(1.5)) } else { 0.0 };
    let end = |z: f64| {
        let moved = bias + (bias + z) / (1.0 - bend * (bias + z));
        let rank = (normal::share(moved) * m) as usize;
        drawn.get(rank.min(drawn.len().saturating_sub(1))).copied().unwrap_or(f64::NAN)
    };
    [end(-1.959_964), end(1.959_964)]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Statistics with sigma one; the real flights carry `gap` in half of them, the model after
    /// carries `closed` of it.
    fn world(gap: f64, closed: f64, flights: usize, seed: u64) -> (Vec<Paired>, Vec<f64>) {
        let mut rng = Stream::new(seed, "world");
        let mut flight = |shift: f64| -> Vec<f64> {
            (0..40).map(|j| 3.0 * (rng.normal() + if j < 20 { shift } else { 0.0 })).collect()
        };
        let paired: Vec<Paired> = (0..flights)
            .map(|_| Paired {
                real: flight(gap),
                before: (0..20).map(|_| flight(0.0)).collect(),
                after: (0..20).map(|_| flight(closed * gap)).collect(),
                healthy: vec![],
            })
            .collect();
        let nominal: Vec<Vec<f64>> = paired.iter().flat_map(|p| p.before.clone()).collect();
        (paired, scales(&nominal))
    }

    #[test]
    fn val_shrink_of_a_known_share() {
        // Squared distance: closing a share c of the shift closes 1 - (1 - c)² of the gap.
        for closed in [0.0, 0.5, 1.0, -0.5] {
            let (flights, scales) = world(2.5, closed, 24, 3);
            let s = shrink(&flights, &scales, 1);
            let want = 1.0 - (1.0 - closed) * (1.0 - closed);
            let value = s.value.unwrap();
            assert!((value - want).abs() < 0.12, "{value} {want}");
            let [low, high] = s.interval.unwrap();
            assert!(low <= value && value <= high && high - low < 0.4, "{low} {value} {high}");
        }
    }

    #[test]
    fn prop_accepted_flights_make_the_floor_of_a_noisier_world() {
        // A real world with twice the noise of the model: a perfect model still has its floor there.
        let mut rng = Stream::new(11, "noisier");
        let mut flight = |sigma: f64, shift: f64| -> Vec<f64> {
            (0..40).map(|j| sigma * rng.normal() + if j < 20 { shift } else { 0.0 }).collect()
        };
        let flights: Vec<Paired> = (0..12)
            .map(|_| Paired {
                real: flight(2.0, 6.0),
                before: (0..12).map(|_| flight(1.0, 0.0)).collect(),
                after: (0..12).map(|_| flight(1.0, 6.0)).collect(),
                healthy: (0..24).map(|_| flight(2.0, 0.0)).collect(),
            })
            .collect();
        let scales = vec![1.0; 40];
        let value = shrink(&flights, &scales, 1).value.unwrap();
        assert!((value - 1.0).abs() < 0.1, "{value}");
        let blind: Vec<Paired> =
            flights.iter().map(|f| Paired { healthy: vec![], ..f.clone() }).collect();
        let low = shrink(&blind, &scales, 1).value.unwrap();
        assert!(low < value - 0.1, "without them the real noise counts as gap: {low}");
    }

    #[test]
    fn prop_no_number_without_a_gap() {
        let mut numbers = 0;
        for seed in 0..20 {
            let (flights, scales) = world(0.0, 0.0, 6, seed);
            numbers += usize::from(shrink(&flights, &scales, 1).value.is_some());
        }
        assert!(numbers <= 4, "{numbers} of 20 flights without a gap got a number");
    }

    #[test]
    fn prop_unknown_statistics_are_left_out() {
        let (mut flights, scales) = world(4.0, 1.0, 8, 4);
        let plain = shrink(&flights, &scales, 1).value.unwrap();
        for f in &mut flights {
            f.real[3] = f64::NAN;
            f.after[2][7] = f64::INFINITY;
        }
        let holed = shrink(&flights, &scales, 1).value.unwrap();
        assert!((plain - holed).abs() < 0.1, "{plain} {holed}");
        let empty = shrink(&[], &scales, 1);
        assert_eq!(empty.value, None);
    }

    #[test]
    fn prop_channels_controls_and_efficiency() {
        let (flights, scales) = world(4.0, 1.0, 8, 5);
        let channels =
            [("hit".to_string(), (0..20).collect()), ("quiet".to_string(), (20..40).collect())];
        let parts = by_channel(&flights, &scales, &channels, 1);
        assert!(parts[0].1.value.unwrap() > 0.9);
        assert_eq!(parts[1].1.value, None, "{:?}", parts[1]);
        let full = shrink(&flights, &scales, 1);
        assert_eq!(efficiency(&full, &full), Some(1.0));
        let (wrong, scales) = world(4.0, -0.5, 8, 6);
        let wrong = shrink(&wrong, &scales, 1);
        assert!(wrong_effects(&[wrong, full, wrong]).unwrap() < -0.5);
    }
}
