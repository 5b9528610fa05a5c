//! Delivery times jitter on every link.
//!
//! `delay += |σ n|` (ms), order kept. Size by judgement: 1 to 8 ms rms.

use crate::effects::{
    Block, Cargo, Delivery, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role,
    Stage, State,
};
use crate::random::Stream;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "T4",
    name: "timing jitter",
    block: Block::Timing,
    parameters: &[ParameterSpec::new("rms", "ms", Kind::Size, 0.0, 4.0, [1.0, 8.0], "rms")],
    off: "no jitter beyond N19",
    source: "plausible sizes by judgement",
    equation: "delay += |σ n|",
    role: Role::Deviation(Deviation {
        standard: false,
        hidden: Hidden::Never,
        verdict: "Messages come with {rms} (rms) more jitter than the simulator says.",
        causes: "a loaded computer, a shared USB hub, radio that repeats itself",
        remedy: "check the load of the companion's computer, and what shares its ports",
        shows: "all noises a little larger",
        looks_like: &["U1"],
        apart: "Jitter is in the times of arrival, noise (U1) in the readings.",
    }),
    build: |b| Box::new(SamplingJitter { rms_s: b.value[0] * 1e-3, rng: b.rng }),
};

struct SamplingJitter {
    rms_s: f64,
    rng: Stream,
}

impl Effect for SamplingJitter {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Link]
    }
    fn link(&mut self, _s: &State, delivery: &mut Delivery) {
        if delivery.cargo != Cargo::Setpoint {
            delivery.delay_s += (self.rms_s * self.rng.normal()).abs();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_has_its_rms_and_never_hurries() {
        let mut jitter = probe::build(&SPEC, &[]);
        let mut var = 0.0;
        for _ in 0..10_000 {
            let mut d = Delivery { cargo: Cargo::FromTag, delay_s: 0.0, lost: false };
            jitter.link(&probe::hover(), &mut d);
            assert!(d.delay_s >= 0.0);
            var += d.delay_s.powi(2) / 10_000.0;
        }
        assert!((var.sqrt() / 0.004 - 1.0).abs() < 0.03);
    }
}
