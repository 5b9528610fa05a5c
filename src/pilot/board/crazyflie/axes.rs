//! What the board logs, in our axes, and what it is told, in its own.
//!
//! | there | here |
//! |---|---|
//! | `acc` x forward, y left, z up, g | specific force FRD, m/s² |
//! | `gyro` the same axes, °/s | rates FRD, rad/s |
//! | `stateEstimateZ.quat` body FLU to a world x, y, z up like ENU | body FRD to NED |
//! | legacy setpoint: roll right, pitch nose up, degrees; yaw counter-clockwise, degrees | as NED and FRD have them, yaw the other way |
//!
//! The board's world is the anchors' own (`loco.rs`), x in place of east: its yaw 0 looks along x, which is our 90°.

use nalgebra::{Quaternion, UnitQuaternion};

use haltere_core::frames::{B, E, G_MPS2, Rot, Vec3, attitude_from_flu_enu, body_from_flu};
use haltere_dialect::crtp::{quaternion, setpoint::Setpoint};

/// Thrust of the wire that is all there is.
pub(crate) const FULL: f64 = 65535.0;

/// Specific force, of `acc.x .y .z` in g.
pub(crate) fn specific_force([x, y, z]: [f64; 3]) -> Vec3<B> {
    body_from_flu(x, y, z) * G_MPS2
}

/// Body rates, of `gyro.x .y .z` in degrees/s.
pub(crate) fn rates(deg_ps: [f64; 3]) -> Vec3<B> {
    let [x, y, z] = deg_ps.map(f64::to_radians);
    body_from_flu(x, y, z)
}

/// Attitude, of `stateEstimateZ.quat`.
pub(crate) fn attitude(bits: u32) -> Rot<E, B> {
    let [x, y, z, w] = quaternion::unpack(bits);
    attitude_from_flu_enu(UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)))
}

/// Yaw of a setpoint in the board's frame, degrees counter-clockwise from its x.
fn yaw_deg(attitude: Rot<E, B>) -> f64 {
    90.0 - attitude.yaw_rad().to_degrees()
}

/// The setpoint that is in force: roll, pitch and yaw as it has them, degrees.
pub(crate) fn in_force([roll, pitch, yaw]: [f64; 3]) -> Rot<E, B> {
    Rot::from_euler_rad(roll.to_radians(), pitch.to_radians(), (90.0 - yaw).to_radians())
}

/// The setpoint with an absolute yaw (`flightmode.stabModeYaw` 1).
pub(crate) fn setpoint(attitude: Rot<E, B>, thrust_frac: f64) -> Setpoint {
    let [roll_rad, pitch_rad, _] = attitude.euler_rad();
    let yaw = (yaw_deg(attitude) + 180.0).rem_euclid(360.0) - 180.0;
    Setpoint::Attitude {
        roll_deg: roll_rad.to_degrees() as f32,
        pitch_deg: pitch_rad.to_degrees() as f32,
        yaw: yaw as f32,
        thrust: (thrust_frac.clamp(0.0, 1.0) * FULL).round() as u16,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The attitude that the board would log when it flies exactly what it is told.
    fn obeyed(setpoint: Setpoint) -> Rot<E, B> {
        let Setpoint::Attitude { roll_deg, pitch_deg, yaw, .. } = setpoint else { panic!() };
        // About y, left, nose down is positive: the wire's pitch is the other way.
        let [roll, pitch, yaw] = [roll_deg, -pitch_deg, yaw].map(|d| f64::from(d).to_radians());
        let q = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        attitude(quaternion::pack([q.i, q.j, q.k, q.w]))
    }

    #[test]
    fn prop_what_is_asked_for_is_what_is_logged() {
        for angles in
            [[0.0; 3], [0.2, 0.0, 0.0], [0.0, 0.3, 0.0], [0.1, -0.2, 1.0], [0.0, 0.0, -3.0]]
        {
            let asked = Rot::from_euler_rad(angles[0], angles[1], angles[2]);
            let off_rad = obeyed(setpoint(asked, 0.5)).raw().angle_to(&asked.raw());
            assert!(off_rad < 0.005, "{angles:?}: {off_rad}");
            let Setpoint::Attitude { roll_deg, pitch_deg, yaw, .. } = setpoint(asked, 0.5) else {
                panic!()
            };
            let told = in_force([roll_deg, pitch_deg, yaw].map(f64::from));
            assert!(told.raw().angle_to(&asked.raw()) < 1e-6, "{angles:?}");
        }
    }

    #[test]
    fn val_at_rest_the_force_is_upward_and_thrust_is_a_share() {
        assert_eq!(specific_force([0.0, 0.0, 1.0]).to_array(), [0.0, -0.0, -G_MPS2]);
        assert_eq!(rates([0.0, 180.0, 0.0]).y(), -std::f64::consts::PI);
        for (frac, wire) in [(0.0, 0), (1.0, 65535), (2.0, 65535), (f64::NAN, 0)] {
            let Setpoint::Attitude { thrust, .. } = setpoint(Rot::identity(), frac) else {
                panic!()
            };
            assert_eq!(thrust, wire);
        }
    }
}
