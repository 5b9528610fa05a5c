//! White noise of accelerometer, gyroscope and barometer.
//!
//! `y += σ n` per sample, independent. Units m/s², rad/s, Pa. Source: order of magnitude of small MEMS
//! parts (data sheets of BMI088 and BMP388) at 250 Hz. Left out: quantisation.

use nalgebra::Vector3;

use crate::effects::{
    Block, Effect, EffectSpec, ImuReading, Kind, ParameterSpec, Role, Stage, State,
};
use crate::random::Stream;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N10",
    name: "IMU noise",
    block: Block::Imu,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "std_acc",
            "m/s²",
            Kind::Size,
            0.0,
            0.05,
            [0.01, 0.2],
            "accelerometer, each axis",
        )
        .of_vehicle(|v| &mut v.imu.std_acc_mps2),
        ParameterSpec::new(
            "std_gyro",
            "rad/s",
            Kind::Size,
            0.0,
            0.004,
            [0.001, 0.02],
            "gyroscope, each axis",
        )
        .of_vehicle(|v| &mut v.imu.std_gyro_radps),
        ParameterSpec::new("std_pressure", "Pa", Kind::Size, 0.0, 2.5, [0.5, 10.0], "barometer")
            .of_vehicle(|v| &mut v.imu.std_pressure_pa),
    ],
    off: "exact readings",
    source: "data sheets of common MEMS parts",
    equation: "y += σ n",
    build: |b| Box::new(ImuNoise { std: [b.value[0], b.value[1], b.value[2]], rng: b.rng }),
};

struct ImuNoise {
    std: [f64; 3],
    rng: Stream,
}

impl Effect for ImuNoise {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Imu]
    }
    fn imu(&mut self, _s: &State, reading: &mut ImuReading) {
        let mut draw = || Vector3::from_fn(|_, _| self.rng.normal());
        reading.acc_B_mps2 += draw() * self.std[0];
        reading.rate_B_radps += draw() * self.std[1];
        reading.pressure_pa += self.rng.normal() * self.std[2];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_has_its_standard_deviation() {
        let mut noise = probe::build(&SPEC, &[]);
        let n = 10_000;
        let (mut acc, mut gyro) = (0.0, 0.0);
        for _ in 0..n {
            let zero = Vector3::zeros();
            let mut r = ImuReading { acc_B_mps2: zero, rate_B_radps: zero, pressure_pa: 0.0 };
            noise.imu(&probe::hover(), &mut r);
            acc += r.acc_B_mps2.norm_squared() / f64::from(3 * n);
            gyro += r.rate_B_radps.norm_squared() / f64::from(3 * n);
        }
        assert!((acc.sqrt() / 0.05 - 1.0).abs() < 0.03 && (gyro.sqrt() / 0.004 - 1.0).abs() < 0.03);
    }
}
