//! Reference aid: position from motion capture, fused only if configured.

use nalgebra::Vector3;

use super::state::State;
use super::update::Observation;

/// Observation of one axis of the position, Earth frame.
pub fn observe(state: &State, axis: usize, pos_E_m: f64, var: f64) -> Observation {
    let mut h_pos = Vector3::zeros();
    h_pos[axis] = 1.0;
    Observation {
        innovation: pos_E_m - state.x_E[axis],
        h_pos,
        h_vel: Vector3::zeros(),
        h_att: Vector3::zeros(),
        pair: None,
        var,
    }
}
