//! Stamps depend on received power: far anchors look farther.
//!
//! `ρ -> ρ + s (ρ - ρ₀)`, `ρ₀` 5 m (m). Size by judgement: 1 to 4 cm per m. Left out: the curve of the data sheet.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};
use crate::tag::air::Packet;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "U4",
    name: "distance-dependent bias",
    block: Block::Uwb,
    parameters: &[ParameterSpec::new(
        "slope",
        "m/m",
        Kind::Size,
        0.0,
        0.02,
        [0.01, 0.04],
        "bias per distance",
    )],
    off: "stamps corrected for power",
    source: "plausible sizes by judgement",
    equation: "ρ -> ρ + s (ρ - ρ₀)",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::Never,
        verdict: "Distances come out wrong by {slope}: too long beyond 5 m, too short below.",
        causes: "time stamps that are not corrected for the strength of the signal",
        remedy: "switch on the anchors' correction for signal strength, or calibrate their \
            antenna delays at the distances that are flown",
        shows: "an error that goes with the distance",
        looks_like: &["U7"],
        apart: "An anchor that stands elsewhere (U7) is wrong by direction: measure the anchors \
            by tape.",
    }),
    build: |b| Box::new(DistanceBias(b.value[0])),
};

/// Distance at which antenna delays are calibrated, m.
const CALIBRATED_M: f64 = 5.0;

struct DistanceBias(f64);

impl Effect for DistanceBias {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Air]
    }
    fn air(&mut self, _s: &State, packet: &mut Packet) {
        packet.tag_extra_m += self.0 * (packet.tag_range_m - CALIBRATED_M);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_grows_with_distance() {
        let extra = |x: f64| {
            let mut p = probe::packet(0, nalgebra::Vector3::new(x, 0.1, -0.2));
            probe::build(&SPEC, &[]).air(&probe::hover(), &mut p);
            p.tag_extra_m
        };
        assert!(extra(5.1).abs() < 1e-12 && (extra(9.1) - 0.08).abs() < 1e-12);
    }
}
