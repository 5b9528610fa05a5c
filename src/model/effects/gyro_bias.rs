//! Gyroscope bias as reported; the board's own attitude does not suffer.
//!
//! `ω += b`, constant in the body frame (rad/s). Size by judgement: 0.01 to 0.06 rad/s.

use nalgebra::Vector3;

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, ImuReading, Kind, ParameterSpec, Role, Stage,
    State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "M5",
    name: "gyroscope bias",
    block: Block::Imu,
    parameters: &[
        ParameterSpec::new("x", "rad/s", Kind::Component, 0.0, 0.03, [-0.06, 0.06], "about x")
            .ways("rolling to the left", "rolling to the right"),
        ParameterSpec::new("y", "rad/s", Kind::Component, 0.0, 0.0, [-0.06, 0.06], "about y")
            .ways("pitching down", "pitching up"),
        ParameterSpec::new("z", "rad/s", Kind::Component, 0.0, 0.0, [-0.06, 0.06], "about z")
            .ways("turning to the left", "turning to the right"),
    ],
    off: "no bias beyond that of turn-on (N11)",
    source: "plausible sizes by judgement",
    equation: "ω += b",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.354, 0.707, 1.0]),
        verdict: "The gyroscope reports a rotation that is not there: {}.",
        causes: "a vehicle that was moved while the board calibrated, or another temperature since",
        remedy: "calibrate the board's gyroscope at rest",
        shows: "a mean of the gyroscope, attitude as before",
        looks_like: &[],
        apart: "The board's own attitude does not suffer: log the gyroscope at rest.",
    }),
    build: |b| Box::new(GyroBias(Vector3::new(b.value[0], b.value[1], b.value[2]))),
};

struct GyroBias(Vector3<f64>);

impl Effect for GyroBias {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Imu]
    }
    fn imu(&mut self, _s: &State, reading: &mut ImuReading) {
        reading.rate_B_radps += self.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_adds_to_the_rate_only() {
        let mut r = probe::reading();
        let before = r;
        probe::build(&SPEC, &[("z", 0.01)]).imu(&probe::hover(), &mut r);
        assert_eq!(r.rate_B_radps - before.rate_B_radps, Vector3::new(0.03, 0.0, 0.01));
        assert_eq!(r.acc_B_mps2, before.acc_B_mps2);
    }
}
