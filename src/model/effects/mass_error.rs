//! The vehicle weighs more than the file says.
//!
//! `m -> m + Δm` (kg, given in g). Size by judgement: 2 to 12 g. The drag rate
//! k/m falls with it.

use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};
use crate::vehicle::Vehicle;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "I1",
    name: "mass",
    block: Block::Thrust,
    parameters: &[ParameterSpec::new(
        "extra",
        "g",
        Kind::Size,
        0.0,
        6.0,
        [2.0, 12.0],
        "further mass; goes with the mass",
    )
    .beside(|v| v.body.mass_kg)],
    off: "mass of the vehicle file",
    source: "plausible sizes by judgement",
    equation: "m -> m + Δm",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.354, 0.707, 1.0]),
        verdict: "The vehicle is {extra} heavier than the simulator says.",
        causes: "a heavier battery, a camera or guards that were added, glue of repairs",
        remedy: "weigh the vehicle; take off what was added, or set the mass in the vehicle file",
        shows: "more throttle in hover, and speed that decays more slowly",
        looks_like: &["P1"],
        apart: "Weigh the vehicle: worn wings (P1) take more throttle too, but the scale does not \
            show them.",
    }),
    build: |b| Box::new(Edit(b.value.to_vec())),
};

struct Edit(Vec<f64>);

impl Effect for Edit {
    fn vehicle(&mut self, vehicle: &mut Vehicle) {
        if let [extra] = self.0[..] {
            vehicle.body.mass_kg += extra * 1e-3;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_adds_grams() {
        assert!((probe::edited(&SPEC, &[]).body.mass_kg - 0.108).abs() < 1e-12);
    }
}
