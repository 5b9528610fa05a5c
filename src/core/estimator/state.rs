//! State of the filter: nine error states around a nominal position, velocity and attitude.
//!
//! `S = [x_E, v_B, d]`: position in `E` (m), velocity in `B` (m/s), attitude error in `B` (rad).
//! The true attitude is `R_EB · exp([d]×)`; between updates `d` is zero and only its covariance
//! lives on.
//!
//! Resetting `d̂` into the attitude turns what is left of the error: with the right Jacobian of the
//! rotation group, `d' = J(d̂)·(d − d̂)`, `J(d̂) = I − ½[d̂]× + ⅙[d̂]×²` up to third order. This is the
//! covariance correction of Mueller, Hehn, D'Andrea, "Covariance correction step for Kalman
//! filtering with an attitude", J. Guidance Control Dynamics 40(9), 2017 (they stop at first
//! order). Valid for corrections well below 1 rad.

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::bias::Biases;
pub use super::error_state::{ATT, Cov, POS, STATES, StateVec, VEL};

/// Floor of a variance: keeps P positive when an aid is far better than everything else.
const LEAST_VARIANCE: f64 = 1e-12;

/// Nominal state and covariance.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Position, Earth frame, m.
    pub x_E: Vector3<f64>,
    /// Velocity, body frame, m/s.
    pub v_B: Vector3<f64>,
    /// Attitude: takes body vectors to Earth.
    pub q_EB: UnitQuaternion<f64>,
    /// Covariance of `[x_E, v_B, d]`, symmetric.
    pub P: Cov,
    /// Range biases of the anchors, if they are estimated.
    pub biases: Biases,
}

/// Matrix of the cross product `a ×`.
#[inline]
pub fn skew(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// Unit quaternion of a rotation vector, by series for the small angles that occur at each step.
#[inline]
pub fn quat_exp(v: &Vector3<f64>) -> UnitQuaternion<f64> {
    let n2 = v.norm_squared();
    if n2 > 0.01 {
        return UnitQuaternion::from_scaled_axis(*v);
    }
    // cos(n/2) and sin(n/2)/n; the next terms are below 1e-15 for n < 0.1 rad.
    let w = 1.0 - n2 / 8.0 * (1.0 - n2 / 48.0 * (1.0 - n2 / 120.0));
    let s = 0.5 - n2 / 48.0 * (1.0 - n2 / 80.0 * (1.0 - n2 / 168.0));
    UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(w, s * v.x, s * v.y, s * v.z))
}

/// Product, kept at length 1 to first order: rounding never accumulates.
#[inline]
pub fn quat_turn(q: &UnitQuaternion<f64>, by: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    let p = q.into_inner() * by.into_inner();
    UnitQuaternion::new_unchecked(p * (1.5 - 0.5 * p.norm_squared()))
}

impl State {
    /// At rest at a pose, with diagonal covariance from the given sigmas.
    pub fn at_pose(
        x_E: Vector3<f64>,
        q_EB: UnitQuaternion<f64>,
        std_pos_m: f64,
        std_vel_mps: f64,
        std_att_rad: f64,
    ) -> Self {
        let mut P = Cov::zeros();
        for i in 0..3 {
            P[(POS + i, POS + i)] = std_pos_m * std_pos_m;
            P[(VEL + i, VEL + i)] = std_vel_mps * std_vel_mps;
            P[(ATT + i, ATT + i)] = std_att_rad * std_att_rad;
        }
        Self { x_E, v_B: Vector3::zeros(), q_EB, P, biases: Biases::default() }
    }

    /// Attitude as a matrix.
    #[inline]
    pub fn R_EB(&self) -> Matrix3<f64> {
        *self.q_EB.to_rotation_matrix().matrix()
    }

    /// Adds a correction and resets its attitude part into the quaternion.
    #[inline]
    pub fn inject(&mut self, delta: &StateVec) {
        self.x_E += delta.fixed_rows::<3>(POS);
        self.v_B += delta.fixed_rows::<3>(VEL);
        let d: Vector3<f64> = delta.fixed_rows::<3>(ATT).into_owned();
        if d != Vector3::zeros() {
            self.q_EB = quat_turn(&self.q_EB, &quat_exp(&d));
            self.turn_attitude_covariance(&reset_jacobian(&d));
        }
    }

    /// `P ← T P Tᵀ` with `T = diag(I, I, J)`.
    #[inline]
    fn turn_attitude_covariance(&mut self, J: &Matrix3<f64>) {
        let [nine @ .., c6, c7, c8] = &mut self.P.data.0;
        for (i, column) in nine.iter_mut().enumerate() {
            let [.., d6, d7, d8] = column;
            let turned = J * Vector3::new(*d6, *d7, *d8);
            [*d6, *d7, *d8] = turned.into();
            [c6[i], c7[i], c8[i]] = turned.into();
        }
        let block: Matrix3<f64> = self.P.fixed_view::<3, 3>(ATT, ATT).into_owned();
        let turned = J * block * J.transpose();
        for k in 0..3 {
            self.P[(ATT + k, ATT + k)] = turned[(k, k)].max(LEAST_VARIANCE);
            for j in 0..k {
                self.P[(ATT + k, ATT + j)] = turned[(k, j)];
                self.P[(ATT + j, ATT + k)] = turned[(k, j)];
            }
        }
        self.biases.turn(J);
    }

    /// Forgets where it is: position and its ties to everything else.
    pub fn restart_position(&mut self, x_E: Vector3<f64>, std_pos_m: f64) {
        self.x_E = x_E;
        self.restart_block(POS, std_pos_m);
    }

    /// Forgets how fast it is.
    pub fn restart_velocity(&mut self, v_B: Vector3<f64>, std_vel_mps: f64) {
        self.v_B = v_B;
        self.restart_block(VEL, std_vel_mps);
    }

    /// Keeps its attitude but no longer trusts it.
    pub fn restart_attitude(&mut self, std_att_rad: f64) {
        self.restart_block(ATT, std_att_rad);
    }

    fn restart_block(&mut self, start: usize, std: f64) {
        for i in start..start + 3 {
            for j in 0..STATES {
                self.P[(i, j)] = 0.0;
                self.P[(j, i)] = 0.0;
            }
            self.P[(i, i)] = std * std;
        }
        self.biases.untie(start);
    }

    /// One sigma of three neighbouring states.
    pub fn std3(&self, start: usize) -> [f64; 3] {
        std::array::from_fn(|i| self.P[(start + i, start + i)].max(0.0).sqrt())
    }

    /// Whether every number is finite and every variance positive.
    pub fn is_sane(&self) -> bool {
        self.x_E.iter().chain(self.v_B.iter()).all(|c| c.is_finite())
            && self.q_EB.coords.iter().all(|c| c.is_finite())
            && (0..STATES).all(|i| self.P[(i, i)].is_finite() && self.P[(i, i)] > 0.0)
            && self.biases.is_sane()
    }
}

/// `J(d) = I − ½[d]× + ⅙[d]×²`.
#[inline]
pub fn reset_jacobian(d: &Vector3<f64>) -> Matrix3<f64> {
    let K = skew(d);
    Matrix3::identity() - K * 0.5 + K * K * (1.0 / 6.0)
}
