//! A vibrating accelerometer reads an offset: its nonlinearity rectifies the shaking.
//!
//! `a += k a_vib²`, `a_vib² ∝ (f/f_h)⁴`, hence `a += b_h (f/f_h)⁴` with `b_h` the offset in hover
//! (m/s²), along z and along x; `f` flap rate, `f_h` in hover (Hz). Size by judgement, given as the offset
//! itself. Gone with motors off, which is how it is told from scale.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, ImuReading, Kind, ParameterSpec, Role, Stage,
    State,
};

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "M6",
    name: "vibration rectification",
    block: Block::Imu,
    parameters: &[
        ParameterSpec::new(
            "offset",
            "m/s²",
            Kind::Component,
            0.0,
            0.5,
            [-1.2, 1.2],
            "offset along z in hover",
        )
        .ways("upward", "downward"),
        ParameterSpec::new(
            "forward",
            "m/s²",
            Kind::Component,
            0.0,
            0.0,
            [-1.2, 1.2],
            "offset along x in hover",
        )
        .ways("to the back", "to the front"),
    ],
    off: "linear accelerometer",
    source: "plausible sizes by judgement",
    equation: "a += b_h (f/f_h)⁴",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::ByChance([0.707, 1.0, 1.0]),
        verdict: "In hover vibration shifts what the accelerometer reads: {}.",
        causes: "a board that is mounted hard, damaged or unequal wings, worn gears",
        remedy: "mount the board softer: vibration reaches the accelerometer",
        shows: "an offset that comes and goes with the motors",
        looks_like: &["M3", "M4"],
        apart: "Log 10 s at rest with motors off, then 10 s held with motors on: a wrong scale \
            (M3) and a crooked board (M4) are there at rest.",
    }),
    build: |b| {
        Box::new(Rectification {
            offset: [b.value[0], b.value[1]],
            inverse_hover_hz: 1.0 / b.nominal.hover_hz(),
        })
    },
};

struct Rectification {
    /// Along z and x, m/s².
    offset: [f64; 2],
    inverse_hover_hz: f64,
}

impl Effect for Rectification {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Imu]
    }
    fn imu(&mut self, s: &State, reading: &mut ImuReading) {
        let rate = 0.5 * (s.flap_hz[0] + s.flap_hz[1]) * self.inverse_hover_hz;
        let share = (rate * rate) * (rate * rate);
        reading.acc_B_mps2.z += self.offset[0] * share;
        reading.acc_B_mps2.x += self.offset[1] * share;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_stated_offset_in_hover_and_none_at_rest() {
        let offset = |flap_hz| {
            let mut r = probe::reading();
            probe::build(&SPEC, &[]).imu(&State { flap_hz, ..probe::hover() }, &mut r);
            r.acc_B_mps2.z - probe::reading().acc_B_mps2.z
        };
        assert!((offset(probe::hover().flap_hz) - 0.5).abs() < 1e-12);
        assert_eq!(offset([0.0; 2]), 0.0);
    }
}
