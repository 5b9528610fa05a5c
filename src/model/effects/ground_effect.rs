//! Ground effect: the cushion under the wings.
//!
//! `T = T_free (1 + g e^(-h/l))`, `h` foot of the gear to floor (m), `g` gain, `l` length (m).
//! Deliberately not the paper's `1 - λ/(h - a)²`, which has a pole and which the controller uses: the
//! correction must not be tested against itself. Both agree at the paper's 0.33 m (0.92 of the free
//! command). Source: number from the paper, form usual for flapping wings. Valid from the floor up.

use crate::effects::{Block, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};

/// Lengths of decay after which the factor is 1 within 0.1 %.
const NEGLIGIBLE_LENGTHS: f64 = 6.0;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N8",
    name: "ground effect",
    block: Block::Aerodynamics,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new("gain", "", Kind::Size, 0.0, 0.20, [0.0, 0.4], "gain at the floor")
            .of_vehicle(|v| &mut v.ground.gain),
        ParameterSpec::new("length", "m", Kind::Shape, 0.4, 0.40, [0.1, 0.5], "length of decay")
            .of_vehicle(|v| &mut v.ground.length_m),
    ],
    off: "thrust does not depend on height",
    source: "paper: 92 % of the free command at 0.33 m",
    equation: "T = T_free (1 + g e^(-h/l))",
    build: |b| Box::new(GroundEffect { gain: b.value[0], length_m: b.value[1] }),
};

/// Also used by the deviation A8.
pub(super) struct GroundEffect {
    pub(super) gain: f64,
    pub(super) length_m: f64,
}

impl Effect for GroundEffect {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Thrust]
    }
    fn thrust(&mut self, s: &State, thrust_n: &mut [f64; 2]) {
        let lengths = s.height_m.max(0.0) / self.length_m;
        if lengths < NEGLIGIBLE_LENGTHS {
            let factor = 1.0 + self.gain * (-lengths).exp();
            *thrust_n = thrust_n.map(|t| t * factor);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    fn factor(height_m: f64) -> f64 {
        let mut t = [1.0, 1.0];
        probe::build(&SPEC, &[]).thrust(&State { height_m, ..probe::hover() }, &mut t);
        assert_eq!(t[0], t[1]);
        t[0]
    }

    #[test]
    fn val_the_papers_92_percent_at_0_33_m() {
        assert!((1.0 / factor(0.33) - 0.92).abs() < 0.001, "{}", 1.0 / factor(0.33));
    }

    #[test]
    fn prop_falls_with_height_and_has_no_pole() {
        let heights: Vec<f64> = (0..300).map(|k| f64::from(k) * 0.01).collect();
        assert!(heights.windows(2).all(|h| factor(h[0]) >= factor(h[1])));
        assert!((factor(0.0) - 1.20).abs() < 1e-12 && factor(3.0) == 1.0 && factor(-1.0) < 1.21);
    }
}
