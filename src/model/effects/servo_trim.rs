//! Servos are not centred.
//!
//! `δ -> δ + Δ`, `ψ -> ψ + Δ` at the servos (deg). One degree of dihedral leans the hovering Flapper by some 0.5°
//! through the board's loop, one of the wing roots turns it by 3°. Size by judgement: 1 to 4° of lean; the wing roots as
//! far as turns it by 20°, which nobody overlooks and the loop still acts on. What a trim does goes with the stiffness of the
//! loop, so the sizes go with it; a board whose integrator does not leak hides it (`kept`). Independent of throttle, which tells it
//! from P6 and I2.

use crate::board::BoardSettings;
use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};
use crate::vehicle::Vehicle;
use crate::wings::ActuatorCommand;
use haltere_core::frames::G_MPS2;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "L3",
    name: "servo trim",
    block: Block::Actuators,
    parameters: &[
        ParameterSpec::new(
            "dihedral",
            "deg",
            Kind::Component,
            0.0,
            3.0,
            [-6.0, 6.0],
            "dihedral servo, nose up; goes with the pitch loop",
        )
        .ways("on the dihedral servo (nose down)", "on the dihedral servo (nose up)")
        .beside(|v| {
            let wings = &v.wings;
            let arm_m = wings.centre_m - wings.cop_m * wings.hinge_m / wings.link_m;
            trim_per_error(v, 1, arm_m) * (1.0 + v.inner_loop.boost)
        }),
        ParameterSpec::new(
            "yaw",
            "deg",
            Kind::Component,
            0.0,
            0.0,
            [-6.0, 6.0],
            "wing-root servo, nose right; goes with the yaw loop",
        )
        .ways("on the wing-root servo (nose left)", "on the wing-root servo (nose right)")
        .beside(|v| trim_per_error(v, 2, v.wings.centre_m * v.wings.root_m / v.wings.link_m)),
        KEPT,
    ],
    off: "servos centred",
    source: "plausible sizes by judgement",
    equation: "δ -> δ + Δ, ψ -> ψ + Δ",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.25, 0.5, 1.0]),
        verdict: "Servos are off their centre by {}.",
        causes: "a servo horn that is one tooth off, a bent rod, a servo that was replaced",
        remedy: "centre the servos, or set a trim in the companion's configuration",
        shows: "a constant command of a servo, and as much lean as the board leaves of it",
        looks_like: &["I2", "P6", "M4"],
        apart: "It does not follow throttle, as I2, P6 and M4 do: fly throttle doublets, or \
            measure both servos at neutral with a protractor.",
    }),
    build: |b| {
        let trim_rad = [b.value[0].to_radians(), b.value[1].to_radians()];
        Box::new(ServoTrim { trim_rad, kept: b.value[2] })
    },
};

/// Boards differ in how much of a steady moment they trim out by themselves, which a healthy flight hardly shows.
pub(super) const KEPT: ParameterSpec = ParameterSpec::new(
    "kept",
    "",
    Kind::Shape,
    1.0,
    1.0,
    [0.05, 1.0],
    "share of the standing error that the board's integrator leaves",
);

/// Angle of a servo whose moment in hover the loop of this axis holds with one radian of error: `J ω² / (W a)`, with `a` the
/// lever of the thrust (m) and `W` the weight (N).
fn trim_per_error(v: &Vehicle, axis: usize, arm_m: f64) -> f64 {
    let stiffness_nm = v.body.inertia_kgm2[axis] * v.inner_loop.frequency_radps[axis].powi(2);
    stiffness_nm / (v.body.mass_kg * G_MPS2 * arm_m)
}

struct ServoTrim {
    trim_rad: [f64; 2],
    kept: f64,
}

impl Effect for ServoTrim {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Command]
    }
    fn board(&mut self, board: &mut BoardSettings) {
        board.kept *= self.kept;
    }
    fn command(&mut self, _s: &State, command: &mut ActuatorCommand) {
        command.dihedral_rad += self.trim_rad[0];
        command.yaw_servo_rad += self.trim_rad[1];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_a_board_trims_out_all_but_what_is_kept() {
        let mut board = BoardSettings::default();
        probe::build(&SPEC, &[("kept", 0.1)]).board(&mut board);
        let file = Vehicle::default().inner_loop;
        let [it, same] = [board.kept, 1.0].map(|kept| file.keeping(kept));
        // A steady moment leaves 1 / (1 + boost).
        assert!((1.0 + it.boost - 10.0 * (1.0 + file.boost)).abs() < 1e-9);
        assert!((1.0 + it.boost_yaw - 10.0).abs() < 1e-9);
        assert_eq!(same, file);
    }

    #[test]
    fn prop_adds_to_the_servos() {
        let mut c = ActuatorCommand { dihedral_rad: 0.1, ..ActuatorCommand::default() };
        probe::build(&SPEC, &[("yaw", -2.0)]).command(&probe::hover(), &mut c);
        assert!((c.dihedral_rad - 0.1 - 3f64.to_radians()).abs() < 1e-12);
        assert!((c.yaw_servo_rad + 2f64.to_radians()).abs() < 1e-12 && c.flap_frac == [0.0; 2]);
    }
}
