//! What the drag model leaves out for long: wind, a trim that leans, a wing that pushes sideways.
//!
//! In flight the force along body x and y is modelled as drag in still air, since the accelerometer shows
//! little but the wing beat there (`SpecificForce::ThrustAxis`). In a steady wind `w` the model is off by `k w`, 4 m/s² for
//! 1 m/s on this vehicle, and the filter can only explain that by leaning: its vertical drifts to
//! `atan(k w / g)`, 21 degrees off, within ten seconds. Slowly the accelerometer knows better:
//!
//! ```text
//! b ← b + (f_measured − f_drag − b)·dt/(T + dt),    f = f_drag + b        along body x and y
//! ```
//!
//! with `T` = `slow_force_s`: a complementary filter, drag for what changes within `T`, the accelerometer for what
//! lasts. A beat of 12 Hz with an amplitude of 8 m/s² is 0.05 m/s² behind `T` = 2 s. **Source.** Ours. **Left out.** A bias of
//! the accelerometer leans the vertical by `b/g`, 0.6 degrees for 0.1 m/s², as a wind of 0.02 m/s would. `b` is no
//! state and has no covariance. It is bounded by [`MOST_MPS2`]: a knock, or legs that still carry, is no wind.

use nalgebra::Vector3;

/// Most that is added along an axis, m/s². Chosen: forward drag of this vehicle (4.2 1/s) in a wind of 1.2 m/s.
const MOST_MPS2: f64 = 5.0;

/// Force along body x and y beyond drag, m/s².
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SlowForce {
    beyond_B_mps2: [f64; 2],
}

impl SlowForce {
    /// Follows what was measured beyond drag over a step; gives what is to be added, m/s².
    pub fn follow(
        &mut self,
        dt_s: f64,
        time_s: f64,
        measured_B: &Vector3<f64>,
        drag_B_mps2: [f64; 2],
    ) -> [f64; 2] {
        let weight = dt_s / (time_s + dt_s);
        for (axis, beyond) in self.beyond_B_mps2.iter_mut().enumerate() {
            *beyond += (measured_B[axis] - drag_B_mps2[axis] - *beyond) * weight;
            *beyond = beyond.clamp(-MOST_MPS2, MOST_MPS2);
        }
        self.beyond_B_mps2
    }

    /// On the floor nothing is beyond drag.
    pub fn rest(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_what_lasts_is_followed_and_the_beat_is_not() {
        let mut slow = SlowForce::default();
        let mut b = [0.0; 2];
        for step in 0..2000 {
            let t_s = f64::from(step) * 0.01;
            let beat = 8.0 * (std::f64::consts::TAU * 12.0 * t_s).sin();
            b = slow.follow(0.01, 2.0, &Vector3::new(4.0 + beat - 1.5, 0.0, -9.8), [-1.5, 0.5]);
        }
        assert!((b[0] - 4.0).abs() < 0.1 && (b[1] + 0.5).abs() < 1e-3, "{b:?}");
        slow.rest();
        assert_eq!(slow, SlowForce::default());
    }
}
