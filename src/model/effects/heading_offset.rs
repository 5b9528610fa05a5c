//! The board's north is not room north: indoors a magnetometer points where the steel says.
//!
//! `ψ_board = ψ_room - β`, `β = β₀ + drift`, drift Gauss-Markov; `β` is the angle from room north to
//! the board's north, clockwise positive (rad). Source: offsets of several degrees, about 10 after a
//! turn on one board (BOARDS.md). Larger offsets and ramps: H1, H2.

use crate::effects::{
    ATTITUDE_PERIOD_S, AttitudeError, Block, Build, Effect, EffectSpec, Kind, ParameterSpec, Role,
    Stage, State,
};
use crate::random::{Markov, Stream};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N13",
    name: "heading offset of the board",
    block: Block::InnerLoop,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "offset",
            "deg",
            Kind::Component,
            0.0,
            4.0,
            [-10.0, 10.0],
            "room north to the board's north",
        ),
        ParameterSpec::new("std_drift", "deg", Kind::Size, 0.0, 0.5, [0.0, 2.0], "wander about it"),
        ParameterSpec::new(
            "tau",
            "s",
            Kind::Shape,
            60.0,
            60.0,
            [10.0, 300.0],
            "correlation time of the wander",
        ),
    ],
    off: "the board's north is room north",
    source: "two real boards in simulation",
    equation: "β = β₀ + Gauss-Markov",
    build: |b| Box::new(HeadingOffset::new(b)),
};

struct HeadingOffset {
    offset_rad: f64,
    drift: Markov,
    rng: Stream,
}

impl HeadingOffset {
    fn new(mut b: Build<'_>) -> Self {
        let std = b.value[1].to_radians();
        let drift = Markov::new(std, b.value[2], ATTITUDE_PERIOD_S, &mut b.rng);
        Self { offset_rad: b.value[0].to_radians(), drift, rng: b.rng }
    }
}

impl Effect for HeadingOffset {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Attitude]
    }
    fn attitude(&mut self, _s: &State, error: &mut AttitudeError) {
        error.north_rad += self.offset_rad + self.drift.step(&mut self.rng);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_stays_near_its_offset() {
        let mut offset = probe::build(&SPEC, &[("offset", -7.0)]);
        for _ in 0..5000 {
            let mut e = AttitudeError::default();
            offset.attitude(&probe::hover(), &mut e);
            assert!((e.north_rad.to_degrees() + 7.0).abs() < 2.5);
        }
    }
}
