//! What clients see of positions on Earth and of heights.

use haltere_dialect::mav::haltere::{
    ALTITUDE_DATA, GLOBAL_POSITION_INT_DATA, GPS_GLOBAL_ORIGIN_DATA, GPS_RAW_INT_DATA, GpsFixType,
    HOME_POSITION_DATA, MavMessage, VFR_HUD_DATA,
};

use haltere_core::frames::{E, Vec3};
use haltere_core::geo::LocalOrigin;
use haltere_core::time::HostTime;

use super::shown::Shown;

/// Standard deviations of position are told as dilution of precision with this range error, m: MAVLink
/// wants a unitless number there, and one metre makes it the same number.
const RANGE_ERROR_M: f64 = 1.0;

/// Compass course in hundredths of a degree, 0 to 35999.
fn centidegrees(angle_rad: f64) -> u16 {
    let degrees = angle_rad.to_degrees().rem_euclid(360.0);
    ((degrees * 100.0).round() as u16) % 36_000
}

/// MAVLink counts altitudes in these. Saturates.
fn millimetres(altitude_m: f64) -> i32 {
    (altitude_m * 1e3).round() as i32
}

fn wire_i16(value: f64) -> i16 {
    value.round() as i16
}

/// GLOBAL_POSITION_INT.
pub(crate) fn global_position(shown: &Shown<'_>) -> MavMessage {
    let estimate = shown.estimate;
    let place = shown.origin.to_global(estimate.pos_E_m);
    let [lat, lon] = place.to_e7();
    let vel = estimate.vel_E_mps();
    let [north, east, _] = shown.origin.to_true_north(vel);
    MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
        time_boot_ms: shown.boot_ms(),
        lat,
        lon,
        alt: millimetres(place.alt_m),
        // Home lies on the floor.
        relative_alt: (-estimate.pos_E_m.z() * 1e3).round() as i32,
        vx: wire_i16(north * 100.0),
        vy: wire_i16(east * 100.0),
        vz: wire_i16(vel.z() * 100.0),
        hdg: centidegrees(shown.origin.true_yaw_rad(estimate.R_EB.yaw_rad())),
    })
}

/// GPS_RAW_INT of a receiver that does not exist: our own estimate, by configuration only.
pub(crate) fn gps_raw(shown: &Shown<'_>) -> MavMessage {
    let estimate = shown.estimate;
    let place = shown.origin.to_global(estimate.pos_E_m);
    let [lat, lon] = place.to_e7();
    let vel = estimate.vel_E_mps();
    let [north, east, _] = shown.origin.to_true_north(vel);
    let std = estimate.std_pos_E_m;
    let horizontal_m = std.x().hypot(std.y());
    let dilution = |std_m: f64| (std_m / RANGE_ERROR_M * 100.0).clamp(0.0, 65534.0) as u16;
    let accuracy_mm = |std_m: f64| (std_m * 1e3).clamp(0.0, 1e9) as u32;
    let yaw_rad = shown.origin.true_yaw_rad(estimate.R_EB.yaw_rad());
    MavMessage::GPS_RAW_INT(GPS_RAW_INT_DATA {
        time_usec: shown.at.as_us(),
        lat,
        lon,
        alt: millimetres(place.alt_m),
        eph: dilution(horizontal_m),
        epv: dilution(std.z()),
        vel: (north.hypot(east) * 100.0).clamp(0.0, 65534.0) as u16,
        cog: centidegrees(east.atan2(north)),
        fix_type: if shown.is_aligned() {
            GpsFixType::GPS_FIX_TYPE_3D_FIX
        } else {
            GpsFixType::GPS_FIX_TYPE_NO_FIX
        },
        // What is in view are anchors.
        satellites_visible: shown.navigation.tag.engine.anchors_heard().count().min(254) as u8,
        alt_ellipsoid: 0,
        h_acc: accuracy_mm(horizontal_m),
        v_acc: accuracy_mm(std.z()),
        vel_acc: accuracy_mm(estimate.std_vel_B_mps.norm()),
        hdg_acc: 0,
        // 0 is "not available", north is 36000.
        yaw: match centidegrees(yaw_rad) {
            0 => 36_000,
            yaw => yaw,
        },
    })
}

/// VFR_HUD.
pub(crate) fn vfr_hud(shown: &Shown<'_>) -> MavMessage {
    let estimate = shown.estimate;
    let vel = estimate.vel_E_mps();
    let heading_rad = shown.origin.true_yaw_rad(estimate.R_EB.yaw_rad());
    let throttle =
        if shown.flight.mode.has_thrust() { shown.flight.control.thrust_frac } else { 0.0 };
    MavMessage::VFR_HUD(VFR_HUD_DATA {
        // The air of a room is at rest.
        airspeed: vel.norm() as f32,
        groundspeed: vel.x().hypot(vel.y()) as f32,
        alt: shown.origin.to_global(estimate.pos_E_m).alt_m as f32,
        climb: -vel.z() as f32,
        heading: (centidegrees(heading_rad) / 100).cast_signed(),
        throttle: (throttle * 100.0).round().clamp(0.0, 100.0) as u16,
    })
}

/// ALTITUDE.
pub(crate) fn altitude(shown: &Shown<'_>) -> MavMessage {
    let height_m = -shown.estimate.pos_E_m.z();
    MavMessage::ALTITUDE(ALTITUDE_DATA {
        time_usec: shown.at.as_us(),
        altitude_monotonic: height_m as f32,
        altitude_amsl: (height_m + shown.origin.place().alt_m) as f32,
        altitude_local: height_m as f32,
        altitude_relative: height_m as f32,
        altitude_terrain: shown.origin.place().alt_m as f32,
        bottom_clearance: shown.height_above_floor_m().max(0.0) as f32,
    })
}

/// GPS_GLOBAL_ORIGIN of a room.
pub(crate) fn origin_at(now: HostTime, origin: &LocalOrigin) -> MavMessage {
    let place = origin.place();
    let [latitude, longitude] = place.to_e7();
    MavMessage::GPS_GLOBAL_ORIGIN(GPS_GLOBAL_ORIGIN_DATA {
        latitude,
        longitude,
        altitude: millimetres(place.alt_m),
        time_usec: now.as_us(),
    })
}

/// HOME_POSITION of a place in it.
pub(crate) fn home_at(now: HostTime, origin: &LocalOrigin, home_E_m: Vec3<E>) -> MavMessage {
    let place = origin.to_global(home_E_m);
    let [latitude, longitude] = place.to_e7();
    MavMessage::HOME_POSITION(HOME_POSITION_DATA {
        latitude,
        longitude,
        altitude: millimetres(place.alt_m),
        x: home_E_m.x() as f32,
        y: home_E_m.y() as f32,
        z: home_E_m.z() as f32,
        // The floor is level, and nothing is known of its heading.
        q: [f32::NAN; 4],
        approach_x: f32::NAN,
        approach_y: f32::NAN,
        approach_z: f32::NAN,
        time_usec: now.as_us(),
    })
}

/// GPS_GLOBAL_ORIGIN.
pub(crate) fn origin(shown: &Shown<'_>) -> MavMessage {
    origin_at(shown.clock.now, shown.origin)
}

/// HOME_POSITION. Home is known from the first alignment: until a take-off or a client says otherwise it is the room's
/// origin.
pub(crate) fn home(shown: &Shown<'_>) -> MavMessage {
    home_at(shown.clock.now, shown.origin, shown.flight.guidance.home_E_m())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_courses_are_positive_and_below_a_turn() {
        assert_eq!(centidegrees(-1e-9), 0);
        assert_eq!(centidegrees(-std::f64::consts::FRAC_PI_2), 27_000);
        assert_eq!(centidegrees(7.0 * std::f64::consts::PI), 18_000);
    }
}
