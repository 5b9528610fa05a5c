//! Tipped over on the floor, with motors that run.
//!
//! **Suspicion.** A vehicle that lies is carried by the floor: along the vertical, as the board's attitude has it, its
//! specific force is gravity's, while its own axis points elsewhere than it was told to.
//!
//! ```text
//! f_E = low-pass((R a)_z)     R the board's attitude, a the specific force     carried: |f_E + g| < 2 m/s²
//! ```
//!
//! **Witness.** Drag across the wings carries as well: flown level at 4 m/s a lean of 60 degrees needs 0.8 of the thrust
//! that hovers. So the vehicle that seems to lie is asked: its thrust is taken away. In the air the force is gone with it
//! as soon as the wings stand (VEHICLE.md: 0.08 s), and the thrust comes back after a quarter of a second. What is carried
//! without thrust lies on something, and that alone cuts the motors.
//!
//! Directions are those of the board's room: about its own axis thrust may turn as it likes, and a heading that lags is no
//! lean.

use nalgebra::Vector3;

use haltere_core::frames::{B, E, G_MPS2, Rot};
use haltere_core::measure::ImuSample;
use haltere_core::time::HostTime;

use super::{ATTITUDE_AGE_S, Navigation};
use crate::view::View;

/// Time constant of the low-pass on the vertical specific force, s: wings that beat on the floor toss the vehicle for
/// 0.2 to 0.5 s at a time, and between two blows it is not carried …
const FILTER_S: f64 = 0.3;
/// … and without wings that beat, s.
const STILL_FILTER_S: f64 = 0.04;
/// A longer interval between two samples is a gap, s.
const GAP_S: f64 = 0.1;
/// The floor carries if the vertical specific force is gravity's to within this, m/s².
pub(crate) const CARRIED_MPS2: f64 = 2.0;
/// What lies is not pushed aside by more than this, m/s²: leaning by 30 degrees in the air is 5.7 …
const PUSHED_MPS2: f64 = 4.0;
/// … or, where drag holds against that at 2 m/s, moves as far as this meanwhile, m.
const MOVED_M: f64 = 0.3;
/// A lean of so much, and so far from what was asked for, rad (30 degrees) …
const ASTRAY_RAD: f64 = 0.52;
/// … for so long is one that thrust cannot right, s: the board rights a vehicle in the air within 0.3 s.
const ASTRAY_S: f64 = 0.4;
/// The height has not fallen if it is less than this below where it was, m: noise of the estimate. Falling flat, where drag
/// carries all, it falls as far in 0.1 s.
const FALLEN_M: f64 = 0.2;
/// Without thrust the wings stand after this time, s: twice their lag …
const STILL_S: f64 = 0.16;
/// … and what is then felt for so long is the answer, s: blows of what comes to rest are shorter.
const ANSWER_S: f64 = 0.08;

/// How it leans, and what carries it.
#[derive(Debug)]
pub(crate) struct Lying {
    /// Specific force in the board's room beyond gravity's, low-passed, m/s²: as long as wings beat, and without.
    pushed_mps2: [Vector3<f64>; 2],
    imu_at: Option<HostTime>,
    /// Axis of the thrust of the setpoint that was sent last, in the board's room.
    asked_E: Vector3<f64>,
    /// How long it has leaned otherwise than it was told, and been carried, s, and where at the begin, m.
    astray_s: f64,
    from_E_m: Vector3<f64>,
    /// How long its thrust has been taken away, s, and how long the floor has answered, or the air: below 0.
    asked_s: Option<f64>,
    answer_s: f64,
    /// So many times longer it must seem to lie, at least once: twice as long after each answer of the air but the first,
    /// which may be one of a vehicle that the floor had tossed.
    patience: f64,
}

impl Default for Lying {
    fn default() -> Self {
        Self {
            pushed_mps2: [Vector3::zeros(); 2],
            imu_at: None,
            asked_E: Vector3::z(),
            astray_s: 0.0,
            from_E_m: Vector3::zeros(),
            asked_s: None,
            answer_s: 0.0,
            patience: 0.5,
        }
    }
}

impl Lying {
    /// An IMU sample, at an attitude of the board.
    pub fn imu(&mut self, sample: &ImuSample, attitude: &Rot<E, B>) {
        let dt_s = self.imu_at.map_or(0.0, |t| sample.valid_at.seconds_since(t));
        // The first sample after a gap stands for nothing.
        let dt_s = if (0.0..GAP_S).contains(&dt_s) { dt_s } else { 0.0 };
        self.imu_at = Some(sample.valid_at);
        let force_E_mps2 = attitude.matrix() * Vector3::from(sample.acc_B_mps2.to_array());
        let now_mps2 = force_E_mps2 + Vector3::new(0.0, 0.0, G_MPS2);
        for (slow_mps2, filter_s) in self.pushed_mps2.iter_mut().zip([FILTER_S, STILL_FILTER_S]) {
            *slow_mps2 += (now_mps2 - *slow_mps2) * (dt_s / (filter_s + dt_s));
        }
    }

    /// A setpoint was sent, in the board's room.
    pub fn asked(&mut self, attitude: &Rot<E, B>) {
        self.asked_E = attitude.matrix().column(2).into();
    }

    /// Whether the floor has answered that it lies there.
    pub fn is_found(&self) -> bool {
        self.answer_s > ANSWER_S
    }

    /// Whether its thrust is taken away, to see what carries it.
    pub fn is_asked(&self) -> bool {
        self.asked_s.is_some()
    }

    /// A step of a flight: the board's attitude, the place, m, whether UWB knows it and whether it is near the floor, and
    /// how much later than usual the vehicle shows what was sent, s.
    fn step(
        &mut self,
        dt_s: f64,
        attitude: &Rot<E, B>,
        pos_E_m: Vector3<f64>,
        [known, near]: [bool; 2],
        late_s: f64,
    ) {
        let [beats, still] = self.pushed_mps2.map(|mps2| mps2.z.abs() < CARRIED_MPS2);
        let axis_E = attitude.matrix().column(2).into_owned();
        let moved_m = pos_E_m - self.from_E_m;
        if self.astray_s == 0.0 || (known && moved_m.xy().norm() > MOVED_M) {
            (self.astray_s, self.from_E_m) = (0.0, pos_E_m);
        }
        // A board that leans less than it was told to stands upright.
        let astray = axis_E.z.max(axis_E.dot(&self.asked_E)) < ASTRAY_RAD.cos();
        // Wings that beat on the floor toss it: what it does most of the time counts.
        let rests = beats && self.pushed_mps2[0].xy().norm() < PUSHED_MPS2;
        let counts_s = if rests && astray { dt_s } else { -dt_s };
        self.astray_s = (self.astray_s + counts_s).max(0.0);
        let stays = near || moved_m.z < FALLEN_M;
        let Some(asked_s) = &mut self.asked_s else {
            if stays && self.astray_s > ASTRAY_S * self.patience.max(1.0) {
                (self.asked_s, self.answer_s) = (Some(0.0), 0.0);
            }
            return;
        };
        *asked_s += dt_s;
        if *asked_s > STILL_S + late_s {
            let s = self.answer_s;
            self.answer_s = if stays && still { s.max(0.0) + dt_s } else { s.min(0.0) - dt_s };
        }
        if self.answer_s < -ANSWER_S {
            (self.astray_s, self.asked_s) = (0.0, None);
            self.patience *= 2.0;
        }
    }
}

impl Navigation {
    /// Follows lean and what carries it.
    pub(crate) fn watch_lying(&mut self, view: &View<'_>, dt_s: f64) {
        let at = view.at;
        let fresh = |t: HostTime| at.seconds_since(t) < ATTITUDE_AGE_S;
        let board = view.board.attitude.filter(|board| fresh(board.received_at));
        let heard = self.lying.imu_at.is_some_and(fresh);
        let pos_E_m = Vector3::from(view.estimate.pos_E_m.to_array());
        let (is, late_s) =
            ([self.is_uwb_fresh(at), self.is_near_floor(view)], self.obeyed_after_s(&view.board));
        let lying = &mut self.lying;
        match board.filter(|_| heard && view.mode.has_thrust()) {
            Some(board) => lying.step(dt_s, &board.attitude, pos_E_m, is, late_s),
            None => {
                let Lying { pushed_mps2, imu_at, .. } = *lying;
                *lying = Lying { pushed_mps2, imu_at, ..Lying::default() };
            }
        }
    }
}
