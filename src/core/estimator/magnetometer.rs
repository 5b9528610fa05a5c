//! Magnetometer aid: heading from the direction of the field, as far as the field is the room's own.
//!
//! Symbols: `m` reading in `B`, `n = R_EB m` with parts north, east, down, `h = |(n_x, n_y)|`, `ψ_m`
//! the configured direction of magnetic north from room north (clockwise), `B₀`, `h₀`, `d₀` strength,
//! horizontal and downward part of the configured field. The direction of the horizontal part is
//!
//! ```text
//! α(m, R) = atan2(n_y, n_x),   innovation = ψ_m − α,   ∂α/∂d = m × Rᵀ g,   g = (−n_y, n_x, 0) / h²
//! ```
//!
//! with d the attitude error in `B`. Along the vertical that row is exactly 1. Across it an error of the
//! tilt enters by up to `tan dip` (more than twice), and the other way round a wrong field would tilt
//! the vehicle. So only the vertical part is the Jacobian, and what the tilt's uncertainty does is
//! variance: `(∂α/∂d − k)ᵀ P (∂α/∂d − k)`, `k = Rᵀ z`.
//!
//! Indoors the field is bent by steel. How much is seen where it does not depend on the heading, in the
//! plane of horizontal and downward part: `δ = |(h − h₀, n_z − d₀)| / B₀`. A disturbance of that size may
//! lie across as well as along, so it adds `(δ B₀ / h)²` to the variance; beyond
//! `most_disturbance_frac` the reading is not used. What is left has a heavy tail and errors that stay
//! for `correlation_s`. On the floor nothing is fused: there the same steel speaks in every sample, and
//! the start has asked it once. Left out: calibration (hard and soft iron are the board's), and a field
//! that is turned without a change of strength and dip, which nothing here can tell from a heading.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::config::{MagnetometerConfig, Motion};
use super::state::{ATT, State};
use super::update::Observation;
use super::{Estimator, noise};
use crate::drops::DropReason;
use crate::frames::wrap_pi_rad;
use crate::measure::MagSample;
use crate::time::HostTime;

/// Fields that a sensor in a room may see, T: the Earth's is 22 to 67 µT, steel doubles it or takes it away.
const PLAUSIBLE_TESLA: std::ops::RangeInclusive<f64> = 2e-6..=400e-6;
/// A horizontal part below this share of the field points nowhere.
const LEAST_HORIZONTAL_FRAC: f64 = 0.1;
/// Time constant of the field that a start asks, s: noise, not movement.
const AVERAGE_S: f64 = 0.3;
/// Samples that a start needs.
const LEAST_SAMPLES: u32 = 10;
/// A start does not ask a field older than this, s.
const FRESH_S: f64 = 0.5;
/// Longest interval between samples that counts, s.
const LONGEST_INTERVAL_S: f64 = 1.0;
/// Level, one sigma per axis, rad: of a vehicle that rested, and of one that was switched on in the air.
const STD_RESTED_RAD: f64 = 0.03;
const STD_FLYING_RAD: f64 = 0.15;

/// The field as it looks at an attitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// Direction of the horizontal part from the attitude's north, rad, clockwise.
    pub azimuth_rad: f64,
    /// Horizontal part, T.
    pub horizontal_tesla: f64,
    /// Downward part, T.
    pub down_tesla: f64,
}

impl Field {
    /// Strength, T.
    pub fn strength_tesla(&self) -> f64 {
        self.horizontal_tesla.hypot(self.down_tesla)
    }

    /// Angle below the horizontal, rad.
    pub fn dip_rad(&self) -> f64 {
        f64::atan2(self.down_tesla, self.horizontal_tesla)
    }

    /// Distance from the configured field in the plane of horizontal and downward part, over its
    /// strength.
    pub fn disturbance_frac(&self, c: &MagnetometerConfig) -> f64 {
        let (strength, dip) = (c.strength_ut * 1e-6, c.dip_deg.to_radians());
        let (h, d) = (strength * dip.cos(), strength * dip.sin());
        (self.horizontal_tesla - h).hypot(self.down_tesla - d) / strength
    }

    /// Variance of the heading that it tells, rad², with a tilt of this covariance; `None`: disturbed too
    /// much, or nearly upright.
    fn var_heading(&self, c: &MagnetometerConfig) -> Option<f64> {
        let disturbance = self.disturbance_frac(c);
        let strength = c.strength_ut * 1e-6;
        let usable = disturbance <= c.most_disturbance_frac
            && self.horizontal_tesla >= LEAST_HORIZONTAL_FRAC * strength;
        let bent_rad = disturbance * strength / self.horizontal_tesla;
        let std_rad = c.std_deg.to_radians();
        usable.then_some(std_rad * std_rad + bent_rad * bent_rad)
    }
}

/// The field at an attitude.
pub fn seen(q_EB: &UnitQuaternion<f64>, m_B_tesla: &Vector3<f64>) -> Field {
    let n = q_EB * m_B_tesla;
    Field { azimuth_rad: f64::atan2(n.y, n.x), horizontal_tesla: n.x.hypot(n.y), down_tesla: n.z }
}

/// Derivative of the azimuth to the attitude error, body frame.
pub fn azimuth_row(q_EB: &UnitQuaternion<f64>, m_B_tesla: &Vector3<f64>) -> Vector3<f64> {
    let n = q_EB * m_B_tesla;
    let h2 = n.x * n.x + n.y * n.y;
    let g_E = Vector3::new(-n.y, n.x, 0.0) / h2;
    m_B_tesla.cross(&q_EB.inverse_transform_vector(&g_E))
}

/// Innovation, Jacobian and variance; `None`: a field that says nothing about the heading.
pub fn observe(
    state: &State,
    m_B_tesla: &Vector3<f64>,
    c: &MagnetometerConfig,
) -> Option<Observation> {
    let field = seen(&state.q_EB, m_B_tesla);
    let var_heading = field.var_heading(c)?;
    let down_B = state.q_EB.inverse_transform_vector(&Vector3::z());
    let of_tilt = azimuth_row(&state.q_EB, m_B_tesla) - down_B;
    let P: Matrix3<f64> = state.P.fixed_view::<3, 3>(ATT, ATT).into_owned();
    let var_tilt = of_tilt.dot(&(P * of_tilt)).max(0.0);
    Some(Observation {
        innovation: wrap_pi_rad(c.north_deg.to_radians() - field.azimuth_rad),
        h_pos: Vector3::zeros(),
        h_vel: Vector3::zeros(),
        h_att: down_B,
        pair: None,
        var: var_heading + var_tilt,
    })
}

/// The last readings.
#[derive(Debug, Clone, Default)]
pub(super) struct Compass {
    m_B_tesla: Vector3<f64>,
    samples: u32,
    at: HostTime,
}

impl Compass {
    fn add(&mut self, at: HostTime, m_B_tesla: &Vector3<f64>) -> f64 {
        let interval_s = at.seconds_since(self.at);
        if self.samples == 0 || interval_s > LONGEST_INTERVAL_S {
            (self.m_B_tesla, self.samples) = (*m_B_tesla, 0);
        } else {
            self.m_B_tesla +=
                (m_B_tesla - self.m_B_tesla) * (interval_s / (AVERAGE_S + interval_s));
        }
        self.samples = self.samples.saturating_add(1);
        self.at = at;
        interval_s.min(LONGEST_INTERVAL_S)
    }

    fn is_known(&self, at: HostTime) -> bool {
        self.samples >= LEAST_SAMPLES && at.seconds_since(self.at) < FRESH_S
    }
}

impl Estimator {
    /// Takes a magnetic field. Before the start it tells the heading, in flight it is fused.
    pub fn mag(&mut self, sample: &MagSample) {
        let c = self.config.magnetometer;
        if !c.fuse || self.config.motion == Motion::Unaided {
            return;
        }
        let m_B_tesla = sample.field_B_tesla.raw();
        if !(sample.field_B_tesla.is_finite() && PLAUSIBLE_TESLA.contains(&m_B_tesla.norm())) {
            self.drops.add(DropReason::BadValue, 1);
            return;
        }
        if self.compass.samples > 0 && sample.valid_at <= self.compass.at {
            self.drops.add(DropReason::ImuOutOfOrder, 1);
            return;
        }
        let interval_s = self.compass.add(sample.valid_at, &m_B_tesla);
        let Some(state) = &self.state else {
            if let Some(cold) = &mut self.cold {
                cold.mag(sample);
            }
            return;
        };
        if !self.airborne {
            return;
        }
        let Some(o) = observe(state, &m_B_tesla, &c) else {
            self.drops.add(DropReason::MagDisturbed, 1);
            return;
        };
        self.counts.mag_fused += 1;
        self.fuse_soft(o, noise::correlation_factor(c.correlation_s, interval_s));
    }

    /// The heading at a start and its sigma: by the magnetic field where there is one that can be
    /// believed, else as it was told.
    pub(super) fn heading_to_start(&self) -> Option<(f64, f64)> {
        self.heading_by_field().or(self.heading)
    }

    fn heading_by_field(&self) -> Option<(f64, f64)> {
        let c = &self.config.magnetometer;
        if !c.fuse || !self.compass.is_known(self.at) {
            return None;
        }
        let rests = !self.airborne && self.rest.duration_s() >= self.config.align_s;
        let (q_EB, std_level_rad) = match self.level {
            _ if rests => (self.rest.attitude(0.0), STD_RESTED_RAD),
            Some(level) => (level, STD_RESTED_RAD),
            None => (UnitQuaternion::identity(), STD_FLYING_RAD),
        };
        let field = seen(&q_EB, &self.compass.m_B_tesla);
        let by_tilt_rad = std_level_rad * field.down_tesla / field.horizontal_tesla;
        let var = field.var_heading(c)? + by_tilt_rad * by_tilt_rad;
        let (_, _, yaw_rad) = q_EB.euler_angles();
        let yaw_rad = yaw_rad + c.north_deg.to_radians() - field.azimuth_rad;
        Some((wrap_pi_rad(yaw_rad), var.sqrt()))
    }

    /// The magnetic field at the present attitude, if one is fresh and asked for.
    pub fn magnetic_field(&self) -> Option<Field> {
        let state = self.state.as_ref()?;
        let known = self.config.magnetometer.fuse && self.compass.is_known(self.at);
        known.then(|| seen(&state.q_EB, &self.compass.m_B_tesla))
    }
}
