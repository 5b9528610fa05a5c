//! TDOA aid: difference of the distances from tag to two anchors.
//!
//! `z = |p − b| − |p − a|`, `p = x + R (r + τ v)`: r the tag seen from the centre of mass (`B`, m),
//! τ the time from the state to the measurement (s, small). With
//! `h = (p − b)/|p − b| − (p − a)/|p − a|` the Jacobians are `h` to x, `τ Rᵀ h` to v and
//! `(r + τ v) × Rᵀ h` to d. With range biases of the anchors (`bias.rs`) theirs are added: `+ β_b − β_a`.

use nalgebra::Vector3;

use super::bias::Pair;
use super::state::State;
use super::update::Observation;

/// Nearer to an anchor than this the direction to it means nothing, m.
const LEAST_DISTANCE_M: f64 = 0.05;

/// What does not change from one measurement to the next, and what does.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// Anchor that is subtracted, Earth frame, m.
    pub a_E: Vector3<f64>,
    /// Anchor that is added, Earth frame, m.
    pub b_E: Vector3<f64>,
    /// Tag seen from the centre of mass, body frame, m.
    pub p_BT_B: Vector3<f64>,
    /// Time from the state to the measurement, s.
    pub ahead_s: f64,
}

/// Innovation and Jacobian; `None` on top of an anchor.
#[inline]
pub fn observe(
    state: &State,
    geometry: &Geometry,
    distance_diff_m: f64,
    pair: Option<Pair>,
    var: f64,
) -> Option<Observation> {
    let arm = geometry.p_BT_B + state.v_B * geometry.ahead_s;
    let turned = arm != Vector3::zeros();
    let p = if turned { state.x_E + state.q_EB * arm } else { state.x_E };
    let (from_a, from_b) = (p - geometry.a_E, p - geometry.b_E);
    let (distance_a, distance_b) = (from_a.norm(), from_b.norm());
    if !(distance_a > LEAST_DISTANCE_M && distance_b > LEAST_DISTANCE_M) {
        return None;
    }
    let h = from_b / distance_b - from_a / distance_a;
    let (h_vel, h_att) = if turned {
        let h_B = state.q_EB.inverse_transform_vector(&h);
        (h_B * geometry.ahead_s, arm.cross(&h_B))
    } else {
        (Vector3::zeros(), Vector3::zeros())
    };
    let biases_m = pair.map_or(0.0, |pair| state.biases.difference_m(pair));
    Some(Observation {
        innovation: distance_diff_m - (distance_b - distance_a) - biases_m,
        h_pos: h,
        h_vel,
        h_att,
        pair,
        var,
    })
}
