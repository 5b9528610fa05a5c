//! Commands reach the board late.
//!
//! `delay += d` of setpoints, `delay += s d` of all else towards the board (ms). A slow link delays everything, its time
//! synchronisation too (`s` 1); a queue before the loops delays setpoints alone (`s` 0). Size by judgement: 20 to 80 ms. Nearest
//! confounder: slow inner loop (L1).

use crate::effects::{
    Block, Cargo, Delivery, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role,
    Setpoint, Stage, State,
};
use crate::waiting::Waiting;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "T2",
    name: "command delay",
    block: Block::Link,
    parameters: &[
        ParameterSpec::new("delay", "ms", Kind::Size, 0.0, 40.0, [20.0, 80.0], "delay"),
        ParameterSpec::new(
            "share",
            "",
            Kind::Shape,
            1.0,
            1.0,
            [0.0, 1.0],
            "share of it that all but setpoints have",
        ),
    ],
    off: "no delay beyond N19",
    source: "plausible sizes by judgement",
    equation: "delay += d of setpoints, s d of all else",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.25, 0.5, 1.0]),
        verdict: "Commands reach the board {delay} later than the simulator says.",
        causes: "a low baud rate, a loaded link or computer, a queue on the board",
        remedy: "check the link from companion to board: baud rate, load, packet loss",
        shows: "a pure lag from command to motors and attitude",
        looks_like: &["L1"],
        apart: "A slow loop (L1) blunts a movement as well: fly roll and pitch doublets, or log \
            on the board when setpoints arrive.",
    }),
    build: |b| {
        let [delay_s, share] = [b.value[0] * 1e-3, b.value[1]];
        Box::new(CommandDelay {
            link_s: share * delay_s,
            queue: Waiting::new((1.0 - share) * delay_s),
        })
    },
};

struct CommandDelay {
    link_s: f64,
    /// Before the loops.
    queue: Waiting<Setpoint>,
}

impl Effect for CommandDelay {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Link, Stage::Setpoint]
    }
    fn link(&mut self, _s: &State, delivery: &mut Delivery) {
        if delivery.cargo == Cargo::ToBoard {
            delivery.delay_s += self.link_s;
        }
    }
    fn setpoint(&mut self, _s: &State, setpoint: &mut Setpoint) {
        *setpoint = self.queue.pass(*setpoint);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_delays_commands_only() {
        let delay = |cargo, share| {
            let mut d = Delivery { cargo, delay_s: 0.0, lost: false };
            probe::build(&SPEC, &[("share", share)]).link(&probe::hover(), &mut d);
            d.delay_s
        };
        assert_eq!([Cargo::ToBoard, Cargo::FromTag].map(|cargo| delay(cargo, 1.0)), [0.04, 0.0]);
        assert_eq!([Cargo::ToBoard, Cargo::FromTag].map(|cargo| delay(cargo, 0.0)), [0.0, 0.0]);
        let obeyed = |share| {
            let mut late = probe::build(&SPEC, &[("share", share)]);
            let mut pass = |k: u32| {
                let q = nalgebra::UnitQuaternion::identity();
                let mut s = Setpoint { q, thrust_frac: f64::from(k) };
                late.setpoint(&probe::hover(), &mut s);
                s.thrust_frac
            };
            (0..40).map(&mut pass).last()
        };
        assert_eq!((obeyed(1.0), obeyed(0.0)), (Some(39.0), Some(19.0)), "20 steps of 2 ms");
    }
}
