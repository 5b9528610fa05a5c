//! A draught in one place: an open door, a fan, an air outlet.
//!
//! `w = w₀ e^(-½ d²/σ²)` towards one direction, `d` horizontal distance from the middle of the draught (m),
//! `σ` its half width (m). Size by judgement: 0.25 to 1 m/s, 0.4 to 1.5 m.

use nalgebra::Vector3;

use crate::effects::{
    Block, Build, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "A6",
    name: "draught zone",
    block: Block::Aerodynamics,
    parameters: &[
        ParameterSpec::new("speed", "m/s", Kind::Size, 0.0, 0.6, [0.25, 1.0], "in the middle"),
        ParameterSpec::north(5.0, "middle, from the origin"),
        ParameterSpec::east(5.0, "middle, from the origin"),
        ParameterSpec::new("size", "m", Kind::Shape, 0.8, 0.8, [0.4, 1.5], "half width"),
        ParameterSpec::new(
            "towards",
            "deg",
            Kind::Direction,
            0.0,
            90.0,
            [-180.0, 180.0],
            "direction, clockwise from north",
        ),
    ],
    off: "still air everywhere",
    source: "plausible sizes by judgement",
    equation: "w = w₀ e^(-½ d²/σ²)",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.354, 0.707, 1.0]),
        verdict: "A draught of {speed} blows {towards} at one place of the room, {north} and \
            {east} of the origin.",
        causes: "an air outlet, a fan, an open door",
        remedy: "close doors, stop fans; nothing to repair on the vehicle",
        shows: "a force at one place, whichever way the vehicle passes it",
        looks_like: &["A5", "A10"],
        apart: "Wind (A5) is everywhere, a wall (A10) acts along its whole length: fly the square \
            along the walls, and again with doors closed and fans off.",
    }),
    build: |b| Box::new(Draught::new(&b)),
};

struct Draught {
    wind_E_mps: Vector3<f64>,
    middle_E_m: [f64; 2],
    size_m: f64,
}

impl Draught {
    fn new(b: &Build<'_>) -> Self {
        let (sin, cos) = b.value[4].to_radians().sin_cos();
        Self {
            wind_E_mps: Vector3::new(cos, sin, 0.0) * b.value[0],
            middle_E_m: [b.value[1], b.value[2]],
            size_m: b.value[3].max(0.05),
        }
    }
}

impl Effect for Draught {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Wind]
    }
    fn wind(&mut self, s: &State, wind_E_mps: &mut Vector3<f64>) {
        let x = (s.pos_E_m.x - self.middle_E_m[0]) / self.size_m;
        let y = (s.pos_E_m.y - self.middle_E_m[1]) / self.size_m;
        *wind_E_mps += self.wind_E_mps * (-0.5 * (x * x + y * y)).exp();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_blows_in_its_place_only() {
        let wind = |x: f64| {
            let pos_E_m = Vector3::new(x, 5.0, -1.0);
            let mut w = Vector3::zeros();
            probe::build(&SPEC, &[]).wind(&State { pos_E_m, ..probe::hover() }, &mut w);
            w
        };
        assert!((wind(5.0) - Vector3::new(0.0, 0.6, 0.0)).norm() < 1e-12);
        assert!(wind(9.0).norm() < 1e-4 && (wind(4.5) - wind(5.5)).norm() < 1e-12);
    }
}
