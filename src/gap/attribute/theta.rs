//! Parameters of an effect on the unit cube: log-uniform where the range asks for it, and the
//! features that signatures depend on.

use crate::model::random::Stream;

/// A positive range at least this wide, as a ratio, is drawn and searched on a logarithmic scale.
const LOG_RATIO: f64 = 3.0;

/// Range of one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Range {
    low: f64,
    high: f64,
    log: bool,
}

impl Range {
    /// Range of the parameter in the draws.
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let (low, high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        Self { low, high, log: low > 0.0 && high > LOG_RATIO * low }
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
            self.low * (self.high / self.low).powf(unit)
        } else {
            self.low + (self.high - self.low) * unit
        }
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
    /// As wide as the draws.
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

    /// Features: each parameter on -1 to 1; where zero lies inside the range, its size as well
    /// (slots sorted by size depend on it); for two or more of those, their length.
    pub fn features(&self, unit: &[f64]) -> Vec<f64> {
        let mut out: Vec<f64> = unit.iter().map(|u| 2.0 * u - 1.0).collect();
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
        let (a, b) = ([0.1, -2.0], [10.0, 3.0]);
        let space = Space::of(&[&a, &b]);
        assert!((space.value(&[0.5, 0.4])[0] - 1.0).abs() < 1e-12);
        let back = space.to_unit(&space.value(&[0.3, 0.7]));
        assert!((back[0] - 0.3).abs() < 1e-12 && (back[1] - 0.7).abs() < 1e-12);
        assert_eq!(space.features(&[0.5, 0.4])[2], -1.0, "size of a zero parameter");
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
