//! Wings wear: less thrust at the same flap rate.
//!
//! `T -> (1 - g) T`, both wings. Size by judgement: 3 to 20 %. Drag does not
//! change.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "P1",
    name: "thrust gain loss",
    block: Block::Thrust,
    parameters: &[ParameterSpec::new(
        "loss",
        "",
        Kind::Size,
        0.0,
        0.1,
        [0.03, 0.2],
        "share of thrust lost",
    )],
    off: "new wings",
    source: "plausible sizes by judgement",
    equation: "T -> (1 - g) T",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.177, 0.354, 0.707]),
        verdict: "Thrust is {loss} lower than the simulator says.",
        causes: "worn or torn wing film, cracked spars, a weak motor, a low supply",
        remedy: "look at film and spars and replace the wings where they are worn; check the \
            supply too",
        shows: "more throttle and current in hover, drag as before",
        looks_like: &["I1"],
        apart: "Further mass (I1) takes more throttle too: weigh the vehicle.",
    }),
    build: |b| Box::new(ThrustLoss(1.0 - b.value[0])),
};

struct ThrustLoss(f64);

impl Effect for ThrustLoss {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Thrust]
    }
    fn thrust(&mut self, _s: &State, thrust_n: &mut [f64; 2]) {
        *thrust_n = thrust_n.map(|t| t * self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_takes_its_share_of_both() {
        let mut t = [0.4, 0.6];
        probe::build(&SPEC, &[]).thrust(&probe::hover(), &mut t);
        assert!((t[0] - 0.36).abs() < 1e-12 && (t[1] - 0.54).abs() < 1e-12);
    }
}
