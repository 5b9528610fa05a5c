//! Ground effect differs from the vehicle file.
//!
//! `T -> T (1 + g e^(-h/l))` on top of N8; same symbols. Size by judgement: g -0.1 to 0.3, l 0.1 to 0.4 m.

use crate::effects::{Block, Deviation, EffectSpec, Hidden, Kind, ParameterSpec, Role};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "A8",
    name: "ground effect error",
    block: Block::Aerodynamics,
    parameters: &[
        ParameterSpec::new(
            "gain",
            "",
            Kind::Component,
            0.0,
            0.15,
            [-0.1, 0.3],
            "further gain at the floor",
        )
        .ways("less", "more"),
        ParameterSpec::decay(0.25, [0.1, 0.4]),
    ],
    off: "ground effect of the vehicle file",
    source: "plausible sizes by judgement",
    equation: "T -> T (1 + g e^(-h/l))",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::WhenAsked([0.707, 1.0, 1.0]),
        verdict: "At the floor the wings give {gain} thrust than the simulator says.",
        causes: "wings of another size or at another height over the floor, a soft or uneven floor",
        remedy: "nothing to repair: the nominal model lacks it; take the scenario patch",
        shows: "another throttle below 0.5 m",
        looks_like: &["U6"],
        apart: "The ground effect is in the force, multipath (U6) in the UWB: fly the ladder of \
            heights.",
    }),
    build: |b| Box::new(GroundEffect { gain: b.value[0], length_m: b.value[1].max(0.01) }),
};

// The law is that of N8; a second copy of it would only drift away.
use crate::effects::ground_effect::GroundEffect;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_acts_near_the_floor_only() {
        use crate::effects::State;
        let factor = |height_m| {
            let mut t = [1.0; 2];
            probe::build(&SPEC, &[]).thrust(&State { height_m, ..probe::hover() }, &mut t);
            t[1]
        };
        assert!((factor(0.0) - 1.15).abs() < 1e-12 && factor(2.0) == 1.0);
    }
}
