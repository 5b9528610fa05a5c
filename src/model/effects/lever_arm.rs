//! The antenna is not where it was drawn.
//!
//! `p_BT -> p_BT + Δ` (body, given in cm). Size by judgement: 2 to 10 cm. The error turns with the vehicle.

use crate::effects::{Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role};
use crate::vehicle::Vehicle;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "U11",
    name: "tag lever arm",
    block: Block::Uwb,
    parameters: &[
        ParameterSpec::new(
            "x",
            "cm",
            Kind::Component,
            0.0,
            5.0,
            [-10.0, 10.0],
            "forward; goes with the wing",
        )
        .ways("to the back", "to the front")
        .beside(|v| v.wings.centre_m),
        ParameterSpec::new(
            "y",
            "cm",
            Kind::Component,
            0.0,
            0.0,
            [-10.0, 10.0],
            "right; goes with the wing",
        )
        .ways("to the left", "to the right")
        .beside(|v| v.wings.centre_m),
        ParameterSpec::new(
            "z",
            "cm",
            Kind::Component,
            0.0,
            0.0,
            [-10.0, 10.0],
            "down; goes with the wing",
        )
        .ways("upward", "downward")
        .beside(|v| v.wings.centre_m),
    ],
    off: "antenna of the vehicle file",
    source: "plausible sizes by judgement",
    equation: "p_BT -> p_BT + Δ",
    role: Role::Deviation(Deviation {
        standard: false,
        hidden: Hidden::Never,
        verdict: "The tag's antenna is off its place by {}.",
        causes: "an antenna that was moved, or whose place was never measured",
        remedy: "measure the antenna's place and give it in estimator.p_BT_B_m",
        shows: "an error that turns with the vehicle",
        looks_like: &["U3"],
        apart: "An uneven antenna (U3) turns with the vehicle, too: measure the antenna's place \
            with a ruler.",
    }),
    build: |b| Box::new(Edit(b.value.to_vec())),
};

struct Edit(Vec<f64>);

impl Effect for Edit {
    fn vehicle(&mut self, vehicle: &mut Vehicle) {
        if let [x, y, z] = self.0[..] {
            for (p, shift) in vehicle.body.tag_B_m.iter_mut().zip([x, y, z]) {
                *p += shift * 1e-2;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_shifts_the_antenna() {
        assert_eq!(probe::edited(&SPEC, &[]).body.tag_B_m, [0.05, 0.0, 0.0]);
    }
}
