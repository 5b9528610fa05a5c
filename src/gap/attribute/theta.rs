//! Parameters of an effect on the unit cube: log-uniform where the range asks for it, whole numbers for choices
//! (which anchor, which wall); and the features that signatures depend on.

use crate::bank::axis::Axis;
use haltere_model::random::Stream;

/// A positive range at least this wide, as a ratio, is searched on a logarithmic scale.
const LOG_RATIO: f64 = 3.0;

/// Feature of a choice that is made. Of the others it is zero: any two choices are 1.4 times as far apart as the ends of
/// a range, so that a smooth kernel at its short lengths learns each by itself (judgement).
const CHOSEN: f64 = 2.0;

/// Range of one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Range {
    low: f64,
    high: f64,
    log: bool,
    choice: bool,
}

impl Range {
    fn of(axis: &Axis) -> Self {
        let Axis { low, high, choice, .. } = *axis;
        Self { low, high, choice, log: !choice && low > 0.0 && high > LOG_RATIO * low }
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
    axes: Vec<Axis>,
    ranges: Vec<Range>,
}

impl Space {
    /// The space of these parameters.
    pub fn of(axes: &[Axis]) -> Self {
        Self { axes: axes.to_vec(), ranges: axes.iter().map(Range::of).collect() }
    }

    /// Size of the effect: none at 0, about 1 at its strong end. Where several parameters say how much, the root of
    /// the mean of their squares, `s² = mean (t_i / max t_i)²` with `t_i` of [`Axis::share`], without a unit; 1 where none does.
    pub fn size(&self, theta: &[f64]) -> f64 {
        let shares = self.axes.iter().zip(theta).filter_map(|(axis, value)| axis.share(*value));
        let (sum, count) = shares.fold((0.0, 0.0), |(sum, n), s| (sum + s * s, n + 1.0));
        if count > 0.0 { f64::sqrt(sum / count) } else { 1.0 }
    }

    /// Whether "no effect" lies within these intervals, in all that says how much.
    pub fn holds_off(&self, ends: &[[f64; 2]]) -> bool {
        let mut holds = self.axes.iter().zip(ends).filter_map(|(axis, ends)| axis.holds_off(*ends));
        holds.next().is_some_and(|first| first && holds.all(|next| next))
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
    use crate::bank::axis::Size;

    fn range(low: f64, high: f64) -> Axis {
        Axis { low, high, choice: false, size: None }
    }

    #[test]
    fn prop_unit_and_value_are_inverse_and_log_ranges_are_log() {
        let space = Space::of(&[range(0.1, 10.0), range(-2.2, 3.3)]);
        assert!((space.value(&[0.5, 0.4])[0] - 1.0).abs() < 1e-12);
        let back = space.to_unit(&space.value(&[0.3, 0.7]));
        assert!((back[0] - 0.3).abs() < 1e-12 && (back[1] - 0.7).abs() < 1e-12);
        assert_eq!(space.features(&[0.5, 0.4])[2], -1.0, "size of a zero parameter");
    }

    #[test]
    fn prop_the_size_is_that_of_the_parameters_that_say_how_much() {
        let sized = |axis: Axis| Axis { size: Some(Size::From(0.0)), ..axis };
        let space = Space::of(&[sized(range(-2.0, 2.0)), sized(range(-3.0, 6.0)), range(5.0, 9.0)]);
        assert_eq!(space.size(&[0.0, 0.0, 7.0]), 0.0);
        assert_eq!(space.size(&[-2.0, 6.0, 5.0]), 1.0);
        assert!((space.size(&[-2.0, 0.0, 5.0]) - 0.5_f64.sqrt()).abs() < 1e-12);
        assert_eq!(Space::of(&[range(5.0, 9.0)]).size(&[5.0]), 1.0);
    }

    #[test]
    fn prop_choices_are_whole_and_equally_far_apart() {
        let space = Space::of(&[Axis { choice: true, ..range(0.0, 7.0) }, range(0.1, 0.9)]);
        for theta in &[[0.0, 0.1], [5.0, 0.2], [7.0, 0.9]] {
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
        let points = Space::of(&[range(0.0, 1.0); 3]).spread(512);
        for octant in 0..8 {
            let inside = |p: &&Vec<f64>| (0..3).all(|i| (p[i] > 0.5) == (octant >> i & 1 == 1));
            let count = points.iter().filter(inside).count();
            assert!((52..76).contains(&count), "{count} of 512 in octant {octant}");
        }
    }
}
