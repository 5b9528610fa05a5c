//! Steady draught through the room.
//!
//! `v_air = v - w`, `w` constant in the Earth frame (m/s). Size by judgement: 0.1 to 0.6 m/s.

use nalgebra::Vector3;

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "A5",
    name: "steady wind",
    block: Block::Aerodynamics,
    parameters: &[
        ParameterSpec::new("north", "m/s", Kind::Component, 0.0, 0.3, [-0.6, 0.6], "towards north")
            .ways("towards the south", "towards the north"),
        ParameterSpec::new("east", "m/s", Kind::Component, 0.0, 0.0, [-0.6, 0.6], "towards east")
            .ways("towards the west", "towards the east"),
        ParameterSpec::new(
            "down",
            "m/s",
            Kind::Component,
            0.0,
            0.0,
            [-0.3, 0.3],
            "towards the floor",
        )
        .ways("upward", "downward"),
    ],
    off: "still air",
    source: "plausible sizes by judgement",
    equation: "v_air = v - w",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.177, 0.354, 0.707]),
        verdict: "The air of the whole room moves by {}.",
        causes: "an open door or window, a fan, air conditioning",
        remedy: "close doors, stop fans; nothing to repair on the vehicle",
        shows: "a horizontal force that keeps its direction in the room while the vehicle turns",
        looks_like: &["M1", "M4"],
        apart: "Turn on the spot: wind stays with the room, an error of the accelerometer (M1) or \
            of its mounting (M4) turns with the vehicle.",
    }),
    build: |b| Box::new(SteadyWind(Vector3::new(b.value[0], b.value[1], b.value[2]))),
};

struct SteadyWind(Vector3<f64>);

impl Effect for SteadyWind {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Wind]
    }
    fn wind(&mut self, _s: &State, wind_E_mps: &mut Vector3<f64>) {
        *wind_E_mps += self.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_adds_to_other_winds() {
        let mut wind = Vector3::new(0.1, 0.2, 0.0);
        probe::build(&SPEC, &[("east", -0.2)]).wind(&probe::hover(), &mut wind);
        assert!((wind - Vector3::new(0.4, 0.0, 0.0)).norm() < 1e-15);
    }
}
