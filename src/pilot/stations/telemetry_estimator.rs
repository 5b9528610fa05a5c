//! What clients see of the estimator: odometry, covariances, status, and what is steered to.

use haltere_dialect::mav::haltere::{
    EKF_STATUS_REPORT_DATA, ESTIMATOR_STATUS_DATA, EstimatorStatusFlags,
    LOCAL_POSITION_NED_COV_DATA, MavEstimatorType, MavFrame, MavMessage, ODOMETRY_DATA,
    POSITION_TARGET_LOCAL_NED_DATA, PositionTargetTypemask,
};

use haltere_core::estimate::Health;
use haltere_core::frames::{B, E, Vec3};

use super::endpoint::GpsClaim;
use super::shown::Shown;

/// Places of the diagonal in the upper triangle of a covariance, row by row, of 6 and of 9 states.
const DIAGONAL_6: [usize; 6] = [0, 6, 11, 15, 18, 20];
const DIAGONAL_9: [usize; 9] = [0, 9, 17, 24, 30, 35, 39, 42, 44];

fn f32s(v: [f64; 3]) -> [f32; 3] {
    v.map(|c| c as f32)
}

fn squares<const N: usize, const M: usize>(places: [usize; N], std: [f64; N]) -> [f32; M] {
    // What is not told is left at zero: the filter's correlations are not among the estimate.
    let mut triangle = [0.0; M];
    for (place, std) in places.into_iter().zip(std) {
        if let Some(entry) = triangle.get_mut(place) {
            *entry = (std * std) as f32;
        }
    }
    triangle
}

fn std_vel_E_mps(shown: &Shown<'_>) -> Vec3<E> {
    // Variances along Earth axes of three that are independent along body axes: R S Rᵀ.
    let rot = shown.estimate.R_EB.matrix();
    let body: Vec3<B> = shown.estimate.std_vel_B_mps;
    let std = body.to_array();
    let along = |row: usize| (0..3).map(|k| (rot[(row, k)] * std[k]).powi(2)).sum::<f64>().sqrt();
    Vec3::from_array([along(0), along(1), along(2)])
}

/// ODOMETRY: pose in local NED, velocity in the body frame.
pub(crate) fn odometry(shown: &Shown<'_>) -> MavMessage {
    let estimate = shown.estimate;
    let [x, y, z] = f32s(estimate.pos_E_m.to_array());
    let [vx, vy, vz] = f32s(estimate.vel_B_mps.to_array());
    let [rollspeed, pitchspeed, yawspeed] = f32s(estimate.rate_B_radps.to_array());
    let ([p0, p1, p2], [a0, a1, a2], [v0, v1, v2]) = (
        estimate.std_pos_E_m.to_array(),
        estimate.std_att_B_rad.to_array(),
        estimate.std_vel_B_mps.to_array(),
    );
    MavMessage::ODOMETRY(ODOMETRY_DATA {
        time_usec: shown.at.as_us(),
        x,
        y,
        z,
        q: estimate.R_EB.to_wxyz().map(|c| c as f32),
        vx,
        vy,
        vz,
        rollspeed,
        pitchspeed,
        yawspeed,
        pose_covariance: squares(DIAGONAL_6, [p0, p1, p2, a0, a1, a2]),
        // Rates are measured, not estimated: their uncertainty is not known.
        velocity_covariance: squares(DIAGONAL_6, [v0, v1, v2, f64::NAN, f64::NAN, f64::NAN]),
        frame_id: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        child_frame_id: MavFrame::MAV_FRAME_BODY_FRD as u8,
        reset_counter: 0,
        estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_AUTOPILOT as u8,
        quality: match estimate.health {
            Health::Good => 100,
            Health::Degraded => 50,
            Health::NotAligned | Health::Lost => -1,
        },
    })
}

/// LOCAL_POSITION_NED_COV.
pub(crate) fn position_covariance(shown: &Shown<'_>) -> MavMessage {
    let estimate = shown.estimate;
    let [x, y, z] = f32s(estimate.pos_E_m.to_array());
    let [vx, vy, vz] = f32s(estimate.vel_E_mps().to_array());
    let [p0, p1, p2] = estimate.std_pos_E_m.to_array();
    let [v0, v1, v2] = std_vel_E_mps(shown).to_array();
    let nan = f64::NAN;
    MavMessage::LOCAL_POSITION_NED_COV(LOCAL_POSITION_NED_COV_DATA {
        time_usec: shown.at.as_us(),
        x,
        y,
        z,
        vx,
        vy,
        vz,
        ax: f32::NAN,
        ay: f32::NAN,
        az: f32::NAN,
        covariance: squares(DIAGONAL_9, [p0, p1, p2, v0, v1, v2, nan, nan, nan]),
        estimator_type: MavEstimatorType::MAV_ESTIMATOR_TYPE_AUTOPILOT,
    })
}

fn estimator_flags(shown: &Shown<'_>) -> EstimatorStatusFlags {
    use EstimatorStatusFlags as F;
    let usable = matches!(shown.estimate.health, Health::Good | Health::Degraded);
    let mut flags = F::empty();
    flags.set(
        F::ESTIMATOR_ATTITUDE
            | F::ESTIMATOR_VELOCITY_HORIZ
            | F::ESTIMATOR_VELOCITY_VERT
            | F::ESTIMATOR_POS_HORIZ_REL
            | F::ESTIMATOR_POS_VERT_ABS
            | F::ESTIMATOR_POS_VERT_AGL
            | F::ESTIMATOR_PRED_POS_HORIZ_REL,
        usable,
    );
    flags.set(
        F::ESTIMATOR_POS_HORIZ_ABS | F::ESTIMATOR_PRED_POS_HORIZ_ABS,
        usable && shown.endpoint.gps != GpsClaim::None,
    );
    flags
}

/// Largest test ratio among the pairs' newest measurements: what one test ratio can say of TDOA.
fn worst_test_ratio(shown: &Shown<'_>) -> f32 {
    shown.navigation.pairs.iter().map(|pair| pair.test_ratio).fold(0.0, f64::max) as f32
}

/// ESTIMATOR_STATUS.
pub(crate) fn estimator_status(shown: &Shown<'_>) -> MavMessage {
    let std = shown.estimate.std_pos_E_m;
    let ratio = worst_test_ratio(shown);
    MavMessage::ESTIMATOR_STATUS(ESTIMATOR_STATUS_DATA {
        time_usec: shown.at.as_us(),
        vel_ratio: 0.0,
        pos_horiz_ratio: ratio,
        pos_vert_ratio: ratio,
        mag_ratio: 0.0,
        hagl_ratio: 0.0,
        tas_ratio: 0.0,
        pos_horiz_accuracy: std.x().hypot(std.y()) as f32,
        pos_vert_accuracy: std.z() as f32,
        flags: estimator_flags(shown),
    })
}

/// EKF_STATUS_REPORT, for DroneKit. The low ten flags are those of ESTIMATOR_STATUS.
pub(crate) fn ekf_status(shown: &Shown<'_>) -> MavMessage {
    let ratio = worst_test_ratio(shown);
    MavMessage::EKF_STATUS_REPORT(EKF_STATUS_REPORT_DATA {
        flags: estimator_flags(shown).bits() & 0x3FF,
        velocity_variance: 0.0,
        pos_horiz_variance: ratio,
        pos_vert_variance: ratio,
        compass_variance: 0.0,
        terrain_alt_variance: 0.0,
    })
}

/// POSITION_TARGET_LOCAL_NED: what the position loop is asked for now.
pub(crate) fn position_target(shown: &Shown<'_>) -> Option<MavMessage> {
    if !shown.flight.mode.is_flying() {
        return None;
    }
    use PositionTargetTypemask as M;
    let control = &shown.flight.control;
    let position = control.pos_setpoint_E_m;
    let mut type_mask = M::POSITION_TARGET_TYPEMASK_AX_IGNORE
        | M::POSITION_TARGET_TYPEMASK_AY_IGNORE
        | M::POSITION_TARGET_TYPEMASK_AZ_IGNORE
        | M::POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE;
    type_mask.set(M::POSITION_TARGET_TYPEMASK_X_IGNORE, position[0].is_none());
    type_mask.set(M::POSITION_TARGET_TYPEMASK_Y_IGNORE, position[1].is_none());
    type_mask.set(M::POSITION_TARGET_TYPEMASK_Z_IGNORE, position[2].is_none());
    let [x, y, z] = position.map(|p| p.map_or(f32::NAN, |p| p as f32));
    let [vx, vy, vz] = f32s(control.vel_setpoint_E_mps.to_array());
    Some(MavMessage::POSITION_TARGET_LOCAL_NED(POSITION_TARGET_LOCAL_NED_DATA {
        time_boot_ms: shown.boot_ms(),
        x,
        y,
        z,
        vx,
        vy,
        vz,
        afx: f32::NAN,
        afy: f32::NAN,
        afz: f32::NAN,
        yaw: control.yaw_rad as f32,
        yaw_rate: f32::NAN,
        type_mask,
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED,
    }))
}
