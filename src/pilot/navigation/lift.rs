//! Lift: the specific force against the thrust that was sent, where both should say the same.

use haltere_core::frames::G_MPS2;

use super::Navigation;
use crate::flight::modes::Mode;
use crate::view::View;

/// Time constant of the difference between accelerometer and thrust, s.
const LIFT_FILTER_S: f64 = 1.0;
/// Difference that no flight has, m/s².
pub(crate) const LIFT_MOST_MPS2: f64 = 3.5;
/// … and so much more for each share of the hover thrust that it was commanded away from it, m/s²: in fast
/// climbs and descents drag and the bend of the thrust curve are in the difference.
const LIFT_SLOPE_MPS2: f64 = 20.0;
/// It is looked at below this angle, 20 degrees, and so long after a larger one, s: the
/// speed that it brought decays by drag and by the position loop.
const LIFT_LEVEL_COS: f64 = 0.94;
const LIFT_AFTER_S: f64 = 1.0;
/// Below this height the floor may carry, m.
const LIFT_CLEAR_M: f64 = 0.5;

/// Specific force along body z against the thrust that was sent.
#[derive(Debug, Default)]
pub(crate) struct Lift {
    /// Low-passed difference, measured minus sent, m/s².
    pub off_mps2: f64,
    /// Low-passed distance of the thrust from the one that hovers, share of it.
    away: f64,
    /// Time for which it is not looked at any more, s.
    leaned_s: f64,
}

impl Lift {
    /// A control step in free air: specific force, low-passed over wing beats, and thrust over the thrust
    /// that hovers.
    pub fn step(&mut self, acc_z_mps2: f64, share: f64, dt_s: f64) {
        let off_mps2 = acc_z_mps2 + G_MPS2 * share;
        if off_mps2.is_finite() {
            let weight = dt_s / (LIFT_FILTER_S + dt_s);
            self.off_mps2 += (off_mps2 - self.off_mps2) * weight;
            self.away += ((share - 1.0).abs() - self.away) * weight;
        }
    }

    /// Whether that is more than flying explains.
    pub fn differs(&self) -> bool {
        // Less lift than was sent is no matter of how much was sent: more was sent because it is less.
        let most_mps2 = LIFT_MOST_MPS2 + LIFT_SLOPE_MPS2 * self.away;
        self.off_mps2 > LIFT_MOST_MPS2 || self.off_mps2 < -most_mps2
    }
}

impl Navigation {
    /// Compares accelerometer and thrust where both should say the same: away from the floor, under our
    /// own control.
    pub(crate) fn watch_lift(&mut self, view: &View<'_>, dt_s: f64) {
        let calm = view.mode.is_flying()
            && view.mode != Mode::Land
            && view.height_above_floor_m() > LIFT_CLEAR_M
            && view.board.obeys;
        let hover_frac = view.thrust.hover_frac * view.thrust.ground_factor;
        if !calm || hover_frac < 0.05 {
            self.lift = Lift::default();
            return;
        }
        // Leaning far it moves fast, along its own vertical axis too, and drag is as large as the difference
        // that is looked for: nothing is learned then.
        // By the board's account: ours may be what is wrong.
        let level = view.board.attitude.map_or(1.0, |board| board.attitude.matrix()[(2, 2)]);
        if level < LIFT_LEVEL_COS {
            self.lift.leaned_s = LIFT_AFTER_S;
            return;
        }
        self.lift.leaned_s -= dt_s;
        if self.lift.leaned_s > 0.0 {
            return;
        }
        // Low-passed as the force is.
        let share = self.touch.thrust_frac / hover_frac;
        self.lift.step(self.touch.acc_z_mps2, share, dt_s);
    }
}
