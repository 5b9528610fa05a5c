//! Cold start: neither position nor heading is told, on the floor or in the air.
//!
//! 1. A filter without IMU (`Motion::Unaided`) finds position and velocity from TDOA alone and is what
//!    is shown, with a heading that is said to be unknown.
//! 2. Once the vehicle flies, [`RIVALS`] filters start from there, each with another heading, level
//!    but for [`STD_LEVEL_RAD`]; one half takes the specific force across the thrust axis from the drag model, the
//!    other from the accelerometer, since on one vehicle the one is wrong and on the next the other. Heading
//!    cannot be seen in hover: all rivals then explain the measurements equally well. In motion the wrong ones
//!    predict accelerations to the wrong side, and their innovations grow.
//! 3. Each rival i has the probability `w_i ∝ exp(score_i)`, the best one's heading ψ_b therefore the variance
//!    `Σ w_i ((ψ_i − ψ_b)² + σ_i²)`. Once its root is below [`STD_KNOWN_RAD`] the heading is known with that
//!    sigma, and the best takes over.
//!
//! A rival scores `−½ Σ (ln S + (ν + 1) ln(1 + e²/(ν S)))/n` over its innovations e with variance S:
//! Student-t with ν degrees of freedom, divided by the n samples over which the error of a pair stays.
//! With a heading that is told there is one rival only, which takes over at once: the way back into
//! the air for a companion that was restarted there.

use nalgebra::{UnitQuaternion, Vector3};

use super::Estimator;
use super::config::{EstimatorConfig, Motion, SpecificForce};
use super::state::{ATT, State, VEL};
use crate::estimate::{Estimate, Health};
use crate::frames::{Rot, Vec3};
use crate::measure::{ImuSample, MagSample, Tdoa};
use crate::survey::Survey;
use crate::time::HostTime;
use crate::topics::UwbRecord;

/// Random push along body x and y that a rival allows for, as a share of the usual: with all of it a
/// wrong heading finds excuses.
const RACING_NOISE_FRAC: f64 = 0.25;
/// The race begins above this, m.
const CLEAR_OF_FLOOR_M: f64 = 0.5;
/// What the take-over may leave of an error of level beyond the rival's own sigma, and the least sigma of a heading that
/// was told, rad: judgement.
const STD_WON_RAD: f64 = 0.15;
/// A heading is known that is better than this, one sigma, rad. Chosen on the six recorded flights on which it is
/// judged, none held out: it is found after 13 to 20 s of flight then (docs/ESTIMATOR.md, *Cold starts*).
const STD_KNOWN_RAD: f64 = 0.25;
/// Headings that are tried.
const HEADINGS: usize = 8;
/// Each by the drag model and by the accelerometer.
const RIVALS: usize = 2 * HEADINGS;
/// Time that the position filter runs before the rivals start, s.
const SETTLE_S: f64 = 0.5;
/// Level of a vehicle that flies, one sigma per axis, rad.
const STD_LEVEL_RAD: f64 = 0.15;
/// Start values of the rivals: position m, velocity m/s.
const STD_POS_M: f64 = 0.4;
const STD_VEL_MPS: f64 = 0.5;
/// Least time of the comparison, s.
const LEAST_S: f64 = 1.0;
/// Measurements over which the error of a pair stays: 400 a second, correlated over 0.1 s and more.
const SAMPLES_PER_ERROR: f64 = 40.0;
/// Degrees of freedom of the score.
const FREEDOM: f64 = 3.0;
/// One sigma of a heading of which nothing is known: uniform over the circle, rad.
const STD_UNKNOWN_RAD: f64 = std::f64::consts::PI / 1.732_050_807_568_877_2;

/// What runs until position and heading are known.
#[derive(Debug, Clone)]
pub struct Cold {
    seeker: Estimator,
    rivals: Vec<Estimator>,
    scores: [f64; RIVALS],
    racing: usize,
    sought_since: Option<HostTime>,
    raced_since: Option<HostTime>,
}

impl Cold {
    /// Everything is allocated here.
    pub fn new(config: &EstimatorConfig, survey: &Survey) -> Self {
        let warm = EstimatorConfig { cold_start: false, ..config.clone() };
        let mut racing = warm.clone();
        racing.process.std_acc_xy_mps2_rthz *= RACING_NOISE_FRAC;
        let by = |rival: usize| EstimatorConfig {
            specific_force: match (racing.specific_force, rival < HEADINGS) {
                (own, true) => own,
                (SpecificForce::ThrustAxis, false) => SpecificForce::Accelerometer,
                (SpecificForce::Accelerometer, false) => SpecificForce::ThrustAxis,
            },
            ..racing.clone()
        };
        let seeking = EstimatorConfig { motion: Motion::Unaided, ..warm.clone() };
        Self {
            seeker: Estimator::new(seeking, survey.clone()),
            rivals: (0..RIVALS).map(|i| Estimator::new(by(i), survey.clone())).collect(),
            scores: [0.0; RIVALS],
            racing: 0,
            sought_since: None,
            raced_since: None,
        }
    }

    /// Takes a TDOA; the record is that of the filter which is shown.
    pub fn tdoa(&mut self, tdoa: &Tdoa) -> UwbRecord {
        let record = self.seeker.tdoa(tdoa);
        if self.seeker.is_aligned() {
            self.sought_since.get_or_insert(tdoa.valid_at);
        }
        for (rival, score) in self.rivals.iter_mut().take(self.racing).zip(&mut self.scores) {
            let r = rival.tdoa(tdoa);
            if r.var_innovation_m2 > 0.0 {
                let ratio2 = r.innovation_m * r.innovation_m / r.var_innovation_m2;
                let surprise =
                    r.var_innovation_m2.ln() + (FREEDOM + 1.0) * (1.0 + ratio2 / FREEDOM).ln();
                *score -= 0.5 * surprise / SAMPLES_PER_ERROR;
            }
        }
        record
    }

    /// Takes a magnetic field, for those that race.
    pub fn mag(&mut self, sample: &MagSample) {
        for rival in self.rivals.iter_mut().take(self.racing) {
            rival.mag(sample);
        }
    }

    /// Takes an IMU sample. Says which rival is to take over, if one is, and one sigma of its heading, rad.
    pub fn imu(
        &mut self,
        sample: &ImuSample,
        airborne: bool,
        stands: bool,
        gyro_bias_B: &Vector3<f64>,
        heading: Option<(f64, f64)>,
    ) -> Option<(&Estimator, f64)> {
        for rival in self.rivals.iter_mut().take(self.racing) {
            rival.set_airborne(airborne);
            rival.imu(sample);
        }
        let settled =
            self.sought_since.is_some_and(|since| sample.valid_at.seconds_since(since) > SETTLE_S);
        // What the floor does to the measurements would be charged to the headings.
        let clear = self.seeker.height_m() > CLEAR_OF_FLOOR_M;
        self.seeker.set_airborne(!stands);
        if self.racing == 0 && airborne && settled && clear {
            self.start(sample, gyro_bias_B, heading);
        }
        let (best, std_yaw_rad) = self.winner(sample.valid_at, heading.is_some())?;
        Some((self.rivals.get(best)?, std_yaw_rad))
    }

    fn start(
        &mut self,
        sample: &ImuSample,
        gyro_bias_B: &Vector3<f64>,
        heading: Option<(f64, f64)>,
    ) {
        let Some(found) = self.seeker.state.as_ref() else { return };
        let (x_E, v_E) = (found.x_E, found.v_B);
        self.racing = if heading.is_some() { 1 } else { RIVALS };
        self.scores = [0.0; RIVALS];
        self.raced_since = Some(sample.valid_at);
        for (i, rival) in self.rivals.iter_mut().take(self.racing).enumerate() {
            let spacing = std::f64::consts::TAU / HEADINGS as f64;
            let (yaw_rad, std_yaw) = heading.unwrap_or((i as f64 * spacing, 0.5 * spacing));
            let q_EB = UnitQuaternion::from_euler_angles(0.0, 0.0, yaw_rad);
            rival.reset(gyro_bias_B);
            rival.set_airborne(true);
            rival.imu(sample);
            rival.start(sample.valid_at, x_E, q_EB, std_yaw);
            let Some(state) = &mut rival.state else { continue };
            state.restart_position(x_E, STD_POS_M);
            state.restart_velocity(q_EB.inverse_transform_vector(&v_E), STD_VEL_MPS);
            for k in 0..2 {
                state.P[(ATT + k, ATT + k)] += STD_LEVEL_RAD * STD_LEVEL_RAD;
            }
        }
    }

    /// The best rival and one sigma of its heading, once that is known.
    fn winner(&self, at: HostTime, told: bool) -> Option<(usize, f64)> {
        let since = self.raced_since?;
        if told && self.racing == 1 {
            return Some((0, STD_WON_RAD));
        }
        if at.seconds_since(since) < LEAST_S {
            return None;
        }
        let best = self.best()?;
        let std_yaw_rad = self.std_yaw_rad(best)?;
        (std_yaw_rad < STD_KNOWN_RAD).then_some((best, std_yaw_rad))
    }

    /// One sigma of the best rival's heading, if the truth is one of the rivals.
    fn std_yaw_rad(&self, best: usize) -> Option<f64> {
        let yaw = |i: usize| self.rivals.get(i).map(|r| r.estimate().R_EB.yaw_rad());
        let (leader, top) = (yaw(best)?, self.scores[best]);
        let (mut sum, mut var) = (0.0, 0.0);
        for (i, rival) in self.rivals.iter().enumerate().take(self.racing) {
            let weight = (self.scores[i] - top).exp();
            let std = rival.state.as_ref()?.std3(ATT)[2];
            sum += weight;
            var += weight * (wrapped(yaw(i)? - leader).powi(2) + std * std);
        }
        Some((var / sum).sqrt())
    }

    fn best(&self) -> Option<usize> {
        (0..self.racing).max_by(|a, b| self.scores[*a].total_cmp(&self.scores[*b]))
    }

    /// What is known so far: position and velocity, level if at rest or in the race, no heading.
    pub fn estimate(&self, at: HostTime, rate_B_radps: Vector3<f64>) -> Option<Estimate> {
        let found = self.seeker.state.as_ref()?;
        let base = self.seeker.estimate();
        let R_EB = self
            .best()
            .and_then(|i| self.rivals.get(i)?.state.as_ref())
            .map_or(Rot::identity(), |state| Rot::from_raw(state.q_EB));
        let vel_E: Vec3<crate::frames::E> = Vec3::from_raw(found.v_B);
        let std_vel = found.std3(VEL);
        Some(Estimate {
            at,
            vel_B_mps: R_EB.inverse() * vel_E,
            R_EB,
            rate_B_radps: Vec3::from_raw(rate_B_radps),
            std_vel_B_mps: Vec3::from_array(std_vel),
            std_att_B_rad: Vec3::from_array([STD_LEVEL_RAD, STD_LEVEL_RAD, STD_UNKNOWN_RAD]),
            // To be looked at, not to be flown on: nobody knows which way forward is.
            health: Health::Lost,
            ..base
        })
    }
}

impl Estimator {
    /// Forgets the state and what belongs to it, keeps bias and settings.
    pub(super) fn reset(&mut self, gyro_bias_B: &Vector3<f64>) {
        self.state = None::<State>;
        self.imu.seen = false;
        self.gyro_bias_B = *gyro_bias_B;
        self.doubt.clear();
    }

    /// Takes over what a rival has found, with one sigma of its heading, rad.
    pub(super) fn adopt(&mut self, rival: &Self, std_yaw_rad: f64) {
        self.state.clone_from(&rival.state);
        if let Some(state) = &mut self.state {
            for i in ATT..ATT + 2 {
                state.P[(i, i)] += STD_WON_RAD * STD_WON_RAD;
            }
            let yaw = (ATT + 2, ATT + 2);
            state.P[yaw] = state.P[yaw].max(std_yaw_rad * std_yaw_rad);
        }
        self.qualities = rival.qualities.clone();
        self.pending = rival.pending;
        self.intervals = rival.intervals;
        self.imu.acc_B = rival.imu.acc_B;
        self.imu.rate_B = rival.imu.rate_B;
        self.floor.above_at = rival.floor.above_at;
        self.aided.fused_at = rival.aided.fused_at;
        self.aided.returned_at = rival.aided.returned_at;
        self.doubt.clear();
    }
}

/// Angle in (−π, π].
fn wrapped(angle_rad: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    angle_rad - turn * (angle_rad / turn).round()
}
