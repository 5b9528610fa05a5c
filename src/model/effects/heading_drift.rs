//! The board's heading drifts with time, or is pulled by steel in one place.
//!
//! `β -> β + β̇ t + z e^(-½ d²/σ²)`; `t` time (s), `d` horizontal distance from the steel (m). Size by judgement: 0.5 to 3° per
//! minute or by place.

use crate::effects::{
    AttitudeError, Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage,
    State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "H2",
    name: "heading drift",
    block: Block::InnerLoop,
    parameters: &[
        ParameterSpec::new("rate", "deg/min", Kind::Component, 0.0, 1.5, [-3.0, 3.0], "drift")
            .ways("anticlockwise", "clockwise"),
        ParameterSpec::new(
            "zone",
            "deg",
            Kind::Component,
            0.0,
            0.0,
            [-20.0, 20.0],
            "pull at the steel",
        )
        .ways(
            "anticlockwise at the place {north} and {east} of the origin",
            "clockwise at the place {north} and {east} of the origin",
        ),
        ParameterSpec::north(5.0, "place of the steel"),
        ParameterSpec::east(5.0, "place of the steel"),
        ParameterSpec::new(
            "size",
            "m",
            Kind::Shape,
            1.0,
            1.0,
            [0.4, 3.0],
            "half width of the zone",
        ),
    ],
    off: "offset of N13",
    source: "plausible sizes by judgement",
    equation: "β -> β + β̇ t + z e^(-½ d²/σ²)",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::Never,
        verdict: "The board's north turns in flight: {}.",
        causes: "steel or magnets in the room, a heading that comes from the gyroscope alone",
        remedy: "give board.north_offset_deg, keep magnets and motors' wires away from the compass",
        shows: "an error across the way that grows or has a place",
        looks_like: &["H1"],
        apart: "A misalignment (H1) is there from the start and everywhere: read the heading \
            along a wall before and after the flight.",
    }),
    build: |b| Box::new(HeadingDrift(b.value.to_vec())),
};

struct HeadingDrift(Vec<f64>);

impl Effect for HeadingDrift {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Attitude]
    }
    fn attitude(&mut self, s: &State, error: &mut AttitudeError) {
        if let [rate, zone, north, east, size] = self.0[..] {
            let d2 = (s.pos_E_m.x - north).powi(2) + (s.pos_E_m.y - east).powi(2);
            let pull = zone * (-0.5 * d2 / size.max(0.05).powi(2)).exp();
            error.north_rad += (rate * s.t_s / 60.0 + pull).to_radians();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_grows_with_time_and_near_the_steel() {
        let north = |t_s, x: f64| {
            let pos_E_m = nalgebra::Vector3::new(x, 5.0, -1.0);
            let mut e = AttitudeError::default();
            let effect = &mut probe::build(&SPEC, &[("zone", 10.0)]);
            effect.attitude(&State { t_s, pos_E_m, ..probe::hover() }, &mut e);
            e.north_rad.to_degrees()
        };
        assert!((north(60.0, 9.5) - 1.5).abs() < 1e-2 && (north(0.0, 5.0) - 10.0).abs() < 1e-9);
    }
}
