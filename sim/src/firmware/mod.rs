//! A real firmware in software-in-the-loop flies the simulated vehicle: the plant is its physics, and the
//! companion meets it, not the simulated board. A Crazyflie's is stepped by the plant (`crtp`), the others keep their own time.

mod crtp;
mod hil;
mod json;
mod mixer;

use anyhow::Result;
use haltere::rig::firmware::Interface;
use haltere_core::frames::{E, Vec3};
use haltere_model::{Plant, Vehicle};

pub use crtp::{Crazyflie, FIRMWARE_YAW_DEG};
use hil::Hil;
use json::Json;
use mixer::{Demand, Mixer};

#[derive(Debug)]
enum Physics {
    Json(Json),
    Hil(Box<Hil>),
}

/// The inner loop that lives in another program.
#[derive(Debug)]
pub struct InnerLoop {
    physics: Physics,
    mixer: Mixer,
}

impl InnerLoop {
    /// Waits for a firmware; `start_E_m` is where the vehicle stands.
    pub fn listen(interface: Interface, vehicle: &Vehicle, start_E_m: Vec3<E>) -> Result<Self> {
        let authority = mixer::authority_radps2(vehicle, vehicle.battery.cells * 3.7);
        tracing::info!(?authority, "a moment of one in hover, rad/s², forward, right, down");
        let physics = match interface {
            Interface::Json(port) => Physics::Json(Json::listen(port, start_E_m)?),
            Interface::Hil(port) => Physics::Hil(Box::new(Hil::listen(port)?)),
        };
        Ok(Self { physics, mixer: Mixer::new(vehicle) })
    }

    /// Takes what the firmware tells its motors. `false`: not there yet, the world has to wait.
    pub fn steer(&mut self, plant: &mut Plant, dt_s: f64) -> bool {
        let motors_frac = match &mut self.physics {
            Physics::Json(json) => json.motors(),
            Physics::Hil(hil) => hil.motors(),
        };
        let Some(motors_frac) = motors_frac else { return false };
        plant.steer(self.mixer.wings(Demand::of_quad_x(motors_frac), dt_s));
        true
    }

    /// Tells it what became of that, at `t_us`.
    pub fn answer(&mut self, plant: &Plant, t_us: u64) {
        match &mut self.physics {
            Physics::Json(json) => json.answer(plant, t_us),
            Physics::Hil(hil) => hil.answer(plant, t_us),
        }
    }

    /// How often it began anew, and what was not of its interface.
    pub fn restarts_and_strange(&self) -> (u64, u64) {
        match &self.physics {
            Physics::Json(json) => (json.restarts, json.strange),
            Physics::Hil(hil) => (hil.restarts, hil.strange),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;
    use std::time::Duration;

    use haltere_model::PlantConfig;
    use serde_json::Value;

    use super::*;

    /// A firmware of three lines: what it is told of attitude and rate, and pulses of its X mixer.
    fn pulses(state: &Value, thrust: f64, roll_rad: f64) -> [u16; 16] {
        let number = |v: &Value| v.as_f64().unwrap();
        let q = [0, 1, 2, 3].map(|i| number(&state["quaternion"][i]));
        let w = [0, 1, 2].map(|i| number(&state["imu"]["gyro"][i]));
        let lean = [2.0 * q[0] * q[1] - roll_rad, 2.0 * q[0] * q[2], 2.0 * q[0] * q[3]];
        let [r, p, y] = [0, 1, 2].map(|i| (-1.1 * lean[i] - 0.24 * w[i]).clamp(-0.5, 0.5));
        let motor = |r: f64, p: f64, y: f64| {
            (1000.0 + 1000.0 * (thrust + 0.5 * (r + p + y))).clamp(1000.0, 2000.0) as u16
        };
        let mut all = [1000; 16];
        all[..4].copy_from_slice(&[
            motor(-r, p, y),
            motor(r, -p, y),
            motor(r, p, -y),
            motor(-r, -p, -y),
        ]);
        all
    }

    #[test]
    fn prop_a_firmware_that_only_knows_a_quadrotor_holds_and_tilts_the_wings() {
        let mut plant = Plant::new(PlantConfig::hall(1)).unwrap();
        let start_E_m = plant.truth().pos_E_m;
        let mut inner = InnerLoop::listen(Interface::Json(0), plant.vehicle(), start_E_m).unwrap();
        let firmware = UdpSocket::bind("127.0.0.1:0").unwrap();
        let Physics::Json(json) = &inner.physics else { unreachable!() };
        firmware.connect(("127.0.0.1", json.port())).unwrap();
        firmware.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let thrust = plant.vehicle().hover_command_v() / plant.truth().supply_v;
        let mut heard = [0; 2048];
        let mut state = serde_json::json!({"quaternion": [1, 0, 0, 0], "imu": {"gyro": [0, 0, 0]}});
        let mut worst_rad = [0.0f64; 3];
        for ms in 0..5000_u32 {
            let (climb, roll_rad) = match ms {
                0..1000 => (1.15, 0.0),
                1000..3000 => (1.0, 0.0),
                _ => (1.0, 0.15),
            };
            let mut bytes = vec![0x1a, 0x48, 0, 0];
            bytes.extend(ms.to_le_bytes());
            let pulses = pulses(&state, climb * thrust, roll_rad);
            bytes.extend(pulses.iter().flat_map(|p| p.to_le_bytes()));
            firmware.send(&bytes).unwrap();
            while !inner.steer(&mut plant, 0.001) {}
            let t_us = u64::from(ms + 1) * 1000;
            plant.advance_to(t_us);
            inner.answer(&plant, t_us);
            let n = firmware.recv(&mut heard).unwrap();
            state = serde_json::from_slice(&heard[..n]).unwrap();
            if (1000..3000).contains(&ms) {
                let now_rad = plant.truth().R_EB.euler_rad();
                for (worst, now) in worst_rad.iter_mut().zip(now_rad) {
                    *worst = worst.max(now.abs());
                }
            }
        }
        let truth = plant.truth();
        assert!(!truth.crashed && truth.height_m > 0.3, "{truth:?}");
        assert!(worst_rad.iter().all(|worst| *worst < 0.1), "{worst_rad:?}");
        // Right wing down, and so to the right.
        let [roll_rad, ..] = truth.R_EB.euler_rad();
        assert!((0.08..0.2).contains(&roll_rad), "{roll_rad}");
        assert!(truth.vel_E_mps.y() > 0.3, "{truth:?}");
        let told_east_m = state["position"][1].as_f64().unwrap();
        assert!((told_east_m - (truth.pos_E_m - start_E_m).y()).abs() < 0.01);
        assert_eq!(inner.restarts_and_strange(), (0, 0));
    }
}
