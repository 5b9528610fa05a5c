//! Prediction of the filter from one IMU sample.
//!
//! Symbols: `x` position `E` m, `v` velocity `B` m/s, `R` = `R_EB`, `w` rate `B` rad/s, `f` specific
//! force `B` m/s², `g` gravity `E` m/s², `t` step s, `W = exp([w t]×)`:
//!
//! ```text
//! x ← x + R (v t + ½ f t²) + ½ g t²
//! v ← Wᵀ (v + f t + Rᵀ g t)
//! R ← R W
//! ```
//!
//! Mueller, Hehn, D'Andrea, "Fusing ultra-wideband range measurements with accelerometers and rate
//! gyroscopes for quadrocopter state estimation", ICRA 2015, with the turn of the body integrated
//! exactly. In flight with `ThrustAxis`: `f = (−k_x c_x + b_x, −k_y c_y + b_y, a_z)` with `c = v + w × r` the
//! velocity of the centre of pressure; without drag `f = (0, 0, a_z)`. `a_z` is measured and holds
//! the drag along z already, so `k_z` does not appear. Linear drag is valid up to about 2 m/s on
//! this vehicle. `b` is zero, or what lasts beyond drag (`slow_force.rs`). Left out: gusts, bias of the accelerometer.
//!
//! Jacobian, blocks of x, v, d (`u = Rᵀ g`, `K = diag(k_x, k_y, 0)`, `s = v t + ½ f t²`):
//!
//! ```text
//! F = | I   R (t − ½ t² K)   −R [s]×   |
//!     | 0   Wᵀ (I − t K)      Wᵀ t [u]× |
//!     | 0   0                 Wᵀ        |
//! ```

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use super::error_state::Transition;
use super::state::{ATT, Cov, POS, State, VEL, quat_exp, quat_turn, skew};
use crate::frames::G_MPS2;

/// How the specific force of a step is formed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Force {
    /// As measured on three axes.
    Measured,
    /// z as measured; x and y from linear drag (zero coefficients: no drag).
    ThrustAxis {
        /// Drag over mass along body x and y, 1/s.
        k_per_s: [f64; 2],
        /// Centre of pressure above the centre of mass, m.
        cop_z_m: f64,
        /// Beyond drag along body x and y, m/s² (`slow_force.rs`).
        beyond_B_mps2: [f64; 2],
    },
}

impl Force {
    /// Drag along body x and y, m/s²; `None` where it is measured.
    pub fn drag_B_mps2(&self, v_B: &Vector3<f64>, rate_B: &Vector3<f64>) -> Option<[f64; 2]> {
        let Self::ThrustAxis { k_per_s: [kx, ky], cop_z_m, .. } = self else { return None };
        let r_z = -cop_z_m;
        Some([-kx * (v_B.x + rate_B.y * r_z), -ky * (v_B.y - rate_B.x * r_z)])
    }
}

/// Growth of the variances per second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Growth {
    /// Position, m²/s.
    pub pos: f64,
    /// Velocity along body x, y, z, (m/s)²/s.
    pub vel: [f64; 3],
    /// Attitude, rad²/s.
    pub att: f64,
}

/// What a step changes: the new nominal state's parts and the Jacobian.
struct Step {
    moved_E: Vector3<f64>,
    v_B: Vector3<f64>,
    W: UnitQuaternion<f64>,
    F: Transition,
}

/// Moves the nominal state by one step and returns the Jacobian.
#[inline]
pub fn propagate_nominal(
    state: &mut State,
    dt_s: f64,
    acc_B: &Vector3<f64>,
    rate_B: &Vector3<f64>,
    force: Force,
) -> Transition {
    let step = step(state, dt_s, acc_B, rate_B, force);
    state.x_E += step.moved_E;
    state.v_B = step.v_B;
    state.q_EB = quat_turn(&state.q_EB, &step.W);
    step.F
}

/// The Jacobian of a step that is not made: of several short ones at once, with their mean readings.
#[inline]
pub fn linearise(
    state: &State,
    dt_s: f64,
    acc_B: &Vector3<f64>,
    rate_B: &Vector3<f64>,
    force: Force,
) -> Transition {
    step(state, dt_s, acc_B, rate_B, force).F
}

/// One step of a vehicle without IMU: the velocity, in `E` here, decays.
#[inline]
pub fn coast(state: &mut State, dt_s: f64, decay_per_s: f64) -> Transition {
    let keep = (-decay_per_s * dt_s).exp();
    state.x_E += state.v_B * dt_s;
    state.v_B *= keep;
    Transition {
        xv: Matrix3::identity() * dt_s,
        xd: Matrix3::zeros(),
        vv: Matrix3::identity() * keep,
        vd: Matrix3::zeros(),
        dd: Matrix3::identity(),
    }
}

#[inline]
fn step(
    state: &State,
    dt_s: f64,
    acc_B: &Vector3<f64>,
    rate_B: &Vector3<f64>,
    force: Force,
) -> Step {
    let R = state.R_EB();
    let v = state.v_B;
    let (f, k) = match force {
        Force::Measured => (*acc_B, [0.0; 2]),
        Force::ThrustAxis { k_per_s, beyond_B_mps2: [x, y], .. } => {
            let [drag_x, drag_y] = force.drag_B_mps2(&v, rate_B).unwrap_or_default();
            (Vector3::new(drag_x + x, drag_y + y, acc_B.z), k_per_s)
        }
    };
    let W = quat_exp(&(rate_B * dt_s));
    let Wt = W.to_rotation_matrix().matrix().transpose();
    let u = Vector3::new(R[(2, 0)], R[(2, 1)], R[(2, 2)]) * G_MPS2;
    let s = v * dt_s + f * (0.5 * dt_s * dt_s);
    let half = 0.5 * dt_s * dt_s;

    let moved_E = R * s + Vector3::new(0.0, 0.0, G_MPS2 * half);
    let v_B = Wt * (v + (f + u) * dt_s);

    let keep = |i: usize| if i < 2 { k[i] } else { 0.0 };
    let mut xv = R;
    let mut vv = Wt;
    for i in 0..3 {
        let scale_x = dt_s - half * keep(i);
        let scale_v = 1.0 - dt_s * keep(i);
        for j in 0..3 {
            xv[(j, i)] *= scale_x;
            vv[(j, i)] *= scale_v;
        }
    }
    let F = Transition { xv, xd: -R * skew(&s), vv, vd: Wt * skew(&(u * dt_s)), dd: Wt };
    Step { moved_E, v_B, W, F }
}

/// `P ← F P Fᵀ + Q`, block by block.
#[inline]
pub fn propagate_covariance(P: &mut Cov, F: &Transition, dt_s: f64, growth: &Growth) {
    let block = |i: usize, j: usize| -> Matrix3<f64> { P.fixed_view::<3, 3>(i, j).into_owned() };
    let (xx, vv, dd) = (block(POS, POS), block(VEL, VEL), block(ATT, ATT));
    let (xv, xd, vd) = (block(POS, VEL), block(POS, ATT), block(VEL, ATT));
    let dv = vd.transpose();

    // Rows of F P that are needed.
    let a_xx = xx + F.xv * xv.transpose() + F.xd * xd.transpose();
    let a_xv = xv + F.xv * vv + F.xd * dv;
    let a_xd = xd + F.xv * vd + F.xd * dd;
    let a_vv = F.vv * vv + F.vd * dv;
    let a_vd = F.vv * vd + F.vd * dd;
    let a_dd = F.dd * dd;

    let vv_t = F.vv.transpose();
    let vd_t = F.vd.transpose();
    let dd_t = F.dd.transpose();
    let mut n_xx = a_xx + a_xv * F.xv.transpose() + a_xd * F.xd.transpose();
    let n_xv = a_xv * vv_t + a_xd * vd_t;
    let n_xd = a_xd * dd_t;
    let mut n_vv = a_vv * vv_t + a_vd * vd_t;
    let n_vd = a_vd * dd_t;
    let mut n_dd = a_dd * dd_t;
    for i in 0..3 {
        n_xx[(i, i)] += growth.pos * dt_s;
        n_vv[(i, i)] += growth.vel[i] * dt_s;
        n_dd[(i, i)] += growth.att * dt_s;
    }
    put_symmetric(P, POS, &n_xx);
    put_symmetric(P, VEL, &n_vv);
    put_symmetric(P, ATT, &n_dd);
    put_cross(P, POS, VEL, &n_xv);
    put_cross(P, POS, ATT, &n_xd);
    put_cross(P, VEL, ATT, &n_vd);
}

/// One whole step.
#[inline]
pub fn predict(
    state: &mut State,
    dt_s: f64,
    acc_B: &Vector3<f64>,
    rate_B: &Vector3<f64>,
    force: Force,
    growth: &Growth,
) {
    let F = propagate_nominal(state, dt_s, acc_B, rate_B, force);
    propagate_covariance(&mut state.P, &F, dt_s, growth);
}

#[inline]
fn put_symmetric(P: &mut Cov, at: usize, block: &Matrix3<f64>) {
    for i in 0..3 {
        P[(at + i, at + i)] = block[(i, i)];
        for j in 0..i {
            let mean = 0.5 * (block[(i, j)] + block[(j, i)]);
            P[(at + i, at + j)] = mean;
            P[(at + j, at + i)] = mean;
        }
    }
}

#[inline]
fn put_cross(P: &mut Cov, row: usize, column: usize, block: &Matrix3<f64>) {
    for i in 0..3 {
        for j in 0..3 {
            P[(row + i, column + j)] = block[(i, j)];
            P[(column + j, row + i)] = block[(i, j)];
        }
    }
}
