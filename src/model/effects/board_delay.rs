//! The board obeys late: setpoints wait inside it.
//!
//! `q_obeyed(t) = q_set(t - d)`, thrust alike; `d` a whole number of steps of 2 ms. Source: GAP.md L2, 10 to 60 ms.
//! Not to be told from T2 unless the board logs when it received. N21 is the same of the nominal vehicle.

use crate::effects::{Block, Build, Effect, EffectSpec, ParameterSpec, Role, STEP_S, Setpoint, Stage, State};
use std::collections::VecDeque;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "L2",
    name: "inner delay",
    block: Block::InnerLoop,
    role: Role::Deviation,
    parameters: &[ParameterSpec::new("delay", "ms", 0.0, 30.0, [10.0, 60.0], "delay")],
    off: "setpoints obeyed at once",
    source: "GAP.md 3.4",
    equation: "q_obeyed(t) = q_set(t - d)",
    build: |b| Box::new(BoardDelay::new(&b)),
};

/// The nominal vehicle's own, from its file.
pub const NOMINAL: EffectSpec = EffectSpec {
    id: "N21",
    name: "nominal inner delay",
    role: Role::Nominal,
    parameters: &[ParameterSpec::new("delay", "ms", 0.0, 0.0, [0.0, 100.0], "delay")
        .of_vehicle(|v| &mut v.inner_loop.delay_ms)],
    source: "`haltere gap commission`",
    ..SPEC
};

struct BoardDelay {
    steps: usize,
    waiting: VecDeque<Setpoint>,
}

impl BoardDelay {
    fn new(b: &Build<'_>) -> Self {
        let steps = (b.value[0] * 1e-3 / STEP_S).round().clamp(0.0, 500.0) as usize;
        Self { steps, waiting: VecDeque::new() }
    }
}

impl Effect for BoardDelay {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Setpoint]
    }
    fn setpoint(&mut self, _s: &State, setpoint: &mut Setpoint) {
        self.waiting.push_back(*setpoint);
        if self.waiting.len() > self.steps + 1 {
            self.waiting.pop_front();
        }
        if let Some(old) = self.waiting.front() {
            *setpoint = *old;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_comes_out_after_the_delay() {
        let mut delay = probe::build(&SPEC, &[]);
        for k in 0..40 {
            let mut s = Setpoint { q: nalgebra::UnitQuaternion::identity(), thrust_frac: f64::from(k) };
            delay.setpoint(&probe::hover(), &mut s);
            assert_eq!(s.thrust_frac, f64::from((k - 15).max(0)));
        }
    }
}
