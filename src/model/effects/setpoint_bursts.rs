//! Setpoints get lost in bursts; the board holds the last one.
//!
//! Bursts start at random (Poisson, per second) and last `d` (s); inside, every setpoint is lost at the board's door. Size by judgement:
//! 0.1 to 0.6 s. Beyond 0.5 s the board's own failsafe acts.

use crate::effects::{
    Block, Cargo, Delivery, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role,
    Stage, State,
};
use crate::random::Stream;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "T3",
    name: "dropped setpoints",
    block: Block::Link,
    parameters: &[
        ParameterSpec::new("length", "s", Kind::Size, 0.0, 0.3, [0.1, 0.6], "length of a burst"),
        ParameterSpec::new(
            "rate",
            "1/min",
            Kind::Size,
            0.0,
            15.0,
            [4.0, 40.0],
            "bursts per minute",
        ),
    ],
    off: "every setpoint arrives",
    source: "plausible sizes by judgement",
    equation: "lost in bursts",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.25, 0.5, 1.0]),
        verdict: "Commands get lost in bursts of {length}, {rate}.",
        causes: "a loose plug, interference, a computer that stands still at times",
        remedy: "check the link from companion to board: baud rate, load, packet loss",
        shows: "attitude that stands still while the command moves",
        looks_like: &["L4", "P4"],
        apart: "Log on the board when setpoints arrive: backlash (L4) and a lag of thrust (P4) \
            leave no gap there.",
    }),
    build: |b| {
        Box::new(SetpointBursts {
            length_s: b.value[0],
            rate_hz: b.value[1] / 60.0,
            until_s: 0.0,
            last_s: 0.0,
            rng: b.rng,
        })
    },
};

struct SetpointBursts {
    length_s: f64,
    rate_hz: f64,
    until_s: f64,
    last_s: f64,
    rng: Stream,
}

impl Effect for SetpointBursts {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Link]
    }
    fn link(&mut self, s: &State, delivery: &mut Delivery) {
        if delivery.cargo != Cargo::Setpoint {
            return;
        }
        let draw = self.rng.uniform();
        let dt_s = s.t_s - self.last_s;
        self.last_s = s.t_s;
        if s.t_s >= self.until_s && draw < self.rate_hz * dt_s {
            self.until_s = s.t_s + self.length_s;
        }
        delivery.lost |= s.t_s < self.until_s;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_loses_setpoints_in_bursts_only() {
        let mut bursts = probe::build(&SPEC, &[]);
        let mut lost = |k: i32, cargo| {
            let mut d = Delivery { cargo, delay_s: 0.0, lost: false };
            let t_s = f64::from(k) * 0.01;
            bursts.link(&State { t_s, ..probe::hover() }, &mut d);
            d.lost
        };
        let course: Vec<bool> = (0..60_000).map(|k| lost(k, Cargo::Setpoint)).collect();
        let share = course.iter().filter(|l| **l).count() as f64 / 60_000.0;
        // 15 per minute of 0.3 s: 0.075 of the time, less what overlaps.
        assert!((share - 0.07).abs() < 0.02, "{share}");
        assert!(!(0..1000).any(|k| lost(60_000 + k, Cargo::FromTag)));
    }
}
