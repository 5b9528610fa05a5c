//! Drag that grows with flap rate: each wing beat moves air that the vehicle's own speed adds to.
//!
//! ```text
//! v_c = v_air + ω × r_c          r_c = (0, 0, -l_z) - r_cg
//! F_i = -k_i (f_L + f_R) v_c,i / (1 + |v_c| / v_s)          M = r_c × F
//! ```
//! `v_air` velocity through the air (m/s), `ω` rate (rad/s), `f` flap rate (Hz), `k` coefficient
//! (N·s/m per Hz), `r_c` centre of pressure (m), `v_s` saturation speed (m/s, infinite: linear);
//! body frame. Source: public dynamic model of this vehicle (R² 0.93, 0.87, 0.90); y and z from
//! recorded flights. Valid to about 2 m/s. Left out: lift of the moving wings in fast forward flight.

use nalgebra::Vector3;

use crate::effects::{Block, Build, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};
use crate::wings::Wrench;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N1",
    name: "drag proportional to flap rate",
    block: Block::Aerodynamics,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "k_x",
            "N·s/m per Hz",
            Kind::Size,
            0.0,
            0.0169,
            [0.010, 0.027],
            "along x",
        )
        .of_vehicle(|v| &mut v.drag.k_ns_per_m_hz[0]),
        ParameterSpec::new(
            "k_y",
            "N·s/m per Hz",
            Kind::Size,
            0.0,
            0.0080,
            [0.005, 0.017],
            "along y",
        )
        .of_vehicle(|v| &mut v.drag.k_ns_per_m_hz[1]),
        ParameterSpec::new(
            "k_z",
            "N·s/m per Hz",
            Kind::Size,
            0.0,
            0.0026,
            [0.001, 0.006],
            "along z",
        )
        .of_vehicle(|v| &mut v.drag.k_ns_per_m_hz[2]),
    ],
    off: "no drag",
    source: "public Flapper model after Karásek; recorded flights for y and z",
    equation: "F_i = -k_i (f_L + f_R) (v_air + ω × r_c)_i at the centre of pressure r_c",
    build: |b| Box::new(DragEffect::new(&b)),
};

struct DragEffect {
    k: Vector3<f64>,
    arm_B_m: Vector3<f64>,
    saturation_s_per_m: f64,
}

impl DragEffect {
    fn new(b: &Build<'_>) -> Self {
        Self {
            k: Vector3::new(b.value[0], b.value[1], b.value[2]),
            arm_B_m: Vector3::new(0.0, 0.0, -b.vehicle.wings.cop_m)
                - Vector3::from(b.vehicle.body.cg_B_m),
            saturation_s_per_m: b.vehicle.drag.saturation_s_per_m,
        }
    }
}

impl Effect for DragEffect {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Wrench]
    }
    fn wrench(&mut self, s: &State, wrench: &mut Wrench) {
        let v = s.air_B_mps + s.rate_B_radps.cross(&self.arm_B_m);
        let mut beats = s.flap_hz[0] + s.flap_hz[1];
        if self.saturation_s_per_m > 0.0 {
            beats /= 1.0 + v.norm() * self.saturation_s_per_m;
        }
        let force = self.k.component_mul(&v) * -beats;
        wrench.force_B_n += force;
        wrench.torque_B_nm += self.arm_B_m.cross(&force);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    fn force(air_B_mps: Vector3<f64>) -> Wrench {
        let s = State { air_B_mps, ..probe::hover() };
        let mut w = Wrench::default();
        probe::build(&SPEC, &[]).wrench(&s, &mut w);
        w
    }

    #[test]
    fn val_forward_drag_is_4_2_per_second_in_hover() {
        let rate = -force(Vector3::new(1.0, 0.0, 0.0)).force_B_n.x / 0.102;
        assert!((rate - 4.2).abs() < 0.05, "{rate}"); // VEHICLE.md: 3.4 to 4.2 1/s
        let rate = -force(Vector3::new(0.0, 1.0, 0.0)).force_B_n.y / 0.102;
        assert!((1.85..2.1).contains(&rate), "{rate}"); // recorded flights
        let rate = -force(Vector3::new(0.0, 0.0, 1.0)).force_B_n.z / 0.102;
        assert!((rate - 0.65).abs() < 0.02, "{rate}"); // recorded flights
    }

    #[test]
    fn prop_sign_lever_and_mirror() {
        let still = force(Vector3::zeros());
        assert_eq!((still.force_B_n.norm(), still.torque_B_nm.norm()), (0.0, 0.0));
        // Air from the front acts above the centre of mass: nose up.
        assert!(force(Vector3::new(1.0, 0.0, 0.0)).torque_B_nm.y > 0.0);
        let (a, b) = (force(Vector3::new(0.7, 0.4, 0.1)), force(Vector3::new(0.7, -0.4, 0.1)));
        assert!((a.force_B_n.y + b.force_B_n.y).abs() < 1e-15);
        assert!((a.torque_B_nm.x + b.torque_B_nm.x).abs() < 1e-15);
        assert_eq!(a.force_B_n.x, b.force_B_n.x);
    }
}
