//! Packets get lost, each reception by itself.
//!
//! `P(lost) = p` at the tag and at every anchor. Source: about 1 % in a clear hall. Left out: bursts.

use crate::effects::{Block, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};
use crate::random::Stream;
use crate::tag::air::Packet;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N18",
    name: "packet loss",
    block: Block::Uwb,
    role: Role::Nominal,
    parameters: &[ParameterSpec::new(
        "probability",
        "",
        Kind::Size,
        0.0,
        0.01,
        [0.0, 0.1],
        "per reception",
    )
    .of_vehicle(|v| &mut v.uwb.loss)],
    off: "every packet is heard by all",
    source: "recorded flights",
    equation: "P(lost) = p",
    build: |b| Box::new(PacketLoss { probability: b.value[0], rng: b.rng }),
};

/// Also used by the deviation U9.
pub(super) struct PacketLoss {
    pub(super) probability: f64,
    pub(super) rng: Stream,
}

impl Effect for PacketLoss {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Air]
    }
    fn air(&mut self, _s: &State, packet: &mut Packet) {
        packet.tag_lost |= self.rng.uniform() < self.probability;
        for hop in packet.anchor_hops() {
            hop.lost |= self.rng.uniform() < self.probability;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;
    use nalgebra::Vector3;

    #[test]
    fn prop_loses_its_share() {
        let mut loss = probe::build(&SPEC, &[("probability", 0.05)]);
        let lost = (0..20_000)
            .filter(|_| {
                let mut p = probe::packet(2, Vector3::zeros());
                loss.air(&probe::hover(), &mut p);
                p.tag_lost
            })
            .count();
        assert!((900..1100).contains(&lost), "{lost}");
    }
}
