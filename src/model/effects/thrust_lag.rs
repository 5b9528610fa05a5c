//! Flapping follows more slowly than the vehicle file says.
//!
//! `τ -> τ + Δτ` in N4 (s). Size by judgement: 0.08 to 0.12..0.28 s.

use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};
use crate::vehicle::Vehicle;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "P4",
    name: "thrust lag",
    block: Block::Thrust,
    parameters: &[ParameterSpec::new(
        "extra",
        "s",
        Kind::Size,
        0.0,
        0.08,
        [0.04, 0.2],
        "further lag; goes with the lag",
    )
    .beside(|v| v.wings.flap_lag_s)],
    off: "lag of the vehicle file",
    source: "plausible sizes by judgement",
    equation: "τ -> τ + Δτ",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.707, 1.0, 1.0]),
        verdict: "The wings follow the throttle with {extra} more lag than the simulator says.",
        causes: "friction in gears, heavy wings, a weak motor or motor controller",
        remedy: "turn the gears by hand and look for friction; check the motors: they follow late",
        shows: "a force that lags the command; height that swings",
        looks_like: &["P5"],
        apart: "A lag shows in steps of any size, a limit (P5) in large ones only: fly throttle \
            doublets of 4 % and 12 %.",
    }),
    build: |b| Box::new(Edit(b.value.to_vec())),
};

struct Edit(Vec<f64>);

impl Effect for Edit {
    fn vehicle(&mut self, vehicle: &mut Vehicle) {
        if let [extra] = self.0[..] {
            vehicle.wings.flap_lag_s += extra;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_adds() {
        assert!((probe::edited(&SPEC, &[]).wings.flap_lag_s - 0.16).abs() < 1e-12);
    }
}
