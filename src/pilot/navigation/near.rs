//! Whether the floor is near, and what can be asked about it.

use haltere_core::time::HostTime;

use super::Navigation;
use crate::board::BoardState;
use crate::view::View;

/// The floor is expected below this height by the estimate, m: near it multipath biases the height
/// by up to half a metre (INTERFACES.md section 1; 0.5 m seen in lockstep).
pub(crate) const NEAR_FLOOR_M: f64 = 0.8;
/// The floor is not there yet where estimate and barometer both say more than this, m.
const CLEAR_M: f64 = 0.5;
/// An estimate is back only where UWB is as new as this, s.
const UWB_BACK_S: f64 = 0.5;
/// An accelerometer that repeats itself for this long shows no fall any more, s: a dozen samples, and long before it
/// counts as frozen.
const FEEL_BLIND_S: f64 = 0.05;

impl Navigation {
    pub(crate) fn is_uwb_fresh(&self, at: HostTime) -> bool {
        self.last_fused.is_some_and(|t| at.seconds_since(t) < UWB_BACK_S)
    }

    /// Whether estimate or barometer say that the floor is near.
    pub(crate) fn is_near_floor(&self, view: &View<'_>) -> bool {
        Self::is_low_by_estimate(view) || self.is_low_by_baro(view)
    }

    /// Whether estimate and barometer, each by itself, say that the floor is not there yet.
    pub(crate) fn is_clear_of_floor(&self, view: &View<'_>) -> bool {
        view.height_above_floor_m() > CLEAR_M
            && self.baro_above_floor_m(view).is_some_and(|m| m > CLEAR_M)
    }

    fn is_low_by_estimate(view: &View<'_>) -> bool {
        view.height_above_floor_m() < NEAR_FLOOR_M
    }

    /// Whether the barometer, whose zero was the floor, says that it is near.
    pub(crate) fn is_low_by_baro(&self, view: &View<'_>) -> bool {
        self.baro_above_floor_m(view).is_some_and(|m| m < NEAR_FLOOR_M)
    }

    /// How long what is sent takes to be seen, s; 0 where it is not late.
    pub(crate) fn obeyed_after_s(&self, board: &BoardState) -> f64 {
        board.latency_s.max(self.touch.lag_s)
    }

    /// Whether what is sent is obeyed too late for a loop that is closed over it.
    pub(crate) fn obeys_late(&self, board: &BoardState) -> bool {
        board.is_late || self.touch.lag_s > 0.0
    }

    /// Whether the accelerometer has repeated itself for so long that it shows no fall.
    pub(crate) fn is_numb(&self) -> bool {
        self.repetition.acc_s > FEEL_BLIND_S
    }

    pub(crate) fn imu_age_s(&self, at: HostTime) -> f64 {
        self.last_imu.map_or(f64::INFINITY, |t| at.seconds_since(t))
    }
}
