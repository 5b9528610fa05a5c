//! Body drag that grows with the square of speed.
//!
//! `F = -m c |v| v` (N), `v` velocity through the air (m/s, body), `c` (1/m), at the centre of mass. Not
//! coupled to flap rate, which tells it from A1. Size by judgement: 0.1 to 2 1/m. N23 is the same of the nominal vehicle.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};
use crate::wings::Wrench;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "A3",
    name: "quadratic body drag",
    block: Block::Aerodynamics,
    parameters: &[ParameterSpec::new(
        "c",
        "1/m",
        Kind::Size,
        0.0,
        0.6,
        [0.1, 2.0],
        "coefficient; goes with the wing squared over the mass",
    )
    .beside(|v| v.wings.centre_m.powi(2) / v.body.mass_kg)],
    off: "no quadratic part",
    source: "plausible sizes by judgement",
    equation: "F = -m c |v| v",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.1, 0.2, 0.4]),
        verdict: "Drag has a part that grows with the square of speed and that the simulator \
            lacks: it brakes with {c}.",
        causes: "the body and what is mounted on it, which meet the air without flapping",
        remedy: "nothing to repair: the nominal model lacks it; take the scenario patch",
        shows: "a force that grows with the square of speed, whatever the flap rate",
        looks_like: &["A1"],
        apart: "Drag of the wings (A1) goes with speed itself and with the flap rate: fly dashes \
            there and back at three speeds.",
    }),
    build: |b| Box::new(QuadraticDrag(b.value[0] * b.nominal.body.mass_kg)),
};

/// The nominal vehicle's own, from its file.
pub const NOMINAL: EffectSpec = EffectSpec {
    id: "N23",
    name: "nominal body drag",
    role: Role::Nominal,
    parameters: &[ParameterSpec::new("c", "1/m", Kind::Size, 0.0, 0.0, [0.0, 2.0], "coefficient")
        .of_vehicle(|v| &mut v.drag.body_per_m)],
    source: "`haltere gap commission`",
    ..SPEC
};

struct QuadraticDrag(f64);

impl Effect for QuadraticDrag {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Wrench]
    }
    fn wrench(&mut self, s: &State, wrench: &mut Wrench) {
        let v = s.air_B_mps;
        wrench.force_B_n -= v * (self.0 * v.norm());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_four_times_at_twice_the_speed_against_it() {
        let force = |x: f64| {
            let air_B_mps = nalgebra::Vector3::new(x, 0.0, 0.0);
            let mut w = Wrench::default();
            probe::build(&SPEC, &[]).wrench(&State { air_B_mps, ..probe::hover() }, &mut w);
            w.force_B_n.x
        };
        assert!(force(1.0) < 0.0 && (force(2.0) / force(1.0) - 4.0).abs() < 1e-12);
        assert_eq!(force(-1.0), -force(1.0));
        assert_eq!(force(0.0), 0.0);
    }
}
