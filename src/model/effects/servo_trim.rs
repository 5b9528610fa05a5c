//! Servos are not centred.
//!
//! `δ -> δ + Δ`, `ψ -> ψ + Δ` at the servos (deg). One degree of dihedral leans the hovering vehicle by some 0.5°
//! through the board's loop. Source: GAP.md L3, whose 1 to 4° are the lean. Independent of throttle, which tells it
//! from P6 and I2.

use crate::effects::{Block, Effect, EffectSpec, ParameterSpec, Role, Stage, State};
use crate::wings::{ActuatorCommand};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "L3",
    name: "servo trim",
    block: Block::Actuators,
    role: Role::Deviation,
    parameters: &[ParameterSpec::new("dihedral", "deg", 0.0, 3.0, [-6.0, 6.0], "dihedral servo, nose up"),
ParameterSpec::new("yaw", "deg", 0.0, 0.0, [-10.0, 10.0], "wing-root servo, nose right")],
    off: "servos centred",
    source: "GAP.md 3.4",
    equation: "δ -> δ + Δ, ψ -> ψ + Δ",
    build: |b| Box::new(ServoTrim([b.value[0].to_radians(), b.value[1].to_radians()])),
};

struct ServoTrim([f64; 2]);

impl Effect for ServoTrim {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Command]
    }
    fn command(&mut self, _s: &State, command: &mut ActuatorCommand) {
        command.dihedral_rad += self.0[0];
        command.yaw_servo_rad += self.0[1];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_adds_to_the_servos() {
        let mut c = ActuatorCommand { dihedral_rad: 0.1, ..ActuatorCommand::default() };
        probe::build(&SPEC, &[("yaw", -2.0)]).command(&probe::hover(), &mut c);
        assert!((c.dihedral_rad - 0.1 - 3f64.to_radians()).abs() < 1e-12);
        assert!((c.yaw_servo_rad + 2f64.to_radians()).abs() < 1e-12 && c.flap_frac == [0.0; 2]);
    }
}
