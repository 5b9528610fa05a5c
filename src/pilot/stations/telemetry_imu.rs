//! The board's newest IMU sample, for stations that ask for it.

use haltere_dialect::mav::haltere::{
    HIGHRES_IMU_DATA, HighresImuUpdatedFlags as Flags, MavMessage, SCALED_IMU_DATA,
};

use super::shown::Shown;

/// Standard gravity, m/s²: the unit of SCALED_IMU.
const STANDARD_G_MPS2: f64 = 9.806_65;

/// HIGHRES_IMU. `None`: no sample has come yet.
pub(crate) fn highres_imu(shown: &Shown<'_>) -> Option<MavMessage> {
    let sample = shown.navigation.imu?;
    let [xacc, yacc, zacc] = sample.acc_B_mps2.to_array().map(|c| c as f32);
    let [xgyro, ygyro, zgyro] = sample.rate_B_radps.to_array().map(|c| c as f32);
    Some(MavMessage::HIGHRES_IMU(HIGHRES_IMU_DATA {
        time_usec: sample.valid_at.as_us(),
        xacc,
        yacc,
        zacc,
        xgyro,
        ygyro,
        zgyro,
        fields_updated: Flags::HIGHRES_IMU_UPDATED_XACC
            | Flags::HIGHRES_IMU_UPDATED_YACC
            | Flags::HIGHRES_IMU_UPDATED_ZACC
            | Flags::HIGHRES_IMU_UPDATED_XGYRO
            | Flags::HIGHRES_IMU_UPDATED_YGYRO
            | Flags::HIGHRES_IMU_UPDATED_ZGYRO,
        ..Default::default()
    }))
}

/// SCALED_IMU: in thousandths of gravity and of radians a second.
pub(crate) fn scaled_imu(shown: &Shown<'_>) -> Option<MavMessage> {
    let sample = shown.navigation.imu?;
    // The casts saturate.
    let [xacc, yacc, zacc] =
        sample.acc_B_mps2.to_array().map(|c| (1e3 * c / STANDARD_G_MPS2).round() as i16);
    let [xgyro, ygyro, zgyro] = sample.rate_B_radps.to_array().map(|c| (1e3 * c).round() as i16);
    Some(MavMessage::SCALED_IMU(SCALED_IMU_DATA {
        time_boot_ms: shown.boot_ms(),
        xacc,
        yacc,
        zacc,
        xgyro,
        ygyro,
        zgyro,
        ..Default::default()
    }))
}
