//! PX4's interface to physics of others: it connects over TCP, takes HIL_SENSOR and answers with
//! HIL_ACTUATOR_CONTROLS. Once it has answered, each frame waits for the answer to the one before.

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::time::Duration;

use anyhow::{Context, Result};
use haltere_dialect::mav::haltere::{HIL_SENSOR_DATA, HilSensorUpdatedFlags, MavMessage};
use haltere_dialect::mav_stream::{MavSplitter, encode};
use haltere_model::Plant;
use haltere_model::random::Stream;
use nalgebra::Vector3;

/// Turns of our loop for a frame: 4 ms, what the firmware expects.
const TURNS: u32 = 4;
/// Longest wait for the firmware within one turn of our loop.
const PATIENCE: Duration = Duration::from_millis(5);
/// Frames that are not answered any more: it is somewhere in its start, time goes on.
const MOST_UNANSWERED: u32 = 20;
/// Magnetic field of the room, gauss: north, east, down; about that of central Europe. Without declination, so that the firmware's north is the
/// room's.
const FIELD_E_GAUSS: [f64; 3] = [0.21, 0.0, 0.42];
/// Noise of the sensors that the plant has without any, one sigma: gauss, hPa. A firmware takes a value that does
/// not change for a sensor that is broken. Chosen, as small as sensors of this class are.
const FIELD_NOISE_GAUSS: f64 = 0.001;
const PRESSURE_NOISE_HPA: f64 = 0.02;
/// The same of the inertial sensor, whose own noise is an effect that may be off: m/s², rad/s.
const ACC_NOISE_MPS2: f64 = 0.02;
const RATE_NOISE_RADPS: f64 = 0.001;
/// Metres of height for a hPa near the floor (ISA).
const M_PER_HPA: f64 = 8.43;
const SEA_LEVEL_HPA: f64 = 1013.25;
/// All sensors are new in each frame.
const ALL_FIELDS: u32 = 0x1fff;

/// The connection to the firmware.
#[derive(Debug)]
pub struct Hil {
    listener: TcpListener,
    stream: Option<TcpStream>,
    splitter: MavSplitter,
    sequence: u8,
    turn: u32,
    /// Frames since its last answer; `None`: it has never answered.
    unanswered: Option<u32>,
    motors_frac: [f64; 4],
    noise: Stream,
    /// Frames that were nothing of this interface, or damaged.
    pub strange: u64,
    /// How often it came back.
    pub restarts: u64,
}

impl Hil {
    /// Listens on this port of the loopback.
    pub fn listen(port: u16) -> Result<Self> {
        let listener = TcpListener::bind(("127.0.0.1", port))
            .with_context(|| format!("TCP port {port} for the firmware's physics"))?;
        listener.set_nonblocking(true).context("the firmware's socket")?;
        Ok(Self {
            listener,
            stream: None,
            splitter: MavSplitter::new(),
            sequence: 0,
            turn: 0,
            unanswered: None,
            motors_frac: [0.0; 4],
            noise: Stream::new(1, "hil"),
            strange: 0,
            restarts: 0,
        })
    }

    /// What it tells the motors, 0 to 1; `None`: time has to stand.
    pub fn motors(&mut self) -> Option<[f64; 4]> {
        if self.stream.is_none() && !self.accept() {
            std::thread::sleep(PATIENCE);
            return None;
        }
        let due = self.turn.is_multiple_of(TURNS);
        if due && self.unanswered.is_some_and(|n| (1..MOST_UNANSWERED).contains(&n)) {
            self.receive();
            if self.unanswered.is_some_and(|n| n > 0) {
                return None;
            }
        }
        self.turn = self.turn.wrapping_add(1);
        Some(self.motors_frac)
    }

    fn accept(&mut self) -> bool {
        let Ok((stream, _)) = self.listener.accept() else { return false };
        let ready = stream
            .set_nonblocking(false)
            .and_then(|()| stream.set_nodelay(true))
            .and_then(|()| stream.set_read_timeout(Some(PATIENCE)));
        self.restarts += u64::from(self.unanswered.is_some());
        (self.unanswered, self.splitter) = (None, MavSplitter::new());
        self.stream = ready.is_ok().then_some(stream);
        self.stream.is_some()
    }

    fn receive(&mut self) {
        let Some(stream) = &mut self.stream else { return };
        let mut bytes = [0; 4096];
        match stream.read(&mut bytes) {
            Ok(0) => self.lose(),
            Ok(n) => {
                self.splitter.push(bytes.get(..n).unwrap_or_default());
                self.read_frames();
            }
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted
                ) => {}
            Err(_) => self.lose(),
        }
    }

    fn read_frames(&mut self) {
        while let Some(next) = self.splitter.next() {
            match next.map(|frame| frame.decode()) {
                Ok(Ok(MavMessage::HIL_ACTUATOR_CONTROLS(m))) => {
                    let [a, b, c, d, ..] = m.controls.map(f64::from);
                    // NaN: the motor is off.
                    let sane = |v: f64| if v.is_finite() { v.clamp(0.0, 1.0) } else { 0.0 };
                    self.motors_frac = [a, b, c, d].map(sane);
                    self.unanswered = Some(0);
                }
                // Heartbeats, requests for streams.
                Ok(Ok(_)) => {}
                _ => self.strange += 1,
            }
        }
    }

    fn lose(&mut self) {
        self.stream = None;
        self.motors_frac = [0.0; 4];
    }

    fn noisy(&mut self, v: Vector3<f64>, sigma: f64) -> [f32; 3] {
        [v.x, v.y, v.z].map(|v| (v + sigma * self.noise.normal()) as f32)
    }

    /// Tells it what its sensors read at `t_us`, when a frame is due.
    pub fn answer(&mut self, plant: &Plant, t_us: u64) {
        if !self.turn.is_multiple_of(TURNS) {
            return;
        }
        if self.unanswered.is_none_or(|n| n >= MOST_UNANSWERED) {
            // Nobody waits for these.
            self.receive_what_is_there();
        }
        let (truth, imu) = (plant.truth(), plant.imu());
        let field_B = truth.R_EB.inverse().raw() * Vector3::from(FIELD_E_GAUSS);
        let acc = self.noisy(imu.acc_B_mps2, ACC_NOISE_MPS2);
        let rate = self.noisy(imu.rate_B_radps, RATE_NOISE_RADPS);
        let field = self.noisy(field_B, FIELD_NOISE_GAUSS);
        let hpa = imu.pressure_pa * 0.01 + PRESSURE_NOISE_HPA * self.noise.normal();
        let message = MavMessage::HIL_SENSOR(HIL_SENSOR_DATA {
            time_usec: t_us,
            xacc: acc[0],
            yacc: acc[1],
            zacc: acc[2],
            xgyro: rate[0],
            ygyro: rate[1],
            zgyro: rate[2],
            xmag: field[0],
            ymag: field[1],
            zmag: field[2],
            abs_pressure: hpa as f32,
            diff_pressure: 0.0,
            pressure_alt: ((SEA_LEVEL_HPA - hpa) * M_PER_HPA) as f32,
            temperature: 25.0,
            fields_updated: HilSensorUpdatedFlags::from_bits_retain(ALL_FIELDS),
            id: 0,
        });
        let mut bytes = Vec::with_capacity(96);
        encode(&mut bytes, 1, 1, self.sequence, &message);
        self.sequence = self.sequence.wrapping_add(1);
        if let Some(stream) = &mut self.stream {
            if stream.write_all(&bytes).is_err() {
                self.lose();
            } else if let Some(n) = &mut self.unanswered {
                *n += 1;
            }
        }
    }

    fn receive_what_is_there(&mut self) {
        let set = |stream: &Option<TcpStream>, nonblocking| {
            stream.as_ref().is_some_and(|s| s.set_nonblocking(nonblocking).is_ok())
        };
        if set(&self.stream, true) {
            self.receive();
            set(&self.stream, false);
        }
    }
}
