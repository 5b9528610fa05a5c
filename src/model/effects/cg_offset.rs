//! The centre of mass is not where it was drawn.
//!
//! `r -> r - Δ` for every force, so thrust gives a moment `Δ × T`. Body frame, millimetres. Size by judgement: 1 to
//! 5 mm. Left out: change of inertia.

use super::servo_trim::KEPT;
use crate::board::BoardSettings;
use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};
use crate::vehicle::Vehicle;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "I2",
    name: "centre of mass",
    block: Block::Aerodynamics,
    parameters: &[
        ParameterSpec::new(
            "x",
            "mm",
            Kind::Component,
            0.0,
            1.0,
            [-5.0, 5.0],
            "forward; goes with the wing",
        )
        .ways("to the back", "to the front")
        .beside(|v| v.wings.centre_m),
        ParameterSpec::new(
            "y",
            "mm",
            Kind::Component,
            0.0,
            0.0,
            [-5.0, 5.0],
            "right; goes with the wing",
        )
        .ways("to the left", "to the right")
        .beside(|v| v.wings.centre_m),
        KEPT,
    ],
    off: "centre of mass of the vehicle file",
    source: "plausible sizes by judgement",
    equation: "r -> r - Δ",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.25, 0.5, 1.0]),
        verdict: "The centre of mass is off by {}.",
        causes: "a battery that sits elsewhere, added parts, a repair on one side",
        remedy: "move the battery so that the vehicle balances where it is drawn",
        shows: "a lean in proportion to throttle; a lever arm at doublets",
        looks_like: &["P6", "L3"],
        apart: "Balance the vehicle on an edge, along and across: unequal wings (P6) and servos \
            off their centre (L3) do not show there.",
    }),
    build: |b| Box::new(Edit(b.value.to_vec())),
};

struct Edit(Vec<f64>);

impl Effect for Edit {
    fn board(&mut self, board: &mut BoardSettings) {
        board.kept *= self.0.get(2).copied().unwrap_or(1.0);
    }
    fn vehicle(&mut self, vehicle: &mut Vehicle) {
        if let [x, y, _] = self.0[..] {
            vehicle.body.cg_B_m[0] += x * 1e-3;
            vehicle.body.cg_B_m[1] += y * 1e-3;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_mass_forward_pitches_down_and_mass_right_rolls_right() {
        use crate::wings::{Actuation, thrust_wrench};
        let torque = |given| {
            thrust_wrench(&probe::edited(&SPEC, given), [0.5; 2], &Actuation::default()).torque_B_nm
        };
        // 1 mm times 1 N.
        assert!((torque(&[]).y + 1e-3).abs() < 1e-9);
        assert!((torque(&[("x", 0.0), ("y", 1.0)]).x - 1e-3).abs() < 1e-9);
    }
}
