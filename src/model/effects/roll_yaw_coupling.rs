//! Rolling by unequal flapping turns the vehicle too.
//!
//! `M_z += c M_x`, `M_x = l_w (T_L - T_R)` (N·m, body). Size by judgement: 0.1 to 0.6.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};
use crate::wings::Wrench;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "L6",
    name: "roll-yaw coupling",
    block: Block::InnerLoop,
    parameters: &[ParameterSpec::new(
        "coupling",
        "",
        Kind::Component,
        0.0,
        0.3,
        [-0.6, 0.6],
        "yaw moment over roll moment",
    )
    .ways(
        "of its moment turns it to the opposite side",
        "of its moment turns it to the same side",
    )],
    off: "roll by thrust gives no yaw",
    source: "plausible sizes by judgement",
    equation: "M_z += c l_w (T_L - T_R)",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.354, 0.707, 1.0]),
        verdict: "A roll command turns the nose as well: {coupling}.",
        causes: "wing roots that stick or turn unevenly, wings at unequal angles",
        remedy: "check that the wing roots turn freely and evenly",
        shows: "an error of heading that comes with the roll command",
        looks_like: &["H1"],
        apart: "A turned heading (H1) pushes every dash to the same side, a coupling turns the \
            nose only while it rolls: fly single dashes in x and in y.",
    }),
    build: |b| Box::new(RollYawCoupling(b.value[0] * b.vehicle.wings.centre_m)),
};

struct RollYawCoupling(f64);

impl Effect for RollYawCoupling {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Wrench]
    }
    fn wrench(&mut self, s: &State, wrench: &mut Wrench) {
        wrench.torque_B_nm.z += self.0 * (s.thrust_n[0] - s.thrust_n[1]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_only_with_unequal_thrust() {
        let yaw = |thrust_n| {
            let mut w = Wrench::default();
            probe::build(&SPEC, &[]).wrench(&State { thrust_n, ..probe::hover() }, &mut w);
            w.torque_B_nm.z
        };
        assert_eq!(yaw([0.5, 0.5]), 0.0);
        assert!(yaw([0.6, 0.4]) > 0.0 && yaw([0.6, 0.4]) == -yaw([0.4, 0.6]));
    }
}
