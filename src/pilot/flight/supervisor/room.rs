//! The room: whether its axes and its heading are what UWB and lean together say (`rooms` is the law).

use haltere_dialect::mav::haltere::MavSysStatusSensor as S;
use nalgebra::{Matrix3, Vector2};

use super::condition::{Condition, Number, ROW, Watched};
use super::reaction::Reaction;
use crate::Pilot;
use crate::flight::modes::Mode;
use crate::navigation::rooms::AGAINST;
use crate::out::voice::Severity;
use haltere_core::estimate::Health;
use haltere_core::frames::{G_MPS2, wrap_pi_rad};
use haltere_core::time::HostTime;

/// The board's lean may be this old, s.
const LEAN_AGE_S: f64 = 0.2;
/// UWB must be as new as this, s: without it the position is the integral of the lean.
const UWB_AGE_S: f64 = 0.1;
/// Height of the gear above which nothing but the air holds it, m.
const CLEAR_M: f64 = 0.12;
/// Where biases are learned, UWB is asked alone, over the time between two decisions, s.
const UWB_WINDOW_S: f64 = 0.1;
/// Control steps between two decisions: the noise of UWB in the estimate lasts as long.
const EVERY: u64 = 10;

impl Pilot {
    /// Follows what pushes the vehicle, and where UWB has it, while it is in the air.
    pub(crate) fn watch_room(&mut self, at: HostTime, dt_s: f64) {
        let board = self.board.attitude.filter(|a| at.seconds_since(a.received_at) < LEAN_AGE_S);
        let usable = matches!(self.estimate.health, Health::Good | Health::Degraded)
            && self.flight.mode.is_flying()
            && self.flight.mode != Mode::Descend
            && !self.board.link.lateness().is_late();
        let measured = self.navigation.last_fused.is_some_and(|t| at.seconds_since(t) < UWB_AGE_S);
        let Some(board) = board.filter(|_| usable && self.height_above_floor_m() > CLEAR_M) else {
            self.flight.supervisor.rooms.close();
            return;
        };
        let m: Matrix3<f64> = board.attitude.matrix();
        let yaw_rad = self.estimate.R_EB.yaw_rad();
        let turn_rad = wrap_pi_rad(yaw_rad - board.attitude.yaw_rad());
        // Thrust acts along -z of the body, and carries the weight.
        let lean = Vector2::new(m[(0, 2)], m[(1, 2)]) * (-G_MPS2 / m[(2, 2)].max(0.5));
        let lean_E_mps2 = nalgebra::Rotation2::new(turn_rad) * lean;
        let [k_x, k_y, _] = self.config.estimator.drag_per_s;
        let (pos, vel) = (self.estimate.pos_E_m, self.estimate.vel_E_mps());
        let (pos_E_m, vel_E_mps) = (Vector2::new(pos.x(), pos.y()), Vector2::new(vel.x(), vel.y()));
        let rooms = &mut self.flight.supervisor.rooms;
        rooms.step(lean_E_mps2, yaw_rad, [k_x, k_y], [pos_E_m, vel_E_mps], dt_s);
        if measured && self.clock.control_steps.is_multiple_of(EVERY) {
            let by_uwb = self.navigation.estimator.pos_by_uwb_E_m(UWB_WINDOW_S);
            rooms.decide(by_uwb.map_or(pos_E_m, |pos| Vector2::new(pos.x(), pos.y())));
        }
    }
}

/// The axes or the heading are not the room's.
pub(super) const ROOM: Condition = Condition {
    name: "room_differs",
    seen_by: "UWB leads elsewhere than the vehicle leans. From the first 0.12 m of a flight on, the board's lean, turned \
              by our heading, is held against where UWB has the vehicle ten times a second, under a sound room (turned \
              by up to 40 degrees, or 0.6 to 1.6 times as large) and under fifteen wrong ones: turned by 90 degrees and \
              more, or mirror images. One of these is e^20 times as likely as every sound one, and has foreseen where UWB \
              leads: after what none of them foresees, a gust, it is begun anew. The text says which.",
    numbers: &[Number {
        key: "",
        value: |_| AGAINST,
        unit: "",
        origin: "a sound flight would have to last a year for each wrong room to meet it once by chance; turbulence reached 15",
    }],
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: UWB does not lead where the vehicle leans",
    over: "",
    latched: true,
    health: S::MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL,
    severity: Severity::Emergency,
    is_seen: |pilot, _| pilot.flight.supervisor.rooms.is_wrong(),
    words: |pilot, _| pilot.flight.supervisor.rooms.words(),
    ..ROW
};
