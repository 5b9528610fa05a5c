//! Motors cannot flap faster than the voltage allows.
//!
//! `f <= r f_h V / V₀`, both wings; `f_h` hover flap rate (Hz), `V` supply (V), `V₀` 3.7 V a cell. Acts on the rate itself, after
//! its lag. Size by judgement: r 1.05 to 1.3.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};
use crate::wings::Actuation;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "P5",
    name: "motor saturation",
    block: Block::Thrust,
    parameters: &[ParameterSpec::new(
        "ratio",
        "",
        Kind::Inverse,
        f64::INFINITY,
        1.15,
        [1.05, 1.3],
        "highest flap rate over that of hover, at 3.7 V a cell",
    )],
    off: "as fast as the command says",
    source: "plausible sizes by judgement",
    equation: "f <= r f_h V / V₀",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::WhenAsked([0.707, 1.0, 1.0]),
        verdict: "At the nominal voltage the wings flap no faster than {ratio} of their rate in \
            hover.",
        causes: "a worn motor, friction in gears, a limit of the motor controller",
        remedy: "turn the gears by hand and look for friction; check the motors: they do not come \
            to full speed",
        shows: "thrust that is cut off at high throttle or low voltage",
        looks_like: &["P4"],
        apart: "A limit shows in large steps only, a lag (P4) in steps of any size: fly throttle \
            doublets of 4 % and 12 %.",
    }),
    build: |b| Box::new(MotorSaturation(b.value[0] * b.nominal.hover_hz() / b.nominal.rated_v())),
};

struct MotorSaturation(f64);

impl Effect for MotorSaturation {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Actuate]
    }
    fn actuate(&mut self, s: &State, actuation: &mut Actuation) {
        let most_hz = self.0 * s.supply_v;
        actuation.flap_hz = actuation.flap_hz.map(|f| f.min(most_hz));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_cuts_above_only() {
        let mut a = Actuation { flap_hz: [10.0, 20.0], ..Actuation::default() };
        probe::build(&SPEC, &[]).actuate(&probe::hover(), &mut a);
        assert_eq!(a.flap_hz[0], 10.0);
        assert!((a.flap_hz[1] - 1.15 * probe::hover().flap_hz[0]).abs() < 1e-9);
    }
}
