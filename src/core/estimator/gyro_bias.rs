//! Bias of the gyroscope in flight, as three states beside the nine.
//!
//! **Equation.** The gyroscope reads `m = w + b + noise`; the filter turns by `m − b̂`, so the error `δb = b − b̂`
//! turns the attitude error, to first order in the step:
//!
//! ```text
//! d ← Wᵀ d − t δb,   δb ← δb,   var δb ← var δb + q² t
//! ```
//!
//! Nothing measures it. It is learned through its ties to the attitude, wherever something else shows that:
//! tilt by the UWB while the vehicle flies, heading by the magnetometer or by motion. On the floor the mean of the
//! rest is better, takes its place, and the three begin anew.
//!
//! **Symbols.** w true rate, b bias, rad/s, frame `B`; d attitude error, rad; W turn of the step; t step, s; q
//! walk, rad/s/√s. **Source.** Error-state filters with a rate bias, as in Markley, "Attitude error representations
//! for Kalman filtering", J. Guidance Control Dynamics 26(2), 2003. **Left out.** Scale, misalignment, and that
//! the bias goes with temperature.

use nalgebra::Vector3;

use super::bias::Biases;
use super::state::{ATT, Cov, STATES};

impl Biases {
    /// The bias is zero with this sigma, rad/s, and tied to nothing.
    pub fn restart_gyro(&mut self, std_radps: f64) {
        self.gyro = 3;
        let first = self.gyro_row();
        for i in first..first + 3 {
            self.value[i] = 0.0;
            self.cross[i].fill(0.0);
            for j in 0..self.rows() {
                self.own[i][j] = 0.0;
                self.own[j][i] = 0.0;
            }
            self.own[i][i] = std_radps * std_radps;
        }
    }

    /// The bias beyond that of the rest, body frame, rad/s.
    #[inline]
    pub fn gyro_B_radps(&self) -> Vector3<f64> {
        let first = self.gyro_row();
        if self.gyro == 0 {
            return Vector3::zeros();
        }
        Vector3::new(self.value[first], self.value[first + 1], self.value[first + 2])
    }

    /// What its error does to the attitude in a step, after all else has followed the nine.
    #[inline]
    pub fn turn_by_gyro(&mut self, P: &mut Cov, dt_s: f64, walk_radps_rts: f64) {
        if self.gyro == 0 {
            return;
        }
        let first = self.gyro_row();
        for k in 0..3 {
            for j in 0..STATES {
                let part = dt_s * self.cross[first + k][j];
                P[(ATT + k, j)] -= part;
                P[(j, ATT + k)] -= part;
            }
            for l in 0..3 {
                P[(ATT + k, ATT + l)] += dt_s * dt_s * self.own[first + k][first + l];
            }
        }
        for i in 0..self.rows() {
            for k in 0..3 {
                self.cross[i][ATT + k] -= dt_s * self.own[i][first + k];
            }
        }
        for i in first..first + 3 {
            self.own[i][i] += walk_radps_rts * walk_radps_rts * dt_s;
        }
    }
}
