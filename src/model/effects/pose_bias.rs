//! The tag's antenna pattern: paths are longer from some sides.
//!
//! `ρ_n -> ρ_n + A cos(az_n - ψ - φ)`, `az_n` bearing of the anchor from the tag, `ψ` yaw, `φ` phase (rad). Size by judgement:
//! //! 0.05 to 0.25 m. Changes sign when yawing on the spot. Left out: tilt.

use crate::effects::{
    Block, Deviation, Effect, EffectSpec, Hidden, Kind, ParameterSpec, Role, Stage, State,
};
use crate::tag::air::Packet;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "U3",
    name: "pose-dependent bias",
    block: Block::Uwb,
    parameters: &[
        ParameterSpec::new("amplitude", "m", Kind::Size, 0.0, 0.12, [0.05, 0.25], "amplitude"),
        ParameterSpec::new(
            "phase",
            "deg",
            Kind::Direction,
            0.0,
            0.0,
            [-180.0, 180.0],
            "bearing of the longest path, from the nose",
        )
        .ways("to the left", "to the right"),
    ],
    off: "antenna alike in all directions",
    source: "plausible sizes by judgement",
    equation: "ρ_n -> ρ_n + A cos(az_n - ψ - φ)",
    role: Role::Deviation(Deviation {
        standard: true,
        hidden: Hidden::WhenAsked([0.2, 0.4, 0.8]),
        verdict: "Distances depend on the side from which an anchor sees the tag: up to \
            {amplitude} too long from the bearing {phase} of the nose, as much too short from the \
            opposite one.",
        causes: "an antenna in the shade of battery or frame, or with an uneven pattern",
        remedy: "move the tag's antenna clear of battery and frame",
        shows: "an error that changes its sign while the vehicle turns on the spot",
        looks_like: &["U2"],
        apart: "Turn on the spot: the bias of an anchor (U2) stays.",
    }),
    build: |b| Box::new(PoseBias { amplitude_m: b.value[0], phase_rad: b.value[1].to_radians() }),
};

struct PoseBias {
    amplitude_m: f64,
    phase_rad: f64,
}

impl Effect for PoseBias {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Air]
    }
    fn air(&mut self, s: &State, packet: &mut Packet) {
        let d = packet.from_E_m - packet.tag_E_m;
        let bearing = d.y.atan2(d.x);
        packet.tag_extra_m += self.amplitude_m * (bearing - s.yaw_rad - self.phase_rad).cos();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn prop_sign_turns_with_half_a_turn() {
        let extra = |yaw_rad| {
            let mut p = probe::packet(3, nalgebra::Vector3::new(5.0, 5.0, -1.2));
            probe::build(&SPEC, &[]).air(&State { yaw_rad, ..probe::hover() }, &mut p);
            p.tag_extra_m
        };
        // Anchor 3 stands north-east.
        assert!((extra(std::f64::consts::FRAC_PI_4) - 0.12).abs() < 1e-9);
        assert!((extra(1.0) + extra(1.0 - std::f64::consts::PI)).abs() < 1e-12);
    }
}
