//! Bytes take their time on the serial lines: scheduling and USB frames.
//!
//! `delay += d₀ + j u`, `u` uniform in 0 to 1, per delivery; order is kept. Milliseconds. Source: 1 to 2
//! ms of a full-speed USB or 921600 baud link; BOARDS.md saw 0.3 to 3.9 ms round trips. A setpoint at the
//! board's door has no delay of its own. Left out: baud limit.

use crate::effects::{
    Block, Cargo, Delivery, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State,
};
use crate::random::Stream;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N19",
    name: "link latency",
    block: Block::Link,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new("least", "ms", Kind::Size, 0.0, 0.5, [0.1, 5.0], "least delay")
            .of_vehicle(|v| &mut v.link.delay_ms),
        ParameterSpec::new("jitter", "ms", Kind::Size, 0.0, 1.0, [0.0, 5.0], "width of the jitter")
            .of_vehicle(|v| &mut v.link.jitter_ms),
    ],
    off: "bytes arrive in the step in which they are sent",
    source: "USB frame, 921600 baud; round trips seen on two boards",
    equation: "delay = d₀ + j u",
    build: |b| {
        Box::new(LinkLatency {
            least_s: b.value[0] * 1e-3,
            jitter_s: b.value[1] * 1e-3,
            rng: b.rng,
        })
    },
};

struct LinkLatency {
    least_s: f64,
    jitter_s: f64,
    rng: Stream,
}

impl Effect for LinkLatency {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Link]
    }
    fn link(&mut self, _s: &State, delivery: &mut Delivery) {
        if delivery.cargo != Cargo::Setpoint {
            delivery.delay_s += self.least_s + self.jitter_s * self.rng.uniform();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_delay_stays_in_its_range() {
        let mut link = probe::build(&SPEC, &[]);
        for _ in 0..1000 {
            let mut d = Delivery { cargo: Cargo::FromTag, delay_s: 0.0, lost: false };
            link.link(&probe::hover(), &mut d);
            assert!((0.5e-3..1.5e-3).contains(&d.delay_s) && !d.lost);
        }
    }
}
