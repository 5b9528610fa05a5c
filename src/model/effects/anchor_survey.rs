//! An anchor does not stand where the survey says.
//!
//! `p_n -> p_n + Δ` (m, Earth), for the anchor as it truly stands; the companion keeps the survey. Times of flight between
//! anchors follow the truth. Size by judgement: 0.1 to 0.5 m.

use nalgebra::Vector3;

use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "U7",
    name: "anchor survey error",
    block: Block::Uwb,
    parameters: &[
        ParameterSpec::new("north", "m", Kind::Component, 0.0, 0.25, [-0.5, 0.5], "towards north")
            .ways("farther south", "farther north"),
        ParameterSpec::new("east", "m", Kind::Component, 0.0, 0.0, [-0.5, 0.5], "towards east")
            .ways("farther west", "farther east"),
        ParameterSpec::new(
            "down",
            "m",
            Kind::Component,
            0.0,
            0.0,
            [-0.5, 0.5],
            "towards the floor",
        )
        .ways("higher", "lower"),
        ParameterSpec::anchor("place"),
    ],
    off: "anchors where the survey says",
    source: "plausible sizes by judgement",
    equation: "p_n -> p_n + Δ",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.2, 0.4, 0.8]),
        verdict: "{anchor} does not stand where the survey has it, but {}.",
        causes: "an anchor that was moved or knocked, a slip with the tape measure",
        remedy: "measure the anchor again and correct the survey",
        shows: "an error of one anchor that changes with the direction to it",
        looks_like: &["U2"],
        apart: "A bias (U2) is the same everywhere: fly the square along the walls at two \
            heights, or measure the anchor's place by tape.",
    }),
    build: |b| {
        Box::new(AnchorSurvey {
            shift_E_m: Vector3::new(b.value[0], b.value[1], b.value[2]),
            anchor: b.value[3] as usize,
        })
    },
};

struct AnchorSurvey {
    shift_E_m: Vector3<f64>,
    anchor: usize,
}

impl Effect for AnchorSurvey {
    fn sites(&mut self, sites_E_m: &mut [Vector3<f64>]) {
        if let Some(site) = sites_E_m.get_mut(self.anchor) {
            *site += self.shift_E_m;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_moves_that_anchor() {
        let (mut sites, before) = (probe::sites(), probe::sites());
        probe::build(&SPEC, &[("anchor", 5.0), ("down", 0.1)]).sites(&mut sites);
        assert!((sites[5] - before[5] - Vector3::new(0.25, 0.0, 0.1)).norm() < 1e-12);
        assert_eq!(sites[..5], before[..5]);
        probe::build(&SPEC, &[("anchor", 99.0)]).sites(&mut sites);
    }
}
