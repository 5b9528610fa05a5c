//! What clients see of positions on Earth and of heights.

use haltere_dialect::mav::haltere::{
    ALTITUDE_DATA, GLOBAL_POSITION_INT_DATA, GPS_RAW_INT_DATA, GpsFixType, MavMessage, VFR_HUD_DATA,
};

use haltere_core::time::HostTime;

use crate::Pilot;

/// Standard deviations of position are told as dilution of precision with this range error, m: MAVLink
/// wants a unitless number there, and one metre makes it the same number.
const RANGE_ERROR_M: f64 = 1.0;

/// Compass course in hundredths of a degree, 0 to 35999.
fn centidegrees(angle_rad: f64) -> u16 {
    let degrees = angle_rad.to_degrees().rem_euclid(360.0);
    ((degrees * 100.0).round() as u16) % 36_000
}

/// MAVLink counts altitudes in these. Saturates.
pub(crate) fn millimetres(altitude_m: f64) -> i32 {
    (altitude_m * 1e3).round() as i32
}

fn wire_i16(value: f64) -> i16 {
    value.round() as i16
}

impl Pilot {
    /// GLOBAL_POSITION_INT.
    pub(crate) fn global_position(&self, at: HostTime) -> MavMessage {
        let estimate = &self.estimate;
        let place = self.origin.to_global(estimate.pos_E_m);
        let [lat, lon] = place.to_e7();
        let vel = estimate.vel_E_mps();
        let [north, east, _] = self.origin.to_true_north(vel);
        MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            time_boot_ms: (at.as_us() / 1000) as u32,
            lat,
            lon,
            alt: millimetres(place.alt_m),
            // Home lies on the floor.
            relative_alt: (-estimate.pos_E_m.z() * 1e3).round() as i32,
            vx: wire_i16(north * 100.0),
            vy: wire_i16(east * 100.0),
            vz: wire_i16(vel.z() * 100.0),
            hdg: centidegrees(self.origin.true_yaw_rad(estimate.R_EB.yaw_rad())),
        })
    }

    /// GPS_RAW_INT of a receiver that does not exist: our own estimate, by configuration only.
    pub(crate) fn gps_raw(&self, at: HostTime, aligned: bool) -> MavMessage {
        let estimate = &self.estimate;
        let place = self.origin.to_global(estimate.pos_E_m);
        let [lat, lon] = place.to_e7();
        let vel = estimate.vel_E_mps();
        let [north, east, _] = self.origin.to_true_north(vel);
        let std = estimate.std_pos_E_m;
        let horizontal_m = std.x().hypot(std.y());
        let dilution = |std_m: f64| (std_m / RANGE_ERROR_M * 100.0).clamp(0.0, 65534.0) as u16;
        let accuracy_mm = |std_m: f64| (std_m * 1e3).clamp(0.0, 1e9) as u32;
        let yaw_rad = self.origin.true_yaw_rad(estimate.R_EB.yaw_rad());
        MavMessage::GPS_RAW_INT(GPS_RAW_INT_DATA {
            time_usec: at.as_us(),
            lat,
            lon,
            alt: millimetres(place.alt_m),
            eph: dilution(horizontal_m),
            epv: dilution(std.z()),
            vel: (north.hypot(east) * 100.0).clamp(0.0, 65534.0) as u16,
            cog: centidegrees(east.atan2(north)),
            fix_type: if aligned {
                GpsFixType::GPS_FIX_TYPE_3D_FIX
            } else {
                GpsFixType::GPS_FIX_TYPE_NO_FIX
            },
            // What is in view are anchors.
            satellites_visible: self.navigation.tag.engine.anchors_heard().count().min(254) as u8,
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
    pub(crate) fn vfr_hud(&self) -> MavMessage {
        let estimate = &self.estimate;
        let vel = estimate.vel_E_mps();
        let heading_rad = self.origin.true_yaw_rad(estimate.R_EB.yaw_rad());
        let throttle =
            if self.flight.mode.has_thrust() { self.flight.control.thrust_frac } else { 0.0 };
        MavMessage::VFR_HUD(VFR_HUD_DATA {
            // The air of a room is at rest.
            airspeed: vel.norm() as f32,
            groundspeed: vel.x().hypot(vel.y()) as f32,
            alt: self.origin.to_global(estimate.pos_E_m).alt_m as f32,
            climb: -vel.z() as f32,
            heading: (centidegrees(heading_rad) / 100).cast_signed(),
            throttle: (throttle * 100.0).round().clamp(0.0, 100.0) as u16,
        })
    }

    /// ALTITUDE.
    pub(crate) fn altitude(&self, at: HostTime) -> MavMessage {
        let height_m = -self.estimate.pos_E_m.z();
        MavMessage::ALTITUDE(ALTITUDE_DATA {
            time_usec: at.as_us(),
            altitude_monotonic: height_m as f32,
            altitude_amsl: (height_m + self.origin.place().alt_m) as f32,
            altitude_local: height_m as f32,
            altitude_relative: height_m as f32,
            altitude_terrain: self.origin.place().alt_m as f32,
            bottom_clearance: self.height_above_floor_m().max(0.0) as f32,
        })
    }
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
