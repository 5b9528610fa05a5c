//! Commands reach the board late.
//!
//! `delay += d` towards the board (ms). Source: GAP.md T2, 20 to 80 ms. Nearest confounder: slow inner loop (L1).

use crate::effects::{Block, Cargo, Delivery, Effect, EffectSpec, ParameterSpec, Role, Stage, State};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "T2",
    name: "command delay",
    block: Block::Link,
    role: Role::Deviation,
    parameters: &[ParameterSpec::new("delay", "ms", 0.0, 40.0, [20.0, 80.0], "delay")],
    off: "no delay beyond N19",
    source: "GAP.md 3.7",
    equation: "delay += d",
    build: |b| Box::new(CommandDelay(b.value[0] * 1e-3)),
};

struct CommandDelay(f64);

impl Effect for CommandDelay {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Link]
    }
    fn link(&mut self, _s: &State, delivery: &mut Delivery) {
        if delivery.cargo == Cargo::ToBoard {
            delivery.delay_s += self.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_delays_commands_only() {
        let delay = |cargo| {
            let mut d = Delivery { cargo, delay_s: 0.0, lost: false };
            probe::build(&SPEC, &[]).link(&probe::hover(), &mut d);
            d.delay_s
        };
        assert_eq!((delay(Cargo::ToBoard), delay(Cargo::FromTag)), (0.04, 0.0));
    }
}
