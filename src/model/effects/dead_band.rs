//! Play in the dihedral linkage: the wings follow only when the servo has crossed the gap.
//!
//! `δ_wing = clamp(δ_wing, δ_servo - b, δ_servo + b)`, `b` half of the play (deg). Size by judgement: 0.5 to 3° of play.
//! Small doublets vanish, large ones pass. Left out: play of the wing roots.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};
use crate::wings::ActuatorCommand;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "L4",
    name: "backlash",
    block: Block::Actuators,
    parameters: &[ParameterSpec::new(
        "play",
        "deg",
        Kind::Size,
        0.0,
        1.5,
        [0.5, 3.0],
        "whole width of the play",
    )],
    off: "no play",
    source: "plausible sizes by judgement",
    equation: "δ_wing = clamp(δ_wing, δ_servo ± b)",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.354, 0.707, 1.0]),
        verdict: "The linkage of the dihedral servo has {play} of play.",
        causes: "worn joints or servo horns, loose screws",
        remedy: "tighten the linkages: there is play in them",
        shows: "small doublets vanish, large ones pass",
        looks_like: &["L1"],
        apart: "A slow loop (L1) is late at any size: fly roll and pitch doublets of two sizes.",
    }),
    build: |b| Box::new(DeadBand { half_rad: 0.5 * b.value[0].to_radians(), wing_rad: 0.0 }),
};

struct DeadBand {
    half_rad: f64,
    wing_rad: f64,
}

impl Effect for DeadBand {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Command]
    }
    fn command(&mut self, _s: &State, command: &mut ActuatorCommand) {
        let servo = command.dihedral_rad;
        self.wing_rad = self.wing_rad.max(servo - self.half_rad).min(servo + self.half_rad);
        command.dihedral_rad = self.wing_rad;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_small_moves_vanish_and_large_ones_come_short() {
        let mut band = probe::build(&SPEC, &[]);
        let mut wing = |deg: f64| {
            let dihedral_rad = deg.to_radians();
            let mut c = ActuatorCommand { dihedral_rad, ..ActuatorCommand::default() };
            band.command(&probe::hover(), &mut c);
            c.dihedral_rad.to_degrees()
        };
        assert_eq!(wing(0.5), 0.0);
        assert!((wing(5.0) - 4.25).abs() < 1e-9);
        assert!((wing(4.0) - 4.25).abs() < 1e-9, "stays on the way back");
        assert!((wing(2.0) - 2.75).abs() < 1e-9);
    }
}
