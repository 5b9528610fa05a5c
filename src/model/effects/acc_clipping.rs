//! The accelerometer clips: what it cannot show is gone, and the mean shifts.
//!
//! `a_i = clamp(a_i, ±limit)` (m/s²) after the vibration. Size by judgement; the
//! alias of the wing beat itself is nominal, since N9 is sampled where the IMU samples. A part set to
//! ±2 g clips at 19.6 m/s².

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, ImuReading, Kind, ParameterSpec, Role, Stage,
    State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "M7",
    name: "accelerometer clipping",
    block: Block::Imu,
    parameters: &[ParameterSpec::new(
        "limit",
        "m/s²",
        Kind::Inverse,
        f64::INFINITY,
        19.6,
        [15.0, 60.0],
        "largest reading of an axis",
    )],
    off: "range never reached",
    source: "plausible sizes by judgement",
    equation: "a_i = clamp(a_i, ±limit)",
    role: Role::Deviation(Deviation {
        standard: false,
        hidden: Hidden::Never,
        verdict: "The accelerometer shows no more than {limit} along an axis.",
        causes: "a measuring range that is set small, hard vibration",
        remedy: "set a larger range of the accelerometer on the board, or mount the board softer",
        shows: "raw readings that stop at one value; slow beats that move with throttle",
        looks_like: &["A7"],
        apart: "Gusts (A7) leave the raw readings below the limit of the sensor.",
    }),
    build: |b| Box::new(Clipping(b.value[0].abs())),
};

struct Clipping(f64);

impl Effect for Clipping {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Imu]
    }
    fn imu(&mut self, _s: &State, reading: &mut ImuReading) {
        reading.acc_B_mps2.apply(|a| *a = a.clamp(-self.0, self.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_cuts_both_ways() {
        let mut r = probe::reading();
        r.acc_B_mps2 = nalgebra::Vector3::new(30.0, -30.0, -9.8);
        probe::build(&SPEC, &[]).imu(&probe::hover(), &mut r);
        assert_eq!(r.acc_B_mps2, nalgebra::Vector3::new(19.6, -19.6, -9.8));
    }
}
