//! Accelerometer scale error.
//!
//! `a_i *= 1 + s_i`, body axes. Size by judgement: 2 to 10 %. Left out: cross-axis terms (M4 turns the
//! whole triad). Follows the vibration, so it scales that too.

use nalgebra::Vector3;

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, ImuReading, Kind, ParameterSpec, Role, Stage,
    State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "M3",
    name: "accelerometer scale",
    block: Block::Imu,
    parameters: &[
        ParameterSpec::new("x", "", Kind::Component, 0.0, 0.0, [-0.1, 0.1], "along x")
            .ways("too little along the nose", "too much along the nose"),
        ParameterSpec::new("y", "", Kind::Component, 0.0, 0.0, [-0.1, 0.1], "along y")
            .ways("too little sideways", "too much sideways"),
        ParameterSpec::new("z", "", Kind::Component, 0.0, 0.05, [-0.1, 0.1], "along z")
            .ways("too little vertically", "too much vertically"),
    ],
    off: "calibrated",
    source: "plausible sizes by judgement",
    equation: "a_i *= 1 + s_i",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::WhenAsked([0.707, 1.0, 1.0]),
        verdict: "The accelerometer reads {}.",
        causes: "a calibration that is old or was never made",
        remedy: "calibrate the board's accelerometer, six positions, at flying temperature",
        shows: "a vertical force that is wrong in proportion to itself",
        looks_like: &["M6", "M1"],
        apart: "At rest with motors off a wrong scale is there, rectified vibration (M6) is not. \
            Six positions tell it from bias (M1).",
    }),
    build: |b| Box::new(AccScale(Vector3::new(b.value[0], b.value[1], b.value[2]))),
};

struct AccScale(Vector3<f64>);

impl Effect for AccScale {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Imu]
    }
    fn imu(&mut self, _s: &State, reading: &mut ImuReading) {
        reading.acc_B_mps2 += reading.acc_B_mps2.component_mul(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_hover_reads_five_percent_more() {
        let mut r = probe::reading();
        let z = r.acc_B_mps2.z;
        probe::build(&SPEC, &[]).imu(&probe::hover(), &mut r);
        assert!((r.acc_B_mps2.z / z - 1.05).abs() < 1e-12 && r.acc_B_mps2.x == 0.0);
    }
}
