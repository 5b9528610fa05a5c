//! Motors lose thrust as they warm up.
//!
//! `T -> T (1 - a (1 - e^(-t/τ)))`, `t` time that the wings have been flapping (s). Size by judgement: a 3 to 10 %, τ 60
//! to 180 s. Left out: cooling between flights.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, STEP_S, Stage, State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "P7",
    name: "thermal droop",
    block: Block::Thrust,
    parameters: &[
        ParameterSpec::new("loss", "", Kind::Size, 0.0, 0.06, [0.03, 0.1], "share lost when warm"),
        ParameterSpec::new("tau", "s", Kind::Shape, 120.0, 120.0, [60.0, 180.0], "warming time"),
    ],
    off: "thrust does not depend on temperature",
    source: "plausible sizes by judgement",
    equation: "T -> T (1 - a (1 - e^(-t/τ)))",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::Never,
        verdict: "Thrust falls by {loss} while the motors warm up, most of it within the first \
            {tau}.",
        causes: "motors that run hot, friction in gears",
        remedy: "let the motors cool between flights; check gears for friction",
        shows: "thrust that falls with time at the same voltage",
        looks_like: &["P1", "P3"],
        apart: "Worn wings (P1) are weak from the start, lost capacity (P3) shows in the voltage: \
            hover 60 s twice and compare at the same voltage.",
    }),
    build: |b| {
        Box::new(ThermalDroop { loss: b.value[0], gain: STEP_S / b.value[1].max(1.0), warmth: 0.0 })
    },
};

struct ThermalDroop {
    loss: f64,
    gain: f64,
    /// 0 cold, 1 warm.
    warmth: f64,
}

impl Effect for ThermalDroop {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Thrust]
    }
    fn thrust(&mut self, s: &State, thrust_n: &mut [f64; 2]) {
        if s.flap_hz[0] + s.flap_hz[1] > 0.0 {
            self.warmth += self.gain * (1.0 - self.warmth);
        }
        let factor = 1.0 - self.loss * self.warmth;
        *thrust_n = thrust_n.map(|t| t * factor);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_two_thirds_of_the_loss_after_tau() {
        let mut droop = probe::build(&SPEC, &[]);
        let mut t = [1.0; 2];
        for _ in 0..60_000 {
            t = [1.0; 2];
            droop.thrust(&probe::hover(), &mut t);
        }
        let want = 1.0 - 0.06 * (1.0 - (-1.0f64).exp());
        assert!((t[0] - want).abs() < 1e-5, "{}", t[0]);
    }
}
