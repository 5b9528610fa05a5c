//! The list: the only place that names every effect.

use super::EffectSpec;

/// Every effect: nominal ones first, then deviations by letter and number. At one stage they act in
/// this order.
pub static ALL: &[EffectSpec] = &[
    super::drag::SPEC,
    super::rotational_damping::SPEC,
    super::passive_dihedral::SPEC,
    super::drive_voltage::SPEC,
    super::flap_lag::SPEC,
    super::servos::PITCH,
    super::servos::YAW,
    super::battery::SPEC,
    super::ground_effect::SPEC,
    super::flap_vibration::SPEC,
    super::imu_noise::SPEC,
    super::imu_bias::SPEC,
    super::attitude_error::SPEC,
    super::heading_offset::SPEC,
    super::anchor_clocks::SPEC,
    super::receive_noise::SPEC,
    super::path_bias::SPEC,
    super::floor_multipath::SPEC,
    super::packet_loss::SPEC,
    super::link_latency::SPEC,
    super::clutter::SPEC,
    super::board_delay::NOMINAL,
    super::thrust_curve::SPEC,
    super::quadratic_drag::NOMINAL,
    super::drag_scale::SPEC,           // A1
    super::drag_saturation::SPEC,      // A2
    super::quadratic_drag::SPEC,       // A3
    super::thrust_expo::SPEC,          // A4
    super::steady_wind::SPEC,          // A5
    super::draught::SPEC,              // A6
    super::gusts::SPEC,                // A7
    super::near_ground::SPEC,          // A8
    super::ceiling::SPEC,              // A9
    super::wall::SPEC,                 // A10
    super::damping_scale::SPEC,        // A11
    super::speed_pitch::SPEC,          // A12
    super::thrust_loss::SPEC,          // P1
    super::resistance::SPEC,           // P2
    super::capacity::SPEC,             // P3
    super::thrust_lag::SPEC,           // P4
    super::motor_saturation::SPEC,     // P5
    super::wing_asymmetry::SPEC,       // P6
    super::thermal_droop::SPEC,        // P7
    super::voltage_report::SPEC,       // P8
    super::mass_error::SPEC,           // I1
    super::cg_offset::SPEC,            // I2
    super::inertia_scale::SPEC,        // I3
    super::attitude_lag::SPEC,         // L1
    super::loop_delay::SPEC,           // L2
    super::servo_trim::SPEC,           // L3
    super::dead_band::SPEC,            // L4
    super::tilt_saturation::SPEC,      // L5
    super::roll_yaw_coupling::SPEC,    // L6
    super::acc_bias::SPEC,             // M1
    super::acc_drift::SPEC,            // M2
    super::acc_scale::SPEC,            // M3
    super::acc_misalignment::SPEC,     // M4
    super::gyro_bias::SPEC,            // M5
    super::rectification::SPEC,        // M6
    super::acc_clipping::SPEC,         // M7
    super::noise_level::SPEC,          // U1
    super::anchor_bias::SPEC,          // U2
    super::pose_bias::SPEC,            // U3
    super::distance_bias::SPEC,        // U4
    super::nlos_zone::SPEC,            // U5
    super::low_multipath::SPEC,        // U6
    super::anchor_survey::SPEC,        // U7
    super::anchor_drift::SPEC,         // U8
    super::packet_drops::SPEC,         // U9
    super::outlier_bursts::SPEC,       // U10
    super::lever_arm::SPEC,            // U11
    super::tag_latency::SPEC,          // T1
    super::command_delay::SPEC,        // T2
    super::setpoint_bursts::SPEC,      // T3
    super::sampling_jitter::SPEC,      // T4
    super::heading_misalignment::SPEC, // H1
    super::heading_drift::SPEC,        // H2
];
