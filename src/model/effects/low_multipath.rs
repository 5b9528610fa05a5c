//! More multipath near the floor than usual.
//!
//! Below `h₀` low anchors get `ρ -> ρ + b S (1 + |n|) / 1.8`, `S = 1 - h/h₀`, `n` normal: a bias with positive skew on top of N17.
//! Size by judgement: 0.1 to 0.5 m below 0.4 m.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};
use crate::random::Stream;
use crate::tag::air::Packet;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "U6",
    name: "near-ground multipath",
    block: Block::Uwb,
    parameters: &[
        ParameterSpec::new("bias", "m", Kind::Size, 0.0, 0.3, [0.1, 0.5], "mean at the floor"),
        ParameterSpec::new(
            "below",
            "m",
            Kind::Shape,
            0.4,
            0.4,
            [0.2, 0.8],
            "height at which it ends",
        ),
        ParameterSpec::new(
            "anchor_height",
            "m",
            Kind::Shape,
            1.0,
            1.0,
            [0.3, 2.0],
            "anchors below this suffer",
        ),
    ],
    off: "multipath of N17",
    source: "plausible sizes by judgement",
    equation: "ρ -> ρ + b (1 - h/h₀) (1 + |n|) / 1.8",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.707, 1.0, 1.0]),
        verdict: "Near the floor distances to low anchors come out {bias} too long on average.",
        causes: "reflections from the floor, anchors that stand low",
        remedy: "raise the low anchors",
        shows: "wide and one-sided errors low down",
        looks_like: &["A8"],
        apart: "Multipath is in the UWB, a ground effect (A8) in the force: fly the ladder of \
            heights.",
    }),
    build: |b| {
        Box::new(LowMultipath {
            bias_m: b.value[0],
            below_m: b.value[1].max(0.01),
            anchor_m: b.value[2],
            rng: b.rng,
        })
    },
};

/// Mean of 1 + |n| for a standard normal n.
const MEAN: f64 = 1.797_884_560_802_865_4;

struct LowMultipath {
    bias_m: f64,
    below_m: f64,
    anchor_m: f64,
    rng: Stream,
}

impl Effect for LowMultipath {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Air]
    }
    fn air(&mut self, _s: &State, packet: &mut Packet) {
        let skewed = 1.0 + self.rng.normal().abs();
        let depth = (1.0 + packet.tag_E_m.z / self.below_m).min(1.0);
        if depth > 0.0 && -packet.from_E_m.z < self.anchor_m {
            packet.tag_extra_m += self.bias_m * depth * skewed / MEAN;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_low_tag_and_low_anchor_only() {
        let mut effect = probe::build(&SPEC, &[]);
        let mut mean = |from, h: f64| {
            let draw = |_| {
                let mut p = probe::packet(from, nalgebra::Vector3::new(5.0, 5.0, -h));
                effect.air(&probe::hover(), &mut p);
                p.tag_extra_m
            };
            (0..4000).map(draw).sum::<f64>() / 4000.0
        };
        assert!((mean(0, 0.0) - 0.3).abs() < 0.01);
        assert_eq!((mean(0, 0.5), mean(4, 0.0)), (0.0, 0.0));
    }
}
