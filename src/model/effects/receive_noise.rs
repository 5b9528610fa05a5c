//! Receivers stamp the first path with white noise.
//!
//! `t_rx += σ n / c` at every reception, at the tag and between anchors; given as a path (m). Three
//! receptions enter one TDOA, so its white noise is `√3 σ`. Source: 0.05 to 0.07 m white on recorded
//! TDOA residuals with motion capture, hence σ = 0.035 m. Left out: dependence on signal power (U4).

use crate::effects::{Block, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};
use crate::random::Stream;
use crate::tag::air::Packet;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N15",
    name: "receive-time noise",
    block: Block::Uwb,
    role: Role::Nominal,
    parameters: &[ParameterSpec::new(
        "std",
        "m",
        Kind::Size,
        0.0,
        0.035,
        [0.01, 0.1],
        "per reception, as a path",
    )
    .of_vehicle(|v| &mut v.uwb.std_m)],
    off: "receivers stamp exactly, to the tick",
    source: "recorded TDOA residuals",
    equation: "t_rx += σ n / c",
    build: |b| Box::new(ReceiveNoise { std_m: b.value[0], rng: b.rng }),
};

/// White noise at every reception.
pub(super) struct ReceiveNoise {
    pub std_m: f64,
    pub rng: Stream,
}

impl Effect for ReceiveNoise {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Air]
    }
    fn air(&mut self, _s: &State, packet: &mut Packet) {
        packet.tag_extra_m += self.std_m * self.rng.normal();
        for hop in packet.anchor_hops() {
            hop.extra_m += self.std_m * self.rng.normal();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;
    use nalgebra::Vector3;

    #[test]
    fn val_tdoa_noise_is_0_05_to_0_07_m() {
        let mut noise = probe::build(&SPEC, &[]);
        let (mut var, n) = (0.0, 5000);
        for _ in 0..n {
            let mut draw = || {
                let mut p = probe::packet(0, Vector3::new(5.0, 5.0, -1.0));
                noise.air(&probe::hover(), &mut p);
                let hop = p.anchor_hops()[1].extra_m;
                (p.tag_extra_m, hop)
            };
            let ((a, _), (b, hop)) = (draw(), draw());
            var += (a - b - hop).powi(2) / f64::from(n);
        }
        assert!((0.05..0.07).contains(&var.sqrt()), "{}", var.sqrt());
    }
}
