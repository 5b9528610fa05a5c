//! The board obeys late: setpoints wait inside it.
//!
//! `q_obeyed(t) = q_set(t - d)`, thrust alike; `d` a whole number of steps of 2 ms. Commands that are late without more ado are
//! T2; time inside the loop is L2.

use crate::effects::{Block, Effect, EffectSpec, ParameterSpec, Role, STEP_S, Setpoint, Stage, State};
use std::collections::VecDeque;

/// The nominal vehicle's own, from its file.
pub const NOMINAL: EffectSpec = EffectSpec {
    id: "N21",
    name: "nominal inner delay",
    block: Block::InnerLoop,
    role: Role::Nominal,
    parameters: &[ParameterSpec::new("delay", "ms", 0.0, 0.0, [0.0, 100.0], "delay")
        .of_vehicle(|v| &mut v.inner_loop.delay_ms)],
    off: "setpoints obeyed at once",
    source: "`haltere gap commission`",
    equation: "q_obeyed(t) = q_set(t - d)",
    build: |b| Box::new(BoardDelay(Queue::new(b.value[0] * 1e-3))),
};

struct BoardDelay(Queue);

impl Effect for BoardDelay {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Setpoint]
    }
    fn setpoint(&mut self, _s: &State, setpoint: &mut Setpoint) {
        self.0.pass(setpoint);
    }
}

/// Setpoints that wait.
pub struct Queue {
    steps: usize,
    waiting: VecDeque<Setpoint>,
}

impl Queue {
    /// For so long, s: whole steps, at most 500.
    pub fn new(delay_s: f64) -> Self {
        let steps = (delay_s / STEP_S).round().clamp(0.0, 500.0) as usize;
        Self { steps, waiting: VecDeque::new() }
    }

    /// One goes in, and the one that has waited comes out; until then the first.
    pub fn pass(&mut self, setpoint: &mut Setpoint) {
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
        let mut delay = probe::build(&NOMINAL, &[("delay", 30.0)]);
        for k in 0..40 {
            let mut s = Setpoint { q: nalgebra::UnitQuaternion::identity(), thrust_frac: f64::from(k) };
            delay.setpoint(&probe::hover(), &mut s);
            assert_eq!(s.thrust_frac, f64::from((k - 15).max(0)));
        }
    }
}
