//! The inner attitude loop is slower than usual.
//!
//! `ω -> x ω` for the roll and pitch loops of the board. Size by judgement: 0.4 to 0.8.

use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};
use crate::vehicle::Vehicle;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "L1",
    name: "attitude lag",
    block: Block::InnerLoop,
    parameters: &[ParameterSpec::new(
        "factor",
        "",
        Kind::Size,
        1.0,
        0.6,
        [0.4, 0.8],
        "factor on the natural frequency",
    )],
    off: "loops as set",
    source: "plausible sizes by judgement",
    equation: "ω -> x ω",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.25, 0.5, 1.0]),
        verdict: "The board's attitude loop is {factor} slower than the simulator says.",
        causes: "friction in servos or linkages, worn servos, low gains on the board",
        remedy: "check servos and linkages for friction; check the board's gains",
        shows: "attitude that is late at any size of a movement",
        looks_like: &["T2", "L4"],
        apart: "A late command (T2) shifts a movement and does not blunt it, backlash (L4) \
            swallows small ones: fly roll and pitch doublets of two sizes.",
    }),
    build: |b| Box::new(AttitudeLag(b.value[0])),
};

struct AttitudeLag(f64);

impl Effect for AttitudeLag {
    fn vehicle(&mut self, vehicle: &mut Vehicle) {
        vehicle.inner_loop.frequency_radps[0] *= self.0;
        vehicle.inner_loop.frequency_radps[1] *= self.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_slows_roll_and_pitch() {
        let (slowed, before) =
            (probe::edited(&SPEC, &[]).inner_loop, Vehicle::default().inner_loop);
        assert_eq!(slowed.frequency_radps[0], 0.6 * before.frequency_radps[0]);
        assert_eq!(slowed.frequency_radps[2], before.frequency_radps[2]);
    }
}
