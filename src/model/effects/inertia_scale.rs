//! Moments of inertia differ from the vehicle file.
//!
//! `J_i -> κ_i J_i`. Size by judgement: ±20 to 40 %.

use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};
use crate::vehicle::Vehicle;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "I3",
    name: "inertia scale",
    block: Block::InnerLoop,
    parameters: &[
        ParameterSpec::new("roll", "", Kind::Component, 1.0, 1.3, [0.6, 1.4], "factor about x")
            .ways("smaller in roll", "larger in roll"),
        ParameterSpec::new("pitch", "", Kind::Component, 1.0, 1.3, [0.6, 1.4], "factor about y")
            .ways("smaller in pitch", "larger in pitch"),
        // Drawn as a shape is: a weaker effect keeps it.
        ParameterSpec::new("yaw", "", Kind::Shape, 1.0, 1.0, [0.6, 1.4], "factor about z")
            .ways("smaller in yaw", "larger in yaw"),
    ],
    off: "inertia of the vehicle file",
    source: "plausible sizes by judgement",
    equation: "J_i -> κ_i J_i",
    role: Role::Deviation(Deviation {
        standard: false,
        hidden: Hidden::Never,
        verdict: "The moments of inertia are {} than the simulator says.",
        causes: "parts that were added, moved or lost far from the middle",
        remedy: "look for loose or added parts far from the middle",
        shows: "another slope at the start of a doublet",
        looks_like: &["L1", "A11"],
        apart: "Inertia changes how fast a movement begins, damping (A11) how it ends, a slow \
            loop (L1) both: fly doublets of two lengths.",
    }),
    build: |b| Box::new(Edit(b.value.to_vec())),
};

struct Edit(Vec<f64>);

impl Effect for Edit {
    fn vehicle(&mut self, vehicle: &mut Vehicle) {
        if let [roll, pitch, yaw] = self.0[..] {
            for (inertia, factor) in vehicle.body.inertia_kgm2.iter_mut().zip([roll, pitch, yaw]) {
                *inertia *= factor;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_scales() {
        let j = probe::edited(&SPEC, &[]).body.inertia_kgm2;
        assert!((j[0] / 5.6e-4 - 1.3).abs() < 1e-12 && (j[2] - 3.6e-4).abs() < 1e-18);
    }
}
