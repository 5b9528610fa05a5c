//! A single gust, as a fault: a draught from a door, a fan that is switched on and off.
//!
//! `w(t) = ½ w_0 (1 - cos(2π t / T))` for `t` in 0 to `T` (s), `w_0` the peak (m/s, Earth frame). Source: the
//! "1 - cosine" discrete gust of MIL-F-8785C 3.7.2, here up and down again. Left out: its shape in space.

use nalgebra::Vector3;

use haltere_core::checks::Problems;
use haltere_core::frames::{E, Vec3};

/// The gust.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gust {
    /// Velocity of the air at its peak, m/s.
    pub peak_E_mps: Vec3<E>,
    /// How long it lasts, s.
    pub length_s: f64,
}

impl Gust {
    /// Adds what is out of range to `problems`.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        problems.range(format_args!("{key}.gust_mps"), self.peak_E_mps.norm(), 0.0..=20.0, "m/s");
        problems.range(format_args!("{key}.length_s"), self.length_s, 0.05..=60.0, "s");
    }

    /// Velocity of the air so long after its begin, m/s. `None`: it is over.
    #[inline]
    pub fn wind_E_mps(&self, age_s: f64) -> Option<Vector3<f64>> {
        if !(0.0..self.length_s).contains(&age_s) {
            return None;
        }
        let turn = std::f64::consts::TAU * age_s / self.length_s;
        Some(self.peak_E_mps.raw() * (0.5 * (1.0 - turn.cos())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_peaks_in_the_middle_and_ends() {
        let gust = Gust { peak_E_mps: Vec3::new(0.0, 3.0, 0.0), length_s: 2.0 };
        let east = |age_s| gust.wind_E_mps(age_s).map(|w| w.y);
        assert_eq!(east(0.0), Some(0.0));
        assert!((east(1.0).unwrap() - 3.0).abs() < 1e-12);
        assert!((east(0.5).unwrap() - 1.5).abs() < 1e-12);
        assert_eq!(east(2.0), None);
        assert_eq!(east(-0.1), None);
    }
}
