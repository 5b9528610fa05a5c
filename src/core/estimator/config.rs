//! Settings of the estimator: every number with unit and origin, checked on load.

use serde::{Deserialize, Serialize};

use crate::checks::Problems;

/// Where the prediction takes the specific force from while airborne.
///
/// Drag is never counted twice: `Accelerometer` measures it on all axes and so uses no drag model;
/// `ThrustAxis` measures it on z and models it on x and y only.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpecificForce {
    /// Only body z is measured; x and y come from the drag model, or are zero without it.
    /// Accelerometer x and y of this vehicle are flapping vibration (std 0.56 and 1.76 g).
    ThrustAxis,
    /// All three axes are measured.
    Accelerometer,
}

/// How the variance of a TDOA depends on height.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum UwbNoise {
    /// The same everywhere.
    Constant,
    /// `λ(z)·σ²`, the source's variable noise.
    HeightDependent,
}

/// What a large innovation does to the weight of a measurement inside the gate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Tail {
    /// Nothing: errors are taken as normal.
    Gaussian,
    /// Influence grows up to `tail_sigma` and then stays constant.
    Huber,
    /// Influence grows, then falls again: errors are Student-t with `tail_sigma²` degrees of
    /// freedom.
    StudentT,
}

/// The gate of the TDOA aid and its way back from being wrong.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GateConfig {
    /// Innovations beyond this many sigma are rejected.
    pub sigma: f64,
    /// Weighting inside the gate.
    pub tail: Tail,
    /// Where the tail begins, sigma.
    pub tail_sigma: f64,
    /// Share of recent measurements beyond the gate at which the filter doubts itself.
    pub doubt_frac: f64,
    /// Whether it then opens up and, failing that, finds its position anew.
    pub recover: bool,
    /// Whether what is beyond the gate is thrown away. If not, it is fused with the weight that the
    /// tail leaves it, and only counted as beyond.
    pub reject: bool,
}

impl Default for GateConfig {
    fn default() -> Self {
        Self {
            sigma: 5.0,
            tail: Tail::StudentT,
            tail_sigma: 2.0,
            doubt_frac: 0.5,
            recover: true,
            reject: true,
        }
    }
}

/// Process noise, as densities: one sigma of the error that has grown after one second is the
/// number itself (random walk).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ProcessNoise {
    /// Specific force along body x and y in flight, m/s²/√Hz: error of the drag model, or of the
    /// accelerometer where it is used.
    pub std_acc_xy_mps2_rthz: f64,
    /// Specific force along body z, m/s²/√Hz: flapping of 0.79 g rms sampled at 100 Hz aliases to
    /// 0.77.
    pub std_acc_z_mps2_rthz: f64,
    /// Angular rate, rad/s/√Hz.
    pub std_rate_radps_rthz: f64,
    /// Position, m/√s: what the other terms do not cover.
    pub std_pos_m_rts: f64,
}

impl Default for ProcessNoise {
    fn default() -> Self {
        Self {
            std_acc_xy_mps2_rthz: 1.0,
            std_acc_z_mps2_rthz: 0.8,
            std_rate_radps_rthz: 0.02,
            std_pos_m_rts: 0.01,
        }
    }
}

/// Height from air pressure.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BaroConfig {
    /// Whether it is fused.
    pub fuse: bool,
    /// One sigma of a height, m. Wash of the wings and slow weather are in it.
    pub std_m: f64,
    /// Time over which that error stays the same, s.
    pub correlation_s: f64,
}

impl Default for BaroConfig {
    fn default() -> Self {
        Self { fuse: true, std_m: 0.5, correlation_s: 5.0 }
    }
}

/// The board's vertical (`board_vertical.rs`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BoardVerticalConfig {
    /// Whether it is fused in flight.
    pub fuse: bool,
    /// One sigma of it, deg: alignment, the board's filter under acceleration.
    pub std_deg: f64,
    /// Time over which that error stays the same, s.
    pub correlation_s: f64,
}

impl Default for BoardVerticalConfig {
    fn default() -> Self {
        Self { fuse: true, std_deg: 3.0, correlation_s: 2.0 }
    }
}

/// Heading from the magnetic field (`magnetometer.rs`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MagnetometerConfig {
    /// Whether it tells the heading at the start and is fused in flight.
    pub fuse: bool,
    /// Magnetic north from room north, positive clockwise seen from above, deg.
    pub north_deg: f64,
    /// Strength of the field in the room, µT.
    pub strength_ut: f64,
    /// How far it points below the horizontal, deg; negative on the southern half of the Earth.
    pub dip_deg: f64,
    /// One sigma of a heading from an undisturbed field, deg: calibration, motors, what strength and dip
    /// do not show.
    pub std_deg: f64,
    /// Time over which that error stays the same, s.
    pub correlation_s: f64,
    /// A field is not used when it is this far from strength and dip, as a share of the strength.
    pub most_disturbance_frac: f64,
}

impl Default for MagnetometerConfig {
    fn default() -> Self {
        Self {
            fuse: false,
            north_deg: 0.0,
            strength_ut: 49.0,
            dip_deg: 66.0,
            std_deg: 8.0,
            correlation_s: 5.0,
            most_disturbance_frac: 0.15,
        }
    }
}

/// What drives the prediction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// The IMU.
    Inertial,
    /// Nothing: positions alone, from TDOA alone. Attitude is not estimated.
    Unaided,
}

/// How a vehicle without IMU moves: a velocity that is pushed at random and decays.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Unaided {
    /// Random push, m/s²/√Hz.
    pub std_acc_mps2_rthz: f64,
    /// Decay of the velocity, 1/s. With the push it bounds the speed that is expected: one sigma is
    /// push / √(2 decay).
    pub decay_per_s: f64,
}

impl Default for Unaided {
    fn default() -> Self {
        Self { std_acc_mps2_rthz: 0.45, decay_per_s: 0.5 }
    }
}

/// Range bias of each anchor as a state (`bias.rs`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AnchorBias {
    /// Whether biases are estimated. Without: the nine states alone.
    pub estimate: bool,
    /// One sigma of the part that wanders, m.
    pub std_m: f64,
    /// Time over which it stays, s.
    pub correlation_s: f64,
    /// Distance flown over which it stays, m.
    pub correlation_m: f64,
    /// Time in which it is learned how much each wanders (`bias_level.rs`), s; 0: as much as `std_m` says.
    pub level_s: f64,
    /// One sigma of the part that stays, m.
    pub constant_std_m: f64,
    /// One sigma of the bias of an anchor that the floor hides, m.
    pub hidden_std_m: f64,
    /// Time over which that stays, s.
    pub hidden_s: f64,
    /// The floor hides anchors from a tag below this, m.
    pub hidden_below_m: f64,
    /// It hides those that hang below this, m.
    pub low_anchor_m: f64,
}

impl Default for AnchorBias {
    fn default() -> Self {
        Self {
            estimate: false,
            std_m: 0.2,
            correlation_s: 8.0,
            correlation_m: 0.6,
            level_s: 0.0,
            constant_std_m: 0.1,
            hidden_std_m: 2.5,
            hidden_s: 0.5,
            hidden_below_m: 0.5,
            low_anchor_m: 0.6,
        }
    }
}

/// Leaving out an anchor that does not fit in flight (`isolation.rs`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Isolation {
    /// Whether anchors are left out.
    pub leave_out: bool,
    /// Time over which residuals are remembered, s.
    pub memory_s: f64,
    /// One sigma of the range bias of an anchor that is sound, m.
    pub std_bias_m: f64,
    /// Doubt, in units of what is usual, from which an anchor is suspected: twice that of the check on the
    /// floor, chosen beforehand …
    pub doubt: f64,
    /// … when the others without it stay below this: chosen after a look at recorded flights behind metal.
    pub others_doubt: f64,
    /// Least range error that is worth it, m.
    pub least_m: f64,
    /// Time for which the suspicion must last, s.
    pub confirm_s: f64,
    /// Time for which one that is left out must fit before it is taken back, s.
    pub return_s: f64,
}

impl Default for Isolation {
    fn default() -> Self {
        Self {
            leave_out: false,
            memory_s: 1.0,
            std_bias_m: 0.3,
            doubt: 4.0,
            others_doubt: 2.0,
            least_m: 0.6,
            confirm_s: 0.3,
            return_s: 2.0,
        }
    }
}

/// Bias of the gyroscope in flight (`gyro_bias.rs`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GyroBias {
    /// Whether it is estimated.
    pub estimate: bool,
    /// One sigma of what it has changed since the rest, rad/s.
    pub std_radps: f64,
    /// Its walk, rad/s/√s.
    pub walk_radps_rts: f64,
}

impl Default for GyroBias {
    /// Off. The sigma is the change that docs/ESTIMATOR_SIM.md tries; the walk, which was chosen, makes as much of it
    /// in a quarter of an hour.
    fn default() -> Self {
        Self { estimate: false, std_radps: 0.01, walk_radps_rts: 3e-4 }
    }
}

/// Quality of each anchor, learned in flight (`quality.rs`).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Quality {
    /// Whether it is learned.
    pub learn: bool,
    /// Time of learning, s.
    pub time_s: f64,
    /// Least factor on the variance.
    pub least: f64,
    /// Largest factor.
    pub most: f64,
}

impl Default for Quality {
    fn default() -> Self {
        Self { learn: false, time_s: 0.8, least: 0.5, most: 100.0 }
    }
}

/// Settings of the estimator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EstimatorConfig {
    /// What drives the prediction.
    pub motion: Motion,
    /// Motion without IMU.
    pub unaided: Unaided,
    /// Whether position and heading are found by motion when nobody tells them (`cold.rs`); without,
    /// a start needs rest and a heading.
    pub cold_start: bool,
    /// The covariance is predicted in steps of at least this, s; 0: with each IMU sample. The state
    /// itself follows each sample.
    pub covariance_step_s: f64,
    /// Range bias of each anchor.
    pub anchor_bias: AnchorBias,
    /// Bias of the gyroscope.
    pub gyro_bias: GyroBias,
    /// Quality of each anchor.
    pub quality: Quality,
    /// Leaving out anchors that do not fit.
    pub isolation: Isolation,
    /// Where the specific force comes from in flight.
    pub specific_force: SpecificForce,
    /// Whether the drag model is used (with `thrust_axis` only).
    pub drag: bool,
    /// Drag along body x, y, z over mass, 1/s (crazyflie-firmware for this vehicle). The z entry
    /// completes the vehicle's record and enters no equation here: the accelerometer measures it.
    pub drag_per_s: [f64; 3],
    /// Centre of pressure above the centre of mass, m (crazyflie-firmware).
    pub cop_z_m: f64,
    /// Window over which the accelerometer is low-passed (time constant), s; 0 is off. It takes
    /// the edge off a beat of 13 Hz (factor 0.6 at the default) at the price of as much lag.
    pub acc_average_s: f64,
    /// Time from which on a force along body x and y counts that the drag model leaves out, such as wind, as the
    /// accelerometer shows it, s; 0 is off (`slow_force.rs`). With `thrust_axis` only.
    pub slow_force_s: f64,
    /// How the UWB variance depends on height.
    pub uwb_noise: UwbNoise,
    /// One sigma of a TDOA near the floor (λ = 1), m.
    pub std_uwb_m: f64,
    /// Time over which the error of an anchor stays the same, s; 0 is white noise. A measurement
    /// is then fused with the variance of the independent samples it is worth.
    pub uwb_correlation_s: f64,
    /// Range biases that are known beforehand: number of the anchor and its bias, m, as `haltere fit
    /// anchors` prints them. They are taken off before anything else.
    pub range_bias_m: Vec<[f64; 2]>,
    /// Tag antenna seen from the centre of mass, body frame, m.
    pub p_BT_B_m: [f64; 3],
    /// Gate of the TDOA aid.
    pub gate: GateConfig,
    /// Process noise.
    pub process: ProcessNoise,
    /// Barometer.
    pub baro: BaroConfig,
    /// Magnetometer.
    pub magnetometer: MagnetometerConfig,
    /// The board's vertical.
    pub board_vertical: BoardVerticalConfig,
    /// Whether motion capture is fused; it is recorded as truth otherwise.
    pub fuse_reference: bool,
    /// One sigma of a motion-capture position, m.
    pub std_reference_m: f64,
    /// Rest that is needed before a start from rest, s.
    pub align_s: f64,
    /// Height of the centre of mass above the origin while standing, m: near the floor TDOA alone tells height badly.
    /// Unset: `flight.gear_height_m` where that is told and errors of the UWB are learned, for a take-off from the
    /// floor; else not known. From a table, say its height and the gear's.
    pub rest_height_m: Option<f64>,
}

impl Default for EstimatorConfig {
    fn default() -> Self {
        Self {
            motion: Motion::Inertial,
            unaided: Unaided::default(),
            cold_start: false,
            covariance_step_s: 0.0,
            anchor_bias: AnchorBias::default(),
            gyro_bias: GyroBias::default(),
            quality: Quality::default(),
            isolation: Isolation::default(),
            specific_force: SpecificForce::ThrustAxis,
            drag: true,
            drag_per_s: [4.2, 1.8, 0.3],
            cop_z_m: 0.03,
            acc_average_s: 0.015,
            slow_force_s: 0.0,
            uwb_noise: UwbNoise::HeightDependent,
            std_uwb_m: 0.15,
            uwb_correlation_s: 0.1,
            range_bias_m: Vec::new(),
            p_BT_B_m: [0.0; 3],
            gate: GateConfig::default(),
            process: ProcessNoise::default(),
            baro: BaroConfig::default(),
            magnetometer: MagnetometerConfig::default(),
            board_vertical: BoardVerticalConfig::default(),
            fuse_reference: false,
            std_reference_m: 0.01,
            align_s: 1.0,
            rest_height_m: None,
        }
    }
}

impl EstimatorConfig {
    /// The same vehicle with the errors of the UWB learned in flight, by anchor: biases that wander and biases that stay,
    /// quality, and an anchor left out that does not fit. Nothing is thrown away: what does not fit keeps the weight that
    /// its tail leaves it, so that a bad start converges. One set for all rooms, from the README of the recordings (white
    /// part 0.05 to 0.09 m, a part that wanders by 0.04 to 0.3 m, one of 0.06 m that stays) and within its ranges by the
    /// recorded flights (docs/ESTIMATOR.md); errors that last 0.06 s in place of 0.03 s cost 6 mm of the median with IMU, bring two
    /// more flights into the band of the NEES and take a fifth of the tremble of setpoints away. With λ of the height its white part is 0.064 m from 1 m on. What was told otherwise than
    /// by default stays.
    pub fn learned_uwb_errors(mut self) -> Self {
        let plain = Self::default();
        macro_rules! unless_told {
            ($($($key:ident).+ = $value:expr;)+) => {
                $(if self.$($key).+ == plain.$($key).+ { self.$($key).+ = $value; })+
            };
        }
        unless_told! {
            std_uwb_m = 0.09;
            uwb_correlation_s = 0.06;
            gate.sigma = 10.0;
            gate.tail_sigma = 1.2;
            gate.reject = false;
            anchor_bias.estimate = true;
            anchor_bias.std_m = 0.08;
            anchor_bias.correlation_s = 8.0;
            anchor_bias.correlation_m = 1.2;
            anchor_bias.level_s = 10.0;
            anchor_bias.constant_std_m = 0.045;
            quality.learn = true;
            quality.time_s = 0.6;
            quality.least = 0.35;
            isolation.leave_out = true;
        }
        self
    }

    /// The source's filter as published: constant noise, no drag term, no tails.
    pub fn source_raw() -> Self {
        Self {
            drag: false,
            uwb_noise: UwbNoise::Constant,
            uwb_correlation_s: 0.0,
            gate: GateConfig { tail: Tail::Gaussian, ..GateConfig::default() },
            board_vertical: BoardVerticalConfig { fuse: false, ..Default::default() },
            ..Self::default()
        }
    }

    /// Notes every value that cannot be flown with; `key` is the name of the section.
    pub fn check(&self, key: &str, problems: &mut Problems) {
        let mut range = |name: &str, value: f64, low: f64, high: f64, unit: &str| {
            problems.range(format_args!("{key}.{name}"), value, low..=high, unit);
        };
        for (axis, drag) in ["x", "y", "z"].into_iter().zip(self.drag_per_s) {
            range(&format!("drag_per_s.{axis}"), drag, 0.0, 20.0, "1/s");
        }
        for (axis, arm) in ["x", "y", "z"].into_iter().zip(self.p_BT_B_m) {
            range(&format!("p_BT_B_m.{axis}"), arm, -1.0, 1.0, "m");
        }
        range("slow_force_s", self.slow_force_s, 0.0, 60.0, "s");
        range("covariance_step_s", self.covariance_step_s, 0.0, 0.02, "s");
        let u = &self.unaided;
        range("unaided.std_acc_mps2_rthz", u.std_acc_mps2_rthz, 1e-3, 50.0, "m/s²/√Hz");
        range("unaided.decay_per_s", u.decay_per_s, 0.0, 20.0, "1/s");
        let b = &self.anchor_bias;
        range("anchor_bias.std_m", b.std_m, 1e-4, 5.0, "m");
        range("anchor_bias.correlation_s", b.correlation_s, 0.01, 1e5, "s");
        range("anchor_bias.correlation_m", b.correlation_m, 0.01, 1e5, "m");
        range("anchor_bias.level_s", b.level_s, 0.0, 1e4, "s");
        range("anchor_bias.constant_std_m", b.constant_std_m, 0.0, 5.0, "m");
        range("anchor_bias.hidden_std_m", b.hidden_std_m, 1e-4, 10.0, "m");
        range("anchor_bias.hidden_s", b.hidden_s, 0.01, 100.0, "s");
        range("anchor_bias.hidden_below_m", b.hidden_below_m, -50.0, 5.0, "m");
        range("anchor_bias.low_anchor_m", b.low_anchor_m, -50.0, 5.0, "m");
        let g = &self.gyro_bias;
        range("gyro_bias.std_radps", g.std_radps, 1e-6, 0.5, "rad/s");
        range("gyro_bias.walk_radps_rts", g.walk_radps_rts, 0.0, 0.1, "rad/s/√s");
        let q = &self.quality;
        range("quality.time_s", q.time_s, 0.05, 100.0, "s");
        range("quality.least", q.least, 0.01, 1.0, "");
        range("quality.most", q.most, 1.0, 1e4, "");
        let i = &self.isolation;
        range("isolation.memory_s", i.memory_s, 0.1, 60.0, "s");
        range("isolation.std_bias_m", i.std_bias_m, 0.01, 5.0, "m");
        range("isolation.doubt", i.doubt, 0.5, 1e3, "");
        range("isolation.others_doubt", i.others_doubt, 0.1, 1e3, "");
        range("isolation.least_m", i.least_m, 0.05, 20.0, "m");
        range("isolation.confirm_s", i.confirm_s, 0.0, 60.0, "s");
        range("isolation.return_s", i.return_s, 0.0, 600.0, "s");
        range("cop_z_m", self.cop_z_m, -0.5, 0.5, "m");
        range("acc_average_s", self.acc_average_s, 0.0, 0.2, "s");
        range("std_uwb_m", self.std_uwb_m, 0.01, 5.0, "m");
        range("uwb_correlation_s", self.uwb_correlation_s, 0.0, 10.0, "s");
        range("gate.sigma", self.gate.sigma, 2.0, 100.0, "sigma");
        range("gate.tail_sigma", self.gate.tail_sigma, 0.5, 100.0, "sigma");
        range("gate.doubt_frac", self.gate.doubt_frac, 0.1, 0.95, "");
        let p = &self.process;
        range("process.std_acc_xy_mps2_rthz", p.std_acc_xy_mps2_rthz, 1e-3, 20.0, "m/s²/√Hz");
        range("process.std_acc_z_mps2_rthz", p.std_acc_z_mps2_rthz, 1e-3, 20.0, "m/s²/√Hz");
        range("process.std_rate_radps_rthz", p.std_rate_radps_rthz, 1e-5, 2.0, "rad/s/√Hz");
        range("process.std_pos_m_rts", p.std_pos_m_rts, 0.0, 2.0, "m/√s");
        range("baro.std_m", self.baro.std_m, 0.01, 20.0, "m");
        let v = &self.board_vertical;
        range("board_vertical.std_deg", v.std_deg, 0.1, 60.0, "deg");
        range("board_vertical.correlation_s", v.correlation_s, 0.0, 100.0, "s");
        range("baro.correlation_s", self.baro.correlation_s, 0.0, 100.0, "s");
        let m = &self.magnetometer;
        range("magnetometer.north_deg", m.north_deg, -180.0, 180.0, "deg");
        range("magnetometer.strength_ut", m.strength_ut, 15.0, 100.0, "µT");
        range("magnetometer.dip_deg", m.dip_deg, -80.0, 80.0, "deg");
        range("magnetometer.std_deg", m.std_deg, 1.0, 60.0, "deg");
        range("magnetometer.correlation_s", m.correlation_s, 0.0, 100.0, "s");
        range("magnetometer.most_disturbance_frac", m.most_disturbance_frac, 0.02, 1.0, "");
        range("std_reference_m", self.std_reference_m, 1e-4, 1.0, "m");
        range("align_s", self.align_s, 0.05, 30.0, "s");
        for [anchor, bias_m] in &self.range_bias_m {
            range("range_bias_m: number of an anchor", *anchor, 0.0, 255.0, "");
            range(&format!("range_bias_m: bias of anchor {anchor}"), *bias_m, -5.0, 5.0, "m");
        }
        if let Some(height_m) = self.rest_height_m {
            range("rest_height_m", height_m, -50.0, 50.0, "m");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_presets_pass_their_own_check() {
        for config in [EstimatorConfig::default(), EstimatorConfig::source_raw()] {
            let mut problems = Problems::new();
            config.check("estimator", &mut problems);
            assert!(problems.is_empty(), "{problems}");
        }
    }

    #[test]
    fn prop_a_bad_value_is_named() {
        let mut problems = Problems::new();
        let config = EstimatorConfig { std_uwb_m: f64::NAN, ..EstimatorConfig::default() };
        config.check("estimator", &mut problems);
        assert_eq!(problems.lines(), ["estimator.std_uwb_m = NaN, allowed 0.01 to 5 m"]);
    }
}
