//! Thrust is not linear in flap rate.
//!
//! `T -> T + ½ W ε (r² - 1)` per wing, not below zero, `r = f/f_h`, `W` weight (N), `f_h` hover flap rate
//! (Hz). No change in hover. Size by judgement: ±0.05 to 0.2.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "A4",
    name: "thrust curve",
    block: Block::Thrust,
    parameters: &[ParameterSpec::new(
        "epsilon",
        "",
        Kind::Component,
        0.0,
        0.15,
        [-0.2, 0.2],
        "curvature",
    )
    .ways(
        "of the weight lower than the simulator says",
        "of the weight higher than the simulator says",
    )],
    off: "thrust linear in flap rate",
    source: "plausible sizes by judgement",
    equation: "T -> T + ½ W ε (r² - 1)",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([1.0, 1.0, 1.0]),
        verdict: "Thrust is right in hover, but at 1.4 times the flap rate of hover it is \
            {epsilon}.",
        causes: "wings that bend or twist more when they flap faster, a thrust that was measured \
            at one throttle only",
        remedy: "nothing to repair: the nominal model lacks it; take the scenario patch",
        shows: "a vertical force that goes with the flap rate; errors of height change sign \
            between climb and descent",
        looks_like: &["A8"],
        apart: "A ground effect (A8) shows near the floor only, this at any height: fly the \
            ladder of heights, and throttle doublets high up.",
    }),
    build: |b| {
        let weight_n = b.nominal.body.mass_kg * haltere_core::frames::G_MPS2;
        Box::new(ThrustExpo {
            gain_n: 0.5 * weight_n * b.value[0],
            inverse_hover_hz: 1.0 / b.nominal.hover_hz(),
        })
    },
};

struct ThrustExpo {
    gain_n: f64,
    inverse_hover_hz: f64,
}

impl Effect for ThrustExpo {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Thrust]
    }
    fn thrust(&mut self, s: &State, thrust_n: &mut [f64; 2]) {
        for (t, f) in thrust_n.iter_mut().zip(s.flap_hz) {
            let r = f * self.inverse_hover_hz;
            // A wing that stands gives nothing, whatever the curvature says.
            if r > 0.0 {
                *t = (*t + self.gain_n * (r * r - 1.0)).max(0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_no_change_in_hover_and_more_above() {
        let thrust = |f: f64| {
            let mut t = [0.5; 2];
            probe::build(&SPEC, &[]).thrust(&State { flap_hz: [f; 2], ..probe::hover() }, &mut t);
            t[0]
        };
        let hover_hz = probe::hover().flap_hz[0];
        assert!((thrust(hover_hz) - 0.5).abs() < 1e-12);
        assert!(thrust(1.1 * hover_hz) > 0.5 && thrust(0.9 * hover_hz) < 0.5);
        assert_eq!(thrust(0.0), 0.5);
    }
}
