//! Receivers are noisier than usual: weak signals, wrong radio settings.
//!
//! Independent noise is added to that of N15 so that the standard deviation of every reception becomes `x σ`. Size by judgement:
//! 1.4 to 3 times.

use crate::effects::receive_noise::ReceiveNoise;
use crate::effects::{Block, Deviation, EffectSpec, Hidden, Kind, ParameterSpec, Role};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "U1",
    name: "UWB noise level",
    block: Block::Uwb,
    parameters: &[
        ParameterSpec::new(
            "factor",
            "",
            Kind::Size,
            1.0,
            2.0,
            [1.4, 3.0],
            "standard deviation over the nominal one",
        ),
        ParameterSpec::new(
            "std",
            "m",
            Kind::OfTheReceiver,
            0.035,
            0.035,
            [0.01, 0.1],
            "nominal standard deviation per reception; goes with that of the vehicle",
        )
        .beside(|v| v.uwb.std_m),
    ],
    off: "noise of N15",
    source: "plausible sizes by judgement",
    equation: "σ -> x σ",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.2, 0.4, 0.8]),
        verdict: "UWB readings are {factor} noisier than the simulator says.",
        causes: "weak signals, a bent or covered antenna, another transmitter, unsuitable radio \
            settings",
        remedy: "check antennas, cables, and what else sends on the channel",
        shows: "all readings spread wider, without a pattern",
        looks_like: &["U10"],
        apart: "Noise is always there, outliers (U10) come in bursts.",
    }),
    build: |b| {
        Box::new(ReceiveNoise {
            std_m: b.value[1] * (b.value[0].powi(2) - 1.0).max(0.0).sqrt(),
            rng: b.rng,
        })
    },
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_doubles_the_deviation() {
        let mut noise = probe::build(&SPEC, &[]);
        let (mut var, n) = (0.035f64.powi(2), 20_000);
        for _ in 0..n {
            let mut p = probe::packet(0, nalgebra::Vector3::zeros());
            noise.air(&probe::hover(), &mut p);
            var += p.tag_extra_m.powi(2) / f64::from(n);
        }
        assert!((var.sqrt() / 0.07 - 1.0).abs() < 0.02, "{}", var.sqrt());
    }
}
