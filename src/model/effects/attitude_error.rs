//! The board's attitude estimate leans a little, and the lean wanders.
//!
//! `R_believed = R_true exp(ε)`, each of `ε_x`, `ε_y` (rad, body axes) a Gauss-Markov process. Source:
//! tenths of a degree seen on both real boards in simulation; slow because their filters are. Heading
//! is N13. Left out: dependence on acceleration.

use crate::effects::{
    ATTITUDE_PERIOD_S, AttitudeError, Block, Build, Effect, EffectSpec, Kind, ParameterSpec, Role,
    Stage, State,
};
use crate::random::{Markov, Stream};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N12",
    name: "attitude error of the board",
    block: Block::InnerLoop,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "std",
            "deg",
            Kind::Size,
            0.0,
            0.4,
            [0.1, 1.5],
            "lean, each of roll and pitch",
        )
        .of_vehicle(|v| &mut v.imu.std_lean_deg),
        ParameterSpec::new("tau", "s", Kind::Shape, 15.0, 15.0, [3.0, 60.0], "correlation time"),
    ],
    off: "the board knows up exactly",
    source: "assumed, after boards seen in simulation",
    equation: "R_believed = R_true exp(ε), ε Gauss-Markov",
    build: |b| Box::new(Lean::new(b)),
};

struct Lean {
    axes: [Markov; 2],
    rng: Stream,
}

impl Lean {
    fn new(mut b: Build<'_>) -> Self {
        let std = b.value[0].to_radians();
        let axes = [(); 2].map(|()| Markov::new(std, b.value[1], ATTITUDE_PERIOD_S, &mut b.rng));
        Self { axes, rng: b.rng }
    }
}

impl Effect for Lean {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Attitude]
    }
    fn attitude(&mut self, _s: &State, error: &mut AttitudeError) {
        error.tilt_B_rad.x += self.axes[0].step(&mut self.rng);
        error.tilt_B_rad.y += self.axes[1].step(&mut self.rng);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_small_slow_and_level_only() {
        let mut lean = probe::build(&SPEC, &[]);
        let (mut var, mut jump, mut last): (f64, f64, Option<f64>) = (0.0, 0.0, None);
        let n = 50_000; // 1000 s, 67 correlation times
        for _ in 0..n {
            let mut e = AttitudeError::default();
            lean.attitude(&probe::hover(), &mut e);
            assert_eq!((e.tilt_B_rad.z, e.north_rad), (0.0, 0.0));
            var += e.tilt_B_rad.x.powi(2) / f64::from(n);
            jump = jump.max((e.tilt_B_rad.x - last.unwrap_or(e.tilt_B_rad.x)).abs());
            last = Some(e.tilt_B_rad.x);
        }
        assert!((0.2..0.6).contains(&var.sqrt().to_degrees()), "{}", var.sqrt().to_degrees());
        assert!(jump.to_degrees() < 0.15);
    }
}
