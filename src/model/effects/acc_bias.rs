//! Accelerometer bias.
//!
//! `a += b`, constant in the body frame (m/s²). Size by judgement: 0.1 to 0.6 m/s². Left out: drift (M2).

use nalgebra::Vector3;

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, ImuReading, Kind, ParameterSpec, Role, Stage,
    State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "M1",
    name: "accelerometer bias",
    block: Block::Imu,
    parameters: &[
        ParameterSpec::new("x", "m/s²", Kind::Component, 0.0, 0.3, [-0.6, 0.6], "along x")
            .ways("to the back", "to the front"),
        ParameterSpec::new("y", "m/s²", Kind::Component, 0.0, 0.0, [-0.6, 0.6], "along y")
            .ways("to the left", "to the right"),
        ParameterSpec::new("z", "m/s²", Kind::Component, 0.0, 0.0, [-0.6, 0.6], "along z")
            .ways("upward", "downward"),
    ],
    off: "no bias beyond that of turn-on (N11)",
    source: "plausible sizes by judgement",
    equation: "a += b",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::WhenAsked([0.707, 1.0, 1.0]),
        verdict: "The accelerometer reads an acceleration that is not there: {}.",
        causes: "a calibration that is old, or was made at another temperature",
        remedy: "calibrate the board's accelerometer, six positions, at flying temperature",
        shows: "an error that is constant in the body",
        looks_like: &["M4", "A5"],
        apart: "Log 10 s at rest and level with motors off: wind (A5) is not there, and a board \
            that sits crooked (M4) has an error that follows thrust in flight.",
    }),
    build: |b| Box::new(AccBias(Vector3::new(b.value[0], b.value[1], b.value[2]))),
};

struct AccBias(Vector3<f64>);

impl Effect for AccBias {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Imu]
    }
    fn imu(&mut self, _s: &State, reading: &mut ImuReading) {
        reading.acc_B_mps2 += self.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_adds_in_its_direction() {
        let mut r = probe::reading();
        let before = r;
        probe::build(&SPEC, &[("y", -0.2)]).imu(&probe::hover(), &mut r);
        assert!((r.acc_B_mps2 - before.acc_B_mps2 - Vector3::new(0.3, -0.2, 0.0)).norm() < 1e-15);
        assert_eq!(r.rate_B_radps, before.rate_B_radps);
    }
}
