//! A wall near by pulls or pushes.
//!
//! `F = k e^(-d/l)` away from the wall (N, Earth frame), `d` distance to it (m). Size by judgement: 0.03 to
//! 0.12 N. Left out: corners, moments.

use nalgebra::Vector3;

use crate::effects::{
    Block, Build, Choice, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage,
    State,
};
use crate::wings::Wrench;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "A10",
    name: "wall effect",
    block: Block::Aerodynamics,
    parameters: &[
        ParameterSpec::new(
            "force",
            "N",
            Kind::Component,
            0.0,
            0.06,
            [-0.12, 0.12],
            "at the wall, away from it; goes with the mass",
        )
        .ways("towards the wall", "away from the wall")
        .beside(|v| v.body.mass_kg),
        ParameterSpec::new("length", "m", Kind::Shape, 0.5, 0.5, [0.2, 1.0], "length of decay"),
        ParameterSpec::new(
            "wall",
            "",
            Kind::Which(Choice::Wall),
            0.0,
            0.0,
            [0.0, 3.0],
            "0 north, 1 east, 2 south, 3 west",
        ),
    ],
    off: "walls far away",
    source: "plausible sizes by judgement",
    equation: "F = k e^(-d/l)",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::WhenAsked([1.0, 1.0, 1.0]),
        verdict: "Close to {wall} the air pushes the vehicle with {force}.",
        causes: "air of the wings that flows back along the wall",
        remedy: "nothing to repair: keep away from the wall, or take the scenario patch",
        shows: "a force from or to one wall, all along it",
        looks_like: &["A6", "M4"],
        apart: "A draught (A6) has one place, a board that sits crooked (M4) pushes everywhere: \
            fly the square along the walls.",
    }),
    build: |b| Box::new(Wall::new(&b)),
};

struct Wall {
    force_n: f64,
    length_m: f64,
    /// Outward normal of the wall, horizontal, and its distance from the origin along it.
    normal: Vector3<f64>,
    at_m: f64,
}

impl Wall {
    fn new(b: &Build<'_>) -> Self {
        let (normal, at_m) = match b.value[2] as u8 {
            0 => (Vector3::x(), b.room.north_m[1]),
            1 => (Vector3::y(), b.room.east_m[1]),
            2 => (-Vector3::x(), -b.room.north_m[0]),
            _ => (-Vector3::y(), -b.room.east_m[0]),
        };
        Self { force_n: b.value[0], length_m: b.value[1].max(0.01), normal, at_m }
    }
}

impl Effect for Wall {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Wrench]
    }
    fn wrench(&mut self, s: &State, wrench: &mut Wrench) {
        let away_m = (self.at_m - self.normal.dot(&s.pos_E_m)).max(0.0);
        let force_E = self.normal * (-self.force_n * (-away_m / self.length_m).exp());
        wrench.force_B_n += s.R_EB.tr_mul(&force_E);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_pushes_away_from_each_wall() {
        for (wall, place, direction) in [
            (0.0, Vector3::new(10.0, 5.0, -1.0), -Vector3::x()),
            (1.0, Vector3::new(5.0, 10.0, -1.0), -Vector3::y()),
            (2.0, Vector3::new(0.0, 5.0, -1.0), Vector3::x()),
            (3.0, Vector3::new(5.0, 0.0, -1.0), Vector3::y()),
        ] {
            let force = |pos_E_m| {
                let mut w = Wrench::default();
                let s = State { pos_E_m, ..probe::hover() };
                probe::build(&SPEC, &[("wall", wall)]).wrench(&s, &mut w);
                w.force_B_n
            };
            assert!((force(place) - direction * 0.06).norm() < 1e-12);
            assert!(force(Vector3::new(5.0, 5.0, -1.0)).norm() < 1e-5);
        }
    }
}
