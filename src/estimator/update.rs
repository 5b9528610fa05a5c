//! The one update: fuses a scalar observation. No other file of an aid touches P.
//!
//! `S = H P Hᵀ + R`, `K = P Hᵀ / S`, `P ← P − K (P Hᵀ)ᵀ`, then the correction is injected and its
//! attitude part reset (see `state.rs`). Scalars one after the other equal one joint update when
//! their errors are independent.

use nalgebra::Vector3;

use super::arrival::Arrivals;
use super::bias::{BiasVec, NO_BIASES, Pair};
use super::state::{ATT, POS, STATES, State, StateVec, VEL};

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
    /// Arrivals whose errors have a state.
    pub arrivals: Arrivals,
    /// Variance of the measurement.
    pub var: f64,
}

/// `P Hᵀ` and `H P Hᵀ` of an observation.
#[derive(Debug, Clone, Copy)]
pub struct Projected {
    pht: StateVec,
    /// The biases' part of `P Hᵀ`.
    own: BiasVec,
    /// Variance of the prediction, `H P Hᵀ`.
    pub var_predicted: f64,
}

/// Projects the covariance onto an observation.
#[inline]
pub fn project(state: &State, o: &Observation) -> Projected {
    let mut pht = StateVec::zeros();
    let mut own = NO_BIASES;
    let mut add = |start: usize, h: &Vector3<f64>| {
        if *h != Vector3::zeros() {
            for k in 0..3 {
                let column = state.P.fixed_columns::<1>(start + k);
                for i in 0..STATES {
                    pht[i] += column[i] * h[k];
                }
            }
        }
    };
    add(POS, &o.h_pos);
    add(VEL, &o.h_vel);
    add(ATT, &o.h_att);
    let mut var_biases = 0.0;
    if !state.biases.is_empty() {
        let mut h = StateVec::zeros();
        h.fixed_rows_mut::<3>(POS).copy_from(&o.h_pos);
        h.fixed_rows_mut::<3>(VEL).copy_from(&o.h_vel);
        h.fixed_rows_mut::<3>(ATT).copy_from(&o.h_att);
        var_biases = state.biases.project(o.pair, o.arrivals, &h, &mut pht, &mut own);
    }
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
    for j in 0..STATES {
        for i in 0..STATES {
            // `pht[i] * pht[j]` first: the product commutes, so P stays symmetric to the last bit.
            state.P[(i, j)] -= (pht[i] * pht[j]) * inverse;
        }
    }
    if !state.biases.is_empty() {
        state.biases.correct(pht, &projected.own, inverse, o.innovation);
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
