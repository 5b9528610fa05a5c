//! The carrot: the point that the position loop is asked for, on its way along a leg.

use haltere_core::frames::{E, Vec3};

/// A setpoint that moves along a straight leg with limited speed and acceleration.
#[derive(Debug, Clone, Copy)]
pub(super) struct Carrot {
    /// Where it is, Earth frame, m.
    pub pos_E_m: Vec3<E>,
    /// Where its leg ends, Earth frame, m.
    pub target_E_m: Vec3<E>,
    speed_mps: f64,
}

impl Carrot {
    /// Where a leg has ended, or none began.
    pub fn resting(pos_E_m: Vec3<E>) -> Self {
        Self { pos_E_m, target_E_m: pos_E_m, speed_mps: 0.0 }
    }

    /// Whether its leg is over.
    pub fn has_arrived(&self) -> bool {
        self.pos_E_m == self.target_E_m
    }

    /// Moves on; the velocity it moves with, Earth frame, m/s.
    pub fn advance(&mut self, top_speed_mps: f64, acceleration_mps2: f64, dt_s: f64) -> Vec3<E> {
        let way = self.target_E_m - self.pos_E_m;
        let distance_m = way.norm();
        let braking_mps = (2.0 * acceleration_mps2 * distance_m).sqrt();
        let faster_mps = self.speed_mps + acceleration_mps2 * dt_s;
        self.speed_mps = top_speed_mps.min(braking_mps).min(faster_mps);
        let stride_m = self.speed_mps * dt_s;
        if distance_m <= stride_m.max(1e-6) {
            *self = Self::resting(self.target_E_m);
            return Vec3::zero();
        }
        let direction = way * (1.0 / distance_m);
        self.pos_E_m += direction * stride_m;
        direction * self.speed_mps
    }
}
