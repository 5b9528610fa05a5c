//! Near the floor the reflection off it merges with the straight path of low anchors: a bias.
//!
//! `b_n = β_n S(1 - h/h₀)` (m) on paths of anchors lower than `h_a`, `β_n` uniform in a range per
//! anchor, `h` antenna over floor (m), `S` the smoothstep. Source: INTERFACES.md: 0.2 to 0.5 m per pair,
//! a bias, not noise; below about 0.4 m. In UTIL's flights of April 2.7 to 3.4 m on the floor that end at 0.15 m
//! (`haltere-lab recorded DIR --ranging`). Left out: dependence on the angle of the reflection.

use crate::effects::{Block, Build, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};
use crate::tag::air::Packet;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N17",
    name: "floor multipath",
    block: Block::Uwb,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "least",
            "m",
            Kind::Size,
            0.0,
            0.2,
            [0.0, 4.0],
            "bias at the floor, least anchor",
        ),
        ParameterSpec::new(
            "most",
            "m",
            Kind::Size,
            0.0,
            0.5,
            [0.0, 4.0],
            "bias at the floor, worst anchor",
        ),
        ParameterSpec::new(
            "below",
            "m",
            Kind::Shape,
            0.4,
            0.4,
            [0.1, 0.8],
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
    off: "no reflection off the floor",
    source: "INTERFACES.md section 1",
    equation: "b_n = β_n S(1 - h/h₀)",
    build: |b| Box::new(FloorMultipath::new(b)),
};

struct FloorMultipath {
    bias_m: Vec<f64>,
    below_m: f64,
}

impl FloorMultipath {
    fn new(mut b: Build<'_>) -> Self {
        let bias_m = b
            .sites_E_m
            .iter()
            .map(|site| {
                let bias = b.rng.between(b.value[0], b.value[1]);
                if -site.z < b.value[3] { bias } else { 0.0 }
            })
            .collect();
        Self { bias_m, below_m: b.value[2] }
    }
}

impl Effect for FloorMultipath {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Air]
    }
    fn air(&mut self, _s: &State, packet: &mut Packet) {
        let depth = 1.0 + packet.tag_E_m.z / self.below_m;
        if depth > 0.0 {
            let depth = depth.min(1.0);
            let bias = self.bias_m.get(packet.from).copied().unwrap_or(0.0);
            packet.tag_extra_m += bias * depth * depth * (3.0 - 2.0 * depth);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;
    use nalgebra::Vector3;

    #[test]
    fn val_0_2_to_0_5_m_on_low_anchors_only() {
        let mut effect = probe::build(&SPEC, &[]);
        let mut at = |from, h: f64| {
            let mut p = probe::packet(from, Vector3::new(5.0, 5.0, -h));
            effect.air(&probe::hover(), &mut p);
            p.tag_extra_m
        };
        for low in 0..4 {
            assert!((0.2..0.5).contains(&at(low, 0.0)));
            assert!(at(low, 0.2) < at(low, 0.1));
            assert_eq!(at(low, 0.4), 0.0);
        }
        assert_eq!(at(5, 0.0), 0.0);
    }
}
