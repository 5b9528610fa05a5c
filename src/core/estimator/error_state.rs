//! Places of the nine error states in vectors and matrices, and the Jacobian of a step as the blocks that are not trivial.

use nalgebra::{Matrix3, SMatrix, SVector};

/// Number of error states.
pub const STATES: usize = 9;
/// Covariance of the error states.
pub type Cov = SMatrix<f64, STATES, STATES>;
/// A vector of error states.
pub type StateVec = SVector<f64, STATES>;

/// First index of position.
pub const POS: usize = 0;
/// First index of velocity.
pub const VEL: usize = 3;
/// First index of the attitude error.
pub const ATT: usize = 6;

/// The blocks of F that are neither zero nor identity.
#[derive(Debug, Clone, Copy)]
pub struct Transition {
    /// Position from velocity.
    pub xv: Matrix3<f64>,
    /// Position from attitude.
    pub xd: Matrix3<f64>,
    /// Velocity from velocity.
    pub vv: Matrix3<f64>,
    /// Velocity from attitude.
    pub vd: Matrix3<f64>,
    /// Attitude from attitude.
    pub dd: Matrix3<f64>,
}
