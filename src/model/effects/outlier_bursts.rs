//! Bursts of wild receptions: reflections while something moves, interference.
//!
//! Windows of `1.5 s · u`, `u` in 0.1 to 0.6, start at random (Poisson); inside, a reception is off by 0.5 to 3 m with a
//! probability of one half. Size by judgement.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};
use crate::random::Stream;
use crate::tag::air::Packet;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "U10",
    name: "outlier bursts",
    block: Block::Uwb,
    parameters: &[
        ParameterSpec::new("rate", "1/min", Kind::Size, 0.0, 8.0, [2.0, 20.0], "bursts per minute"),
        ParameterSpec::new("size", "m", Kind::Shape, 3.0, 3.0, [1.0, 6.0], "largest error"),
    ],
    off: "no outliers",
    source: "plausible sizes by judgement",
    equation: "ρ -> ρ + e in bursts",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.167, 0.333, 0.667]),
        verdict: "Wild UWB readings come in bursts, {rate}.",
        causes: "somebody or something that moves between the anchors, another transmitter",
        remedy: "check antennas, cables, and what else sends on the channel",
        shows: "rare large errors, rejections in clusters",
        looks_like: &["U1"],
        apart: "Noise (U1) is always there, bursts come and go.",
    }),
    build: |b| {
        Box::new(OutlierBursts {
            rate_hz: b.value[0] / 60.0,
            size_m: b.value[1],
            until_s: 0.0,
            last_s: 0.0,
            rng: b.rng,
        })
    },
};

/// Longest burst, s, and the share of it that a burst lasts.
const LONGEST_S: f64 = 1.5;
const SHARE: [f64; 2] = [0.1, 0.6];
/// Share of receptions that are wild in a burst, and the least error, m.
const WILD: f64 = 0.5;
const LEAST_M: f64 = 0.5;

struct OutlierBursts {
    rate_hz: f64,
    size_m: f64,
    until_s: f64,
    last_s: f64,
    rng: Stream,
}

impl Effect for OutlierBursts {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Air]
    }
    fn air(&mut self, s: &State, packet: &mut Packet) {
        let draws = [(); 4].map(|()| self.rng.uniform());
        let dt_s = s.t_s - self.last_s;
        self.last_s = s.t_s;
        if draws[0] < self.rate_hz * dt_s {
            let share = SHARE[0] + (SHARE[1] - SHARE[0]) * draws[1];
            self.until_s = s.t_s + LONGEST_S * share;
        }
        if s.t_s < self.until_s && draws[2] < WILD {
            packet.tag_extra_m += LEAST_M + (self.size_m - LEAST_M) * draws[3];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_come_in_bursts() {
        let mut bursts = probe::build(&SPEC, &[]);
        let mut wild = Vec::new();
        for k in 0..60_000 {
            let t_s = f64::from(k) * 0.0021;
            let mut p = probe::packet(0, nalgebra::Vector3::zeros());
            bursts.air(&State { t_s, ..probe::hover() }, &mut p);
            assert!(p.tag_extra_m == 0.0 || (0.5..3.0).contains(&p.tag_extra_m));
            wild.push(p.tag_extra_m > 0.0);
        }
        let count = wild.iter().filter(|w| **w).count() as f64;
        // 8 per minute of 0.525 s on average, half of it: 3.5 %.
        assert!((count / 60_000.0 - 0.035).abs() < 0.02, "{count}");
        let pairs = wild.windows(2).filter(|w| w[0] && w[1]).count() as f64;
        assert!(pairs / count > 0.35, "clustered");
    }
}
