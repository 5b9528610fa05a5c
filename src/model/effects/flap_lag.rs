//! Flap rate follows its command with a lag: motor, gear and wing have inertia.
//!
//! `f' = (f_target - f) / τ`, exact over a step with the target held:
//! `f += (1 - e^(-dt/τ)) (f_target - f)`. `f` Hz, `τ` s. Source: public dynamic model of this vehicle, τ = 0.0796 s. Left out:
//! different lags for speeding up and slowing down.

use crate::effects::{Block, Effect, EffectSpec, Kind, ParameterSpec, Role, STEP_S, Stage, State};
use crate::wings::Actuation;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N4",
    name: "flap lag",
    block: Block::Thrust,
    role: Role::Nominal,
    parameters: &[ParameterSpec::new(
        "lag",
        "s",
        Kind::Size,
        1e-6,
        0.08,
        [0.05, 0.28],
        "time constant",
    )
    .of_vehicle(|v| &mut v.wings.flap_lag_s)],
    off: "flap rate jumps to its command",
    source: "public Flapper model",
    equation: "f' = (f_target - f) / τ",
    build: |b| Box::new(FlapLag { gain: 1.0 - (-STEP_S / b.value[0]).exp(), flap_hz: [0.0; 2] }),
};

struct FlapLag {
    gain: f64,
    flap_hz: [f64; 2],
}

impl Effect for FlapLag {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Actuate]
    }
    fn actuate(&mut self, _s: &State, actuation: &mut Actuation) {
        for (now, target) in self.flap_hz.iter_mut().zip(&mut actuation.flap_hz) {
            *now += self.gain * (*target - *now);
            *target = *now;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn val_reaches_63_percent_after_80_ms() {
        let mut lag = probe::build(&SPEC, &[]);
        let mut a = Actuation::default();
        for _ in 0..40 {
            a.flap_hz = [10.0, 0.0];
            lag.actuate(&probe::hover(), &mut a);
        }
        assert!((a.flap_hz[0] - 10.0 * (1.0 - (-1.0f64).exp())).abs() < 1e-9);
        assert_eq!(a.flap_hz[1], 0.0);
    }
}
