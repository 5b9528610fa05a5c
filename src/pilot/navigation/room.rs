//! Whether the room's axes and our heading are what UWB and lean together say (`rooms` is the law).

use nalgebra::{Matrix3, Vector2};

use haltere_core::frames::{G_MPS2, wrap_pi_rad};

use super::{ATTITUDE_AGE_S, Navigation};
use crate::flight::modes::Mode;
use crate::view::View;

/// UWB must be as new as this, s: without it the position is the integral of the lean.
const UWB_AGE_S: f64 = 0.1;
/// Height of the gear above which nothing but the air holds it, m.
const CLEAR_M: f64 = 0.12;
/// Where biases are learned, UWB is asked alone, over the time between two decisions, s.
const UWB_WINDOW_S: f64 = 0.1;
/// Control steps between two decisions: the noise of UWB in the estimate lasts as long.
const EVERY: u64 = 10;

impl Navigation {
    /// Follows what pushes the vehicle, and where UWB has it, while it is in the air.
    pub(crate) fn watch_room(&mut self, view: &View<'_>, control_steps: u64, dt_s: f64) {
        let at = view.at;
        let board =
            view.board.attitude.filter(|a| at.seconds_since(a.received_at) < ATTITUDE_AGE_S);
        let usable = view.is_usable()
            && view.mode.is_flying()
            && view.mode != Mode::Descend
            && !view.board.is_late;
        let measured = self.last_fused.is_some_and(|t| at.seconds_since(t) < UWB_AGE_S);
        let Some(board) = board.filter(|_| usable && view.height_above_floor_m() > CLEAR_M) else {
            self.rooms.close();
            return;
        };
        let m: Matrix3<f64> = board.attitude.matrix();
        let yaw_rad = view.estimate.R_EB.yaw_rad();
        let turn_rad = wrap_pi_rad(yaw_rad - board.attitude.yaw_rad());
        // Thrust acts along -z of the body, and carries the weight.
        let lean = Vector2::new(m[(0, 2)], m[(1, 2)]) * (-G_MPS2 / m[(2, 2)].max(0.5));
        let lean_E_mps2 = nalgebra::Rotation2::new(turn_rad) * lean;
        let [k_x, k_y, _] = view.config.estimator.drag_per_s;
        let (pos, vel) = (view.estimate.pos_E_m, view.estimate.vel_E_mps());
        let (pos_E_m, vel_E_mps) = (Vector2::new(pos.x(), pos.y()), Vector2::new(vel.x(), vel.y()));
        let rooms = &mut self.rooms;
        rooms.step(lean_E_mps2, yaw_rad, [k_x, k_y], [pos_E_m, vel_E_mps], dt_s);
        if measured && control_steps.is_multiple_of(EVERY) {
            let by_uwb = self.estimator.pos_by_uwb_E_m(UWB_WINDOW_S);
            rooms.decide(by_uwb.map_or(pos_E_m, |pos| Vector2::new(pos.x(), pos.y())));
        }
    }
}
