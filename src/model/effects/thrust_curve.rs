//! Thrust bends off its tangent in hover: the vehicle's own law, where it is not a line.
//!
//! `T -> T + ½ W c (f/f_h - 1)²` per wing, not below zero; `W` weight (N), `f_h` flap rate in hover (Hz), `c` from the
//! vehicle file. Neither thrust nor its slope in hover change, so `c` can be found beside the line of the file: `T ∝ f²` is its
//! tangent with `c` = 1. A4 is what deviates from it.

use haltere_core::frames::G_MPS2;

use crate::effects::{Block, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N22",
    name: "nominal thrust curve",
    block: Block::Thrust,
    role: Role::Nominal,
    parameters: &[ParameterSpec::new("curve", "", Kind::Component, 0.0, 0.0, [-0.5, 1.5], "bend")
        .of_vehicle(|v| &mut v.wings.thrust_curve)],
    off: "thrust linear in flap rate",
    source: "`haltere gap commission`",
    equation: "T -> T + ½ W c (f/f_h - 1)²",
    build: |b| {
        let weight_n = b.nominal.body.mass_kg * G_MPS2;
        Box::new(ThrustCurve {
            gain_n: 0.5 * weight_n * b.value[0],
            inverse_hover_hz: 1.0 / b.nominal.hover_hz(),
        })
    },
};

struct ThrustCurve {
    gain_n: f64,
    inverse_hover_hz: f64,
}

impl Effect for ThrustCurve {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Thrust]
    }
    fn thrust(&mut self, s: &State, thrust_n: &mut [f64; 2]) {
        for (t, f) in thrust_n.iter_mut().zip(s.flap_hz) {
            // A wing that stands gives nothing, whatever the tangent says.
            if f > 0.0 {
                *t = (*t + self.gain_n * (f * self.inverse_hover_hz - 1.0).powi(2)).max(0.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;
    use crate::vehicle::Vehicle;
    use crate::wings::wing_thrust_n;

    #[test]
    fn prop_a_tangent_with_curve_one_is_the_square_law() {
        let mut v = Vehicle::default();
        let (weight_n, hover_hz) = (v.body.mass_kg * G_MPS2, v.hover_hz());
        v.wings.thrust_offset_n = -weight_n;
        v.wings.thrust_n_per_hz = weight_n / hover_hz;
        let mut effect = probe::build(&SPEC, &[("curve", 1.0)]);
        // Below half of hover the tangent is cut at zero.
        for share in [0.6, 1.0, 1.3] {
            let f = share * hover_hz;
            let s = State { flap_hz: [f; 2], ..probe::hover() };
            let mut thrust_n = [wing_thrust_n(&v.wings, f); 2];
            effect.thrust(&s, &mut thrust_n);
            let square_n = 0.5 * weight_n * share * share;
            assert!((thrust_n[0] - square_n).abs() < 1e-9, "{share}: {} {square_n}", thrust_n[0]);
        }
    }
}
