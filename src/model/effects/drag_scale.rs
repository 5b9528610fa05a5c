//! Drag differs from the vehicle file by a factor per axis.
//!
//! `k_i -> κ_i k_i`, body axes; acts on rotational damping too, which has the same origin. Size by judgement:
//! 0.6 to 1.6.

use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};
use crate::vehicle::Vehicle;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "A1",
    name: "drag scale",
    block: Block::Aerodynamics,
    parameters: &[
        ParameterSpec::new("kappa_x", "", Kind::Component, 1.0, 1.3, [0.6, 1.6], "factor along x")
            .ways("lower in forward flight", "higher in forward flight"),
        ParameterSpec::new("kappa_y", "", Kind::Component, 1.0, 1.3, [0.6, 1.6], "factor along y")
            .ways("lower in sideways flight", "higher in sideways flight"),
        // Drawn as a shape is: a weaker effect keeps it.
        ParameterSpec::new("kappa_z", "", Kind::Shape, 1.0, 1.0, [0.6, 1.6], "factor along z")
            .ways("lower in vertical flight", "higher in vertical flight"),
    ],
    off: "drag of the vehicle file",
    source: "plausible sizes by judgement",
    equation: "k_i -> κ_i k_i",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.25, 0.5, 1.0]),
        verdict: "The drag of the air is {} than the simulator says.",
        causes: "other wings, parts added where the air meets them, a drag that was never \
            measured on this vehicle",
        remedy: "nothing to repair: give the simulator this drag, by the scenario patch or in the \
            vehicle file",
        shows: "a force in proportion to speed and flap rate; another lean at the same speed",
        looks_like: &["A5", "A2"],
        apart: "Wind (A5) pushes in hover too, drag does not. Drag that saturates (A2) is the \
            same when slow: fly dashes there and back at three speeds.",
    }),
    build: |b| Box::new(Edit(b.value.to_vec())),
};

struct Edit(Vec<f64>);

impl Effect for Edit {
    fn vehicle(&mut self, vehicle: &mut Vehicle) {
        if let [x, y, z] = self.0[..] {
            for (k, factor) in vehicle.drag.k_ns_per_m_hz.iter_mut().zip([x, y, z]) {
                *k *= factor;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_scales_each_axis() {
        let v = probe::edited(&SPEC, &[("kappa_y", 0.5)]);
        let k = Vehicle::default().drag.k_ns_per_m_hz;
        assert_eq!(v.drag.k_ns_per_m_hz, [1.3 * k[0], 0.5 * k[1], k[2]]);
    }
}
