//! Something stands between one anchor and one part of the room.
//!
//! Inside a box around (north, east): `ρ_n -> ρ_n + b + σ n`, `b > 0` (m): the path goes round or through. Size by judgement:
//! //! 0.15 to 0.8 m on one anchor, plus variance.

use crate::effects::{
    Block, Build, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};
use crate::random::Stream;
use crate::tag::air::Packet;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "U5",
    name: "NLOS zone",
    block: Block::Uwb,
    parameters: &[
        ParameterSpec::new("bias", "m", Kind::Size, 0.0, 0.4, [0.15, 0.8], "added path"),
        ParameterSpec::new("std", "m", Kind::Size, 0.0, 0.1, [0.0, 0.3], "added noise"),
        ParameterSpec::anchor("zone"),
        ParameterSpec::north(6.0, "middle of the zone"),
        ParameterSpec::east(6.0, "middle of the zone"),
        ParameterSpec::new(
            "size",
            "m",
            Kind::Shape,
            1.5,
            1.5,
            [0.5, 4.0],
            "half width of the zone",
        ),
    ],
    off: "line of sight everywhere",
    source: "plausible sizes by judgement",
    equation: "ρ_n -> ρ_n + b + σ n in a box",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.187, 0.375, 0.75]),
        verdict: "Something stands between {anchor} and one place of the room, {north} and {east} \
            of the origin: there distances come out {bias} too long.",
        causes: "a pillar, a cabinet, a metal frame or a person in the path",
        remedy: "clear the path between the anchor and that place, or move the anchor",
        shows: "an error of one anchor at one place, never too short",
        looks_like: &["U7", "U2"],
        apart: "A wrong place in the survey (U7) and a bias (U2) are wrong everywhere: fly the \
            square along the walls at two heights.",
    }),
    build: |b| Box::new(NlosZone::new(b)),
};

struct NlosZone {
    bias_m: f64,
    std_m: f64,
    anchor: usize,
    middle_E_m: [f64; 2],
    half_m: f64,
    rng: Stream,
}

impl NlosZone {
    fn new(b: Build<'_>) -> Self {
        let v = b.value;
        Self {
            bias_m: v[0],
            std_m: v[1],
            anchor: v[2] as usize,
            middle_E_m: [v[3], v[4]],
            half_m: v[5],
            rng: b.rng,
        }
    }
}

impl Effect for NlosZone {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Air]
    }
    fn air(&mut self, _s: &State, packet: &mut Packet) {
        let noise = self.rng.normal();
        let [north, east] = self.middle_E_m;
        let inside = (packet.tag_E_m.x - north).abs() < self.half_m
            && (packet.tag_E_m.y - east).abs() < self.half_m;
        if packet.from == self.anchor && inside {
            packet.tag_extra_m += self.bias_m + (self.std_m * noise).max(-self.bias_m);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_one_anchor_one_place_one_sided() {
        let mut zone = probe::build(&SPEC, &[("anchor", 3.0)]);
        let mut extra = |from, x: f64| {
            let mut p = probe::packet(from, nalgebra::Vector3::new(x, 6.0, -1.0));
            zone.air(&probe::hover(), &mut p);
            p.tag_extra_m
        };
        let mean = (0..1000).map(|_| extra(3, 6.0)).sum::<f64>() / 1000.0;
        assert!((mean - 0.4).abs() < 0.02 && (0..100).all(|_| extra(3, 7.4) >= 0.0));
        assert_eq!((extra(2, 6.0), extra(3, 8.0)), (0.0, 0.0));
    }
}
