//! Dihedral servo: second order with end stops.
//!
//! `δ'' = ω² (δ_target - δ) - 2 ζ ω δ'`, |δ| ≤ limit; solved exactly over a step with the target
//! held. `δ` dihedral (rad), `ω` natural frequency (rad/s), `ζ` damping. Source: public dynamic model
//! of this vehicle: 40 rad/s, 0.634, ±18°. Left out: rate limit, load of the wings.

use crate::effects::{Block, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};
use crate::servo::SecondOrder;
use crate::wings::Actuation;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N5",
    name: "pitch servo",
    block: Block::Actuators,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "frequency",
            "rad/s",
            Kind::Inverse,
            1e9,
            40.0,
            [15.0, 80.0],
            "natural frequency",
        )
        .of_vehicle(|v| &mut v.pitch_servo.frequency_radps),
        ParameterSpec::new("damping", "", Kind::Component, 1.0, 0.634, [0.4, 1.2], "damping ratio")
            .of_vehicle(|v| &mut v.pitch_servo.damping),
    ],
    off: "dihedral jumps to its command, still within its end stops",
    source: "public Flapper model",
    equation: "δ'' = ω² (δ_target - δ) - 2 ζ ω δ'",
    build: |b| Box::new(PitchServo(SecondOrder::new(b.value[0], b.value[1]))),
};

struct PitchServo(SecondOrder);

impl Effect for PitchServo {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Actuate]
    }
    fn actuate(&mut self, _s: &State, actuation: &mut Actuation) {
        actuation.dihedral_rad = self.0.step(actuation.dihedral_rad);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn val_overshoots_as_its_damping_says() {
        let mut servo = probe::build(&SPEC, &[]);
        let mut peak: f64 = 0.0;
        for _ in 0..200 {
            let mut a = Actuation { dihedral_rad: 0.1, ..Actuation::default() };
            servo.actuate(&probe::hover(), &mut a);
            peak = peak.max(a.dihedral_rad);
        }
        // e^(-πζ/√(1-ζ²)) = 7.6 % for ζ = 0.634.
        assert!((peak / 0.1 - 1.076).abs() < 0.002, "{peak}");
        let mut a = Actuation::default();
        probe::build(&SPEC, &[]).actuate(&probe::hover(), &mut a);
        assert_eq!(a.dihedral_rad, 0.0);
    }
}
