//! Many packets get lost: a crowded band, bodies in the way.
//!
//! `P(lost) = p` at the tag and at every anchor, on top of N18. Size by judgement: 25 to 80 %.

use crate::effects::{Block, Deviation, EffectSpec, Hidden, Kind, ParameterSpec, Role};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "U9",
    name: "packet loss",
    block: Block::Uwb,
    parameters: &[ParameterSpec::new(
        "probability",
        "",
        Kind::Size,
        0.0,
        0.5,
        [0.25, 0.8],
        "per reception",
    )],
    off: "loss of N18",
    source: "plausible sizes by judgement",
    equation: "P(lost) = p",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.312, 0.625, 1.0]),
        verdict: "Tag and anchors lose {probability} of the UWB packets beyond what the simulator \
            loses.",
        causes: "a crowded channel, bodies or metal in the way, weak antennas",
        remedy: "check antennas, cables, and what else sends on the channel",
        shows: "fewer readings, no bias",
        looks_like: &[],
        apart: "Readings that come are as good as before.",
    }),
    build: |b| Box::new(PacketLoss { probability: b.value[0], rng: b.rng }),
};

// The law is that of N18; a second copy of it would only drift away.
use crate::effects::packet_loss::PacketLoss;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_loses_half() {
        let mut loss = probe::build(&SPEC, &[]);
        let lost = (0..10_000)
            .filter(|_| {
                let mut p = probe::packet(0, nalgebra::Vector3::zeros());
                loss.air(&probe::hover(), &mut p);
                p.tag_lost
            })
            .count();
        assert!((4800..5200).contains(&lost), "{lost}");
    }
}
