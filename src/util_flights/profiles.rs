//! Settings for the vehicles of UTIL: one set for every flight.

use haltere_core::estimator::{
    AnchorBias, BaroConfig, EstimatorConfig, GateConfig, IsolationConfig, Motion, ProcessNoise,
    Quality, SpecificForce, Tail, UwbNoise,
};
use haltere_log::import::util::Flight;

/// Settings for the quadrotors of UTIL: one set for every flight.
///
/// They differ from the Flapper's where vehicle and place differ:
/// * drag 0.6 1/s (a quadrotor; the result is flat from 0.4 to 1 1/s), thrust along body z, an
///   accelerometer that is quiet along z;
/// * the errors of the UWB are what the README of the recordings says: a white part of 0.05 to 0.09 m, taken
///   to stay for 0.03 s (chosen by the consistency of these flights; what stays longer is in the biases), biases of the anchors
///   that wander by some 0.1 m and stay at 0.05 m; with heavy tails, so no tight gate is needed.
pub fn util_profile() -> EstimatorConfig {
    EstimatorConfig {
        std_uwb_m: 0.07,
        uwb_noise: UwbNoise::Constant,
        uwb_correlation_s: 0.03,
        covariance_step_s: 0.004,
        gate: GateConfig {
            sigma: 10.0,
            tail: Tail::StudentT,
            tail_sigma: 1.4,
            reject: false,
            ..GateConfig::default()
        },
        // Numbers of the README, see above; how long biases last is what the searches of `leave_one_out` chose before.
        anchor_bias: AnchorBias {
            estimate: true,
            std_m: 0.12,
            correlation_s: 5.0,
            correlation_m: 0.8,
            // What wanders is 0.04 m in `const1`, 0.15 m in `const3` and more behind metal (README): learned, not set.
            level_s: 7.0,
            constant_std_m: 0.05,
            ..AnchorBias::default()
        },
        quality: Quality { learn: true, time_s: 0.6, least: 0.25, ..Quality::default() },
        isolation: IsolationConfig { leave_out: true, ..IsolationConfig::default() },
        process: ProcessNoise {
            // Against motion capture 0.06 m/s² that last a second in April, 0.7 m/s² in June: the drag
            // model does not know why. Between them, by the consistency of all six.
            std_acc_xy_mps2_rthz: 0.4,
            std_acc_z_mps2_rthz: 0.08,
            // The gyroscope's bias from 0.06 s of rest is off by 0.003 rad/s.
            std_rate_radps_rthz: 0.01,
            std_pos_m_rts: 0.01,
        },
        // Specific force across the thrust axis over speed, from IMU and motion capture of the five April
        // flights: 0.30 to 0.45 1/s. A property of the vehicle: it is not searched.
        drag_per_s: [0.4, 0.4, 0.0],
        // Recorded pressure follows the wash of the propellers more than the height: it costs 0.03 to
        // 0.1 m on both flights that have it (docs/ESTIMATOR.md).
        baro: BaroConfig { fuse: false, ..BaroConfig::default() },
        ..util_nine_profile()
    }
}

/// The nine states alone with errors that last, heavy tails and drag.
pub fn util_nine_profile() -> EstimatorConfig {
    EstimatorConfig {
        specific_force: SpecificForce::ThrustAxis,
        drag: true,
        drag_per_s: [0.6, 0.6, 0.0],
        cop_z_m: 0.0,
        acc_average_s: 0.0,
        std_uwb_m: 0.3,
        uwb_correlation_s: 0.5,
        gate: GateConfig {
            sigma: 10.0,
            tail: Tail::StudentT,
            tail_sigma: 1.5,
            ..GateConfig::default()
        },
        process: ProcessNoise {
            std_acc_xy_mps2_rthz: 1.0,
            std_acc_z_mps2_rthz: 0.1,
            std_rate_radps_rthz: 0.01,
            std_pos_m_rts: 0.01,
        },
        // Motors start 0.07 to 0.1 s after the beginning of the April recordings.
        align_s: 0.06,
        // The survey's zero is the floor.
        rest_height_m: Some(0.03),
        ..EstimatorConfig::default()
    }
}

/// The source's constant-noise filter on the same vehicles: white, normal errors, no drag.
pub fn util_source_profile() -> EstimatorConfig {
    let util = util_profile();
    EstimatorConfig {
        specific_force: util.specific_force,
        acc_average_s: util.acc_average_s,
        align_s: util.align_s,
        rest_height_m: util.rest_height_m,
        ..EstimatorConfig::source_raw()
    }
}

/// The same without IMU, for recordings that hold positions only. They are of another, later vehicle:
/// its biases wander less and stay more (README of the recordings: 0.04 m in its first layout), and nothing but
/// their smoothness tells them from its motion.
pub fn util_unaided_profile() -> EstimatorConfig {
    let util = util_profile();
    EstimatorConfig {
        motion: Motion::Unaided,
        gate: GateConfig { tail_sigma: 1.0, ..util.gate },
        anchor_bias: AnchorBias {
            std_m: 0.07,
            correlation_s: 10.0,
            correlation_m: 1.5,
            ..util.anchor_bias
        },
        ..util
    }
}

/// What is shipped for a recording.
pub fn shipped(flight: &Flight) -> EstimatorConfig {
    if flight.has_imu() { util_profile() } else { util_unaided_profile() }
}

/// Where the search for parameters begins: round numbers from the README of the recordings (white
/// part 0.05 to 0.09 m, constant of 0.06 m, wandering part of 0.04 to 0.3 m that stays 0.1 to 3 s) and
/// what is usual, none of it from our own results. Drag and process noise are the vehicle's and not
/// searched.
pub fn util_start_profile() -> EstimatorConfig {
    let util = util_profile();
    EstimatorConfig {
        std_uwb_m: 0.1,
        uwb_correlation_s: 0.1,
        gate: GateConfig { tail_sigma: 2.0, ..util.gate },
        anchor_bias: AnchorBias {
            std_m: 0.2,
            correlation_s: 3.0,
            correlation_m: 1.0,
            level_s: 10.0,
            constant_std_m: 0.06,
            ..util.anchor_bias
        },
        quality: Quality { time_s: 1.0, ..util.quality },
        isolation: IsolationConfig { others_doubt: 1.0, ..util.isolation },
        ..util
    }
}
