//! The board's heading is off by more than usual.
//!
//! `β -> β + Δ` in N13 (deg). Size by judgement: 3 to 17°.

use crate::effects::{
    AttitudeError, Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage,
    State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "H1",
    name: "heading misalignment",
    block: Block::InnerLoop,
    parameters: &[ParameterSpec::new(
        "angle",
        "deg",
        Kind::Component,
        0.0,
        8.0,
        [-17.0, 17.0],
        "room north to the board's north",
    )
    .ways("anticlockwise", "clockwise")],
    off: "offset of N13",
    source: "plausible sizes by judgement",
    equation: "β -> β + Δ",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.354, 0.707, 1.0]),
        verdict: "The board's north is {angle} from that of the room.",
        causes: "magnets, steel or motor wires near the compass, a room north that was not given",
        remedy: "give board.north_offset_deg, keep magnets and motors' wires away from the compass",
        shows: "an error across the way that turns with it",
        looks_like: &["A5", "L6"],
        apart: "Wind (A5) pushes in hover too, a coupling (L6) turns the nose only while it \
            rolls: point the nose along a wall and read the heading.",
    }),
    build: |b| Box::new(HeadingMisalignment(b.value[0].to_radians())),
};

struct HeadingMisalignment(f64);

impl Effect for HeadingMisalignment {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Attitude]
    }
    fn attitude(&mut self, _s: &State, error: &mut AttitudeError) {
        error.north_rad += self.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_adds_to_the_offset() {
        let mut e = AttitudeError { north_rad: 0.1, ..AttitudeError::default() };
        probe::build(&SPEC, &[]).attitude(&probe::hover(), &mut e);
        assert!(
            (e.north_rad - 0.1 - 8f64.to_radians()).abs() < 1e-12 && e.tilt_B_rad.norm() == 0.0
        );
    }
}
