//! Damping of rotation: each wing meets its own air, because it sits beside the centre of mass.
//!
//! ```text
//! L = κ k_z l_w [ (f_L - f_R) w - l_w (f_L + f_R) p ]
//! N = -κ k_x l_w [ (f_L - f_R) u + l_w (f_L + f_R) r ]
//! ```
//! `u`, `w` velocity through the air along x and z (m/s), `p`, `r` roll and yaw rate (rad/s), `f`
//! flap rates (Hz), `k` drag coefficients (N·s/m per Hz), `l_w` wing centre (m), `κ` factor; body
//! frame. Source: drag of the public model taken at each wing; has the form of its yaw line. Pitch
//! damping follows from the lever in N1. Valid in hover. Left out: dihedral in the arms.

use crate::effects::{Block, Build, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};
use crate::wings::Wrench;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N2",
    name: "rotational damping from wing velocities",
    block: Block::Aerodynamics,
    role: Role::Nominal,
    parameters: &[ParameterSpec::new(
        "factor",
        "",
        Kind::Size,
        0.0,
        1.0,
        [0.5, 1.5],
        "factor on the damping",
    )
    .of_vehicle(|v| &mut v.drag.damping_factor)],
    off: "no damping of roll and yaw beyond the lever of the drag",
    source: "public Flapper model, yaw line; derived from N1 at each wing",
    equation: "M = Σ r_w × F_drag(v_air + ω × r_w) over both wings, differences only",
    build: |b| Box::new(RotationalDamping::new(&b)),
};

struct RotationalDamping {
    roll: f64,
    yaw: f64,
    arm_m: f64,
}

impl RotationalDamping {
    fn new(b: &Build<'_>) -> Self {
        let (k, arm_m) = (b.vehicle.drag.k_ns_per_m_hz, b.vehicle.wings.centre_m);
        Self { roll: b.value[0] * k[2] * arm_m, yaw: b.value[0] * k[0] * arm_m, arm_m }
    }
}

impl Effect for RotationalDamping {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Wrench]
    }
    fn wrench(&mut self, s: &State, wrench: &mut Wrench) {
        let (sum, difference) = (s.flap_hz[0] + s.flap_hz[1], s.flap_hz[0] - s.flap_hz[1]);
        let (v, w) = (s.air_B_mps, s.rate_B_radps);
        wrench.torque_B_nm.x += self.roll * (difference * v.z - self.arm_m * sum * w.x);
        wrench.torque_B_nm.z -= self.yaw * (difference * v.x + self.arm_m * sum * w.z);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;
    use nalgebra::Vector3;

    fn torque(rate_B_radps: Vector3<f64>, air_B_mps: Vector3<f64>, flap: [f64; 2]) -> Vector3<f64> {
        let s = State { rate_B_radps, air_B_mps, flap_hz: flap, ..probe::hover() };
        let mut w = Wrench::default();
        probe::build(&SPEC, &[]).wrench(&s, &mut w);
        w.torque_B_nm
    }

    #[test]
    fn prop_damps_and_mirrors() {
        let (zero, even) = (Vector3::zeros(), [12.75; 2]);
        assert_eq!(torque(zero, Vector3::new(1.0, 2.0, 3.0), even), zero);
        let t = torque(Vector3::new(1.0, 1.0, 1.0), zero, even);
        assert!(t.x < 0.0 && t.y == 0.0 && t.z < 0.0);
        // Yaw damping 7.7 1/s: 0.08² · 0.0169 · 25.5 / 3.6e-4.
        assert!((-t.z / 3.6e-4 - 7.66).abs() < 0.05, "{}", -t.z / 3.6e-4);
        let a = torque(zero, Vector3::new(1.0, 0.0, 0.5), [13.0, 12.0]);
        let b = torque(zero, Vector3::new(1.0, 0.0, 0.5), [12.0, 13.0]);
        assert_eq!((a.x, a.z), (-b.x, -b.z));
    }
}
