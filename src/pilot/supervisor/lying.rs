//! Tipped over on the floor, with motors that run.
//!
//! A vehicle that lies is carried by the floor: along the vertical, as the board's attitude has it, its specific force is
//! gravity's, while thrust along its own axis points elsewhere. In the air that does not last. Leaning by 70 degrees,
//! thrust carries a third of the weight and the vehicle falls; after half a second drag across the wings carries it,
//! at 2 m/s, and then its height falls.
//!
//! ```text
//! f_E = low-pass((R a)_z)     R the board's attitude, a the specific force     carried: |f_E + g| < 2 m/s²
//! ```
//!
//! A lean that is smaller, but not the one that was asked for, is held up by gear and wing tip: 38 degrees with the
//! Flapper. Thrust could carry that in the air, so it is looked for near the floor alone, and for longer.

use haltere_dialect::mav::haltere::MavSysStatusSensor;

use super::super::{Pilot, Severity};
use super::condition::{Condition, Number, ROW};
use super::reaction::Reaction;
use haltere_core::frames::{B, E, G_MPS2, Rot};
use haltere_core::measure::ImuSample;
use haltere_core::time::HostTime;

/// Time constant of the low-pass on the vertical specific force, s: wings that beat on the floor toss the vehicle for
/// 0.2 to 0.5 s at a time, and between two blows it is not carried. In the air the force still leaves gravity's within
/// 0.11 s of a lean of 70 degrees, before `LIES_S`.
const FILTER_S: f64 = 0.3;
/// A longer interval between two samples is a gap, s.
const GAP_S: f64 = 0.1;
/// The board's attitude must be as new as this, s.
const ATTITUDE_AGE_S: f64 = 0.2;
/// The floor carries if the vertical specific force is gravity's to within this, m/s².
const CARRIED_MPS2: f64 = 2.0;
/// A lean of so much carries nothing for so long: the board rights a vehicle in the air within 0.3 s.
const LIES_S: f64 = 0.3;
/// A lean of so much, and so far from what was asked for, rad (30 degrees) …
const ASTRAY_RAD: f64 = 0.52;
/// … for so long is one that thrust cannot right, s.
const ASTRAY_S: f64 = 0.5;
/// The height has not fallen if it is less than this below where it was, m: noise of the estimate. In the air it falls
/// 0.35 m in that time.
const FALLEN_M: f64 = 0.2;

/// How it leans, and what carries it.
#[derive(Debug)]
pub(crate) struct Lying {
    /// Vertical specific force, low-passed, m/s².
    down_mps2: f64,
    imu_at: Option<HostTime>,
    /// Vertical of the setpoint that was sent last, body frame.
    asked_down_B: [f64; 3],
    /// How long it has leaned too far and been carried, s, and its height at the begin, m.
    leans_s: f64,
    from_m: f64,
    /// How long it has leaned otherwise than it was told, and been carried, s.
    astray_s: f64,
    /// What is told of it.
    seen: bool,
}

impl Default for Lying {
    fn default() -> Self {
        Self {
            down_mps2: -G_MPS2,
            imu_at: None,
            asked_down_B: [0.0, 0.0, 1.0],
            leans_s: 0.0,
            from_m: 0.0,
            astray_s: 0.0,
            seen: false,
        }
    }
}

fn down_B(attitude: &Rot<E, B>) -> [f64; 3] {
    let m = attitude.matrix();
    [m[(2, 0)], m[(2, 1)], m[(2, 2)]]
}

impl Lying {
    /// An IMU sample, at an attitude of the board.
    pub fn imu(&mut self, sample: &ImuSample, attitude: &Rot<E, B>) {
        let dt_s = self.imu_at.map_or(0.0, |t| sample.valid_at.seconds_since(t));
        // The first sample after a gap stands for nothing.
        let dt_s = if (0.0..GAP_S).contains(&dt_s) { dt_s } else { 0.0 };
        self.imu_at = Some(sample.valid_at);
        let force = sample.acc_B_mps2.to_array();
        let now: f64 = down_B(attitude).iter().zip(force).map(|(d, f)| d * f).sum();
        self.down_mps2 += (now - self.down_mps2) * (dt_s / (FILTER_S + dt_s));
    }

    /// A setpoint was sent.
    pub fn asked(&mut self, attitude: &Rot<E, B>) {
        self.asked_down_B = down_B(attitude);
    }

    /// A step of a flight: the board's attitude, the height, m, and whether it is near the floor.
    fn step(&mut self, dt_s: f64, attitude: &Rot<E, B>, most_rad: f64, height_m: f64, near: bool) {
        let down_B = down_B(attitude);
        let carried = (self.down_mps2 + G_MPS2).abs() < CARRIED_MPS2;
        let dot: f64 = down_B.iter().zip(self.asked_down_B).map(|(a, b)| a * b).sum();
        if self.leans_s == 0.0 {
            self.from_m = height_m;
        }
        // Wings that beat on the floor toss it: what it does most of the time counts.
        let count = |s: f64, holds: bool| (s + if holds { dt_s } else { -dt_s }).max(0.0);
        self.leans_s = count(self.leans_s, carried && down_B[2] < most_rad.cos());
        // A board that leans less than it was told to stands upright.
        let astray = down_B[2] < ASTRAY_RAD.cos() && dot < ASTRAY_RAD.cos();
        self.astray_s = count(self.astray_s, carried && near && astray);
        let lies = self.leans_s > LIES_S && (near || height_m > self.from_m - FALLEN_M);
        self.seen = lies || self.astray_s > ASTRAY_S;
    }
}

impl Pilot {
    /// Follows lean and what carries it.
    pub(crate) fn watch_lying(&mut self, at: HostTime, dt_s: f64) {
        let fresh = |t: HostTime| at.seconds_since(t) < ATTITUDE_AGE_S;
        let board = self.board_attitude.filter(|board| fresh(board.received_at));
        let heard = self.supervisor.lying.imu_at.is_some_and(fresh);
        let Some(board) = board.filter(|_| heard && self.mode.has_thrust()) else {
            let lying = &mut self.supervisor.lying;
            (lying.leans_s, lying.astray_s, lying.seen) = (0.0, 0.0, false);
            return;
        };
        let most_rad = self.config.supervisor.tilt_most_deg.to_radians();
        let height_m = self.height_above_floor_m();
        let near = self.is_near_floor(at);
        self.supervisor.lying.step(dt_s, &board.attitude, most_rad, height_m, near);
    }
}

/// Lies on its side.
pub(super) const LIES: Condition = Condition {
    name: "tipped_over",
    seen_by: "The vehicle leans more than `supervisor.tilt_most_deg` by the board's attitude and is carried all the \
              same: its specific force along the vertical is gravity's to within 2 m/s², for 0.3 s, near the floor or \
              at a height that does not fall. Or it leans by 30 degrees, and as much otherwise than it was told, carried, near the \
              floor (below 0.8 m by estimate or barometer), for 0.5 s. In the air such a lean falls at once. The motors \
              are cut, forced, and thrust is not tried any more.",
    numbers: &[
        Number {
            key: "supervisor.tilt_most_deg",
            value: |c| c.supervisor.tilt_most_deg,
            unit: "deg",
            origin: "as above",
        },
        Number {
            key: "",
            value: |_| CARRIED_MPS2,
            unit: "m/s²",
            origin: "derived: leaning by 70 degrees the largest thrust leaves half of the weight",
        },
        Number {
            key: "",
            value: |_| LIES_S,
            unit: "s",
            origin: "the time in which a board rights a vehicle in the air",
        },
    ],
    gone_s: 0.0,
    latched: true,
    wanted: |_| Reaction::Disarm,
    because: "tipped over on the floor",
    over: "",
    health: MavSysStatusSensor::empty(),
    severity: Severity::Emergency,
    is_seen: |pilot, _| pilot.supervisor.lying.seen,
    words: |_, _| "lies on the floor: motors are cut".to_owned(),
    ..ROW
};
