//! Wings bend back in forward flight and take the centre of pressure with them.
//!
//! `M_y = -c l_w (T_L + T_R) u`, with `c` bend per airspeed (rad per m/s), `l_w` wing centre (m), `T`
//! thrust (N), `u` velocity through the air along x (m/s); body frame. Source: 0.175 rad per m/s on
//! the smaller Nimble (Karásek 2018); 0.145 here, so that it balances the lever of the drag in hover
//! (l_z k_x (f_L + f_R) = l_w c W), as the clean v(θ) law of the flights demands. Valid to 2 m/s.

use crate::effects::{Block, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};
use crate::wings::Wrench;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N3",
    name: "passive dihedral",
    block: Block::Aerodynamics,
    role: Role::Nominal,
    parameters: &[ParameterSpec::new(
        "bend",
        "rad per m/s",
        Kind::Size,
        0.0,
        0.145,
        [0.0, 0.3],
        "bend per airspeed",
    )
    .of_vehicle(|v| &mut v.wings.passive_dihedral_rad_per_mps)],
    off: "stiff wings: full nose-up moment of the drag above the centre of mass",
    source: "Karásek et al. 2018 (DelFly Nimble), scaled",
    equation: "M_y = -c l_w (T_L + T_R) u",
    build: |b| Box::new(PassiveDihedral { lever_s: b.value[0] * b.vehicle.wings.centre_m }),
};

struct PassiveDihedral {
    lever_s: f64,
}

impl Effect for PassiveDihedral {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Wrench]
    }
    fn wrench(&mut self, s: &State, wrench: &mut Wrench) {
        wrench.torque_B_nm.y -= self.lever_s * (s.thrust_n[0] + s.thrust_n[1]) * s.air_B_mps.x;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::{drag, probe};
    use nalgebra::Vector3;

    #[test]
    fn prop_balances_the_lever_of_the_drag_in_hover() {
        let s = State { air_B_mps: Vector3::new(1.0, 0.0, 0.0), ..probe::hover() };
        let (mut bend, mut both) = (Wrench::default(), Wrench::default());
        probe::build(&SPEC, &[]).wrench(&s, &mut bend);
        probe::build(&SPEC, &[]).wrench(&s, &mut both);
        probe::build(&drag::SPEC, &[]).wrench(&s, &mut both);
        assert!(bend.torque_B_nm.y < -0.011, "nose down against the wind");
        assert!(both.torque_B_nm.y.abs() < 0.03 * bend.torque_B_nm.y.abs());
        let mut still = Wrench::default();
        probe::build(&SPEC, &[]).wrench(&probe::hover(), &mut still);
        assert_eq!(still.torque_B_nm.norm(), 0.0);
    }
}
