//! The board's vertical as an aid: which way is down, by the filter of the inner loop.
//!
//! The board flies by a filter of its own, which has the accelerometer on all axes. Ours models drag in still air along
//! body x and y, and in a steady wind its vertical leans (`slow_force.rs`). What counts for control is that both agree: a
//! setpoint in our frame is flown in the board's. With `u = R_EBᵀ e_z` down by us and `d` down by the board, both in
//! `B`, and δ our attitude error (`R_true = R exp(δ)`):
//!
//! ```text
//! d = u + u × δ,   so   d × u = δ − u (u·δ):   innovation = a·(d × u),   ∂/∂δ = aᵀ
//! ```
//!
//! for two directions `a` across `u`. A reading is turned by our angular rate from its time to ours. Its error is
//! taken as `std_deg`, the same for `correlation_s`. The heading is not touched. **Source.** Ours; the error-state form is
//! that of `update.rs`. **Left out.** The two filters share the board's accelerometer and gyroscope: their errors
//! are not independent, which the long correlation stands for.

use nalgebra::Vector3;

use super::state::State;
use super::update::Observation;
use super::{Estimator, noise};
use crate::drops::DropReason;
use crate::measure::BoardAttitude;

/// Oldest reading that is turned to our time, s: at 3 rad/s that is a turn of 17 degrees.
const OLDEST_S: f64 = 0.1;
/// Longest interval between readings that counts, s.
const LONGEST_INTERVAL_S: f64 = 1.0;

/// Two directions across `u`; `None` with a vehicle on its side, whose x axis points down.
fn across(u: &Vector3<f64>) -> Option<[Vector3<f64>; 2]> {
    let x = Vector3::x() - u * u.x;
    let first = x.try_normalize(0.1)?;
    Some([first, u.cross(&first)])
}

/// What the board's `down_B` says along one of the two directions.
fn observe(state: &State, down_B: &Vector3<f64>, axis: usize, var: f64) -> Option<Observation> {
    let u = state.q_EB.inverse_transform_vector(&Vector3::z());
    let a = across(&u)?[axis];
    Some(Observation {
        innovation: a.dot(&down_B.cross(&u)),
        h_pos: Vector3::zeros(),
        h_vel: Vector3::zeros(),
        h_att: a,
        pair: None,
        var,
    })
}

impl Estimator {
    /// Takes the board's attitude; fused in flight, where that is asked for.
    pub fn board_vertical(&mut self, board: &BoardAttitude) {
        let c = self.config.board_vertical;
        if !c.fuse || !self.airborne || self.state.is_none() {
            self.aided.board_vertical_at = None;
            return;
        }
        let down_B = Vector3::from(std::array::from_fn(|i| board.attitude.matrix()[(2, i)]));
        let norm = down_B.norm();
        let late_s = self.at.seconds_since(board.valid_at);
        let known = self.aided.board_vertical_at.replace(board.valid_at);
        let interval_s = known.map_or(LONGEST_INTERVAL_S, |t| board.valid_at.seconds_since(t));
        if !((norm - 1.0).abs() < 0.01 && late_s.abs() < OLDEST_S && interval_s > 0.0) {
            self.drops.add(DropReason::BadValue, 1);
            return;
        }
        let down_B = down_B / norm;
        let down_B = down_B + down_B.cross(&self.imu.rate_B) * late_s;
        let std_rad = c.std_deg.to_radians();
        let worth = noise::correlation_factor(c.correlation_s, interval_s.min(LONGEST_INTERVAL_S));
        for axis in 0..2 {
            let Some(state) = &self.state else { return };
            if let Some(o) = observe(state, &down_B, axis, std_rad * std_rad) {
                self.fuse_soft(o, worth);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimator::state::{quat_exp, quat_turn};
    use nalgebra::UnitQuaternion;

    #[test]
    fn prop_the_row_is_the_difference_of_the_innovation() {
        let q_EB = UnitQuaternion::from_euler_angles(0.3, -0.4, 1.1);
        let mut state = State::at_pose(Vector3::zeros(), q_EB, 0.1, 0.1, 0.1);
        let down_B = UnitQuaternion::from_euler_angles(0.35, -0.3, 0.0)
            .inverse_transform_vector(&Vector3::z());
        let small = 1e-6;
        for axis in 0..2 {
            let o = observe(&state, &down_B, axis, 1.0).unwrap();
            // Turned by a little along a, the innovation falls by as much.
            state.q_EB = quat_turn(&q_EB, &quat_exp(&(o.h_att * small)));
            let u = state.q_EB.inverse_transform_vector(&Vector3::z());
            let after = o.h_att.dot(&down_B.cross(&u));
            assert!(((o.innovation - after) / small - 1.0).abs() < 0.02, "{axis}");
            state.q_EB = q_EB;
        }
    }

    #[test]
    fn prop_told_often_it_agrees_with_the_board_and_keeps_its_heading() {
        let q_EB = UnitQuaternion::from_euler_angles(0.2, -0.25, 1.1);
        let mut state = State::at_pose(Vector3::zeros(), q_EB, 0.1, 0.1, 0.2);
        let board = UnitQuaternion::from_euler_angles(-0.05, 0.1, 2.7);
        let down_B = board.inverse_transform_vector(&Vector3::z());
        for _ in 0..50 {
            for axis in 0..2 {
                let o = observe(&state, &down_B, axis, 1e-4).unwrap();
                crate::estimator::update::fuse(&mut state, &o);
            }
        }
        let u = state.q_EB.inverse_transform_vector(&Vector3::z());
        assert!((u - down_B).norm() < 2e-3, "{u} {down_B}");
        assert!((state.q_EB.euler_angles().2 - 1.1).abs() < 0.1, "{:?}", state.q_EB.euler_angles());
    }
}
