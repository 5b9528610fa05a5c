//! Parameters of an effect on the unit cube: log-uniform where the range asks for it, whole numbers where draws have no
//! others (which anchor, which wall), and the features that signatures depend on.

use crate::gap::bank::LEAST_DRAWS;
use crate::model::random::Stream;

/// A positive range at least this wide, as a ratio, is drawn and searched on a logarithmic scale.
const LOG_RATIO: f64 = 3.0;

/// A parameter that is a whole number in every draw and has fewer values than this is a choice: more anchors than a room has.
const MOST_CHOICES: f64 = 32.0;
/// Feature of a choice that is made. Of the others it is zero: any two choices are 1.4 times as far apart as the ends of
/// a range, so that a smooth kernel at its short lengths learns each by itself (judgement).
const CHOSEN: f64 = 2.0;

/// Of a range of one sign, the end near zero is at least this share of the least draw: a logarithmic range does not
/// begin at nothing (judgement).
const LEAST_SHARE: f64 = 0.5;

/// Range of one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Range {
    low: f64,
    high: f64,
    log: bool,
    /// A choice of one of some: nothing lies between two of them, and the next one is no nearer than the last.
    choice: bool,
}

impl Range {
    /// Range that draws of a parameter come from. Draws are stratified, one in each of `count` equal parts: the ends lie up to
    /// one part beyond the outermost. Without that, a size at the end of what is plausible is outside of every interval.
    fn of(values: impl Iterator<Item = f64> + Clone) -> Self {
        let count = values.clone().count();
        let (low, high) = values
            .clone()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        let width = high - low;
        let choice =
            width > 0.0 && width < MOST_CHOICES && values.clone().all(|v| v.fract() == 0.0);
        let log = !choice && low > 0.0 && high > LOG_RATIO * low;
        let part = if choice || count < LEAST_DRAWS { 0.0 } else { width / (count as f64 - 1.0) };
        // A size has one sign.
        let low = if low > 0.0 { (low - part).max(LEAST_SHARE * low) } else { low - part };
        let high = if high < 0.0 { (high + part).min(LEAST_SHARE * high) } else { high + part };
        Self { low, high, log, choice }
    }

    fn to_unit(self, value: f64) -> f64 {
        let width = self.high - self.low;
        if width <= 0.0 {
            return 0.5;
        }
        let unit = if self.log {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / width
        };
        unit.clamp(0.0, 1.0)
    }

    fn value(self, unit: f64) -> f64 {
        if self.log {
            return self.low * (self.high / self.low).powf(unit);
        }
        let value = self.low + (self.high - self.low) * unit;
        if self.choice { value.round() } else { value }
    }

    /// Choices that there are.
    fn choices(self) -> usize {
        if self.choice { (self.high - self.low) as usize + 1 } else { 0 }
    }

    /// Place of "no effect" when the range lies on both sides of it.
    fn zero(self) -> Option<f64> {
        let straddles = self.low < 0.0 && self.high > 0.0;
        straddles.then(|| -self.low / (self.high - self.low))
    }
}

/// Parameter space of one effect.
#[derive(Debug, Clone)]
pub(super) struct Space {
    ranges: Vec<Range>,
}

impl Space {
    /// As wide as what the draws come from.
    pub fn of(thetas: &[&[f64]]) -> Self {
        let d = thetas.first().map_or(0, |t| t.len());
        let range = |k: usize| Range::of(thetas.iter().filter_map(|t| t.get(k).copied()));
        Self { ranges: (0..d).map(range).collect() }
    }

    /// Number of parameters.
    pub fn len(&self) -> usize {
        self.ranges.len()
    }

    /// Physical to unit.
    pub fn to_unit(&self, theta: &[f64]) -> Vec<f64> {
        self.ranges.iter().zip(theta).map(|(r, v)| r.to_unit(*v)).collect()
    }

    /// Unit to physical.
    pub fn value(&self, unit: &[f64]) -> Vec<f64> {
        self.ranges.iter().zip(unit).map(|(r, u)| r.value(*u)).collect()
    }

    /// Features: each parameter on -1 to 1; a choice by one feature for each that there is; where zero lies inside the
    /// range, its size as well
    /// (slots sorted by size depend on it); for two or more of those, their length.
    pub fn features(&self, unit: &[f64]) -> Vec<f64> {
        let mut out = Vec::new();
        for (r, u) in self.ranges.iter().zip(unit) {
            let chosen = r.value(*u) - r.low;
            match r.choices() {
                0 => out.push(2.0 * u - 1.0),
                count => {
                    out.extend((0..count).map(|k| if k as f64 == chosen { CHOSEN } else { 0.0 }))
                }
            }
        }
        let mut squares = Vec::new();
        for (r, u) in self.ranges.iter().zip(unit) {
            if let Some(zero) = r.zero() {
                let size = (u - zero).abs() / zero.max(1.0 - zero);
                out.push(2.0 * size - 1.0);
                squares.push(size * size);
            }
        }
        if squares.len() > 1 {
            let mean = squares.iter().sum::<f64>() / squares.len() as f64;
            out.push(2.0 * mean.sqrt() - 1.0);
        }
        out
    }

    /// Points spread evenly over the cube: a Kronecker sequence of the generalised golden ratio
    /// (Roberts 2018), `x_k = frac(½ + k φ_d^-i)`.
    pub fn spread(&self, count: usize) -> Vec<Vec<f64>> {
        let d = self.len();
        let mut ratio: f64 = 2.0;
        for _ in 0..64 {
            ratio = (1.0 + ratio).powf(1.0 / (d as f64 + 1.0));
        }
        let at = |k: usize| {
            (0..d).map(|i| (0.5 + (k + 1) as f64 * ratio.powi(-(i as i32) - 1)).fract()).collect()
        };
        (0..count).map(at).collect()
    }
}

/// Standard normal vectors from a stream with a fixed name: the same for every flight, so that
/// evidences of different effects and flights share their sampling error.
pub(super) fn normals(count: usize, d: usize) -> Vec<Vec<f64>> {
    let mut rng = Stream::new(d as u64, "importance");
    (0..count).map(|_| (0..d).map(|_| rng.normal()).collect()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_unit_and_value_are_inverse_and_log_ranges_are_log() {
        let (a, b) = ([0.1, -2.2], [10.0, 3.3]);
        let space = Space::of(&[&a, &b]);
        assert!((space.value(&[0.5, 0.4])[0] - 1.0).abs() < 1e-12);
        let back = space.to_unit(&space.value(&[0.3, 0.7]));
        assert!((back[0] - 0.3).abs() < 1e-12 && (back[1] - 0.7).abs() < 1e-12);
        assert_eq!(space.features(&[0.5, 0.4])[2], -1.0, "size of a zero parameter");
    }

    /// Sizes at the ends of what is plausible were outside of every interval: 40 draws of 0.05 to 0.22 began at 0.054.
    #[test]
    fn bug_the_ends_of_what_is_drawn_lie_inside() {
        let inside = |low: f64, high: f64| {
            let draws: Vec<[f64; 1]> =
                (0..40).map(|k| [low + (high - low) * (f64::from(k) + 0.5) / 40.0]).collect();
            let refs: Vec<&[f64]> = draws.iter().map(|d| d.as_slice()).collect();
            let space = Space::of(&refs);
            let ends = [space.value(&[0.0])[0], space.value(&[1.0])[0]];
            let most = 0.03 * (high - low);
            assert!(ends[0] <= low && ends[0] > low - most, "{ends:?} of {low} to {high}");
            assert!(ends[1] >= high && ends[1] < high + most, "{ends:?} of {low} to {high}");
        };
        inside(0.05, 0.22);
        inside(-3.0, 2.0);
        // A size keeps its sign, and a logarithmic range does not begin at nothing.
        let wide: Vec<[f64; 1]> = (0..40).map(|k| [0.1 + 0.25 * f64::from(k)]).collect();
        let refs: Vec<&[f64]> = wide.iter().map(|d| d.as_slice()).collect();
        assert!((Space::of(&refs).value(&[0.0])[0] - 0.05).abs() < 1e-12);
    }

    #[test]
    fn prop_choices_are_whole_and_equally_far_apart() {
        let thetas = [[0.0, 0.1], [5.0, 0.2], [7.0, 0.9]];
        let space = Space::of(&[&thetas[0], &thetas[1], &thetas[2]]);
        for theta in &thetas {
            assert_eq!(space.value(&space.to_unit(theta))[0], theta[0]);
        }
        assert_eq!(space.value(&[0.49, 0.5])[0], 3.0);
        let apart = |a: f64, b: f64| -> f64 {
            let [a, b] = [a, b].map(|v| space.features(&space.to_unit(&[v, 0.5])));
            a.iter().zip(&b).map(|(x, y)| (x - y).powi(2)).sum()
        };
        assert_eq!(apart(0.0, 1.0), apart(0.0, 7.0));
        assert_eq!((apart(3.0, 3.0), apart(2.0, 6.0)), (0.0, 2.0 * CHOSEN * CHOSEN));
    }

    #[test]
    fn prop_spread_points_fill_the_cube() {
        let (a, b) = ([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]);
        let points = Space::of(&[&a, &b]).spread(512);
        for octant in 0..8 {
            let inside = |p: &&Vec<f64>| (0..3).all(|i| (p[i] > 0.5) == (octant >> i & 1 == 1));
            let count = points.iter().filter(inside).count();
            assert!((52..76).contains(&count), "{count} of 512 in octant {octant}");
        }
    }
}
