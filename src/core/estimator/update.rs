//! The one update: fuses a scalar observation. No other file of an aid touches P.
//!
//! `S = H P Hᵀ + R`, `K = P Hᵀ / S`, `P ← P − K (P Hᵀ)ᵀ`, then the correction is injected and its
//! attitude part reset (see `state.rs`). Scalars one after the other equal one joint update when
//! their errors are independent.

use nalgebra::Vector3;

use super::bias::{BiasVec, NO_BIASES, Pair};
use super::state::{ATT, POS, State, StateVec, VEL};

/// What an aid says: innovation = measured − predicted, its Jacobian, its variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Measured minus predicted.
    pub innovation: f64,
    /// Jacobian of the prediction to position.
    pub h_pos: Vector3<f64>,
    /// Jacobian to velocity.
    pub h_vel: Vector3<f64>,
    /// Jacobian to the attitude error.
    pub h_att: Vector3<f64>,
    /// Anchors whose range biases are in it.
    pub pair: Option<Pair>,
    /// Variance of the measurement.
    pub var: f64,
}

/// `P Hᵀ` and `H P Hᵀ` of an observation.
#[derive(Debug, Clone, Copy)]
pub struct Projected {
    pht: StateVec,
    /// The biases' part of `P Hᵀ`, where there are any.
    own: Option<BiasVec>,
    /// Variance of the prediction, `H P Hᵀ`.
    pub var_predicted: f64,
}

/// Projects the covariance onto an observation.
#[inline]
pub fn project(state: &State, o: &Observation) -> Projected {
    let mut pht = StateVec::zeros();
    let [sums] = &mut pht.data.0;
    let (columns, _) = state.P.data.0.as_chunks::<3>();
    // Blocks of three columns: position, velocity, attitude.
    for (block, h) in columns.iter().zip([&o.h_pos, &o.h_vel, &o.h_att]) {
        if *h != Vector3::zeros() {
            for (column, h) in block.iter().zip(h.iter()) {
                for (sum, p) in sums.iter_mut().zip(column) {
                    *sum += p * h;
                }
            }
        }
    }
    let mut var_biases = 0.0;
    let own = (!state.biases.is_empty()).then(|| {
        let mut own = NO_BIASES;
        let mut h = StateVec::zeros();
        h.fixed_rows_mut::<3>(POS).copy_from(&o.h_pos);
        h.fixed_rows_mut::<3>(VEL).copy_from(&o.h_vel);
        h.fixed_rows_mut::<3>(ATT).copy_from(&o.h_att);
        var_biases = state.biases.project(o.pair, &h, &mut pht, &mut own);
        own
    });
    let dot = |start: usize, h: &Vector3<f64>| {
        pht[start] * h.x + pht[start + 1] * h.y + pht[start + 2] * h.z
    };
    let var_predicted = dot(POS, &o.h_pos) + dot(VEL, &o.h_vel) + dot(ATT, &o.h_att) + var_biases;
    Projected { pht, own, var_predicted: var_predicted.max(0.0) }
}

/// Fuses an observation whose projection is known. False and no change when a number is not
/// finite or the variance not positive.
#[inline]
pub fn fuse_projected(state: &mut State, o: &Observation, projected: &Projected) -> bool {
    let s = projected.var_predicted + o.var;
    if !(o.innovation.is_finite() && s.is_finite() && o.var > 0.0) {
        return false;
    }
    let inverse = 1.0 / s;
    let pht = &projected.pht;
    let gain = pht * inverse;
    let [rows] = &pht.data.0;
    for (column, j) in state.P.data.0.iter_mut().zip(rows) {
        for (p, i) in column.iter_mut().zip(rows) {
            // The product of the two first: it commutes, so P stays symmetric to the last bit.
            *p -= (i * j) * inverse;
        }
    }
    if let Some(own) = &projected.own {
        state.biases.correct(pht, own, inverse, o.innovation);
    }
    state.inject(&(gain * o.innovation));
    true
}

/// Fuses an observation.
#[inline]
pub fn fuse(state: &mut State, o: &Observation) -> bool {
    let projected = project(state, o);
    fuse_projected(state, o, &projected)
}
