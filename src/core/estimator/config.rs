//! Settings of the estimator: every number with unit and origin, checked on load.

use serde::{Deserialize, Serialize};

use crate::checks::Problems;
use crate::choices;

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

crate::keys! {
    /// The gate of the TDOA aid and its way back from being wrong.
    #[derive(Copy)]
    pub struct GateConfig {
        /// Innovations beyond this many sigma are rejected.
        sigma: f64 = 5.0, [2.0..=100.0, "sigma"], EST_GATE(124, Restart);
        /// Weighting inside the gate.
        tail: Tail = Tail::StudentT, EST_TAIL(125, Restart);
        /// Where the tail begins, in sigma.
        tail_sigma: f64 = 2.0, [0.5..=100.0, "sigma"], EST_TAIL_SIGMA(126, Restart);
        /// Share of recent measurements beyond the gate at which the filter doubts itself.
        doubt_frac: f64 = 0.5, [0.1..=0.95], EST_DOUBT(127, Restart);
        /// Whether it then opens up and, failing that, finds its position anew.
        recover: bool = true, EST_RECOVER(128, Restart);
        /// Whether what is beyond the gate is thrown away; if not, its tail weighs it.
        reject: bool = true, EST_REJECT(146, Restart);
    }
}

crate::keys! {
    /// Process noise, as densities: one sigma of the error that has grown after one second is the
    /// number itself (random walk).
    #[derive(Copy)]
    pub struct ProcessNoise {
        /// Process noise of the specific force along body x and y.
        ///
        /// Error of the drag model, or of the accelerometer where it is used.
        std_acc_xy_mps2_rthz: f64 = 1.0, [1e-3..=20.0, "m/s²/√Hz"], @vehicle, EST_STD_ACC_XY(129, Restart);
        /// Process noise of the specific force along body z.
        // Flapping of 0.79 g rms sampled at 100 Hz aliases to 0.77.
        std_acc_z_mps2_rthz: f64 = 0.8, [1e-3..=20.0, "m/s²/√Hz"], @vehicle, EST_STD_ACC_Z(130, Restart);
        /// Process noise of the angular rate.
        std_rate_radps_rthz: f64 = 0.02, [1e-5..=2.0, "rad/s/√Hz"], @vehicle, EST_STD_RATE(131, Restart);
        /// Process noise of the position.
        ///
        /// What the other terms do not cover.
        std_pos_m_rts: f64 = 0.01, [0.0..=2.0, "m/√s"], @vehicle, EST_STD_POS(132, Restart);
    }
}

crate::keys! {
    /// Height from air pressure.
    #[derive(Copy)]
    pub struct BaroConfig {
        /// Whether height from air pressure is fused.
        fuse: bool = true, EST_BARO(133, Restart);
        /// One sigma of a height from air pressure.
        ///
        /// Wash of the wings and slow weather are in it.
        std_m: f64 = 0.5, [0.01..=20.0, "m"], EST_BARO_STD(134, Restart);
        /// Time over which that error stays the same.
        correlation_s: f64 = 5.0, [0.0..=100.0, "s"], EST_BARO_CORR_T(135, Restart);
    }
}

crate::keys! {
    /// The board's vertical (`board_vertical.rs`).
    #[derive(Copy)]
    pub struct BoardVerticalConfig {
        /// Whether the board's vertical is fused.
        ///
        /// In a steady wind the filter's own leans.
        fuse: bool = true, EST_BVT(148, Restart);
        /// One sigma of the board's vertical.
        ///
        /// Alignment, the board's filter under acceleration.
        std_deg: f64 = 3.0, [0.1..=60.0, "deg"], EST_BVT_STD(149, Restart);
        /// Time over which that error stays the same.
        correlation_s: f64 = 2.0, [0.0..=100.0, "s"], EST_BVT_CORR_T(150, Restart);
    }
}

crate::keys! {
    /// Heading from the magnetic field (`magnetometer.rs`).
    #[derive(Copy)]
    pub struct MagnetometerConfig {
        /// Whether the magnetic field tells the heading.
        ///
        /// At the start in place of the board's, and in flight. The board must send a calibrated field (HIGHRES_IMU,
        /// RAW_IMU or SCALED_IMU); what it sees is told at the start.
        fuse: bool = false, EST_MAG(136, Restart);
        /// Magnetic north from room north, positive clockwise.
        north_deg: f64 = 0.0, [-180.0..=180.0, "deg"], EST_MAG_NORTH(137, Restart);
        /// Strength of the magnetic field in the room.
        strength_ut: f64 = 49.0, [15.0..=100.0, "µT"], EST_MAG_FIELD(138, Restart);
        /// How far it points below the horizontal.
        ///
        /// Negative on the southern half of the Earth.
        dip_deg: f64 = 66.0, [-80.0..=80.0, "deg"], EST_MAG_DIP(139, Restart);
        /// One sigma of a heading from an undisturbed field.
        // Calibration, motors, what strength and dip do not show.
        std_deg: f64 = 8.0, [1.0..=60.0, "deg"], EST_MAG_STD(140, Restart);
        /// Time over which that error stays the same.
        correlation_s: f64 = 5.0, [0.0..=100.0, "s"], EST_MAG_CORR_T(141, Restart);
        /// A field is not used when it is this far from strength and dip, as a share.
        ///
        /// Below that the difference widens the sigma.
        most_disturbance_frac: f64 = 0.15, [0.02..=1.0], EST_MAG_MOST(142, Restart);
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

crate::keys! {
    /// How a vehicle without IMU moves: a velocity that is pushed at random and decays.
    #[derive(Copy)]
    pub struct Unaided {
        /// Random push of a vehicle without IMU.
        std_acc_mps2_rthz: f64 = 0.45, [1e-3..=50.0, "m/s²/√Hz"], EST_UNA_ACC(153, Restart);
        /// Decay of the velocity of a vehicle without IMU.
        // With the push it bounds the speed that is expected: one sigma is push / √(2 decay).
        decay_per_s: f64 = 0.5, [0.0..=20.0, "1/s"], EST_UNA_DECAY(154, Restart);
    }
}

crate::keys! {
    /// Range bias of each anchor as a state (`bias.rs`).
    #[derive(Copy)]
    pub struct AnchorBias {
        /// Whether the range bias of each anchor is estimated.
        estimate: bool = false, EST_BIA(155, Restart);
        /// One sigma of the part of that bias that wanders.
        std_m: f64 = 0.2, [1e-4..=5.0, "m"], EST_BIA_STD(156, Restart);
        /// Time over which that part stays.
        correlation_s: f64 = 8.0, [0.01..=1e5, "s"], EST_BIA_CORR_T(157, Restart);
        /// Distance flown over which that part stays.
        correlation_m: f64 = 0.6, [0.01..=1e5, "m"], EST_BIA_CORR_L(158, Restart);
        /// Time in which it is learned in flight how much each wanders; 0: as much as std_m says.
        level_s: f64 = 0.0, [0.0..=1e4, "s"],
            EST_BIA_LVL_T(159, Restart, "Time in which it is learned how much each wanders; 0: as much as EST_BIA_STD says.");
        /// One sigma of the part of that bias that stays.
        constant_std_m: f64 = 0.1, [0.0..=5.0, "m"], EST_BIA_CONST(160, Restart);
        /// One sigma of the bias of an anchor that the floor hides.
        hidden_std_m: f64 = 2.5, [1e-4..=10.0, "m"], EST_BIA_HID(161, Restart);
        /// Time over which that stays.
        hidden_s: f64 = 0.5, [0.01..=100.0, "s"], EST_BIA_HID_T(162, Restart);
        /// The floor hides anchors from a tag below this height.
        hidden_below_m: f64 = 0.5, [-50.0..=5.0, "m"], EST_BIA_HID_H(163, Restart);
        /// It hides anchors that hang below this height.
        low_anchor_m: f64 = 0.6, [-50.0..=5.0, "m"], EST_BIA_LOW(164, Restart);
    }
}

crate::keys! {
    /// Leaving out an anchor that does not fit in flight (`isolation.rs`).
    #[derive(Copy)]
    pub struct Isolation {
        /// Whether an anchor that does not fit in flight is left out.
        ///
        /// Needs seven anchors that are heard.
        leave_out: bool = false, EST_OUT(172, Restart);
        /// Time over which residuals are remembered for that.
        memory_s: f64 = 1.0, [0.1..=60.0, "s"], EST_OUT_MEM(173, Restart);
        /// One sigma of the range bias of an anchor that is sound.
        std_bias_m: f64 = 0.3, [0.01..=5.0, "m"], EST_OUT_USUAL(174, Restart);
        /// Doubt from which an anchor is suspected.
        // Twice that of the check on the floor, chosen beforehand.
        doubt: f64 = 4.0, [0.5..=1e3], EST_OUT_DOUBT(175, Restart);
        /// Doubt below which the others are sound without it.
        // Chosen after a look at recorded flights behind metal.
        others_doubt: f64 = 2.0, [0.1..=1e3], EST_OUT_OTHERS(176, Restart);
        /// Least range error for which one is left out.
        least_m: f64 = 0.6, [0.05..=20.0, "m"], EST_OUT_LEAST(177, Restart);
        /// Time for which the suspicion must last.
        confirm_s: f64 = 0.3, [0.0..=60.0, "s"], EST_OUT_CONF_T(178, Restart);
        /// Time for which one that is left out must fit before it is taken back.
        return_s: f64 = 2.0, [0.0..=600.0, "s"], EST_OUT_BACK_T(179, Restart);
    }
}

crate::keys! {
    /// Bias of the gyroscope in flight (`gyro_bias.rs`).
    /// Off. The sigma is the change that `haltere-lab aids` tries; the walk, which was chosen, makes as much of it
    /// in a quarter of an hour.
    #[derive(Copy)]
    pub struct GyroBias {
        /// Whether the gyroscope's bias is estimated in flight.
        estimate: bool = false, EST_GB(165, Restart);
        /// One sigma of what the gyroscope's bias has changed since the rest.
        std_radps: f64 = 0.01, [1e-6..=0.5, "rad/s"], EST_GB_STD(166, Restart);
        /// Walk of the gyroscope's bias.
        walk_radps_rts: f64 = 3e-4, [0.0..=0.1, "rad/s/√s"], EST_GB_WALK(167, Restart);
    }
}

crate::keys! {
    /// Quality of each anchor, learned in flight (`quality.rs`).
    #[derive(Copy)]
    pub struct Quality {
        /// Whether the quality of each anchor is learned in flight.
        learn: bool = false, EST_QUA(168, Restart);
        /// Time of that learning.
        time_s: f64 = 0.8, [0.05..=100.0, "s"], EST_QUA_T(169, Restart);
        /// Least factor on the variance of an anchor.
        least: f64 = 0.5, [0.01..=1.0], EST_QUA_LEAST(170, Restart);
        /// Largest factor on the variance of an anchor.
        most: f64 = 100.0, [1.0..=1e4], EST_QUA_MOST(171, Restart);
    }
}

crate::keys! {
    /// Settings of the estimator.
    pub struct EstimatorConfig {
        /// What drives the prediction: the IMU, or nothing: position from TDOA alone, without attitude; for recordings,
        /// not for flight.
        motion: Motion = Motion::Inertial;
        /// Whether position and heading are found by motion when nobody tells them.
        ///
        /// Without, a start needs rest and a heading.
        cold_start: bool = false, EST_COLD(147, Restart);
        /// Least step in which the covariance is predicted. 0: with each IMU sample.
        // The state itself follows each sample.
        covariance_step_s: f64 = 0.0, [0.0..=0.02, "s"], EST_COV_STEP(152, Restart);
        /// Where the specific force comes from in flight.
        specific_force: SpecificForce = SpecificForce::ThrustAxis, @vehicle, EST_FORCE(111, Restart);
        /// Whether the drag model is used (with the thrust axis only).
        drag: bool = true, @vehicle, EST_DRAG(112, Restart);
        /// Drag along body x, y, z over mass, 1/s (crazyflie-firmware for this vehicle). The z entry completes the
        /// vehicle's record and enters no equation here: the accelerometer measures it.
        drag_per_s: [f64; 3] = [4.2, 1.8, 0.3], [0.0..=20.0, "1/s"], @vehicle,
            EST_DRAG_X(113, Restart, "Drag along body x over mass."),
            EST_DRAG_Y(114, Restart, "Drag along body y over mass."),
            EST_DRAG_Z(115, Restart, "Drag along body z over mass.");
        /// Centre of pressure above the centre of mass.
        cop_z_m: f64 = 0.03, [-0.5..=0.5, "m"], @vehicle, EST_COP_Z(116, Restart);
        /// Time constant of the low-pass on the accelerometer. 0: off.
        ///
        /// It takes the edge off a beat of 13 Hz (factor 0.6 at the default) at the price of as much lag.
        acc_average_s: f64 = 0.015, [0.0..=0.2, "s"], @vehicle, EST_ACC_AVG_T(117, Restart);
        /// Time from which on the accelerometer shows forces beyond drag, such as wind. 0: off.
        ///
        /// Not for an accelerometer that is off in flight by 1 m/s² and more.
        // With `thrust_axis` only (`slow_force.rs`).
        slow_force_s: f64 = 0.0, [0.0..=60.0, "s"], EST_SLOW_F_T(151, Restart);
        /// How the UWB variance depends on height.
        uwb_noise: UwbNoise = UwbNoise::HeightDependent, EST_UWB_NOISE(118, Restart);
        /// One sigma of a time difference near the floor.
        std_uwb_m: f64 = 0.15, [0.01..=5.0, "m"], EST_UWB_STD(119, Restart);
        /// Time over which the error of an anchor stays the same. 0: white noise.
        ///
        /// A measurement is then fused with the variance of the independent samples it is worth.
        uwb_correlation_s: f64 = 0.1, [0.0..=10.0, "s"], EST_UWB_CORR_T(120, Restart);
        /// Range biases that are known beforehand: pairs of an anchor's number and its bias, m, as `haltere fit
        /// anchors` prints them.
        // They are taken off before anything else.
        range_bias_m: Vec<[f64; 2]> = Vec::new();
        /// Tag antenna seen from the centre of mass, body frame.
        p_BT_B_m: [f64; 3] = [0.0; 3], [-1.0..=1.0, "m"], @vehicle,
            EST_TAG_X(121, Restart, "Tag antenna seen from the centre of mass, body x."),
            EST_TAG_Y(122, Restart, "Tag antenna seen from the centre of mass, body y."),
            EST_TAG_Z(123, Restart, "Tag antenna seen from the centre of mass, body z.");
        /// Whether motion capture is fused as a measurement.
        ///
        /// It is always recorded as truth.
        fuse_reference: bool = false, EST_FUSE_REF(143, Restart);
        /// One sigma of a motion-capture position.
        std_reference_m: f64 = 0.01, [1e-4..=1.0, "m"], EST_REF_STD(144, Restart);
        /// Rest that is needed before a start from rest.
        align_s: f64 = 1.0, [0.05..=30.0, "s"], @vehicle, EST_ALIGN_T(145, Restart);
        /// Height of the centre of mass above the origin while standing, -50 to 50 m, if the place of take-off is known:
        /// near the floor TDOA alone tells height badly.
        // Unset: `flight.gear_height_m` where that is told and errors of the UWB are learned, for a take-off from the
        // floor; else not known. From a table, say its height and the gear's.
        rest_height_m: Option<f64> = None, ~[-51.0..=50.0, "m"], {"0.05"}, @vehicle,
            EST_REST_HGT(180, Restart, "Height of the centre of mass while standing. -51: not told.");
    } sections {
        /// Motion without IMU.
        unaided: Unaided;
        /// Range bias of each anchor.
        anchor_bias: AnchorBias;
        /// Bias of the gyroscope.
        gyro_bias: GyroBias;
        /// Quality of each anchor.
        quality: Quality;
        /// Leaving out anchors that do not fit.
        isolation: Isolation;
        /// Gate of the TDOA aid.
        gate: GateConfig;
        /// Process noise.
        process: ProcessNoise;
        /// Barometer.
        baro: BaroConfig;
        /// Magnetometer.
        magnetometer: MagnetometerConfig;
        /// The board's vertical.
        board_vertical: BoardVerticalConfig;
    } rules more_ranges;
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

    /// Values that stand in a list, or may be absent.
    fn more_ranges(&self, key: &str, problems: &mut Problems) {
        for [anchor, bias_m] in &self.range_bias_m {
            let key = format!("{key}.range_bias_m");
            problems.range(format!("{key}: number of an anchor"), *anchor, 0.0..=255.0, "");
            problems.range(format!("{key}: bias of anchor {anchor}"), *bias_m, -5.0..=5.0, "m");
        }
        if let Some(height_m) = self.rest_height_m {
            problems.range(format!("{key}.rest_height_m"), height_m, -50.0..=50.0, "m");
        }
    }
}

choices!(SpecificForce: ThrustAxis "thrust axis", Accelerometer "accelerometer");
choices!(UwbNoise: Constant "constant", HeightDependent "height dependent");
choices!(Tail: Gaussian "gaussian", Huber "huber", StudentT "student t");
choices!(Motion: Inertial "inertial", Unaided "unaided");

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
