//! Rotational damping differs from the vehicle file.
//!
//! `M -> κ M` in N2. Size by judgement: ±50 %.

use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};
use crate::vehicle::Vehicle;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "A11",
    name: "rotational damping scale",
    block: Block::Aerodynamics,
    parameters: &[ParameterSpec::new("kappa", "", Kind::Component, 1.0, 0.6, [0.5, 1.5], "factor")
        .ways("less", "more")],
    off: "damping of the vehicle file",
    source: "plausible sizes by judgement",
    equation: "M -> κ M",
    role: Role::Deviation(Deviation {
        standard: false,
        hidden: Hidden::Never,
        verdict: "The air damps rotation {kappa} than the simulator says.",
        causes: "wings of another size or farther from the middle, softer or stiffer film",
        remedy: "check servos and linkages for friction; check the board's gains",
        shows: "doublets that decay otherwise at the same gain",
        looks_like: &["L1"],
        apart: "A slow loop (L1) is late from the start of a movement, damping changes how it \
            ends: fly roll and pitch doublets.",
    }),
    build: |b| Box::new(Edit(b.value.to_vec())),
};

struct Edit(Vec<f64>);

impl Effect for Edit {
    fn vehicle(&mut self, vehicle: &mut Vehicle) {
        if let [kappa] = self.0[..] {
            vehicle.drag.damping_factor *= kappa;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_scales() {
        assert_eq!(probe::edited(&SPEC, &[]).drag.damping_factor, 0.6);
    }
}
