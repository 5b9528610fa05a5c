//! The estimate: what the filter tells everyone else.

use crate::frames::{B, E, Rot, Vec3};
use crate::time::HostTime;

/// Whether the estimate may be flown on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Health {
    /// No start values yet.
    #[default]
    NotAligned,
    /// Within its stated uncertainty.
    Good,
    /// Usable to hold or land: measurements are missing or do not fit.
    Degraded,
    /// Not to be flown on.
    Lost,
}

/// State of the filter at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Time of validity.
    pub at: HostTime,
    /// Position, Earth frame, m.
    pub pos_E_m: Vec3<E>,
    /// Velocity, body frame, m/s.
    pub vel_B_mps: Vec3<B>,
    /// Attitude.
    pub R_EB: Rot<E, B>,
    /// Angular rate with the known bias taken off, body frame, rad/s.
    pub rate_B_radps: Vec3<B>,
    /// One sigma of position, Earth frame, m.
    pub std_pos_E_m: Vec3<E>,
    /// One sigma of velocity, body frame, m/s.
    pub std_vel_B_mps: Vec3<B>,
    /// One sigma of the attitude error, body axes, rad.
    pub std_att_B_rad: Vec3<B>,
    /// Factor λ on the UWB variance in force at this height.
    pub uwb_noise_factor: f64,
    /// Whether it may be flown on.
    pub health: Health,
}

impl Estimate {
    /// Velocity, Earth frame, m/s.
    pub fn vel_E_mps(&self) -> Vec3<E> {
        self.R_EB * self.vel_B_mps
    }
}
