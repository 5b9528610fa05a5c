//! Bytes of the tag come late, by a constant that nobody can see in them.
//!
//! `delay += d` from the tag (ms). The companion learns its clock from the earliest bytes, so a constant delay becomes a time
//! offset between UWB and IMU. Size by judgement: 30 to 150 ms.

use crate::effects::{
    Block, Cargo, Delivery, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role,
    Stage, State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "T1",
    name: "UWB time offset",
    block: Block::Timing,
    parameters: &[ParameterSpec::new("delay", "ms", Kind::Size, 0.0, 80.0, [30.0, 150.0], "delay")],
    off: "no delay beyond N19",
    source: "plausible sizes by judgement",
    equation: "delay += d",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.316, 0.632, 1.0]),
        verdict: "UWB readings come {delay} later than the companion believes.",
        causes: "a loaded computer, a slow or buffered serial link, a tag that answers late",
        remedy: "set uwb.tag_latency_s; check the load of the companion's computer",
        shows: "an error in proportion to speed, none in hover",
        looks_like: &["U3"],
        apart: "Lateness shows in a fast dash at one heading, an uneven antenna (U3) in a turn on \
            the spot.",
    }),
    build: |b| Box::new(TagLatency(b.value[0] * 1e-3)),
};

struct TagLatency(f64);

impl Effect for TagLatency {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Link]
    }
    fn link(&mut self, _s: &State, delivery: &mut Delivery) {
        if delivery.cargo == Cargo::FromTag {
            delivery.delay_s += self.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_delays_the_tag_only() {
        let delay = |cargo| {
            let mut d = Delivery { cargo, delay_s: 0.001, lost: false };
            probe::build(&SPEC, &[]).link(&probe::hover(), &mut d);
            d.delay_s
        };
        assert!((delay(Cargo::FromTag) - 0.081).abs() < 1e-12);
        assert_eq!(delay(Cargo::FromBoard), 0.001);
    }
}
