//! ArduPilot's interface to physics of others: servo pulses come as a datagram, state goes back as a line
//! of JSON, and the firmware's clock stands until it has come.
//!
//! The datagram, little-endian: magic (u16), wanted steps a second (u16), number (u32), pulses in µs
//! (16 or 32 of u16). While it waits the firmware says the same number again.

use std::fmt::Write as _;
use std::net::{SocketAddr, UdpSocket};
use std::time::Duration;

use anyhow::{Context, Result};
use haltere_core::frames::{E, Vec3};
use haltere_model::Plant;
use nalgebra::{UnitQuaternion, Vector3};

/// Magic numbers, and how many pulses follow.
const MAGIC: [(u16, usize); 2] = [(18_458, 16), (29_569, 32)];
const HEADER_BYTES: usize = 8;
/// Pulse of a motor that stands, and of one at full throttle, µs.
const PULSE_US: [f64; 2] = [1000.0, 2000.0];
/// Longest wait for the firmware within one turn of our loop.
const PATIENCE: Duration = Duration::from_millis(5);

/// Pulses of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Servos {
    /// Its number; begins anew when the firmware restarts.
    pub number: u32,
    /// Of the first four outputs, µs.
    pub motors_us: [u16; 4],
}

impl Servos {
    /// `None`: not of this interface.
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let word = |at: usize| Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?));
        let magic = word(0)?;
        let (_, pulses) = MAGIC.into_iter().find(|(known, _)| *known == magic)?;
        if bytes.len() != HEADER_BYTES + 2 * pulses {
            return None;
        }
        let number = u32::from_le_bytes(bytes.get(4..8)?.try_into().ok()?);
        let motor = |n: usize| word(HEADER_BYTES + 2 * n);
        Some(Self { number, motors_us: [motor(0)?, motor(1)?, motor(2)?, motor(3)?] })
    }
}

/// The socket to the firmware.
#[derive(Debug)]
pub struct Json {
    socket: UdpSocket,
    /// Who asked last, and for which frame.
    asked: Option<(SocketAddr, u32)>,
    home_E_m: Vec3<E>,
    line: String,
    /// Datagrams that were nothing of this interface.
    pub strange: u64,
    /// Frames that it numbered from the beginning again: it was started anew.
    pub restarts: u64,
}

impl Json {
    /// Listens; `home_E_m` is where the firmware thinks it is at the start.
    pub fn listen(port: u16, home_E_m: Vec3<E>) -> Result<Self> {
        let socket = UdpSocket::bind(("127.0.0.1", port))
            .with_context(|| format!("UDP port {port} for the firmware's physics"))?;
        socket.set_read_timeout(Some(PATIENCE)).context("the firmware's socket")?;
        Ok(Self { socket, asked: None, home_E_m, line: String::new(), strange: 0, restarts: 0 })
    }

    /// Where it listens.
    #[cfg(test)]
    pub fn port(&self) -> u16 {
        self.socket.local_addr().map_or(0, |a| a.port())
    }

    /// What it tells the motors in its next frame, 0 to 1; `None`: it has not said so yet, and time has to stand.
    pub fn motors(&mut self) -> Option<[f64; 4]> {
        let mut bytes = [0; 256];
        let (length, from) = self.socket.recv_from(&mut bytes).ok()?;
        let Some(servos) = bytes.get(..length).and_then(Servos::parse) else {
            self.strange += 1;
            return None;
        };
        if let Some((_, last)) = self.asked.replace((from, servos.number)) {
            if last == servos.number {
                // It has not heard us: the answer again, time stands.
                self.send();
                return None;
            }
            self.restarts += u64::from(servos.number < last);
        }
        let [low, high] = PULSE_US;
        Some(servos.motors_us.map(|p| ((f64::from(p) - low) / (high - low)).clamp(0.0, 1.0)))
    }

    /// Tells it the state at `t_us`, which may lie after the plant's last step.
    pub fn answer(&mut self, plant: &Plant, t_us: u64) {
        self.line.clear();
        let truth = plant.truth();
        let ahead_s = t_us.saturating_sub(truth.t_us) as f64 * 1e-6;
        let (rate_B, acc_B) = (plant.imu().rate_B_radps, plant.imu().acc_B_mps2);
        let (vel_E, turned) = (truth.vel_E_mps.raw(), truth.rate_B_radps.raw() * ahead_s);
        let pos_E = truth.pos_E_m.raw() - self.home_E_m.raw() + vel_E * ahead_s;
        let q = truth.R_EB.raw() * UnitQuaternion::from_scaled_axis(turned);
        let three = |v: &Vector3<f64>| format!("[{},{},{}]", v.x, v.y, v.z);
        let _ = writeln!(
            self.line,
            "\n{{\"timestamp\":{},\"imu\":{{\"gyro\":{},\"accel_body\":{}}},\"position\":{},\
             \"velocity\":{},\"quaternion\":[{},{},{},{}],\
             \"battery\":{{\"voltage\":{},\"current\":{}}}}}",
            t_us as f64 * 1e-6,
            three(&rate_B),
            three(&acc_B),
            three(&pos_E),
            three(&vel_E),
            q.w,
            q.i,
            q.j,
            q.k,
            truth.supply_v,
            truth.current_a,
        );
        self.send();
    }

    fn send(&self) {
        if let Some((to, _)) = self.asked
            && !self.line.is_empty()
        {
            // It asks again when this is lost.
            let _ = self.socket.send_to(self.line.as_bytes(), to);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_datagram_is_read_as_the_firmware_writes_it() {
        // 18458 is 0x481a; frame 7; 1000, 1500, 1600, 1700 µs.
        let mut bytes = vec![0x1a, 0x48, 0xb0, 0x04, 7, 0, 0, 0];
        bytes.extend([1000_u16, 1500, 1600, 1700].iter().flat_map(|p| p.to_le_bytes()));
        bytes.extend([0; 24]);
        let motors_us = [1000, 1500, 1600, 1700];
        assert_eq!(Servos::parse(&bytes), Some(Servos { number: 7, motors_us }));
        for cut in 0..bytes.len() {
            assert_eq!(Servos::parse(&bytes[..cut]), None);
        }
        bytes[0] = 0;
        assert_eq!(Servos::parse(&bytes), None);
    }

    #[test]
    fn prop_time_stands_while_the_firmware_repeats_itself() {
        let plant = Plant::new(haltere_model::PlantConfig::hall(1)).unwrap();
        let mut physics = Json::listen(0, Vec3::new(5.0, 5.0, -0.12)).unwrap();
        let port = physics.port();
        let firmware = UdpSocket::bind("127.0.0.1:0").unwrap();
        firmware.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        let frame = |n: u8| {
            let mut bytes = vec![0x1a, 0x48, 0, 0, n, 0, 0, 0];
            bytes.extend([0xe8, 0x03].repeat(16));
            firmware.send_to(&bytes, ("127.0.0.1", port)).unwrap();
        };
        let mut heard = [0; 2048];
        let mut line = || {
            let n = firmware.recv(&mut heard).unwrap();
            serde_json::from_slice::<serde_json::Value>(&heard[..n]).unwrap()
        };
        frame(1);
        assert_eq!(physics.motors(), Some([0.0; 4]));
        physics.answer(&plant, 1000);
        let first = line();
        assert_eq!(first["timestamp"], 0.001);
        assert_eq!(first["position"][2], 0.0);
        assert!((first["imu"]["accel_body"][2].as_f64().unwrap() + 9.81).abs() < 0.3);
        frame(1);
        assert_eq!(physics.motors(), None);
        assert_eq!(line(), first);
        firmware.send_to(b"garbage", ("127.0.0.1", port)).unwrap();
        assert_eq!((physics.motors(), physics.strange), (None, 1));
        frame(0);
        assert_eq!((physics.motors(), physics.restarts), (Some([0.0; 4]), 1));
    }
}
