//! Doublets: a step to one side and the same step to the other, added to the controller's setpoint.
//!
//! They show what the inner loop and the wings make of a setpoint, which a flight that only follows
//! points leaves in the dark. The position loop stays closed underneath.

use haltere_core::control::ControlOutput;
use haltere_core::control::config::LimitsConfig;
use haltere_core::frames::Rot;

/// Largest amplitude in roll and pitch, rad (20 degrees), and in thrust, share of full throttle.
const MOST_LEAN_RAD: f64 = 0.35;
const MOST_THRUST_FRAC: f64 = 0.2;
/// Length of each half, s: 1.5 s at the largest lean would gather 5 m/s against no drag.
const HALF_S: [f64; 2] = [0.05, 1.5];

/// What a doublet is added to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// Roll setpoint.
    Roll,
    /// Pitch setpoint.
    Pitch,
    /// Thrust.
    Thrust,
}

/// One doublet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Doublet {
    axis: Axis,
    /// rad, or share of full throttle. The first half has its sign.
    amplitude: f64,
    half_s: f64,
}

impl Doublet {
    /// From the numbers of a mission item: axis 0 roll, 1 pitch, 2 thrust; amplitude in degrees, or
    /// as a share of full throttle; length of each half in s. The error says what is allowed.
    pub fn from_params(axis: f64, amplitude: f64, half_s: f64) -> Result<Self, String> {
        let (axis, amplitude, most) = if axis == 0.0 {
            (Axis::Roll, amplitude.to_radians(), MOST_LEAN_RAD)
        } else if axis == 1.0 {
            (Axis::Pitch, amplitude.to_radians(), MOST_LEAN_RAD)
        } else if axis == 2.0 {
            (Axis::Thrust, amplitude, MOST_THRUST_FRAC)
        } else {
            return Err(format!("axis = {axis}, allowed 0 roll, 1 pitch, 2 thrust"));
        };
        if !(amplitude.abs() > 0.0 && amplitude.abs() <= most) {
            return Err(format!(
                "amplitude = {amplitude:.3}, allowed up to {most} (rad or share of full throttle)"
            ));
        }
        let [shortest, longest] = HALF_S;
        if !(shortest..=longest).contains(&half_s) {
            return Err(format!("half = {half_s}, allowed {shortest} to {longest} s"));
        }
        Ok(Self { axis, amplitude, half_s })
    }

    /// Length of both halves, s.
    pub fn length_s(&self) -> f64 {
        2.0 * self.half_s
    }

    /// What is added at this time after its start, s.
    pub(crate) fn value_at(&self, elapsed_s: f64) -> f64 {
        if elapsed_s < self.half_s {
            self.amplitude
        } else if elapsed_s < self.length_s() {
            -self.amplitude
        } else {
            0.0
        }
    }

    /// Adds it to a setpoint, inside the limits of the controller.
    pub(crate) fn add(&self, elapsed_s: f64, limits: &LimitsConfig, output: &mut ControlOutput) {
        let value = self.value_at(elapsed_s);
        let most_rad = limits.tilt_deg.to_radians();
        let lean = |angle_rad: f64| (angle_rad + value).clamp(-most_rad, most_rad);
        match self.axis {
            Axis::Roll => output.roll_rad = lean(output.roll_rad),
            Axis::Pitch => output.pitch_rad = lean(output.pitch_rad),
            Axis::Thrust => {
                output.thrust_frac = (output.thrust_frac + value)
                    .clamp(limits.thrust_min_frac, limits.thrust_max_frac);
            }
        }
        output.record.roll_rad = output.roll_rad;
        output.record.pitch_rad = output.pitch_rad;
        output.record.thrust_frac = output.thrust_frac;
        output.R_EB = Rot::from_euler_rad(output.roll_rad, output.pitch_rad, output.yaw_rad);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_both_halves_cancel_and_nothing_is_left() {
        let doublet = Doublet::from_params(1.0, 8.0, 0.3).unwrap();
        let sum: f64 = (0..100).map(|k| doublet.value_at(f64::from(k) * 0.01)).sum();
        assert!(sum.abs() < 1e-12);
        assert_eq!(doublet.value_at(0.0), 8f64.to_radians());
        assert_eq!(doublet.value_at(0.61), 0.0);
    }

    #[test]
    fn prop_what_is_out_of_range_is_refused_with_the_range() {
        for (axis, amplitude, half_s, says) in [
            (3.0, 1.0, 0.3, "axis = 3"),
            (0.0, 40.0, 0.3, "allowed up to 0.35"),
            (2.0, 0.5, 0.3, "allowed up to 0.2"),
            (0.0, f64::NAN, 0.3, "amplitude"),
            (0.0, 5.0, 9.0, "allowed 0.05 to 1.5 s"),
            (f64::NAN, 5.0, 0.3, "axis"),
        ] {
            let error = Doublet::from_params(axis, amplitude, half_s).unwrap_err();
            assert!(error.contains(says), "{error}");
        }
    }
}
