//! Pitch moment that grows with airspeed: wings bend more or less than the vehicle file says.
//!
//! `c -> c + Δc` in N3 (rad per m/s). Size by judgement: trim 0 to 0.2 rad per m/s.

use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};
use crate::vehicle::Vehicle;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "A12",
    name: "speed-pitch coupling",
    block: Block::Aerodynamics,
    parameters: &[ParameterSpec::new(
        "bend",
        "rad per m/s",
        Kind::Component,
        0.0,
        0.1,
        [-0.2, 0.2],
        "further bend per airspeed",
    )
    .ways("less", "more")],
    off: "bend of the vehicle file",
    source: "plausible sizes by judgement",
    equation: "c -> c + Δc",
    role: Role::Deviation(Deviation {
        standard: false,
        hidden: Hidden::Never,
        verdict: "With airspeed the wings bend {bend} than the simulator says.",
        causes: "softer or stiffer film and wing roots, another lever between wings and centre of \
            mass",
        remedy: "nothing to repair: the nominal model lacks it; take the scenario patch",
        shows: "pitch in proportion to airspeed, not to the setpoint",
        looks_like: &["L3", "A1"],
        apart: "A servo off its centre (L3) leans the vehicle in hover too. Other drag (A1) leans \
            it as the setpoint says.",
    }),
    build: |b| Box::new(Edit(b.value.to_vec())),
};

struct Edit(Vec<f64>);

impl Effect for Edit {
    fn vehicle(&mut self, vehicle: &mut Vehicle) {
        if let [bend] = self.0[..] {
            vehicle.wings.passive_dihedral_rad_per_mps += bend;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_adds() {
        let v = probe::edited(&SPEC, &[]);
        assert!((v.wings.passive_dihedral_rad_per_mps - 0.245).abs() < 1e-12);
    }
}
