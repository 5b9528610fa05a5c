//! What is down by the board's attitude, as the mean of what it says at rest.

use haltere_core::estimator::STANDING_S;
use haltere_core::frames::{B, Vec3};
use haltere_core::measure::BoardAttitude;
use haltere_core::time::HostTime;

/// What is down by the board's attitude, followed as the accelerometer is.
#[derive(Debug, Default)]
pub(crate) struct BoardDown {
    pub mean_B: Option<Vec3<B>>,
    pub at: HostTime,
}

impl BoardDown {
    /// An attitude of the board.
    pub fn note(&mut self, board: &BoardAttitude) {
        let m = board.attitude.matrix();
        let now_B = Vec3::new(m[(2, 0)], m[(2, 1)], m[(2, 2)]);
        let dt_s = board.received_at.seconds_since(self.at).clamp(0.0, STANDING_S);
        self.at = board.received_at;
        let mean_B = self.mean_B.unwrap_or(now_B);
        self.mean_B = Some(mean_B + (now_B - mean_B) * (dt_s / (STANDING_S + dt_s)));
    }
}
