//! Accelerometer bias that grows while the board warms up.
//!
//! `a += ḃ t` (m/s², body), `t` time since power-on (s). Size by judgement: 0.2 to 1.2 m/s² per minute.
//! Valid for flights of a few minutes; a real one levels off.

use nalgebra::Vector3;

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, ImuReading, Kind, ParameterSpec, Role, Stage,
    State,
};

const MINUTE_S: f64 = 60.0;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "M2",
    name: "accelerometer bias drift",
    block: Block::Imu,
    parameters: &[
        ParameterSpec::new("x", "m/s² per min", Kind::Component, 0.0, 0.5, [-1.2, 1.2], "along x")
            .ways("to the back", "to the front"),
        ParameterSpec::new("y", "m/s² per min", Kind::Component, 0.0, 0.0, [-1.2, 1.2], "along y")
            .ways("to the left", "to the right"),
        ParameterSpec::new("z", "m/s² per min", Kind::Component, 0.0, 0.0, [-1.2, 1.2], "along z")
            .ways("upward", "downward"),
    ],
    off: "bias constant in a flight",
    source: "plausible sizes by judgement",
    equation: "a += ḃ t",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.354, 0.707, 1.0]),
        verdict: "An error of the accelerometer grows in flight: {}.",
        causes: "a board that warms up in flight",
        remedy: "let the board warm up before take-off; calibrate its accelerometer, six \
            positions, at flying temperature",
        shows: "an error that is a ramp",
        looks_like: &["M1"],
        apart: "Hover 60 s at one point: a drift grows, a bias (M1) stays.",
    }),
    build: |b| Box::new(AccDrift(Vector3::new(b.value[0], b.value[1], b.value[2]) / MINUTE_S)),
};

struct AccDrift(Vector3<f64>);

impl Effect for AccDrift {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Imu]
    }
    fn imu(&mut self, s: &State, reading: &mut ImuReading) {
        reading.acc_B_mps2 += self.0 * s.t_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_a_minute_brings_the_stated_bias() {
        let at = |t_s| {
            let mut r = probe::reading();
            probe::build(&SPEC, &[]).imu(&State { t_s, ..probe::hover() }, &mut r);
            r.acc_B_mps2.x - probe::reading().acc_B_mps2.x
        };
        assert_eq!(at(0.0), 0.0);
        assert!((at(60.0) - 0.5).abs() < 1e-12);
    }
}
