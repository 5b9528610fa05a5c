//! Battery or connector with more inner resistance.
//!
//! `R -> R + (1 - s) ΔR`, `R_s -> R_s + s ΔR` in N7 (Ω). Size by judgement: 0.05 to 0.3 Ω. A corroded plug acts at once (`s` 0); in
//! an aged pack the polarisation grows as well.

use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};
use crate::vehicle::Vehicle;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "P2",
    name: "battery resistance",
    block: Block::Battery,
    parameters: &[
        ParameterSpec::new(
            "extra",
            "Ω",
            Kind::Size,
            0.0,
            0.15,
            [0.05, 0.3],
            "further resistance; goes with voltage over current in hover",
        )
        .beside(|v| v.hover_ohm()),
        ParameterSpec::new(
            "slow",
            "",
            Kind::Shape,
            0.0,
            0.0,
            [0.0, 1.0],
            "share of it that acts late, by the pack's polarisation",
        ),
    ],
    off: "resistance of the vehicle file",
    source: "plausible sizes by judgement",
    equation: "R -> R + (1 - s) ΔR, R_s -> R_s + s ΔR",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.227, 0.455, 0.909]),
        verdict: "The battery and its leads have {extra} more resistance than the simulator says.",
        causes: "an aged or cold battery, a worn or corroded plug, thin leads",
        remedy: "clean the plug and try another battery; replace what has the higher resistance",
        shows: "a voltage that follows the current, step for step or late",
        looks_like: &["P3"],
        apart: "Resistance answers a step of throttle, lost capacity (P3) the charge that was \
            used: fly throttle steps early, then hover long.",
    }),
    build: |b| Box::new(Edit(b.value.to_vec())),
};

struct Edit(Vec<f64>);

impl Effect for Edit {
    fn vehicle(&mut self, vehicle: &mut Vehicle) {
        if let [extra, slow] = self.0[..] {
            vehicle.battery.resistance_ohm += (1.0 - slow) * extra;
            vehicle.battery.slow_ohm += slow * extra;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_adds() {
        assert!((probe::edited(&SPEC, &[]).battery.resistance_ohm - 0.32).abs() < 1e-12);
    }
}
