//! Zero-velocity aid: a vehicle that stands does not move. Used while resting only.

use nalgebra::Vector3;

use super::state::State;
use super::update::Observation;

/// One sigma of the velocity of a standing vehicle over one sample, m/s: idling wings shake it.
pub const STD_MPS: f64 = 0.05;
/// The aid is fused this often, s: a sample every millisecond would claim certainty.
pub const INTERVAL_S: f64 = 0.02;

/// Observation of one axis of the body velocity.
pub fn observe(state: &State, axis: usize) -> Observation {
    let mut h_vel = Vector3::zeros();
    h_vel[axis] = 1.0;
    Observation {
        innovation: -state.v_B[axis],
        h_pos: Vector3::zeros(),
        h_vel,
        h_att: Vector3::zeros(),
        pair: None,
        var: STD_MPS * STD_MPS,
    }
}
