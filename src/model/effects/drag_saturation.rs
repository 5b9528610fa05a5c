//! Drag grows less than linearly with speed.
//!
//! `F -> F / (1 + |v| / v_s)` in N1; `v_s` speed at which half of the linear law is left (m/s). Size by judgement:
//! 0.6 to 2.5 m/s; the paper's exponential v(θ) law is of this kind. Same as A1 below 0.5 m/s.

use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};
use crate::vehicle::Vehicle;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "A2",
    name: "drag law saturates",
    block: Block::Aerodynamics,
    parameters: &[ParameterSpec::new(
        "speed",
        "m/s",
        Kind::Inverse,
        f64::INFINITY,
        1.2,
        [0.6, 2.5],
        "speed at which drag is half of the linear law",
    )],
    off: "drag linear in speed",
    source: "plausible sizes by judgement",
    equation: "F -> F / (1 + |v| / v_s)",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.6, 1.0, 1.0]),
        verdict: "Drag grows ever less with speed: at {speed} it is half of what the simulator \
            says.",
        causes: "soft wings that give way in fast air, a drag law that was measured at low speed \
            only",
        remedy: "nothing to repair: the nominal model lacks it; take the scenario patch",
        shows: "a force that bends at speed; overshoot on fast legs only",
        looks_like: &["A1"],
        apart: "Below 0.5 m/s it is the same as less drag (A1): fly dashes there and back at \
            three speeds.",
    }),
    build: |b| Box::new(Edit(b.value.to_vec())),
};

struct Edit(Vec<f64>);

impl Effect for Edit {
    fn vehicle(&mut self, vehicle: &mut Vehicle) {
        if let [speed] = self.0[..] {
            vehicle.drag.saturation_s_per_m = 1.0 / speed;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_half_the_drag_at_that_speed() {
        use crate::effects::drag;
        use crate::wings::Wrench;
        let air_B_mps = nalgebra::Vector3::new(1.2, 0.0, 0.0);
        let s = crate::effects::State { air_B_mps, ..probe::hover() };
        let force = |v: &Vehicle| {
            let mut w = Wrench::default();
            probe::build_values(&drag::SPEC, &v.drag.k_ns_per_m_hz, v).wrench(&s, &mut w);
            w.force_B_n.x
        };
        let (linear, half) = (force(&Vehicle::default()), force(&probe::edited(&SPEC, &[])));
        assert!((half / linear - 0.5).abs() < 1e-12);
    }
}
