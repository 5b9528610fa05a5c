//! Time passes inside the board's loop: what it tells the actuators is late.
//!
//! `u_told(t) = u(t - d)`, `u` of setpoint, attitude and rate alike; `d` (s) a whole number of steps of 2 ms: filters, buses and
//! servos that are driven slowly. Size by judgement: up to 40 ms, since a loop bears less inside than before it
//! (judgement). It takes damping and leaves the frequency: of `s² + (2ζω s + ω²) e^(-sd)` the terms to first order in `d` are a loop with
//! `2ζω - ω² d` in place of `2ζω`.

use crate::board::BoardSettings;
use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "L2",
    name: "inner delay",
    block: Block::InnerLoop,
    parameters: &[ParameterSpec::new(
        "delay",
        "ms",
        Kind::Size,
        0.0,
        20.0,
        [6.0, 40.0],
        "delay inside the loop",
    )],
    off: "actuators told at once",
    source: "plausible sizes by judgement",
    equation: "u_told(t) = u(t - d)",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::Never,
        verdict: "The board's loop tells its servos {delay} later than the simulator says.",
        causes: "filters on the board that are set low, servos that are driven at a low rate",
        remedy: "set filters and servo rate of the board higher; check its gains",
        shows: "attitude that rings, motors that are late after the command",
        looks_like: &["L4", "T2"],
        apart: "A late command (T2) does not ring more than before, backlash (L4) swallows small \
            movements: fly roll and pitch doublets of two sizes.",
    }),
    build: |b| Box::new(LoopDelay(b.value[0] * 1e-3)),
};

struct LoopDelay(f64);

impl Effect for LoopDelay {
    fn board(&mut self, board: &mut BoardSettings) {
        board.loop_delay_s += self.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_the_board_is_late() {
        let mut board = BoardSettings::default();
        probe::build(&SPEC, &[]).board(&mut board);
        assert_eq!(board.loop_delay_s, 0.02);
    }
}
