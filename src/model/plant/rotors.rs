//! Four rotors on a rigid body, for a firmware whose mixer knows no wings: in the place of wings and servos.
//!
//! ```text
//! T_i' = (T_full u_i^e - T_i) / τ           thrust of motor i after its command u_i, N
//! F    = (0, 0, -Σ T_i) - m d v             force, N
//! M    = Σ r_i × (0, 0, -T_i) ± κ T_i e_z   torque about the centre of mass, N m
//! ```
//! Body frame: x forward, y right, z down. `T_full` N, `e`, `d` 1/s by axis, `m` kg and `κ` m, torque over thrust, are the vehicle file's
//! (`full_n`, `command_exponent`, `drag_per_s`, `mass_kg`, `torque_m`), `r_i` m the place of the motor, `v` m/s the airspeed, `τ` s the
//! lag; + of a motor that turns counter-clockwise from above. The numbers' sources stand in the file.
//!
//! Without ground effect, without any effect of the library: those are of wings. The pack does not run down.

use nalgebra::Vector3;

use crate::effects::STEP_S;
use crate::rotorcraft::{MOTORS, Rotorcraft, Turns};
use crate::vehicle::{Body, Vehicle};
use crate::wings::Wrench;

/// Lag of a small brushed motor, s (assumed; Förster 2015 has some tens of milliseconds).
const LAG_S: f64 = 0.03;
/// Feet of such a vehicle below its centre of mass, m.
const GEAR_M: f64 = 0.02;

/// They, and what each lifts.
pub(super) struct Rotors {
    file: Rotorcraft,
    thrust_n: [f64; MOTORS],
}

impl Rotors {
    pub fn new(file: Rotorcraft) -> Self {
        Self { file, thrust_n: [0.0; MOTORS] }
    }

    /// What all of them lift, N.
    pub fn lift_n(&self) -> f64 {
        self.thrust_n.iter().sum()
    }

    /// One step with these commands.
    pub fn step(&mut self, outputs_frac: [f64; MOTORS], air_B_mps: &Vector3<f64>) -> Wrench {
        let law = &self.file.thrust;
        let drag = Vector3::from(self.file.drag_per_s).component_mul(air_B_mps);
        let mut wrench =
            Wrench { force_B_n: -self.file.mass_kg * drag, torque_B_nm: Vector3::zeros() };
        let motors = self.file.motor.iter().zip(&mut self.thrust_n).zip(outputs_frac);
        for ((motor, thrust_n), u) in motors {
            let wanted_n = law.full_n * u.clamp(0.0, 1.0).powf(law.command_exponent);
            *thrust_n += (wanted_n - *thrust_n) * (STEP_S / LAG_S);
            let arm_m = Vector3::new(motor.forward_m, motor.right_m, 0.0);
            let force_n = Vector3::new(0.0, 0.0, -*thrust_n);
            let turned = if motor.turns == Turns::Ccw { 1.0 } else { -1.0 };
            wrench.force_B_n += force_n;
            wrench.torque_B_nm += arm_m.cross(&force_n);
            wrench.torque_B_nm.z += turned * law.torque_m * *thrust_n;
        }
        wrench
    }
}

impl Rotorcraft {
    /// The vehicle file that stands for its body where a plant wants one of wings.
    pub fn as_vehicle(&self) -> Vehicle {
        let body = Body {
            mass_kg: self.mass_kg,
            inertia_kgm2: self.inertia_kgm2,
            cg_B_m: [0.0; 3],
            gear_m: GEAR_M,
            tag_B_m: [0.0; 3],
        };
        Vehicle { name: self.name.clone(), body, ..Vehicle::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_core::frames::G_MPS2;

    const CRAZYFLIE: &str = include_str!("../../../sim/rotorcraft/crazyflie-2.1.toml");

    #[test]
    fn val_it_hovers_at_its_command_and_turns_as_its_mixer_means() {
        let file = Rotorcraft::from_toml(CRAZYFLIE).unwrap();
        let settled = |outputs: [f64; MOTORS]| {
            let mut rotors = Rotors::new(file.clone());
            (0..500).map(|_| rotors.step(outputs, &Vector3::zeros())).last().unwrap()
        };
        let hover = file.hover_frac();
        let lift_n = -settled([hover; MOTORS]).force_B_n.z;
        assert!((lift_n / (0.027 * G_MPS2) - 1.0).abs() < 1e-3, "{lift_n}");
        // m1 + p + yaw - r, and so on (power_distribution_quadrotor.c).
        let mixed = |r: f64, p: f64, y: f64| {
            settled([hover - r + p + y, hover - r - p - y, hover + r - p + y, hover + r + p - y])
        };
        let turns = |wrench: Wrench, axis: usize| {
            wrench.torque_B_nm.iamax() == axis && wrench.torque_B_nm[axis] > 0.0
        };
        assert!(turns(mixed(0.1, 0.0, 0.0), 0) && turns(mixed(0.0, 0.1, 0.0), 1));
        assert!(turns(mixed(0.0, 0.0, 0.1), 2));
    }
}
