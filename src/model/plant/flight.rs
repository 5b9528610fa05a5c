//! The flying part of a step: wind, board, actuators, forces, floor, body.

use nalgebra::{Matrix3, Vector3};

use super::contact::{FRICTION, GEAR_HALF_WIDTH_M, PARTS};
use super::{Plant, STEP_US};
use crate::effects::STEP_S;
use crate::faults::FaultKind;
use crate::vehicle::Servo;
use crate::wings::{Actuation, Wrench, flap_target_hz, thrust_wrench, wing_thrust_n};
use haltere_core::frames::G_MPS2;

/// Half widths from the legs that are left to the weight, of a gear that has lost one: more than it holds.
const BROKEN_LEG_ARMS: f64 = 1.5;
/// The gear brings the vehicle upright with this time constant, s.
const GEAR_UPRIGHT_S: f64 = 0.08;
/// Speed into the floor that breaks the vehicle, m/s.
const CRASH_MPS: f64 = 2.0;
/// Cosine of the tilt that counts as fallen over: 80°.
const CRASH_TILT_COS: f64 = 0.173_648;
/// On the floor with less thrust than this share of the weight for this long: landed.
const LANDED_THRUST_SHARE: f64 = 0.7;

impl Plant {
    /// Actuators, forces, floor, body.
    pub(super) fn fly(&mut self) {
        let s = &mut self.state;
        let bank = &mut self.bank;
        self.wind_E_mps = Vector3::zeros();
        bank.wind(s, &mut self.wind_E_mps);
        if let Some((gust, since_s)) = self.broken.gust {
            match gust.wind_E_mps(s.t_s - since_s) {
                Some(wind_E_mps) => self.wind_E_mps += wind_E_mps,
                None => self.broken.gust = None,
            }
        }
        s.air_B_mps = s.R_EB.tr_mul(&(s.vel_E_mps - self.wind_E_mps));

        if let Some(rotors) = &mut self.rotors {
            let wrench = rotors.step(self.board.outputs_frac(), &s.air_B_mps);
            s.thrust_n = [0.5 * rotors.lift_n(); 2];
            return self.move_body(wrench);
        }
        let mut command = match self.steered {
            Some(command) => command,
            None => self.board.control(s, bank),
        };
        bank.command(s, &mut command);
        let wings = &self.vehicle.wings;
        let mut target = Actuation {
            flap_hz: command.flap_frac.map(|c| flap_target_hz(wings, c.min(1.0), s.supply_v)),
            dihedral_rad: within(&self.vehicle.pitch_servo, command.dihedral_rad),
            yaw_servo_rad: within(&self.vehicle.yaw_servo, command.yaw_servo_rad),
        };
        bank.actuate(s, &mut target);
        match self.broken.servos.0 {
            FaultKind::Healthy => {}
            FaultKind::Off => (target.dihedral_rad, target.yaw_servo_rad) = (0.0, 0.0),
            _ => {
                target.dihedral_rad = self.actuation.dihedral_rad;
                target.yaw_servo_rad = self.actuation.yaw_servo_rad;
            }
        }
        self.actuation = target;
        s.flap_hz = self.actuation.flap_hz;
        s.flap_cycles += 0.5 * STEP_S * (s.flap_hz[0] + s.flap_hz[1]);
        if s.flap_cycles >= 1.0 {
            s.flap_cycles -= 1.0; // wings beat far below 500 Hz
        }

        bank.battery(s, &mut self.supply);
        s.supply_v = (self.supply.volt - self.broken.battery_drop_v).max(1.0);
        s.current_a = self.supply.current_a;
        s.charge_frac = self.supply.charge_frac;

        s.thrust_n = s.flap_hz.map(|f| wing_thrust_n(wings, f));
        let mut thrust_n = s.thrust_n;
        bank.thrust(s, &mut thrust_n);
        let [left, right] = self.broken.wing_gain;
        s.thrust_n = [thrust_n[0] * left, thrust_n[1] * right];
        let mut wrench = thrust_wrench(&self.vehicle, s.thrust_n, &self.actuation);
        bank.wrench(s, &mut wrench);
        self.move_body(wrench);
    }

    fn move_body(&mut self, wrench: Wrench) {
        let mass_kg = self.vehicle.body.mass_kg;
        let R_EB = self.state.R_EB;
        let mut a_E = R_EB * wrench.force_B_n / mass_kg;
        a_E.z += G_MPS2;
        let mut torque_B = wrench.torque_B_nm;

        if R_EB[(2, 2)] < self.contact.tip_cos {
            self.move_leaning(a_E, torque_B, &R_EB);
            return;
        }
        let push_mps2 = a_E.z;
        if self.state.on_ground && push_mps2 > 0.0 {
            // The floor bears the rest of the weight; friction holds or brakes.
            a_E.z = 0.0;
            let grip_mps2 = FRICTION * push_mps2;
            let v = Vector3::new(self.body.v_E.x, self.body.v_E.y, 0.0);
            let speed = v.norm();
            if speed > grip_mps2 * STEP_S {
                a_E -= v * (grip_mps2 / speed);
            } else if a_E.xy().norm() <= grip_mps2 {
                a_E = Vector3::zeros();
                self.body.v_E = Vector3::zeros();
                self.body.restart();
            }
            let held_nm = mass_kg * push_mps2 * GEAR_HALF_WIDTH_M;
            if self.broken.gear_leg {
                // It stands on the other legs: the weight turns it to the side that nothing holds up.
                torque_B.x += BROKEN_LEG_ARMS * held_nm;
            }
            if torque_B.xy().norm() <= held_nm {
                let up_B = R_EB.tr_mul(&Vector3::z());
                // Turning about this axis at this rate brings body z to the vertical.
                let upright = Vector3::z().cross(&up_B) / GEAR_UPRIGHT_S;
                self.body.set_rate(Vector3::new(upright.x, upright.y, 0.0));
                torque_B = Vector3::zeros();
            }
        }
        let felt_up_mps2 = G_MPS2 + self.contact.jolt_mps2(STEP_S);
        self.state.acc_B_mps2 = R_EB.tr_mul(&(a_E - Vector3::new(0.0, 0.0, felt_up_mps2)));
        self.body.step(STEP_S, a_E, torque_B, &R_EB);

        let floor_z = -self.vehicle.body.gear_m;
        if self.body.x_E.z >= floor_z {
            if self.body.v_E.z > CRASH_MPS {
                self.crash();
            }
            if self.body.v_E.z > 0.0 {
                self.contact.stop(self.body.v_E.z);
                self.body.v_E.z = 0.0;
                self.body.restart();
            }
            self.body.x_E.z = floor_z;
        }
    }

    /// A step in which it leans beyond its gear: in free air, or with points on the floor instead of a gear that stands.
    fn move_leaning(&mut self, a_E: Vector3<f64>, torque_B: Vector3<f64>, R_EB: &Matrix3<f64>) {
        if !self.contact.touches(&self.body.x_E, R_EB) {
            let felt_E_mps2 = a_E - Vector3::new(0.0, 0.0, G_MPS2);
            self.state.acc_B_mps2 = R_EB.tr_mul(&felt_E_mps2);
            self.body.step(STEP_S, a_E, torque_B, R_EB);
            return;
        }
        if self.body.v_E.z > CRASH_MPS {
            self.crash();
        }
        let mass_kg = self.vehicle.body.mass_kg;
        let mut felt_mps2 = Vector3::zeros();
        for _ in 0..PARTS {
            let R_EB = *self.body.q_EB.to_rotation_matrix().matrix();
            let (force_E_n, contact_B_nm) = self.contact.wrench(&self.body, &R_EB);
            let a_E = a_E + force_E_n / mass_kg;
            felt_mps2 += R_EB.tr_mul(&(a_E - Vector3::new(0.0, 0.0, G_MPS2))) / PARTS as f64;
            // The second order of the body's own step is for forces that are smooth.
            self.body.restart();
            self.body.step(STEP_S / PARTS as f64, a_E, torque_B + contact_B_nm, &R_EB);
        }
        self.body.restart();
        self.state.acc_B_mps2 = felt_mps2;
    }

    /// Broken: the motors stop.
    fn crash(&mut self) {
        self.crashed = true;
        self.wrecked = true;
        self.board.crash();
    }

    /// Brings the state that effects see up to date with the body.
    pub(super) fn observe(&mut self) {
        let s = &mut self.state;
        s.t_s = (self.steps * STEP_US) as f64 * 1e-6;
        s.pos_E_m = self.body.x_E;
        s.vel_E_mps = self.body.v_E;
        s.q_EB = self.body.q_EB;
        s.R_EB = *s.q_EB.to_rotation_matrix().matrix();
        s.rate_B_radps = self.body.w_B();
        s.height_m = -s.pos_E_m.z - self.vehicle.body.gear_m;
        // In a lean beyond its gear it does not stand; it lies as soon as anything touches.
        let leans = s.R_EB[(2, 2)] < self.contact.tip_cos;
        s.on_ground = if leans {
            s.height_m = s.height_m.max(0.0);
            self.contact.touches(&s.pos_E_m, &s.R_EB)
        } else {
            s.height_m <= 0.0
        };
        let weight_n = self.vehicle.body.mass_kg * G_MPS2;
        let idle = s.thrust_n[0] + s.thrust_n[1] < LANDED_THRUST_SHARE * weight_n;
        self.landed_s = if s.on_ground && idle { self.landed_s + STEP_S } else { 0.0 };
        // It has fallen over, and lies with motors that run as long as somebody has them run.
        self.crashed |= s.R_EB[(2, 2)] < CRASH_TILT_COS;
        if self.wrecked && self.board.armed() {
            self.board.crash();
        }
    }
}

/// Cuts a command at the end stops of the servo.
fn within(servo: &Servo, rad: f64) -> f64 {
    let limit_rad = servo.limit_deg.to_radians();
    rad.clamp(-limit_rad, limit_rad)
}
