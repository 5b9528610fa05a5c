//! Gusts: coloured turbulence.
//!
//! Each component of `w` a Gauss-Markov process with `σ` (m/s) and `τ` (s), half of it vertically; Earth
//! frame. Size by judgement: σ 0.1 to 0.6 m/s, τ 0.5 to 3 s. Left out: Dryden's second-order components.

use nalgebra::Vector3;

use crate::effects::{
    Block, Build, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, STEP_S, Stage,
    State,
};
use crate::random::{Markov, Stream};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "A7",
    name: "gusts",
    block: Block::Aerodynamics,
    parameters: &[
        ParameterSpec::new(
            "std",
            "m/s",
            Kind::Size,
            0.0,
            0.3,
            [0.1, 0.6],
            "standard deviation of each horizontal component",
        ),
        ParameterSpec::new("tau", "s", Kind::Shape, 1.5, 1.5, [0.5, 3.0], "correlation time"),
    ],
    off: "no turbulence",
    source: "plausible sizes by judgement",
    equation: "w Gauss-Markov",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.167, 0.333, 0.667]),
        verdict: "Gusts of {std} (standard deviation) shake the vehicle.",
        causes: "a fan, air conditioning, people who walk by, the vehicle's own air in a small \
            room",
        remedy: "close doors, stop fans; nothing to repair on the vehicle",
        shows: "slow noise of the force, in hover too",
        looks_like: &["T1", "U1"],
        apart: "The accelerometer feels gusts. Late (T1) or noisy (U1) UWB is in the position \
            alone.",
    }),
    build: |b| Box::new(Gusts::new(b)),
};

/// Vertical over horizontal standard deviation: the floor holds eddies down.
const VERTICAL_SHARE: f64 = 0.5;

struct Gusts {
    axes: [Markov; 3],
    rng: Stream,
}

impl Gusts {
    fn new(mut b: Build<'_>) -> Self {
        let (std, tau_s) = (b.value[0], b.value[1].max(0.05));
        let axes =
            [std, std, VERTICAL_SHARE * std].map(|s| Markov::new(s, tau_s, STEP_S, &mut b.rng));
        Self { axes, rng: b.rng }
    }
}

impl Effect for Gusts {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Wind]
    }
    fn wind(&mut self, _s: &State, wind_E_mps: &mut Vector3<f64>) {
        for (w, axis) in wind_E_mps.iter_mut().zip(&mut self.axes) {
            *w += axis.step(&mut self.rng);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_has_its_standard_deviation_and_no_mean() {
        let mut gusts = probe::build(&SPEC, &[]);
        let (mut sum, mut var, n) = (0.0, 0.0, 1_000_000);
        for _ in 0..n {
            let mut w = Vector3::zeros();
            gusts.wind(&probe::hover(), &mut w);
            sum += w.x / f64::from(n);
            var += w.x * w.x / f64::from(n);
        }
        // 2000 s are some 670 independent values: three sigma of the mean are 0.035, of the std 0.03.
        assert!(sum.abs() < 0.05 && (var.sqrt() - 0.3).abs() < 0.03, "{sum} {}", var.sqrt());
    }
}
