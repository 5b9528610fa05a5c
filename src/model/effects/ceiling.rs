//! Ceiling effect: the wings suck themselves up.
//!
//! `T -> T (1 + c e^(-(H-h)/l))`, `H - h` distance of the vehicle below the ceiling (m). Size by judgement:
//! //! c 0.05 to 0.2.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "A9",
    name: "ceiling effect",
    block: Block::Aerodynamics,
    parameters: &[
        ParameterSpec::new("gain", "", Kind::Size, 0.0, 0.12, [0.05, 0.2], "gain at the ceiling"),
        ParameterSpec::decay(0.3, [0.1, 0.6]),
    ],
    off: "no ceiling",
    source: "plausible sizes by judgement",
    equation: "T -> T (1 + c e^(-(H-h)/l))",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::WhenAsked([1.0, 1.0, 1.0]),
        verdict: "At the ceiling the wings give {gain} more thrust than the simulator says.",
        causes: "wings that draw the air out of the gap between them and the ceiling",
        remedy: "nothing to repair: stay half a metre below the ceiling, or take the scenario \
            patch",
        shows: "a vertical force in the last half metre below the ceiling",
        looks_like: &["A8"],
        apart: "Hover in steps up to just under the ceiling: it shows only there, a ground effect \
            (A8) only at the floor.",
    }),
    build: |b| {
        Box::new(Ceiling {
            gain: b.value[0],
            length_m: b.value[1].max(0.01),
            z_E_m: -b.room.ceiling_m,
        })
    },
};

struct Ceiling {
    gain: f64,
    length_m: f64,
    z_E_m: f64,
}

impl Effect for Ceiling {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Thrust]
    }
    fn thrust(&mut self, s: &State, thrust_n: &mut [f64; 2]) {
        let below_m = (s.pos_E_m.z - self.z_E_m).max(0.0);
        let factor = 1.0 + self.gain * (-below_m / self.length_m).exp();
        *thrust_n = thrust_n.map(|t| t * factor);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_acts_under_the_ceiling_only() {
        let factor = |z: f64| {
            let pos_E_m = nalgebra::Vector3::new(5.0, 5.0, z);
            let mut t = [1.0; 2];
            probe::build(&SPEC, &[]).thrust(&State { pos_E_m, ..probe::hover() }, &mut t);
            t[0]
        };
        assert!((factor(-7.0) - 1.12).abs() < 1e-12 && factor(-1.0) - 1.0 < 1e-6);
    }
}
