//! Servos of the dihedral (pitch) and of the wing roots (yaw): second order with end stops.
//!
//! `δ'' = ω² (δ_target - δ) - 2 ζ ω δ'`, |δ| ≤ limit; solved exactly over a step with the target
//! held. `δ` dihedral or wing-root angle (rad), `ω` natural frequency (rad/s), `ζ` damping. Source: public dynamic model
//! of this vehicle: dihedral 40 rad/s, 0.634, ±18°; wing roots 10 rad/s, 0.7 (both estimated there), ±45°. Left out: rate
//! limit, load of the wings.

use crate::effects::{Block, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};
use crate::servo::SecondOrder;
use crate::vehicle::Vehicle;
use crate::wings::Actuation;

/// Entry of the dihedral's in the list.
pub const PITCH: EffectSpec = EffectSpec {
    id: "N5",
    name: "pitch servo",
    block: Block::Actuators,
    role: Role::Nominal,
    parameters: &[
        frequency(40.0, [15.0, 80.0], |v| &mut v.pitch_servo.frequency_radps),
        damping(0.634, |v| &mut v.pitch_servo.damping),
    ],
    off: "dihedral jumps to its command, still within its end stops",
    source: "public Flapper model",
    equation: "δ'' = ω² (δ_target - δ) - 2 ζ ω δ'",
    build: |b| Box::new(Servo(SecondOrder::new(b.value[0], b.value[1]), |a| &mut a.dihedral_rad)),
};

/// Entry of the wing roots' in the list.
pub const YAW: EffectSpec = EffectSpec {
    id: "N6",
    name: "yaw servo",
    parameters: &[
        frequency(10.0, [6.0, 40.0], |v| &mut v.yaw_servo.frequency_radps),
        damping(0.7, |v| &mut v.yaw_servo.damping),
    ],
    off: "wing roots jump to their command, still within their end stops",
    equation: "ψ'' = ω² (ψ_target - ψ) - 2 ζ ω ψ'",
    build: |b| Box::new(Servo(SecondOrder::new(b.value[0], b.value[1]), |a| &mut a.yaw_servo_rad)),
    ..PITCH
};

const fn frequency(at: f64, range: [f64; 2], of: fn(&mut Vehicle) -> &mut f64) -> ParameterSpec {
    let what = "natural frequency";
    ParameterSpec::new("frequency", "rad/s", Kind::Inverse, 1e9, at, range, what).of_vehicle(of)
}

const fn damping(at: f64, of: fn(&mut Vehicle) -> &mut f64) -> ParameterSpec {
    let what = "damping ratio";
    ParameterSpec::new("damping", "", Kind::Component, 1.0, at, [0.4, 1.2], what).of_vehicle(of)
}

/// One of the two, and the angle that it turns.
struct Servo(SecondOrder, fn(&mut Actuation) -> &mut f64);

impl Effect for Servo {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Actuate]
    }
    fn actuate(&mut self, _s: &State, actuation: &mut Actuation) {
        let angle_rad = (self.1)(actuation);
        *angle_rad = self.0.step(*angle_rad);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn val_overshoots_as_its_damping_says() {
        let mut servo = probe::build(&PITCH, &[]);
        let mut peak: f64 = 0.0;
        for _ in 0..200 {
            let mut a = Actuation { dihedral_rad: 0.1, ..Actuation::default() };
            servo.actuate(&probe::hover(), &mut a);
            peak = peak.max(a.dihedral_rad);
        }
        // e^(-πζ/√(1-ζ²)) = 7.6 % for ζ = 0.634.
        assert!((peak / 0.1 - 1.076).abs() < 0.002, "{peak}");
        let mut a = Actuation::default();
        probe::build(&PITCH, &[]).actuate(&probe::hover(), &mut a);
        assert_eq!(a.dihedral_rad, 0.0);
    }

    #[test]
    fn val_peaks_after_0_44_s() {
        let mut servo = probe::build(&YAW, &[]);
        let mut best = (0, 0.0);
        for k in 1..500 {
            let mut a = Actuation { yaw_servo_rad: -0.2, ..Actuation::default() };
            servo.actuate(&probe::hover(), &mut a);
            if a.yaw_servo_rad < best.1 {
                best = (k, a.yaw_servo_rad);
            }
        }
        // π / (ω √(1-ζ²)) = 0.440 s, overshoot 4.6 %.
        assert!((f64::from(best.0) * 0.002 - 0.440).abs() < 0.003);
        assert!((best.1 / -0.2 - 1.046).abs() < 0.002);
    }
}
