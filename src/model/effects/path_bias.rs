//! Every place in the room has its own small bias on every anchor's path: reflections and antenna
//! pattern, smooth in position.
//!
//! `b_n(p) = c_n + σ [ sin(k_n1·p + φ_n1) + sin(k_n2·p + φ_n2) ]` (m), wave vectors of random direction and
//! wavelength 1.5 to 4 m, `c_n` normal, per anchor. A pair's bias has standard deviations √2 σ and √2 of that of
//! `c`. Source: recorded flights, pair bias 0.04 to 0.06 m varying over a metre or so; 0.06 m in a
//! clear room and 0.15 m in a cluttered one that stay (`haltere-lab recorded --ranging`). Left out: dependence on attitude (U3).

use std::f64::consts::TAU;

use nalgebra::Vector3;

use crate::effects::{Block, Build, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};
use crate::tag::air::Packet;

/// Wavelengths, m.
const WAVELENGTH_M: [f64; 2] = [1.5, 4.0];

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N16",
    name: "position-dependent path bias",
    block: Block::Uwb,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "std",
            "m",
            Kind::Size,
            0.0,
            0.035,
            [0.01, 0.3],
            "per path; a pair has √2 of it",
        )
        .of_vehicle(|v| &mut v.uwb.path_bias_m),
        ParameterSpec::new(
            "constant",
            "m",
            Kind::Shape,
            0.0,
            0.0,
            [0.0, 0.3],
            "that stays, per path",
        ),
    ],
    off: "paths are straight",
    source: "recorded flights against motion capture",
    equation: "b_n(p) = c_n + σ Σ sin(k·p + φ)",
    build: |b| Box::new(PathBias::new(b)),
};

struct PathBias {
    std_m: f64,
    /// Per anchor what stays, m.
    constant_m: Vec<f64>,
    /// Per anchor two waves: wave vector (rad/m) and phase (rad).
    waves: Vec<[(Vector3<f64>, f64); 2]>,
}

impl PathBias {
    fn new(mut b: Build<'_>) -> Self {
        let mut wave = || {
            let direction = Vector3::from_fn(|_, _| b.rng.normal()).normalize();
            let length_m = b.rng.between(WAVELENGTH_M[0], WAVELENGTH_M[1]);
            (direction * (TAU / length_m), b.rng.between(0.0, TAU))
        };
        let waves = b.sites_E_m.iter().map(|_| [wave(), wave()]).collect();
        let constant_m = b.sites_E_m.iter().map(|_| b.value[1] * b.rng.normal()).collect();
        Self { std_m: b.value[0], constant_m, waves }
    }
}

impl Effect for PathBias {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Air]
    }
    fn air(&mut self, _s: &State, packet: &mut Packet) {
        if let (Some(waves), Some(constant_m)) =
            (self.waves.get(packet.from), self.constant_m.get(packet.from))
        {
            let sum: f64 =
                waves.iter().map(|(k, phase)| (k.dot(&packet.tag_E_m) + phase).sin()).sum();
            packet.tag_extra_m += constant_m + self.std_m * sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn val_pair_bias_is_0_04_to_0_06_m_and_smooth() {
        let mut bias = probe::build(&SPEC, &[]);
        let mut at = |from, x: f64, y: f64| {
            let mut p = probe::packet(from, Vector3::new(x, y, -1.2));
            bias.air(&probe::hover(), &mut p);
            p.tag_extra_m
        };
        let (mut var, mut n) = (0.0f64, 0.0);
        for i in 0..100 {
            for j in 0..100 {
                let (x, y) = (f64::from(i) * 0.1, f64::from(j) * 0.1);
                var += (at(0, x, y) - at(1, x, y)).powi(2);
                n += 1.0;
                assert!((at(0, x, y) - at(0, x + 0.05, y)).abs() < 0.02);
            }
        }
        let std: f64 = (var / n).sqrt();
        assert!((0.04..0.06).contains(&std), "{std}");
    }
}
