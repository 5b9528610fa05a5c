//! The wing beat shakes the IMU.
//!
//! ```text
//! a_i += g (f/f_h)² s_i [ √2 (√w₁ sin(θ + φ_i1) + √w₂ sin(2θ + φ_i2)) + √(1-w₁-w₂) n ]
//! ```
//! and likewise for the gyroscope; `θ` phase of the wing beat, integrated from the flap rate (rad),
//! `s` standard deviation in hover (g; rad/s), `w` shares of the two harmonics in the variance, `n`
//! white. Source: standard deviations of raw 100 Hz accelerometer records in flight, 0.56, 1.76,
//! 0.79 g; shares and gyroscope assumed. Sampled where the IMU samples, so it aliases as it would.
//! Left out: the same shaking in the true motion (GAP.md: a wing-beat resolved generator is another
//! program).

use std::f64::consts::{SQRT_2, TAU};

use nalgebra::Vector3;

use crate::effects::{
    Block, Build, Effect, EffectSpec, ImuReading, Kind, ParameterSpec, Role, Stage, State,
};
use crate::random::Stream;
use haltere_core::frames::G_MPS2;

/// Shares of the harmonics in the variance; the rest is white. Assumed.
const SHARES: [f64; 2] = [0.6, 0.3];

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N9",
    name: "flapping vibration on the IMU",
    block: Block::Imu,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "std_acc_x",
            "g",
            Kind::Size,
            0.0,
            0.56,
            [0.2, 1.5],
            "accelerometer x in hover",
        )
        .of_vehicle(|v| &mut v.imu.vibration_g[0]),
        ParameterSpec::new(
            "std_acc_y",
            "g",
            Kind::Size,
            0.0,
            1.76,
            [0.5, 3.0],
            "accelerometer y in hover",
        )
        .of_vehicle(|v| &mut v.imu.vibration_g[1]),
        ParameterSpec::new(
            "std_acc_z",
            "g",
            Kind::Size,
            0.0,
            0.79,
            [0.2, 2.0],
            "accelerometer z in hover",
        )
        .of_vehicle(|v| &mut v.imu.vibration_g[2]),
        ParameterSpec::new(
            "std_gyro",
            "rad/s",
            Kind::Size,
            0.0,
            0.15,
            [0.0, 0.6],
            "each gyroscope axis in hover",
        )
        .of_vehicle(|v| &mut v.imu.vibration_radps),
    ],
    off: "the IMU feels the cycle-averaged motion only",
    source: "recorded flights, raw 100 Hz accelerometer; gyroscope assumed",
    equation: "a += g (f/f_h)² s [√2 Σ √w_k sin(kθ + φ_k) + √(1-Σw) n]",
    build: |b| Box::new(FlapVibration::new(b)),
};

struct FlapVibration {
    /// Standard deviation per channel: acc x, y, z (m/s²), gyro x, y, z (rad/s).
    std: [f64; 6],
    /// Per channel: factors of sin θ, cos θ, sin 2θ, cos 2θ for unit variance.
    shape: [[f64; 4]; 6],
    inverse_hover_hz: f64,
    rng: Stream,
}

impl FlapVibration {
    fn new(mut b: Build<'_>) -> Self {
        let v = b.value;
        let std = [v[0] * G_MPS2, v[1] * G_MPS2, v[2] * G_MPS2, v[3], v[3], v[3]];
        let mut shape = [[0.0; 4]; 6];
        for channel in &mut shape {
            for (pair, share) in channel.chunks_exact_mut(2).zip(SHARES) {
                let phase = b.rng.between(0.0, TAU);
                let amplitude = SQRT_2 * share.sqrt();
                pair[0] = amplitude * phase.cos();
                pair[1] = amplitude * phase.sin();
            }
        }
        Self { std, shape, inverse_hover_hz: 1.0 / b.nominal.hover_hz(), rng: b.rng }
    }
}

impl Effect for FlapVibration {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Imu]
    }
    fn imu(&mut self, s: &State, reading: &mut ImuReading) {
        let rate = 0.5 * (s.flap_hz[0] + s.flap_hz[1]) * self.inverse_hover_hz;
        let strength = rate * rate;
        let (s1, c1) = (TAU * s.flap_cycles).sin_cos();
        let basis = [s1, c1, 2.0 * s1 * c1, c1 * c1 - s1 * s1];
        let white = (1.0 - SHARES[0] - SHARES[1]).sqrt();
        let mut out = [0.0; 6];
        for ((out, shape), std) in out.iter_mut().zip(&self.shape).zip(&self.std) {
            let wave: f64 = shape.iter().zip(&basis).map(|(a, b)| a * b).sum();
            *out = strength * std * (wave + white * self.rng.normal());
        }
        reading.acc_B_mps2 += Vector3::new(out[0], out[1], out[2]);
        reading.rate_B_radps += Vector3::new(out[3], out[4], out[5]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    fn std_g(flap_hz: f64) -> [f64; 3] {
        let mut effect = probe::build(&SPEC, &[]);
        let (mut sum, n) = ([0.0; 3], 20_000);
        for k in 0..n {
            let flap_cycles = (f64::from(k) * 0.01 * 14.83).fract();
            let s = State { flap_hz: [flap_hz; 2], flap_cycles, ..probe::hover() };
            let zero = Vector3::zeros();
            let mut r = ImuReading { acc_B_mps2: zero, rate_B_radps: zero, pressure_pa: 0.0 };
            effect.imu(&s, &mut r);
            for (sum, a) in sum.iter_mut().zip(r.acc_B_mps2.iter()) {
                *sum += (a / G_MPS2).powi(2) / f64::from(n);
            }
        }
        sum.map(f64::sqrt)
    }

    #[test]
    fn val_standard_deviations_of_the_recorded_flights() {
        for (got, want) in std_g(probe::hover().flap_hz[0]).into_iter().zip([0.56, 1.76, 0.79]) {
            assert!((got / want - 1.0).abs() < 0.03, "{got} {want}");
        }
    }

    #[test]
    fn prop_still_with_motors_off() {
        assert_eq!(std_g(0.0), [0.0; 3]);
    }
}
