//! One anchor's path grows with time: its antenna or crystal warms up.
//!
//! `ρ_n -> ρ_n + ḃ t` (m), `t` time (s). Size by judgement: 2 to 10 mm/s ramp.

use crate::effects::anchor_bias::LongerPath;
use crate::effects::{Block, Deviation, EffectSpec, Hidden, Kind, ParameterSpec, Role};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "U8",
    name: "anchor drift",
    block: Block::Uwb,
    parameters: &[
        ParameterSpec::new("rate", "mm/s", Kind::Component, 0.0, 5.0, [-10.0, 10.0], "growth")
            .ways("and get shorter", "and get longer"),
        ParameterSpec::anchor("drift"),
    ],
    off: "anchors steady",
    source: "plausible sizes by judgement",
    equation: "ρ_n -> ρ_n + ḃ t",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.2, 0.4, 0.8]),
        verdict: "Distances to {anchor} drift by {rate}.",
        causes: "an anchor that warms up, a bad crystal, a poor supply",
        remedy: "power-cycle the anchor and let it warm up; replace it if it still drifts",
        shows: "an error of one anchor that grows",
        looks_like: &["U7", "U2"],
        apart: "Hover a minute at one point: a drift grows, a wrong place (U7) and a bias (U2) \
            stay.",
    }),
    build: |b| {
        Box::new(LongerPath {
            bias_m: 0.0,
            rate_mps: b.value[0] * 1e-3,
            anchor: b.value[1] as usize,
        })
    },
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_only_that_anchor() {
        let extra = |from| {
            let mut p = probe::packet(from, nalgebra::Vector3::new(5.0, 5.0, -1.2));
            probe::build(&SPEC, &[("anchor", 3.0)]).air(&probe::hover(), &mut p);
            p.tag_extra_m
        };
        assert!((extra(3) - 0.05).abs() < 1e-12 && extra(4) == 0.0, "10 s of 5 mm/s");
    }
}
