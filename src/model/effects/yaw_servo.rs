//! Wing-root servo: second order with end stops.
//!
//! `ψ'' = ω² (ψ_target - ψ) - 2 ζ ω ψ'`, |ψ| ≤ limit; solved exactly over a step with the target
//! held. `ψ` wing-root angle (rad). Source: public dynamic model of this vehicle: 10 rad/s, 0.7
//! (both estimated there), ±45°. Left out: rate limit, load of the wings.

use crate::effects::{Block, Effect, EffectSpec, Kind, ParameterSpec, Role, Stage, State};
use crate::servo::SecondOrder;
use crate::wings::Actuation;

/// Entry in the list.
pub const SPEC: EffectSpec = EffectSpec {
    id: "N6",
    name: "yaw servo",
    block: Block::Actuators,
    role: Role::Nominal,
    parameters: &[
        ParameterSpec::new(
            "frequency",
            "rad/s",
            Kind::Inverse,
            1e9,
            10.0,
            [6.0, 40.0],
            "natural frequency",
        )
        .of_vehicle(|v| &mut v.yaw_servo.frequency_radps),
        ParameterSpec::new("damping", "", Kind::Component, 1.0, 0.7, [0.4, 1.2], "damping ratio")
            .of_vehicle(|v| &mut v.yaw_servo.damping),
    ],
    off: "wing roots jump to their command, still within their end stops",
    source: "public Flapper model",
    equation: "ψ'' = ω² (ψ_target - ψ) - 2 ζ ω ψ'",
    build: |b| Box::new(YawServo(SecondOrder::new(b.value[0], b.value[1]))),
};

struct YawServo(SecondOrder);

impl Effect for YawServo {
    fn stages(&self) -> &'static [Stage] {
        &[Stage::Actuate]
    }
    fn actuate(&mut self, _s: &State, actuation: &mut Actuation) {
        actuation.yaw_servo_rad = self.0.step(actuation.yaw_servo_rad);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::probe;

    #[test]
    fn val_peaks_after_0_44_s() {
        let mut servo = probe::build(&SPEC, &[]);
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
