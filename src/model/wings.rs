//! Wings: from command to flap rate, from flap rate to thrust, from thrust to force and moment.
//!
//! Body frame FRD, `x` forward, `y` right, `z` down. Symbols: `f` flap rate (Hz), `T` thrust of one
//! wing (N), `δ` dihedral (rad, positive: wings forward, nose up), `ψ` wing-root angle (rad,
//! positive: nose right), `c` command (0 to 1), `V` supply (V).
//!
//! ```text
//! f_target = a (c V) + b                                          (0 when c = 0)
//! T        = ½ (2 k f + T₀)       each wing, so that both give k (f_L + f_R) + T₀
//! r        = (l_w sin δ, ∓ l_w cos δ, -l_z) - r_cg                (left −, right +)
//! sin α    = (l_h sin δ ± l_y sin ψ) / l_k                        (left +, right −)
//! F        = T (sin α, 0, -cos α)         M = Σ r × F
//! ```
//!
//! Source: public dynamic model of this vehicle, after Karásek's minimal model. Its lines mix two
//! frames: forces and arms are those of a z-down body, gravity and the moment of the x-force those
//! of a z-up one, and its thrust line falls with flap rate when taken at face value. Here every
//! moment is `r × F` in FRD, which fixes all signs at once. Its yaw line holds damping only; the
//! yaw moment of the wing roots follows from the same `r × F`.
//!
//! Validity: hover and flight below some 2 m/s; `f` between 0 and 20 Hz.

use nalgebra::Vector3;

use crate::vehicle::{Vehicle, Wings};

/// What the board tells the actuators.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ActuatorCommand {
    /// Throttle of left and right wing, 0 to 1.
    pub flap_frac: [f64; 2],
    /// Dihedral servo, rad, nose up positive.
    pub dihedral_rad: f64,
    /// Wing-root servo, rad, nose right positive.
    pub yaw_servo_rad: f64,
}

/// What the actuators do.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Actuation {
    /// Flap rate of left and right wing, Hz.
    pub flap_hz: [f64; 2],
    /// Dihedral, rad.
    pub dihedral_rad: f64,
    /// Wing-root angle, rad.
    pub yaw_servo_rad: f64,
}

/// Force and moment about the centre of mass, body frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wrench {
    /// Force, N.
    pub force_B_n: Vector3<f64>,
    /// Moment, N·m.
    pub torque_B_nm: Vector3<f64>,
}

/// Flap rate that a wing settles at, Hz.
#[inline]
pub fn flap_target_hz(wings: &Wings, command_frac: f64, supply_v: f64) -> f64 {
    if command_frac <= 0.0 {
        return 0.0;
    }
    (wings.flap_hz_per_v * command_frac * supply_v + wings.flap_offset_hz).max(0.0)
}

/// Thrust of one wing, N; never negative.
#[inline]
pub fn wing_thrust_n(wings: &Wings, flap_hz: f64) -> f64 {
    (wings.thrust_n_per_hz * flap_hz + 0.5 * wings.thrust_offset_n).max(0.0)
}

/// Force and moment of both wings' thrust.
#[inline]
pub fn thrust_wrench(vehicle: &Vehicle, thrust_n: [f64; 2], a: &Actuation) -> Wrench {
    let w = &vehicle.wings;
    let sin_d = sin(a.dihedral_rad);
    let cos_d = (1.0 - sin_d * sin_d).sqrt();
    let lean = w.hinge_m * sin_d;
    let twist = w.root_m * sin(a.yaw_servo_rad);
    let mut wrench = Wrench::default();
    for (side, thrust) in [-1.0, 1.0].into_iter().zip(thrust_n) {
        let sin_a = (lean - side * twist) / w.link_m;
        let cos_a = (1.0 - sin_a * sin_a).sqrt();
        let force = Vector3::new(thrust * sin_a, 0.0, -thrust * cos_a);
        let arm = Vector3::new(w.centre_m * sin_d, side * w.centre_m * cos_d, -w.cop_m)
            - Vector3::from(vehicle.body.cg_B_m);
        wrench.force_B_n += force;
        wrench.torque_B_nm += arm.cross(&force);
    }
    wrench
}

/// Sine to 1e-6 within ±0.8 rad, the travel of the servos.
#[inline]
fn sin(x: f64) -> f64 {
    let x2 = x * x;
    x * (1.0 - x2 / 6.0 * (1.0 - x2 / 20.0 * (1.0 - x2 / 42.0 * (1.0 - x2 / 72.0))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_core::frames::G_MPS2;

    fn wrench(thrust_n: [f64; 2], dihedral_rad: f64, yaw_servo_rad: f64) -> Wrench {
        let a = Actuation { flap_hz: [12.8; 2], dihedral_rad, yaw_servo_rad };
        thrust_wrench(&Vehicle::default(), thrust_n, &a)
    }

    #[test]
    fn val_hover_rate_carries_the_weight() {
        // Public model: T = 0.040 (f_L + f_R) - 0.02 N, 12.8 Hz per wing.
        let v = Vehicle::default();
        let thrust = 2.0 * wing_thrust_n(&v.wings, 12.8);
        assert!((thrust - (0.040 * 25.6 - 0.02)).abs() < 1e-12);
        assert!((thrust / (0.102 * G_MPS2) - 1.0).abs() < 0.005);
        // command · V = 4.73 V gives that rate at any voltage.
        for supply_v in [7.1, 7.4, 7.9] {
            let f = flap_target_hz(&v.wings, 4.73 / supply_v, supply_v);
            assert!((f - 12.754).abs() < 0.01, "{f}");
        }
        assert_eq!(flap_target_hz(&v.wings, 0.0, 7.4), 0.0);
        assert_eq!(wing_thrust_n(&v.wings, 0.0), 0.0);
    }

    #[test]
    fn prop_signs_of_the_moments() {
        let level = wrench([0.5, 0.5], 0.0, 0.0);
        assert!(level.force_B_n.z < 0.0 && level.torque_B_nm.norm() < 1e-15);
        // More thrust on the left: right wing down.
        assert!(wrench([0.6, 0.4], 0.0, 0.0).torque_B_nm.x > 0.0);
        // Wings forward: nose up.
        assert!(wrench([0.5, 0.5], 0.1, 0.0).torque_B_nm.y > 0.0);
        // Positive wing-root angle: nose right.
        assert!(wrench([0.5, 0.5], 0.0, 0.2).torque_B_nm.z > 0.0);
    }

    #[test]
    fn prop_mirror_swaps_the_wings() {
        let a = wrench([0.6, 0.4], 0.12, 0.2);
        let b = wrench([0.4, 0.6], 0.12, -0.2);
        let mirror = |w: Wrench| {
            let (f, t) = (w.force_B_n, w.torque_B_nm);
            (Vector3::new(f.x, -f.y, f.z), Vector3::new(-t.x, t.y, -t.z))
        };
        let (f, t) = mirror(a);
        assert!((f - b.force_B_n).norm() < 1e-15 && (t - b.torque_B_nm).norm() < 1e-15);
    }

    #[test]
    fn prop_sine_is_good_over_the_travel() {
        for i in -80..=80 {
            let x = f64::from(i) * 0.01;
            assert!((sin(x) - x.sin()).abs() < 1e-8);
        }
    }
}
