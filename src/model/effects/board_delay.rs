//! The board obeys late: setpoints wait inside it.
//!
//! `q_obeyed(t) = q_set(t - d)`, thrust alike; `d` a whole number of steps of 2 ms. Commands that are late without more ado are
//! T2; time inside the loop is L2.

use crate::effects::{
    Block, Effect, EffectSpec, Kind, ParameterSpec, Role, Setpoint, Stage, State,
};
use crate::waiting::Waiting;

/// The nominal vehicle's own, from its file.
pub const NOMINAL: EffectSpec = EffectSpec {
    id: "N21",
    name: "nominal inner delay",
    block: Block::InnerLoop,
    role: Role::Nominal,
    parameters: &[ParameterSpec::new("delay", "ms", Kind::Size, 0.0, 0.0, [0.0, 100.0], "delay")
        .of_vehicle(|v| &mut v.inner_loop.delay_ms)],
    off: "setpoints obeyed at once",
    source: "`haltere gap commission`",
    equation: "q_obeyed(t) = q_set(t - d)",
    build: |b| Box::new(BoardDelay(Waiting::new(b.value[0] * 1e-3))),
};

struct BoardDelay(Waiting<Setpoint>);

impl Effect for BoardDelay {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Setpoint]
    }
    fn setpoint(&mut self, _s: &State, setpoint: &mut Setpoint) {
        *setpoint = self.0.pass(*setpoint);
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
            let mut s =
                Setpoint { q: nalgebra::UnitQuaternion::identity(), thrust_frac: f64::from(k) };
            delay.setpoint(&probe::hover(), &mut s);
            assert_eq!(s.thrust_frac, f64::from((k - 15).max(0)));
        }
    }
}
