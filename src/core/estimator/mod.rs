//! Estimator: the nine-state filter of the source, fed with decoded measurements.
//!
//! Position in `E`, velocity in `B`, attitude error in `B` (`state.rs`). The IMU drives the
//! prediction (`predict.rs`); every other sensor is an aid, a file that returns an innovation, its
//! Jacobian and its variance; `update.rs` alone touches P. No I/O, no clock, no random number, no
//! allocation after construction.

mod align;
mod aligning;
mod anchor_check;
mod anchors;
mod bias;
mod bias_level;
mod board_vertical;
mod cold;
mod config;
mod error_state;
mod fusing;
mod gate;
mod gyro_bias;
mod height;
mod isolation;
mod magnetometer;
mod misgiving;
mod noise;
mod predict;
mod quality;
mod reference;
mod slow_force;
mod state;
mod tdoa;
mod update;
mod zero_velocity;

#[cfg(test)]
mod anchor_check_tests;
#[cfg(test)]
mod bias_tests;
#[cfg(test)]
mod filter_tests;
#[cfg(test)]
mod isolation_tests;
#[cfg(test)]
mod jacobian_tests;
#[cfg(test)]
mod magnetometer_tests;
#[cfg(test)]
mod robust_tests;
#[cfg(test)]
mod truth;

use nalgebra::{Matrix3, UnitQuaternion, Vector3};

use crate::drops::{DropReason, Drops};
use crate::estimate::{Estimate, Health};
use crate::frames::{B, G_MPS2, Rot, Vec3};
use crate::measure::{AnchorId, ImuSample};
use crate::survey::Survey;
use crate::time::HostTime;

pub use align::{FORCE_MOST_SHARE, FORCE_TOLD_SHARE, LARGEST_BIAS_RADPS, STANDING_S, Standing};
use align::{Recent, RestAverage};
pub use anchor_check::{AnchorCheck, AnchorFit, MOST_HIDDEN_M};
use anchors::Anchors;
pub use bias::MOST_ANCHORS;
use bias::Wander;
use bias_level::BiasLevel;
use cold::Cold;
pub use config::{
    AnchorBias, BaroConfig, BoardVerticalConfig, EstimatorConfig, GateConfig, GyroBias,
    Isolation as IsolationConfig, MagnetometerConfig, Motion, ProcessNoise, Quality, SpecificForce,
    Tail, Unaided, UwbNoise,
};
use gate::Doubt;
use height::BaroZero;
pub use height::{standard_height_m, standard_pressure_pa};
use isolation::Isolation;
use magnetometer::Compass;
pub use magnetometer::Field as MagneticField;
pub use misgiving::Misgiving;
use predict::{Force, Growth};
use quality::Qualities;
use slow_force::SlowForce;
use state::{ATT, POS, State, VEL};

/// Longest step that is predicted in one piece, s: the Jacobian is of first order in it.
const LONGEST_STEP_S: f64 = 0.02;
/// Longest gap in the IMU that is bridged with the last sample, s; beyond it the uncertainty of a
/// gap of this length stands.
const LONGEST_GAP_S: f64 = 1.0;
/// A gap in the IMU beyond this adds unknown acceleration, s.
const GAP_S: f64 = 0.1;
/// After a gap beyond this the velocity is not the one before it, s: a board whose companion was silent for so long
/// sinks by itself and may have been stopped by the floor, so that how far it came says nothing of how fast it is.
const FORGET_GAP_S: f64 = 0.5;
/// One sigma of the velocity after such a gap, m/s: of a board that sinks by itself.
const STD_VEL_FORGOTTEN_MPS: f64 = 1.5;
/// Acceleration that may have happened in a gap, m/s²/√Hz.
const STD_ACC_GAP_MPS2_RTHZ: f64 = 4.0;
/// Largest specific force an IMU of this class reports, m/s² (16 g and some).
const LARGEST_ACC_MPS2: f64 = 200.0;
/// Largest rate it reports, rad/s (2000 deg/s and some).
const LARGEST_RATE_RADPS: f64 = 40.0;
/// Interval of an anchor before it has been heard twice, s (50 Hz).
const FIRST_INTERVAL_S: f64 = 0.02;
/// What taking off may change of the UWB errors, m: multipath near the floor shifts a pair by
/// 0.2 to 0.5 m.
const STD_TAKE_OFF_M: f64 = 0.2;
/// Growth while resting: m/s²/√Hz and rad/s/√Hz.
const STD_ACC_REST_MPS2_RTHZ: f64 = 0.2;
const STD_RATE_REST_RADPS_RTHZ: f64 = 0.005;

/// When more than this share of the anchors …
const SUSPECT_SHARE: f64 = 0.5;
/// … have learned that one sigma of what they say is beyond this, m, it is the filter that is wrong: chosen, three
/// times the 0.2 m that were once reckoned with on the recorded flights.
const SUSPECT_STD_M: f64 = 0.6;

/// Counters of the estimator.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// IMU samples predicted with.
    pub predicted: u64,
    /// TDOA fused.
    pub tdoa_fused: u64,
    /// TDOA rejected by the gate.
    pub tdoa_gated: u64,
    /// Magnetic fields fused.
    pub mag_fused: u64,
    /// Times the filter doubted itself and did something about it.
    pub remedies: u64,
    /// Positions found anew in the air.
    pub fixes: u64,
    /// Anchors left out in flight because they did not fit.
    pub left_out: u64,
}

/// Steps that the state has made and the covariance not yet.
#[derive(Debug, Clone, Copy, Default)]
struct Pending {
    dt_s: f64,
    /// Readings times their steps.
    acc_B: Vector3<f64>,
    rate_B: Vector3<f64>,
}

/// When the vehicle was on the floor, or near it.
#[derive(Debug, Clone, Copy, Default)]
struct Floor {
    /// When its IMU was last heard while it was not said to fly.
    rested_at: HostTime,
    /// When it last had rested long enough to be sure of it.
    stood_at: Option<HostTime>,
    /// When the floor last was taken to hide anchors.
    hidden_at: HostTime,
    /// When its estimate was last high enough above the floor for no anchor to be hidden.
    above_at: HostTime,
    /// Height at the start as TDOA alone had it, where a known height was taken, m.
    start_height_by_uwb_m: Option<f64>,
}

/// The last sample of the IMU, as it was used.
#[derive(Debug, Clone, Copy, Default)]
struct Imu {
    seen: bool,
    acc_B: Vector3<f64>,
    rate_B: Vector3<f64>,
}

/// When each aid of the prediction was last taken.
#[derive(Debug, Clone, Copy, Default)]
struct Aided {
    fused_at: Option<HostTime>,
    /// When something was fused again in the air after a loss.
    returned_at: Option<HostTime>,
    sought_fix_at: Option<HostTime>,
    zero_velocity_at: Option<HostTime>,
    baro_at: Option<HostTime>,
    board_vertical_at: Option<HostTime>,
}

/// The estimator.
#[derive(Debug, Clone)]
pub struct Estimator {
    config: EstimatorConfig,
    anchors: Anchors,
    state: Option<State>,
    at: HostTime,
    airborne: bool,
    heading: Option<(f64, f64)>,
    rest: RestAverage,
    standing: Standing,
    /// What the specific force is multiplied with, as the last rest had it.
    force_gain: f64,
    /// Attitude from rest, carried on by the gyroscope until there is a position to start with.
    level: Option<UnitQuaternion<f64>>,
    floor: Floor,
    gyro_bias_B: Vector3<f64>,
    slow_force: SlowForce,
    qualities: Qualities,
    bias_level: BiasLevel,
    isolation: Isolation,
    /// Steps whose covariance waits to be predicted.
    pending: Pending,
    /// Until position and heading are known, if they are not told.
    cold: Option<Box<Cold>>,
    imu: Imu,
    recent: Recent,
    doubt: Doubt,
    intervals: [(HostTime, f64); 256],
    baro_zero: BaroZero,
    compass: Compass,
    aided: Aided,
    counts: Counts,
    drops: Drops,
}

impl Estimator {
    /// Not aligned, standing.
    pub fn new(config: EstimatorConfig, survey: Survey) -> Self {
        // Without IMU nothing tells whether it stands.
        let airborne = config.motion == Motion::Unaided;
        let cold = config.cold_start.then(|| Box::new(Cold::new(&config, &survey)));
        Self {
            cold,
            slow_force: SlowForce::default(),
            qualities: Qualities::default(),
            bias_level: BiasLevel::default(),
            isolation: Isolation::default(),
            pending: Pending::default(),
            anchors: Anchors::new(&config, survey),
            config,
            state: None,
            at: HostTime::default(),
            airborne,
            heading: None,
            rest: RestAverage::default(),
            standing: Standing::default(),
            force_gain: 1.0,
            level: None,
            floor: Floor::default(),
            gyro_bias_B: Vector3::zeros(),
            imu: Imu::default(),
            recent: Recent::default(),
            doubt: Doubt::default(),
            intervals: [(HostTime::default(), FIRST_INTERVAL_S); 256],
            baro_zero: BaroZero::default(),
            compass: Compass::default(),
            aided: Aided::default(),
            counts: Counts::default(),
            drops: Drops::default(),
        }
    }

    /// Whether the vehicle flies. Standing: full accelerometer, zero velocity, gyroscope bias.
    pub fn set_airborne(&mut self, airborne: bool) {
        if airborne && !self.airborne {
            self.rest.clear();
            if let Some(state) = &mut self.state
                && !state.biases.of_anchors()
            {
                for i in POS..POS + 3 {
                    state.P[(i, i)] += STD_TAKE_OFF_M * STD_TAKE_OFF_M;
                }
            }
        }
        if !airborne && self.airborne {
            // In flight nobody hears it again any more; before the next one the check on the floor judges.
            self.isolation.restart();
            self.slow_force.rest();
        }
        self.airborne = airborne;
    }

    /// How long the IMU has rested, s, while the vehicle is not said to fly.
    pub fn rested_s(&self) -> f64 {
        self.rest.duration_s()
    }

    /// What the IMU reads while the vehicle stands, or read when it last did; `None`: it did not for long enough yet.
    pub fn standing(&self) -> Option<&Standing> {
        Some(&self.standing).filter(|standing| standing.is_known())
    }

    /// A sample whose specific force is gravity's where the vehicle rests: an accelerometer of a few percent too much or
    /// too little is used so.
    pub fn weighed(&self, sample: &ImuSample) -> ImuSample {
        ImuSample { acc_B_mps2: sample.acc_B_mps2 * self.force_gain, ..*sample }
    }

    /// Heading at the start, which rest cannot show: without it there is no start from rest.
    pub fn set_initial_heading(&mut self, yaw_rad: f64, std_rad: f64) {
        if yaw_rad.is_finite() && std_rad.is_finite() && std_rad > 0.0 {
            self.heading = Some((yaw_rad, std_rad));
        } else {
            self.drops.add(DropReason::BadValue, 1);
        }
    }

    /// Takes an IMU sample and predicts to it.
    pub fn imu(&mut self, sample: &ImuSample) {
        let read_acc_B = sample.acc_B_mps2.raw();
        let rate_B = sample.rate_B_radps.raw();
        let plausible = sample.acc_B_mps2.is_finite()
            && sample.rate_B_radps.is_finite()
            && read_acc_B.amax() < LARGEST_ACC_MPS2
            && rate_B.amax() < LARGEST_RATE_RADPS;
        if !plausible {
            self.drops.add(DropReason::BadValue, 1);
            return;
        }
        let dt_s = sample.valid_at.seconds_since(self.at);
        if self.imu.seen && dt_s <= 0.0 {
            self.drops.add(DropReason::ImuOutOfOrder, 1);
            return;
        }
        let first = !self.imu.seen;
        self.imu.seen = true;
        self.at = sample.valid_at.max(self.at);
        if !self.airborne {
            self.rest.add(sample.valid_at, &read_acc_B, &rate_B);
            // The first sample, and one after a gap, stand for no time.
            let dt_s = if (0.0..GAP_S).contains(&dt_s) { dt_s } else { 0.0 };
            self.standing.add(dt_s, sample.acc_B_mps2, sample.rate_B_radps);
            self.floor.rested_at = self.at;
            if self.rest.duration_s() >= self.config.align_s {
                self.floor.stood_at = Some(self.at);
                self.force_gain = self.rest.force_gain();
                self.gyro_bias_B = self.rest.rate_B();
                let gyro = self.config.gyro_bias;
                if let Some(state) = self.state.as_mut().filter(|_| gyro.estimate) {
                    state.biases.restart_gyro(gyro.std_radps);
                }
            }
        }
        let sample = &self.weighed(sample);
        let acc_B = sample.acc_B_mps2.raw();
        let learned_B = self.state.as_ref().map(|s| s.biases.gyro_B_radps()).unwrap_or_default();
        let unbiased_B = rate_B - self.gyro_bias_B - learned_B;
        if first {
            self.imu.acc_B = acc_B;
            self.imu.rate_B = unbiased_B;
            return;
        }
        let mean_rate_B = (self.imu.rate_B + unbiased_B) * 0.5;
        let weight = dt_s / (self.config.acc_average_s + dt_s);
        self.imu.acc_B += (acc_B - self.imu.acc_B) * weight;
        self.imu.rate_B = unbiased_B;
        match self.state {
            Some(_) => self.predict(dt_s, mean_rate_B),
            None => self.try_align(dt_s, &mean_rate_B),
        }
        if self.state.is_none() {
            self.start_cold(sample);
        }
        if !self.airborne {
            self.standing_aids();
        }
    }

    fn start_cold(&mut self, sample: &ImuSample) {
        let Some(mut cold) = self.cold.take() else { return };
        let stands =
            self.floor.stood_at.is_some_and(|at| self.at.seconds_since(at) < aligning::STILL_LOW_S);
        let heading = self.heading_to_start();
        let winner = cold.imu(sample, self.airborne, stands, &self.gyro_bias_B, heading);
        match winner {
            // It has done its work: what is lost later is found by `realign`.
            Some((winner, std_yaw_rad)) => self.adopt(winner, std_yaw_rad),
            None => self.cold = Some(cold),
        }
    }

    fn predict(&mut self, dt_s: f64, rate_B: Vector3<f64>) {
        let forgets = self.airborne && dt_s > FORGET_GAP_S;
        // Nor did it turn or push all the while as in the last moment: it stays, and may be elsewhere.
        let (acc_B, rate_B) = if forgets {
            (Vector3::new(0.0, 0.0, -G_MPS2), Vector3::zeros())
        } else {
            (self.imu.acc_B, rate_B)
        };
        let hidden_std_m = self.note_hidden();
        let Some(state) = &mut self.state else { return };
        if forgets {
            state.v_B = Vector3::zeros();
        }
        let c = &self.config;
        let mut force = match (self.airborne, c.specific_force) {
            (false, _) | (_, SpecificForce::Accelerometer) => Force::Measured,
            (true, SpecificForce::ThrustAxis) => Force::ThrustAxis {
                k_per_s: if c.drag { [c.drag_per_s[0], c.drag_per_s[1]] } else { [0.0; 2] },
                cop_z_m: c.cop_z_m,
                beyond_B_mps2: [0.0; 2],
            },
        };
        if let Some(drag_B_mps2) = force.drag_B_mps2(&state.v_B, &rate_B)
            && let Force::ThrustAxis { beyond_B_mps2, .. } = &mut force
            && c.slow_force_s > 0.0
        {
            let time_s = c.slow_force_s;
            *beyond_B_mps2 = self.slow_force.follow(dt_s, time_s, &acc_B, drag_B_mps2);
        }
        let p = &c.process;
        let (acc_xy, acc_z, rate) = match (self.airborne, dt_s > GAP_S) {
            (_, true) => {
                (STD_ACC_GAP_MPS2_RTHZ, STD_ACC_GAP_MPS2_RTHZ, 10.0 * p.std_rate_radps_rthz)
            }
            (false, _) => {
                (STD_ACC_REST_MPS2_RTHZ, STD_ACC_REST_MPS2_RTHZ, STD_RATE_REST_RADPS_RTHZ)
            }
            (true, _) => (p.std_acc_xy_mps2_rthz, p.std_acc_z_mps2_rthz, p.std_rate_radps_rthz),
        };
        let growth = Growth {
            pos: p.std_pos_m_rts * p.std_pos_m_rts,
            vel: [acc_xy * acc_xy, acc_xy * acc_xy, acc_z * acc_z],
            att: rate * rate,
        };
        let dt_s = dt_s.min(LONGEST_GAP_S);
        let pieces = (dt_s / LONGEST_STEP_S).ceil().max(1.0);
        if c.covariance_step_s == 0.0 && state.biases.is_empty() {
            for _ in 0..pieces as u32 {
                predict::predict(state, dt_s / pieces, &acc_B, &rate_B, force, &growth);
            }
        } else {
            for _ in 0..pieces as u32 {
                let dt_s = dt_s / pieces;
                predict::propagate_nominal(state, dt_s, &acc_B, &rate_B, force);
                let p = &mut self.pending;
                p.dt_s += dt_s;
                p.acc_B += acc_B * dt_s;
                p.rate_B += rate_B * dt_s;
                if p.dt_s >= c.covariance_step_s {
                    let (acc_B, rate_B) = (p.acc_B / p.dt_s, p.rate_B / p.dt_s);
                    let F = predict::linearise(state, p.dt_s, &acc_B, &rate_B, force);
                    let levels = self.bias_level.factors();
                    let step = Wander {
                        dt_s: p.dt_s,
                        speed_mps: state.v_B.norm(),
                        hidden_std_m,
                        anchors_m: &self.anchors.heights_m,
                        factors: self.qualities.factors(),
                        levels: &levels,
                        left_out: self.isolation.left_out(),
                    };
                    state.biases.propagate(&F, &c.anchor_bias, &step);
                    self.bias_level.learn(&state.biases, &c.anchor_bias, &step);
                    predict::propagate_covariance(&mut state.P, &F, step.dt_s, &growth);
                    let walk = c.gyro_bias.walk_radps_rts;
                    state.biases.turn_by_gyro(&mut state.P, step.dt_s, walk);
                    *p = Pending::default();
                }
            }
        }
        if forgets {
            state.restart_velocity(Vector3::zeros(), STD_VEL_FORGOTTEN_MPS);
        }
        self.counts.predicted += 1;
        if !state.is_sane() {
            // Cannot happen with the checks above; if it does, start again rather than fly on it.
            self.state = None;
            self.rest.clear();
        }
    }

    /// Carries a state without IMU to a measurement's time.
    fn coast(&mut self, to: HostTime) {
        let hidden_std_m = self.note_hidden();
        let Some(state) = &mut self.state else { return };
        let dt_s = to.seconds_since(self.at).min(LONGEST_GAP_S);
        if dt_s <= 0.0 {
            return;
        }
        self.at = to;
        let c = &self.config;
        let acc = c.unaided.std_acc_mps2_rthz;
        let F = predict::coast(state, dt_s, c.unaided.decay_per_s);
        let growth = Growth {
            pos: c.process.std_pos_m_rts * c.process.std_pos_m_rts,
            vel: [acc * acc; 3],
            att: 0.0,
        };
        let levels = self.bias_level.factors();
        let step = Wander {
            dt_s,
            speed_mps: state.v_B.norm(),
            hidden_std_m,
            anchors_m: &self.anchors.heights_m,
            factors: self.qualities.factors(),
            levels: &levels,
            left_out: self.isolation.left_out(),
        };
        state.biases.propagate(&F, &c.anchor_bias, &step);
        self.bias_level.learn(&state.biases, &c.anchor_bias, &step);
        predict::propagate_covariance(&mut state.P, &F, dt_s, &growth);
        self.counts.predicted += 1;
        if !state.is_sane() {
            self.state = None;
        }
    }

    /// The state as everyone else sees it, at the time of the newest IMU sample.
    pub fn estimate(&self) -> Estimate {
        self.estimate_at(self.at)
    }

    /// The same with health as it is at `now`: without IMU only the reader's clock tells that
    /// measurements are missing.
    pub fn estimate_at(&self, now: HostTime) -> Estimate {
        let Some(state) = &self.state else {
            let cold = self.cold.as_ref();
            if let Some(estimate) = cold.and_then(|cold| cold.estimate(self.at, self.imu.rate_B)) {
                return estimate;
            }
            return Estimate {
                at: self.at,
                pos_E_m: Vec3::zero(),
                vel_B_mps: Vec3::zero(),
                R_EB: Rot::identity(),
                rate_B_radps: Vec3::from_raw(self.imu.rate_B),
                std_pos_E_m: Vec3::zero(),
                std_vel_B_mps: Vec3::zero(),
                std_att_B_rad: Vec3::zero(),
                uwb_noise_factor: 1.0,
                health: Health::NotAligned,
            };
        };
        Estimate {
            at: self.at,
            pos_E_m: Vec3::from_raw(state.x_E),
            vel_B_mps: Vec3::from_raw(state.v_B),
            R_EB: Rot::from_raw(state.q_EB),
            rate_B_radps: Vec3::from_raw(self.imu.rate_B),
            std_pos_E_m: Vec3::from_array(state.std3(POS)),
            std_vel_B_mps: Vec3::from_array(state.std3(VEL)),
            std_att_B_rad: Vec3::from_array(state.std3(ATT)),
            uwb_noise_factor: noise::height_factor(self.config.uwb_noise, -state.x_E.z),
            health: self.health(state, now.max(self.at)),
        }
    }

    /// Whether the anchor at this place in the survey is left out because it does not fit.
    pub fn is_left_out(&self, rank: usize) -> bool {
        self.isolation.is_out(rank)
    }

    /// The same of all: bit n is the n-th of the survey.
    pub fn left_out_bits(&self) -> u16 {
        let out = self.isolation.left_out().iter().enumerate();
        out.fold(0, |bits, (rank, out)| bits | u16::from(*out) << rank)
    }

    /// Anchors that are left out because they do not fit (`isolation.rs`).
    pub fn left_out(&self) -> impl Iterator<Item = AnchorId> {
        let ids = self.anchors.survey.ids().iter().enumerate();
        ids.filter(|(rank, _)| self.isolation.is_out(*rank)).map(|(_, id)| *id)
    }

    /// Height above the origin's level, m; 0 before alignment.
    pub fn height_m(&self) -> f64 {
        self.state.as_ref().map_or(0.0, |state| -state.x_E.z)
    }

    /// Covariance of the position, Earth frame, m², once there are start values.
    pub fn cov_pos_E_m2(&self) -> Option<Matrix3<f64>> {
        self.state.as_ref().map(|state| state.P.fixed_view::<3, 3>(POS, POS).into_owned())
    }

    /// Whether it has start values.
    pub fn is_aligned(&self) -> bool {
        self.state.is_some()
    }

    /// Whether there is a position, be it without a heading.
    pub fn is_located(&self) -> bool {
        self.state.is_some() || self.estimate().health != Health::NotAligned
    }

    /// Age of the newest fused TDOA at the time of the state, s.
    pub fn uwb_age_s(&self) -> Option<f64> {
        self.aided.fused_at.map(|at| self.at.seconds_since(at))
    }

    /// Bias of the gyroscope, rad/s.
    pub fn gyro_bias_B_radps(&self) -> Vec3<B> {
        Vec3::from_raw(self.gyro_bias_B)
    }

    /// Range bias of an anchor and its sigma, m, while it is estimated.
    pub fn anchor_bias_m(&self, id: AnchorId) -> Option<(f64, f64)> {
        self.anchors.survey.position_E_m(id)?;
        self.state.as_ref()?.biases.of(self.anchors.rank(id))
    }

    /// Factor on the variance of an anchor, as learned; 1 if none is.
    pub fn anchor_factor(&self, id: AnchorId) -> f64 {
        self.qualities.of(self.anchors.rank(id))
    }

    /// What was counted.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// What was thrown away.
    pub fn drops(&self) -> &Drops {
        &self.drops
    }
}
