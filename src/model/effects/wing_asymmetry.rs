//! One wing is better than the other.
//!
//! `T_L -> (1 + ε) T_L`, `T_R -> (1 - ε) T_R`. Size by judgement: 1 to 6 %.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "P6",
    name: "wing asymmetry",
    block: Block::Thrust,
    parameters: &[ParameterSpec::new(
        "epsilon",
        "",
        Kind::Component,
        0.0,
        0.03,
        [-0.06, 0.06],
        "share by which the left wing gives more",
    )
    .ways(
        "less thrust than the simulator says, and the right wing as much more",
        "more thrust than the simulator says, and the right wing as much less",
    )],
    off: "both wings alike",
    source: "plausible sizes by judgement",
    equation: "T_L -> (1 + ε) T_L, T_R -> (1 - ε) T_R",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.707, 1.0, 1.0]),
        verdict: "The left wing gives {epsilon}.",
        causes: "one wing worn, creased or newly replaced, one motor weaker than the other",
        remedy: "compare the two wings, replace the weaker one, or trim roll",
        shows: "a roll command in proportion to throttle, and a yaw moment",
        looks_like: &["I2", "L3"],
        apart: "A servo off its centre (L3) does not follow throttle, a shifted centre of mass \
            (I2) does not turn the nose: fly throttle doublets, and balance the vehicle on an \
            edge.",
    }),
    build: |b| Box::new(WingAsymmetry(b.value[0])),
};

struct WingAsymmetry(f64);

impl Effect for WingAsymmetry {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Thrust]
    }
    fn thrust(&mut self, _s: &State, thrust_n: &mut [f64; 2]) {
        thrust_n[0] *= 1.0 + self.0;
        thrust_n[1] *= 1.0 - self.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_mirror_swaps() {
        let thrust = |e| {
            let mut t = [0.5; 2];
            probe::build(&SPEC, &[("epsilon", e)]).thrust(&probe::hover(), &mut t);
            t
        };
        let [l, r] = thrust(0.03);
        assert!(l > r && thrust(-0.03) == [r, l] && (l + r - 1.0).abs() < 1e-12);
    }
}
