//! Wrong antenna delay of one anchor.
//!
//! `ρ_n -> ρ_n + b` on its path to the tag (m), everywhere alike. Size by judgement: 0.08 to 0.35 m.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};
use crate::tag::air::Packet;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "U2",
    name: "anchor bias",
    block: Block::Uwb,
    parameters: &[
        ParameterSpec::new("bias", "m", Kind::Component, 0.0, 0.2, [-0.35, 0.35], "bias")
            .ways("too short", "too long"),
        ParameterSpec::anchor("bias"),
    ],
    off: "antenna delays calibrated",
    source: "plausible sizes by judgement",
    equation: "ρ_n -> ρ_n + b",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.229, 0.457, 0.914]),
        verdict: "Distances to {anchor} come out {bias}, everywhere in the room.",
        causes: "an antenna delay that was not calibrated, another antenna or cable at this anchor",
        remedy: "calibrate the anchor's antenna delay",
        shows: "an error of one anchor that is the same everywhere",
        looks_like: &["U7", "U8"],
        apart: "A wrong place in the survey (U7) shows otherwise in every direction, a drift (U8) \
            grows: fly the square along the walls, or measure the anchor's place by tape.",
    }),
    build: |b| {
        Box::new(LongerPath { bias_m: b.value[0], rate_mps: 0.0, anchor: b.value[1] as usize })
    },
};

/// One anchor's path to the tag is longer, and grows: `ρ_n -> ρ_n + b + ḃ t` (m), `t` time (s).
pub(super) struct LongerPath {
    pub bias_m: f64,
    pub rate_mps: f64,
    pub anchor: usize,
}

impl Effect for LongerPath {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Air]
    }
    fn air(&mut self, s: &State, packet: &mut Packet) {
        if packet.from == self.anchor {
            packet.tag_extra_m += self.bias_m + self.rate_mps * s.t_s;
        }
    }
}

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
        assert_eq!((extra(3), extra(2)), (0.2, 0.0));
    }
}
