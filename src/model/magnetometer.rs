//! The board's magnetometer, and the field in a room with steel in its floor.
//!
//! `m_B = R_BE (b_E + s_E(p)) + o_B + σ n`, all in µT: `b_E` the room's field of strength B pointing to
//! magnetic north and down by the dip, `s_E` the steel's, `o_B` hard iron that a calibration has left,
//! `n` white noise. The steel of a reinforced floor is a sum of waves of a potential that obeys Laplace's
//! equation above the floor (no source in the air), with wave vectors `k` in the plane, `h` the height
//! over the floor (m) and `θ = k·p + φ`:
//!
//! ```text
//! s_E = Σ A e^(−|k| h) [ k̂_x sin θ, k̂_y sin θ, −cos θ ],   |s_E| ≤ Σ A
//! ```
//!
//! so that what varies within half a metre is gone half a metre up. Source: the form is potential theory;
//! amplitude and wavelengths are assumed, from what people report of compasses on concrete (tens of
//! degrees on the floor, a few at head height). Left out: soft iron, motor currents, moving steel.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::random::Stream;
use haltere_core::checks::Problems;

/// What a wave of the floor's field has of the largest disturbance, and its wavelength over `wave_m`:
/// girders, and the mesh between them.
const WAVES: [(f64, f64); 3] = [(0.5, 1.0), (0.3, 0.55), (0.2, 0.3)];

/// Settings of magnetometer and field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MagnetometerSettings {
    /// Whether the board has one.
    pub fitted: bool,
    /// Magnetic north from room north, positive clockwise, deg.
    pub north_deg: f64,
    /// Strength of the room's field, µT.
    pub strength_ut: f64,
    /// Its angle below the horizontal, deg.
    pub dip_deg: f64,
    /// What a calibration has left of the board's own field, body frame, µT.
    pub hard_iron_ut: [f64; 3],
    /// White noise of a reading, each axis, µT.
    pub std_ut: f64,
    /// Most that the floor's steel adds, on the floor, µT.
    pub floor_ut: f64,
    /// Longest wave of that field, m.
    pub wave_m: f64,
}

impl Default for MagnetometerSettings {
    fn default() -> Self {
        Self {
            fitted: false,
            north_deg: 0.0,
            strength_ut: 49.0,
            dip_deg: 66.0,
            hard_iron_ut: [0.6, -0.8, 0.4],
            std_ut: 0.4,
            floor_ut: 8.0,
            wave_m: 3.0,
        }
    }
}

impl MagnetometerSettings {
    /// Refuses what no room has.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        let mut range = |name: &str, value: f64, low: f64, high: f64, unit: &str| {
            problems.range(format_args!("{key}.{name}"), value, low..=high, unit);
        };
        range("north_deg", self.north_deg, -180.0, 180.0, "deg");
        range("strength_ut", self.strength_ut, 0.0, 100.0, "µT");
        range("dip_deg", self.dip_deg, -90.0, 90.0, "deg");
        for (axis, value) in ["x", "y", "z"].into_iter().zip(self.hard_iron_ut) {
            range(&format!("hard_iron_ut.{axis}"), value, -200.0, 200.0, "µT");
        }
        range("std_ut", self.std_ut, 0.0, 20.0, "µT");
        range("floor_ut", self.floor_ut, 0.0, 200.0, "µT");
        range("wave_m", self.wave_m, 0.2, 50.0, "m");
    }
}

/// A wave of the floor's field.
#[derive(Debug, Clone, Copy)]
struct Wave {
    amplitude_ut: f64,
    k_radpm: [f64; 2],
    phase_rad: f64,
}

/// The magnetometer in its room.
#[derive(Debug, Clone)]
pub struct Magnetometer {
    room_E_ut: Vector3<f64>,
    hard_iron_B_ut: Vector3<f64>,
    std_ut: f64,
    waves: [Wave; WAVES.len()],
    rng: Stream,
}

impl Magnetometer {
    /// `None`: the board has none.
    pub fn new(settings: &MagnetometerSettings, seed: u64) -> Option<Self> {
        if !settings.fitted {
            return None;
        }
        let mut rng = Stream::new(seed, "magnetometer");
        let (sin_dip, cos_dip) = settings.dip_deg.to_radians().sin_cos();
        let (sin_n, cos_n) = settings.north_deg.to_radians().sin_cos();
        let room_E_ut =
            Vector3::new(cos_dip * cos_n, cos_dip * sin_n, sin_dip) * settings.strength_ut;
        let waves = WAVES.map(|(share, length)| {
            let k = std::f64::consts::TAU / (length * settings.wave_m);
            let (sin, cos) = rng.between(0.0, std::f64::consts::TAU).sin_cos();
            Wave {
                amplitude_ut: share * settings.floor_ut,
                k_radpm: [k * cos, k * sin],
                phase_rad: rng.between(0.0, std::f64::consts::TAU),
            }
        });
        Some(Self {
            room_E_ut,
            hard_iron_B_ut: Vector3::from(settings.hard_iron_ut),
            std_ut: settings.std_ut,
            waves,
            rng,
        })
    }

    /// Field of the floor's steel at a place, Earth frame, µT.
    pub fn steel_E_ut(&self, pos_E_m: &Vector3<f64>) -> Vector3<f64> {
        self.waves.iter().fold(Vector3::zeros(), |sum, wave| {
            let [kx, ky] = wave.k_radpm;
            let k = kx.hypot(ky);
            let (sin, cos) = (kx * pos_E_m.x + ky * pos_E_m.y + wave.phase_rad).sin_cos();
            // Down is positive: the height over the floor is −z.
            let fade = (k * pos_E_m.z.min(0.0)).exp();
            sum + Vector3::new(kx / k * sin, ky / k * sin, -cos) * (wave.amplitude_ut * fade)
        })
    }

    /// A reading, body frame, µT.
    pub fn read(&mut self, pos_E_m: &Vector3<f64>, R_EB: &Matrix3<f64>) -> Vector3<f64> {
        let noise = Vector3::from_fn(|_, _| self.rng.normal()) * self.std_ut;
        R_EB.tr_mul(&(self.room_E_ut + self.steel_E_ut(pos_E_m))) + self.hard_iron_B_ut + noise
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fitted() -> MagnetometerSettings {
        MagnetometerSettings { fitted: true, ..MagnetometerSettings::default() }
    }

    #[test]
    fn prop_points_north_and_down_far_from_the_floor() {
        let quiet = MagnetometerSettings {
            north_deg: 30.0,
            hard_iron_ut: [0.0; 3],
            std_ut: 0.0,
            ..fitted()
        };
        let mut sensor = Magnetometer::new(&quiet, 1).unwrap();
        let m = sensor.read(&Vector3::new(5.0, 5.0, -20.0), &Matrix3::identity());
        assert!((m.norm() - 49.0).abs() < 1e-6, "{m}");
        assert!((f64::atan2(m.y, m.x).to_degrees() - 30.0).abs() < 1e-6);
        assert!((f64::atan2(m.z, m.x.hypot(m.y)).to_degrees() - 66.0).abs() < 1e-6);
        assert!(Magnetometer::new(&MagnetometerSettings::default(), 1).is_none());
    }

    #[test]
    fn prop_the_steel_has_no_source_in_the_air_and_fades_with_height() {
        let sensor = Magnetometer::new(&fitted(), 3).unwrap();
        let at = |p: Vector3<f64>| sensor.steel_E_ut(&p);
        for i in 0..50 {
            let i = f64::from(i);
            let p = Vector3::new(0.37 * i, 10.0 - 0.21 * i, -0.05 - 0.02 * i);
            let h = 1e-5;
            let d = |axis: usize| {
                let step = Vector3::from_fn(|row, _| if row == axis { h } else { 0.0 });
                (at(p + step) - at(p - step)) / (2.0 * h)
            };
            let (dx, dy, dz) = (d(0), d(1), d(2));
            // Neither divergence nor curl.
            assert!((dx.x + dy.y + dz.z).abs() < 1e-6);
            assert!((dx.y - dy.x).abs() < 1e-6 && (dx.z - dz.x).abs() < 1e-6);
            let floor = Vector3::new(p.x, p.y, 0.0);
            assert!(at(floor).norm() <= 8.0 + 1e-9);
            assert!(at(floor - Vector3::z() * 1.5).norm() < 8.0 * 0.04);
        }
    }

    #[test]
    fn prop_absurd_settings_are_named() {
        let mut problems = Problems::new();
        let settings = MagnetometerSettings { wave_m: 0.0, std_ut: f64::NAN, ..fitted() };
        settings.check("board.magnetometer", &mut problems);
        assert_eq!(problems.lines().len(), 2, "{problems}");
    }
}
