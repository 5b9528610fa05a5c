//! Turn-on bias of accelerometer and gyroscope: drawn once per flight, constant in it.
//!
//! `y += b`, `b ~ N(0, σ²)` per axis, body frame. Units m/s², rad/s. Source: small, as left after the
//! board's own calibration; assumed.

use nalgebra::Vector3;

use crate::effects::{
    Block, Effect, EffectSpec, ImuReading, Kind, ParameterSpec, Role, Stage, State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N11",
    name: "IMU turn-on bias",
    block: Block::Imu,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "std_acc",
            "m/s²",
            Kind::Size,
            0.0,
            0.05,
            [0.0, 0.2],
            "accelerometer, each axis",
        ),
        ParameterSpec::new(
            "std_gyro",
            "rad/s",
            Kind::Size,
            0.0,
            0.003,
            [0.0, 0.01],
            "gyroscope, each axis",
        ),
    ],
    off: "no bias",
    source: "assumed: residue of a calibration",
    equation: "y += b",
    build: |mut b| {
        let mut draw = |std: f64| Vector3::from_fn(|_, _| std * b.rng.normal());
        Box::new(ImuBias { acc: draw(b.value[0]), gyro: draw(b.value[1]) })
    },
};

struct ImuBias {
    acc: Vector3<f64>,
    gyro: Vector3<f64>,
}

impl Effect for ImuBias {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Imu]
    }
    fn imu(&mut self, _s: &State, reading: &mut ImuReading) {
        reading.acc_B_mps2 += self.acc;
        reading.rate_B_radps += self.gyro;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_is_the_same_in_every_sample() {
        let mut bias = probe::build(&SPEC, &[]);
        let mut read = || {
            let zero = Vector3::zeros();
            let mut r = ImuReading { acc_B_mps2: zero, rate_B_radps: zero, pressure_pa: 0.0 };
            bias.imu(&probe::hover(), &mut r);
            r
        };
        let first = read();
        assert_eq!(first, read());
        assert!(first.acc_B_mps2.norm() > 0.0 && first.acc_B_mps2.norm() < 0.25);
    }
}
