//! The estimator's start values and its way back: from rest, told, or found anew in the air.

use nalgebra::{UnitQuaternion, Vector3};

use super::bias::Biases;
use super::quality::Qualities;
use super::state::{self, ATT, State};
use super::{Estimator, GAP_S, Pending, align};
use crate::drops::DropReason;
use crate::frames::{B, E, Rot, Vec3};
use crate::survey::Survey;
use crate::time::HostTime;

/// Start values from rest: one sigma of position m, level rad, and of velocity m/s.
const STD_START_POS_M: f64 = 0.5;
const STD_START_LEVEL_RAD: f64 = 0.03;
const STD_START_VEL_MPS: f64 = 0.05;
/// Age of the TDOA a fix in the air uses, s.
pub(super) const FIX_WINDOW_S: f64 = 0.5;
/// Age of the TDOA the first fix uses, s, and how many it takes.
const START_FIX_WINDOW_S: f64 = 1.5;
const START_LEAST_USED: usize = 64;
/// A vehicle that rested this short a time ago is still at the height of its rest, s.
pub(super) const STILL_LOW_S: f64 = 1.0;
/// One sigma of that height, m.
const STD_START_HEIGHT_M: f64 = 0.1;
/// A fix farther outside the box of the anchors is a false minimum, m.
const OUTSIDE_M: f64 = 1.5;
/// One sigma of a fix among anchors that the floor hides, per axis in the plane, m.
const STD_HIDDEN_FIX_M: f64 = 1.5;
/// Start values after a fix in the air: position m, velocity m/s.
const STD_FIX_POS_M: f64 = 0.5;
const STD_FIX_VEL_MPS: f64 = 1.0;
/// Attitude error after a fix, rad, and tilt beyond which level is the better guess, rad.
const STD_FIX_ATT_RAD: f64 = 0.3;
const LARGEST_KEPT_TILT_RAD: f64 = 0.6;
/// Attitude error of a vehicle whose attitude is not estimated, rad: it must not take part.
const NO_ATTITUDE_RAD: f64 = 1e-6;
/// Common biases that are tried for the anchors that the floor hides, m: +3 to +4 m was recorded.
const HIDDEN_M: [f64; 8] = [0.0, 0.5, 1.0, 1.5, 2.0, 2.75, 3.5, 4.25];
/// Attempts at a fix are this far apart, s.
const FIX_INTERVAL_S: f64 = 0.25;

/// Corners of the box that holds all anchors, m.
pub(super) fn hull_E_m(survey: &Survey) -> (Vector3<f64>, Vector3<f64>) {
    let centre_E_m = survey.centre_E_m().raw();
    let places = survey.ids().iter().filter_map(|id| survey.position_E_m(*id));
    places.fold((centre_E_m, centre_E_m), |(low, high), place| {
        (low.inf(&place.raw()), high.sup(&place.raw()))
    })
}

impl Estimator {
    /// Where the vehicle can be.
    #[inline]
    pub(super) fn volume(&self) -> (Vector3<f64>, Vector3<f64>) {
        let (low, high) = self.anchors.hull_E_m;
        (low.add_scalar(-OUTSIDE_M), high.add_scalar(OUTSIDE_M))
    }

    /// Starts at a told pose, at rest.
    pub fn align_at(&mut self, at: HostTime, pos_E_m: Vec3<E>, R_EB: Rot<E, B>) {
        if !pos_E_m.is_finite() {
            self.drops.add(DropReason::BadValue, 1);
            return;
        }
        let std_yaw = self.heading.map_or(STD_START_LEVEL_RAD, |(_, std)| std);
        self.start(at, pos_E_m.raw(), R_EB.raw(), std_yaw);
    }

    pub(super) fn start(
        &mut self,
        at: HostTime,
        x_E: Vector3<f64>,
        q_EB: UnitQuaternion<f64>,
        std_yaw: f64,
    ) {
        let mut state =
            State::at_pose(x_E, q_EB, STD_START_POS_M, STD_START_VEL_MPS, STD_START_LEVEL_RAD);
        // Heading is about the vertical, whose direction in the body is Rᵀ z.
        let down_B = q_EB.inverse_transform_vector(&Vector3::z());
        let extra = std_yaw * std_yaw - STD_START_LEVEL_RAD * STD_START_LEVEL_RAD;
        for i in 0..3 {
            for j in 0..3 {
                state.P[(ATT + i, ATT + j)] += extra.max(0.0) * down_B[i] * down_B[j];
            }
        }
        if self.config.anchor_bias.estimate {
            self.floor.above_at = self.floor.above_at.max(self.at);
        }
        self.isolation.restart();
        let near_floor = !self.airborne || -x_E.z < self.config.anchor_bias.hidden_below_m;
        state.biases = Biases::new(&self.config.anchor_bias, &self.anchors.heights_m, near_floor);
        if self.config.gyro_bias.estimate {
            state.biases.restart_gyro(self.config.gyro_bias.std_radps);
        }
        self.qualities = Qualities::default();
        self.pending = Pending::default();
        self.state = Some(state);
        self.at = self.at.max(at);
        self.doubt.clear();
        self.note_fused(self.at);
    }

    /// Finds the position in the air from the recent TDOA; attitude is kept, velocity unknown.
    /// Says whether it did.
    pub fn realign(&mut self) -> bool {
        let Some(mut state) = self.state.take() else { return false };
        let found = self.locate(FIX_WINDOW_S, None, Some(state.x_E));
        if let Some(fix) = found {
            state.restart_position(fix.x_E, STD_FIX_POS_M.max(fix.median_m));
            let v_B = if state.v_B.norm() < STD_FIX_VEL_MPS { state.v_B } else { Vector3::zeros() };
            state.restart_velocity(v_B, STD_FIX_VEL_MPS);
            // What led the position astray led the tilt astray with it.
            let [roll, pitch, yaw] = Rot::<E, B>::from_raw(state.q_EB).euler_rad();
            if roll.abs().max(pitch.abs()) > LARGEST_KEPT_TILT_RAD {
                state.q_EB = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw);
            }
            state.restart_attitude(STD_FIX_ATT_RAD);
            let left_out = self.isolation.left_out();
            state.biases.restart(
                &self.config.anchor_bias,
                &self.anchors.heights_m,
                false,
                left_out,
            );
            self.qualities = Qualities::default();
            self.isolation.clear();
            self.doubt.clear();
            self.counts.fixes += 1;
        }
        self.state = Some(state);
        found.is_some()
    }

    /// Height at the start as TDOA alone had it, m; `None` where no height was told (`rest_height_m`), and the
    /// estimate itself is that. Far above the told one it says that the survey is wrong, or that the vehicle does not
    /// stand where it was told.
    pub fn start_height_by_uwb_m(&self) -> Option<f64> {
        self.floor.start_height_by_uwb_m
    }

    /// Where the TDOA of the last `window_s` have it at the estimated height, Earth frame, m. A filter that learns range
    /// biases follows the IMU and takes for a bias what contradicts it: whoever asks whether the two agree must ask
    /// this. `None`: no biases are learned and the estimate says it, or too few were heard.
    pub fn pos_by_uwb_E_m(&self, window_s: f64) -> Option<Vec3<E>> {
        let state = self.state.as_ref().filter(|state| state.biases.of_anchors())?;
        let oldest = self.at.offset_us(-((window_s * 1e6) as i64));
        self.recent.near(oldest, state.x_E).map(Vec3::from_raw)
    }

    pub(super) fn locate(
        &self,
        window_s: f64,
        height_m: Option<f64>,
        guess: Option<Vector3<f64>>,
    ) -> Option<align::Fix> {
        let oldest = self.at.offset_us(-((window_s * 1e6) as i64));
        let (low, high) = self.anchors.hull_E_m;
        let centre = (low + high) * 0.5;
        let half = (high - low) * 0.25;
        let mut starts = [centre; 10];
        for (i, start) in starts.iter_mut().take(8).enumerate() {
            let sign = |bit: usize| if i & bit == 0 { -1.0 } else { 1.0 };
            *start += Vector3::new(sign(1) * half.x, sign(2) * half.y, sign(4) * half.z);
        }
        starts[9] = guess.unwrap_or(centre);
        let tried = if height_m.is_some() && self.config.anchor_bias.estimate {
            &HIDDEN_M[..]
        } else {
            &HIDDEN_M[..1]
        };
        self.recent.locate(oldest, &starts, &self.volume(), height_m, tried)
    }

    /// Level comes from rest, position from TDOA; the two need not be known at the same time, a
    /// vehicle may lift off in between.
    pub(super) fn try_align(&mut self, dt_s: f64, rate_B: &Vector3<f64>) {
        let Some((yaw_rad, std_yaw)) = self.heading_to_start() else { return };
        if !self.airborne && self.rest.duration_s() >= self.config.align_s {
            self.level = Some(self.rest.attitude(yaw_rad));
        } else if dt_s > GAP_S {
            self.level = None;
        } else if let Some(level) = &mut self.level {
            *level = state::quat_turn(level, &state::quat_exp(&(rate_B * dt_s)));
        }
        let Some(level) = self.level else { return };
        if !self.fix_is_due() {
            return;
        }
        let stands = self.at.seconds_since(self.floor.rested_at) < STILL_LOW_S;
        let height_m = self.config.rest_height_m.filter(|_| stands);
        let fix = self.locate(START_FIX_WINDOW_S, height_m, None);
        if let Some(fix) = fix.filter(|fix| fix.used >= START_LEAST_USED) {
            let by_uwb = height_m.and_then(|_| self.locate(START_FIX_WINDOW_S, None, None));
            self.floor.start_height_by_uwb_m = by_uwb.map(|fix| -fix.x_E.z);
            self.start(self.at, fix.x_E, level, std_yaw);
            let heights_m = &self.anchors.heights_m;
            let Some(state) = &mut self.state else { return };
            if !stands {
                state.restart_velocity(Vector3::zeros(), STD_FIX_VEL_MPS);
            } else if height_m.is_some() {
                state.P[(2, 2)] = STD_START_HEIGHT_M * STD_START_HEIGHT_M;
                if self.config.anchor_bias.estimate {
                    // The fix knows one common bias of the low anchors, the filter each of them.
                    for i in 0..2 {
                        state.P[(i, i)] = STD_HIDDEN_FIX_M * STD_HIDDEN_FIX_M;
                    }
                }
                state.biases.set_hidden(&self.config.anchor_bias, heights_m, fix.hidden_m);
            }
        }
    }

    /// Without IMU: a position is all it takes.
    pub(super) fn try_start_unaided(&mut self, at: HostTime) {
        self.at = self.at.max(at);
        if !self.fix_is_due() {
            return;
        }
        let height_m = self.config.rest_height_m.filter(|_| !self.airborne);
        let fix = self.locate(START_FIX_WINDOW_S, height_m, None);
        if let Some(fix) = fix.filter(|fix| fix.used >= START_LEAST_USED) {
            self.start(self.at, fix.x_E, UnitQuaternion::identity(), NO_ATTITUDE_RAD);
            let Some(state) = &mut self.state else { return };
            if height_m.is_some() {
                state.P[(2, 2)] = STD_START_HEIGHT_M * STD_START_HEIGHT_M;
                state.biases.set_hidden(
                    &self.config.anchor_bias,
                    &self.anchors.heights_m,
                    fix.hidden_m,
                );
            }
            state.restart_velocity(Vector3::zeros(), STD_FIX_VEL_MPS);
            state.restart_attitude(NO_ATTITUDE_RAD);
        }
    }

    pub(super) fn fix_is_due(&mut self) -> bool {
        let due =
            self.aided.sought_fix_at.is_none_or(|at| self.at.seconds_since(at) >= FIX_INTERVAL_S);
        if due {
            self.aided.sought_fix_at = Some(self.at);
        }
        due
    }
}
