//! The room: whether its axes, its heading and its height are what UWB, lean and accelerometer together say (`lead`).

use haltere_dialect::mav::haltere::MavSysStatusSensor as S;

use super::super::modes::Mode;
use super::super::{Pilot, Severity};
use super::condition::{Condition, Number, ROW, Watched};
use super::lead::Push;
use super::leads::{RIGHT, TURN_MOST_RAD};
use super::reaction::Reaction;
use crate::frames::{G_MPS2, wrap_pi_rad};
use crate::time::HostTime;

/// The board's lean may be this old, s.
const LEAN_AGE_S: f64 = 0.2;
/// Share of gravity that the accelerometer may have read at rest.
const READ: [f64; 2] = [0.75, 1.3];

impl Pilot {
    /// Follows what pushes the vehicle, while it is in the air.
    pub(in crate::pilot) fn watch_lead(&mut self, at: HostTime, dt_s: f64) {
        if !self.mode.is_flying() {
            if let Some(rest_mps2) = self.estimator.rest_force_mps2() {
                self.supervisor.lead.gravity_read_mps2 = rest_mps2;
            }
            self.supervisor.lead.rest();
            return;
        }
        if self.mode != Mode::Takeoff {
            self.supervisor.lead.abandon_push();
        }
        let read = self.supervisor.lead.gravity_read_mps2 / G_MPS2;
        // The board's lean where it tells one: ours has UWB in it.
        let board = self.board_attitude.filter(|a| at.seconds_since(a.received_at) < LEAN_AGE_S);
        let yaw_rad = self.estimate.R_EB.yaw_rad();
        let tilt = board.map_or(self.estimate.R_EB, |a| a.attitude);
        let turn_rad = wrap_pi_rad(yaw_rad - tilt.yaw_rad());
        let m = tilt.matrix();
        // Thrust acts along -z of the body.
        let per_up = G_MPS2 / m[(2, 2)].max(0.5);
        let (x, y) = (-m[(0, 2)] * per_up, -m[(1, 2)] * per_up);
        let (sin, cos) = turn_rad.sin_cos();
        let push = Push {
            lean_E_mps2: [cos * x - sin * y, sin * x + cos * y],
            down_mps2: m[(2, 2)] * self.touch.acc_z_mps2 / read.clamp(READ[0], READ[1]) + G_MPS2,
            yaw_rad,
            pos_E_m: self.estimate.pos_E_m,
        };
        let [k_x, k_y, _] = self.config.estimator.drag_per_s;
        self.supervisor.lead.step(at, &push, [k_x, k_y], dt_s);
    }
}

/// The axes or the heading are not the room's.
pub(super) const ROOM: Condition = Condition {
    name: "room_differs",
    seen_by: "UWB leads elsewhere than the vehicle is pushed. In the take-off the climb waits at 0.4 m, and the vehicle \
              leans by 10 degrees for 0.4 s forwards, back, to the right and back, unless the way up has shown it \
              already: UWB must follow along every axis, and within 30 degrees of the lean. Undecided after three \
              rounds, the likelier holds. Later the board's lean is held against UWB all the time, over some ten \
              windows of 1.2 s; gusts, which the loop answers, do not reach the four sigmas that are asked for then. \
              A survey that is a mirror image, a heading that is wrong, ranging that is old. The text says which.",
    numbers: &[
        Number {
            key: "",
            value: |_| RIGHT,
            unit: "",
            origin: "chosen: share of the push that UWB follows; a survey too small or too large by a half still flies",
        },
        Number {
            key: "",
            value: |_| TURN_MOST_RAD.to_degrees(),
            unit: "deg",
            origin: "a compass between steel errs by up to 25",
        },
    ],
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: UWB does not lead where the vehicle is pushed",
    over: "",
    latched: true,
    health: S::MAV_SYS_STATUS_SENSOR_XY_POSITION_CONTROL,
    severity: Severity::Emergency,
    is_seen: |pilot, _| pilot.supervisor.lead.against_room().is_some(),
    words: |pilot, _| pilot.supervisor.lead.against_room().map_or(String::new(), |s| s.words()),
    ..ROW
};

/// UWB does not rise and fall as the accelerometer says.
pub(super) const RISE: Condition = Condition {
    name: "rise_differs",
    seen_by: "UWB does not follow the accelerometer up and down, beyond a bias of 0.5 m/s² and over some ten windows of \
              1.2 s, where it says 0.4 m within one: the accelerometer reads another scale, ranging is old, or floor and ceiling anchors are exchanged.",
    numbers: &[Number {
        key: "",
        value: |_| RIGHT,
        unit: "",
        origin: "share of the way that UWB follows, as in room_differs, with four sigmas",
    }],
    lasts_s: |_| 0.1,
    watched: Watched::Air,
    wanted: |_| Reaction::Descend,
    because: "no usable estimate: UWB and accelerometer rise apart",
    over: "",
    latched: true,
    health: S::MAV_SYS_STATUS_SENSOR_Z_ALTITUDE_CONTROL.union(S::MAV_SYS_STATUS_SENSOR_3D_ACCEL),
    severity: Severity::Emergency,
    is_seen: |pilot, _| pilot.supervisor.lead.rises_apart(),
    words: |pilot, _| {
        let share = pilot.supervisor.lead.seen().map_or(0.0, |seen| seen.down[0]);
        format!(
            "UWB rises {share:.1} times as far as the vertical velocity of the accelerometer says"
        )
    },
    ..ROW
};
