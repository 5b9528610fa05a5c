//! Aged battery: less capacity.
//!
//! `C -> (1 - x) C` in N7. Size by judgement: 10 to 50 %.

use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};
use crate::vehicle::Vehicle;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "P3",
    name: "battery capacity",
    block: Block::Battery,
    parameters: &[ParameterSpec::new(
        "loss",
        "",
        Kind::Size,
        0.0,
        0.3,
        [0.1, 0.5],
        "share of the capacity lost",
    )],
    off: "capacity of the vehicle file",
    source: "plausible sizes by judgement",
    equation: "C -> (1 - x) C",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.354, 0.707, 1.0]),
        verdict: "The battery holds {loss} less charge than the simulator says.",
        causes: "an aged or cold battery, one that was not full",
        remedy: "charge it fully and fly again; replace it if it still holds less",
        shows: "a voltage that follows the charge used",
        looks_like: &["P2"],
        apart: "Lost capacity shows late in a flight, resistance (P2) at every step of throttle: \
            fly throttle steps early, then hover long.",
    }),
    build: |b| Box::new(Edit(b.value.to_vec())),
};

struct Edit(Vec<f64>);

impl Effect for Edit {
    fn vehicle(&mut self, vehicle: &mut Vehicle) {
        if let [loss] = self.0[..] {
            vehicle.battery.capacity_mah *= 1.0 - loss;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_takes_its_share() {
        assert!((probe::edited(&SPEC, &[]).battery.capacity_mah - 210.0).abs() < 1e-9);
    }
}
