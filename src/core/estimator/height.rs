//! Height aid: barometric height against the height at which its zero was taken.
//!
//! `h = 44330.77 m · (1 − (p / 101325 Pa)^0.190263)`, p static pressure in Pa: ICAO standard
//! atmosphere, valid below 11 km. Only differences are used; the zero is averaged while resting.

use nalgebra::Vector3;

use super::state::State;
use super::update::Observation;

/// Pressure at sea level, Pa (ICAO).
const SEA_LEVEL_PA: f64 = 101_325.0;
/// Temperature at sea level over its lapse rate, m (ICAO).
const SCALE_M: f64 = 44_330.77;
/// Gas constant times lapse rate over gravity (ICAO).
const EXPONENT: f64 = 0.190_263;
/// Pressures a barometer may report, Pa: about 9 km up to well below sea level.
const PLAUSIBLE_PA: std::ops::RangeInclusive<f64> = 30_000.0..=115_000.0;
/// Samples over which the zero is averaged before older ones are forgotten.
const ZERO_SAMPLES: f64 = 50.0;

/// Height in the standard atmosphere, m; `None` for a pressure no barometer reports.
pub fn standard_height_m(pressure_pa: f64) -> Option<f64> {
    PLAUSIBLE_PA
        .contains(&pressure_pa)
        .then(|| SCALE_M * (1.0 - (pressure_pa / SEA_LEVEL_PA).powf(EXPONENT)))
}

/// Pressure at a height in the standard atmosphere, Pa.
pub fn standard_pressure_pa(height_m: f64) -> f64 {
    SEA_LEVEL_PA * (1.0 - height_m / SCALE_M).max(0.0).powf(1.0 / EXPONENT)
}

/// Zero of the barometer.
#[derive(Debug, Clone, Default)]
pub struct BaroZero {
    offset_m: f64,
    samples: f64,
}

impl BaroZero {
    /// Learns from a sample taken at a height that is known otherwise.
    pub fn learn(&mut self, baro_m: f64, height_m: f64) {
        self.samples = (self.samples + 1.0).min(ZERO_SAMPLES);
        self.offset_m += (baro_m - height_m - self.offset_m) / self.samples;
    }

    /// Whether it has learned anything.
    pub fn is_known(&self) -> bool {
        self.samples > 0.0
    }

    /// Observation of the height: `-x_E.z`.
    pub fn observe(&self, state: &State, baro_m: f64, var: f64) -> Observation {
        Observation {
            innovation: (baro_m - self.offset_m) + state.x_E.z,
            h_pos: Vector3::new(0.0, 0.0, -1.0),
            h_vel: Vector3::zeros(),
            h_att: Vector3::zeros(),
            pair: None,
            var,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_standard_atmosphere() {
        // ICAO Doc 7488: 1000 m is 898.746 hPa, 5000 m 540.20 hPa.
        assert!((standard_height_m(89_874.6).unwrap() - 1000.0).abs() < 0.5);
        assert!((standard_height_m(54_020.0).unwrap() - 5000.0).abs() < 5.0);
        assert!((standard_height_m(standard_pressure_pa(181.0)).unwrap() - 181.0).abs() < 1e-6);
        for absurd in [f64::NAN, 0.0, -1.0, 1e6] {
            assert_eq!(standard_height_m(absurd), None);
        }
    }
}
