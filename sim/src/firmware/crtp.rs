//! A Crazyflie's firmware that its user has built for the host with a clock that others drive: a millisecond of it passes
//! when we say so, and it answers when all of its tasks have run.
//!
//! Datagrams on the loopback. It greets with F3 and is greeted back. Then ours is `T` and items, each behind a byte of its
//! length: what its client sent, and what its sensors read on the simulator's port. Its own are packets for the client, the
//! motors on that port, and at the end of each millisecond FF and its number.

use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use haltere::rig::Process;
use haltere_core::frames::G_MPS2;
use haltere_dialect::crtp::packet::{MAX_PACKET, Packet};
use haltere_dialect::crtp::parameter::{ParameterAnswer, ParameterRequest};
use haltere_dialect::crtp::value::{Kind, Value};
use haltere_dialect::crtp::{FromBoard, ToBoard};
use haltere_dialect::lps::RX_BITS;
use haltere_dialect::lps::tdoa2::Tdoa2Packet;
use haltere_model::board::Outside;
use haltere_model::effects::ImuReading;
use haltere_model::tag::Reception;
use nalgebra::Vector3;

const HELLO: u8 = 0xF3;
const TICK: u8 = b'T';
const DONE: u8 = 0xFF;
/// Port of the simulator in a packet's header; 9, which others take, is the supervisor's since protocol 12.
const SIM: u8 = 10 << 4;
/// The same with channel 3 and the bits of the link: a frame of the radio.
const FRAME: u8 = SIM | 0x0F;
/// What an item on that port holds.
const IMU: u8 = 0;
const BARO: u8 = 2;
const CELL_VOLT: u8 = 3;
const CHIP_DEAD: u8 = 5;
/// Its milliseconds in a step of ours, and how many pass between two readings of barometer and battery.
const TICKS: u32 = 2;
const BARO_TICKS: u32 = 20;
const BATTERY_TICKS: u32 = 100;
/// Units of its sensors: g and degrees a second a count.
const ACC_G: f64 = 32.0 / 65_536.0;
const RATE_DPS: f64 = 4000.0 / 65_536.0;
/// Head of a frame: data, no acknowledgement, long addresses, one network; the network, and what its addresses begin with.
const CONTROL: u16 = 0xDC41;
const NETWORK: u16 = 0xBCCF;
const ADDRESS: u64 = 0xBCCF_0000_0000_0000;
const TO_ALL: u8 = 0xFF;
/// Its own filter takes it that the vehicle was switched on looking along the anchors' x axis: east, degrees from north.
pub const FIRMWARE_YAW_DEG: f64 = 90.0;
/// Gains with which it flies the simulated wings.
const GAINS: &str = include_str!("crazyflie.parm");
/// Its milliseconds until it answers, and within which it has answered.
const START_TICKS: u32 = 400;
const ANSWER_TICKS: u32 = 20;
/// Meanwhile it stands at sea level on a full pack.
const STILL_PA: f64 = 101_325.0;
const STILL_V: f64 = 8.2;
/// It has started, and has run a millisecond, within these times of the wall.
const START: Duration = Duration::from_secs(5);
const PATIENCE: Duration = Duration::from_secs(10);

/// The firmware, running. It ends with this.
pub struct Crazyflie {
    socket: UdpSocket,
    program: Process,
    to: SocketAddr,
    tick: u32,
    /// Bytes of its client of which more is to come.
    half: Vec<u8>,
    /// Items of the next millisecond.
    items: Vec<u8>,
    chip_dead: bool,
    outputs_frac: [f64; 4],
    /// It has ended, or does not answer.
    gone: bool,
}

impl Crazyflie {
    /// Starts a program, waits for its greeting, and lets it come up on a still floor; on wings it is given the gains of
    /// `crazyflie.parm`.
    pub fn start(program: &Path, on_wings: bool) -> Result<Self> {
        let told = || format!("firmware {}", program.display());
        let socket = UdpSocket::bind("127.0.0.1:0").context("no free UDP port")?;
        socket.set_read_timeout(Some(START)).context("the firmware's socket")?;
        let port = socket.local_addr().context("the firmware's socket")?.port();
        let child = Command::new(std::fs::canonicalize(program).with_context(told)?)
            .args([&port.to_string(), "127.0.0.1"])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .spawn()
            .with_context(told)?;
        let program = Process(child);
        let mut first = [0; 64];
        let (n, to) = socket
            .recv_from(&mut first)
            .context("the firmware did not greet")
            .with_context(told)?;
        if first.get(..n) != Some(&[HELLO]) {
            bail!("{}: greets with {:02x?}, not with {HELLO:02x}", told(), first.get(..n));
        }
        socket.send_to(&[HELLO], to).with_context(told)?;
        let mut board = Self::greeted(socket, program, to);
        board.come_up(if on_wings { GAINS } else { "" }).with_context(told)?;
        Ok(board)
    }

    /// Its first milliseconds, in which it is told gains: a name and a value a line.
    fn come_up(&mut self, gains: &str) -> Result<()> {
        let imu = ImuReading {
            acc_B_mps2: Vector3::new(0.0, 0.0, -G_MPS2),
            rate_B_radps: Vector3::zeros(),
            pressure_pa: STILL_PA,
        };
        let mut said = Vec::new();
        for _ in 0..START_TICKS {
            self.tick(&imu, STILL_V, &mut said)?;
        }
        for line in gains.lines().filter(|line| !line.starts_with('#')) {
            let asked = line.split_once(' ').and_then(|(name, value)| {
                let (group, name) = name.split_once('.')?;
                let value = Value::Float(value.parse().ok()?);
                Some(ParameterRequest::SetByName { group, name, kind: Kind::F32, value })
            });
            let asked = asked.and_then(|asked| ToBoard::Parameter(asked).encode());
            self.item(&[asked.context("crazyflie.parm")?.bytes()]);
            said.clear();
            for _ in 0..ANSWER_TICKS {
                self.tick(&imu, STILL_V, &mut said)?;
            }
            if !has_done(&said) {
                bail!("it did not take {line}");
            }
        }
        Ok(())
    }

    fn greeted(socket: UdpSocket, program: Process, to: SocketAddr) -> Self {
        let (half, items, outputs_frac) = (Vec::new(), Vec::new(), [0.0; 4]);
        Self {
            socket,
            program,
            to,
            tick: 0,
            half,
            items,
            chip_dead: false,
            outputs_frac,
            gone: false,
        }
    }

    fn item(&mut self, parts: &[&[u8]]) {
        self.items.push(parts.iter().map(|part| part.len()).sum::<usize>() as u8);
        parts.iter().for_each(|part| self.items.extend_from_slice(part));
    }

    /// One millisecond.
    fn tick(&mut self, imu: &ImuReading, volt: f64, out: &mut Vec<u8>) -> Result<()> {
        self.item(&[
            &[SIM, IMU],
            &counts(imu.acc_B_mps2 / G_MPS2 / ACC_G),
            &counts(imu.rate_B_radps.map(f64::to_degrees) / RATE_DPS),
        ]);
        if self.tick.is_multiple_of(BARO_TICKS) {
            let hpa = imu.pressure_pa / 100.0;
            let values = [hpa, 25.0, height_m(hpa)].map(|v| (v as f32).to_le_bytes());
            self.item(&[&[SIM, BARO], values.as_flattened()]);
        }
        if self.tick.is_multiple_of(BATTERY_TICKS) {
            self.item(&[&[SIM, CELL_VOLT], &(volt as f32).to_le_bytes()]);
            self.item(&[&[SIM, CHIP_DEAD, u8::from(self.chip_dead)]]);
        }
        let mut datagram = vec![TICK];
        datagram.append(&mut self.items);
        self.tick += 1;
        self.socket.send_to(&datagram, self.to)?;
        let until = Instant::now() + PATIENCE;
        let mut packet = [0; 64];
        loop {
            if Instant::now() > until {
                bail!("it did not answer within {PATIENCE:?}");
            }
            match self.socket.recv(&mut packet) {
                Ok(n) if self.hear(packet.get(..n).unwrap_or_default(), out) => return Ok(()),
                Ok(_) => {}
                // It may have ended; a socket does not say so.
                Err(_) => {
                    if let Some(status) = self.program.ends_within(Duration::ZERO)? {
                        bail!("it ended with {}", haltere::rig::told(status));
                    }
                }
            }
        }
    }

    /// Takes what it says; `true`: its millisecond is over.
    fn hear(&mut self, packet: &[u8], out: &mut Vec<u8>) -> bool {
        match packet {
            [DONE, number @ ..] if number.len() == 4 => return number == self.tick.to_le_bytes(),
            [SIM, motors @ ..] => {
                if let ([a, b, c, d], []) = motors.as_chunks::<2>() {
                    let share =
                        |v: &[u8; 2]| f64::from(u16::from_le_bytes(*v)) / f64::from(u16::MAX);
                    self.outputs_frac = [share(a), share(b), share(c), share(d)];
                }
            }
            [HELLO] | [] => {}
            _ if packet.len() <= MAX_PACKET => {
                out.push(packet.len() as u8);
                out.extend_from_slice(packet);
            }
            _ => {}
        }
        false
    }
}

/// Whether among these packets is the answer that a parameter was set.
fn has_done(said: &[u8]) -> bool {
    haltere::live::apart(said).filter_map(|packet| Packet::read(packet).ok()).any(|packet| {
        let done = FromBoard::decode(&packet);
        matches!(done, Ok(FromBoard::Parameter(ParameterAnswer::SetByName { outcome: Ok(()), .. })))
    })
}

/// Counts of a sensor, body axes forward, right, down as it has them, forward, left, up.
fn counts(v: Vector3<f64>) -> [u8; 6] {
    let all = [v.x, -v.y, -v.z].map(|v| (v.round() as i16).to_le_bytes());
    let mut bytes = [0; 6];
    bytes.copy_from_slice(all.as_flattened());
    bytes
}

/// Height that its barometer's driver makes of a pressure (`sensorsScaleBaro`).
fn height_m(hpa: f64) -> f64 {
    ((1015.7 / hpa.max(1.0)).powf(0.190_263_095_8) - 1.0) * (25.0 + 273.15) / 0.0065
}

/// A frame as its radio received it: time of arrival, then the frame of the anchor.
fn frame(r: &Reception<'_>, said_m: Option<[f32; 3]>) -> Option<Vec<u8>> {
    let packet = Tdoa2Packet { position: said_m, ..Tdoa2Packet::decode(r.payload).ok()? };
    let number = packet.counters.get(usize::from(r.source))?;
    let arrived = r.rx_ticks.rem_euclid(1 << RX_BITS).to_le_bytes();
    let mut bytes = vec![FRAME];
    bytes.extend_from_slice(arrived.get(..5)?);
    bytes.extend_from_slice(&CONTROL.to_le_bytes());
    bytes.push(*number);
    bytes.extend_from_slice(&NETWORK.to_le_bytes());
    for end in [TO_ALL, r.source] {
        bytes.extend_from_slice(&(ADDRESS | u64::from(end)).to_le_bytes());
    }
    packet.encode(&mut bytes);
    Some(bytes)
}

impl Outside for Crazyflie {
    fn receive(&mut self, bytes: &[u8]) {
        self.half.extend_from_slice(bytes);
        let mut half = std::mem::take(&mut self.half);
        let mut rest = half.as_slice();
        while let Some((len, later)) = rest.split_first() {
            let Some((packet, later)) = later.split_at_checked(usize::from(*len)) else { break };
            if (1..=MAX_PACKET).contains(&packet.len()) && packet[0] >> 4 != SIM >> 4 {
                self.item(&[packet]);
            }
            rest = later;
        }
        let done = half.len() - rest.len();
        half.drain(..done);
        self.half = half;
    }

    fn hear(&mut self, r: &Reception<'_>, said_m: Option<[f32; 3]>) {
        if let Some(frame) = frame(r, said_m) {
            self.item(&[&frame]);
        }
    }

    fn chip(&mut self, dead: bool) {
        self.chip_dead = dead;
    }

    fn step(&mut self, imu: &ImuReading, volt: f64, out: &mut Vec<u8>) -> [f64; 4] {
        for _ in 0..TICKS {
            if self.gone {
                return [0.0; 4];
            }
            if let Err(why) = self.tick(imu, volt, out) {
                tracing::error!("the firmware is gone after {} ms: {why:#}", self.tick);
                self.gone = true;
            }
        }
        self.outputs_frac
    }
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    /// Items of a datagram.
    fn items(datagram: &[u8]) -> Vec<Vec<u8>> {
        let (first, mut rest) = datagram.split_first().unwrap();
        assert_eq!(*first, TICK);
        let mut all = Vec::new();
        while let Some((len, later)) = rest.split_first() {
            let (item, later) = later.split_at(usize::from(*len));
            all.push(item.to_vec());
            rest = later;
        }
        all
    }

    /// Says back what its client said, and lets its motors turn by its own number.
    fn plays(socket: &UdpSocket, ticks: u32) -> Vec<Vec<u8>> {
        let mut heard = Vec::new();
        let mut datagram = [0; 4096];
        for tick in 1..=ticks {
            let n = socket.recv(&mut datagram).unwrap();
            for item in items(&datagram[..n]) {
                if item[0] >> 4 != SIM >> 4 {
                    socket.send(&item).unwrap();
                }
                heard.push(item);
            }
            let motors = [tick as u16, 0, 0, u16::MAX].map(u16::to_le_bytes);
            socket.send(&[&[SIM][..], motors.as_flattened()].concat()).unwrap();
            socket.send(&[&[DONE][..], &tick.to_le_bytes()].concat()).unwrap();
        }
        heard
    }

    #[test]
    fn prop_a_step_is_two_of_its_milliseconds_and_nothing_is_lost_on_the_way() {
        let (ours, its) =
            (UdpSocket::bind("127.0.0.1:0").unwrap(), UdpSocket::bind("127.0.0.1:0").unwrap());
        its.connect(ours.local_addr().unwrap()).unwrap();
        for socket in [&ours, &its] {
            socket.set_read_timeout(Some(START)).unwrap();
        }
        let to = its.local_addr().unwrap();
        let firmware = std::thread::spawn(move || plays(&its, 2));
        let process = Process(Command::new("true").spawn().unwrap());
        let mut board = Crazyflie::greeted(ours, process, to);
        // Cut anywhere; what claims to be of the simulator is not passed on.
        for bytes in [&[2, 0x3C][..], &[7, 2], &[SIM, 0, 1, 0xFF]] {
            board.receive(bytes);
        }
        let mut payload = Vec::new();
        Tdoa2Packet { counters: [9; 8], ..Tdoa2Packet::default() }.encode(&mut payload);
        let heard =
            Reception { rx_ticks: (1 << RX_BITS) + 5, path_m: 1.0, source: 3, payload: &payload };
        Outside::hear(&mut board, &heard, Some([1.0, 2.0, 3.0]));
        let imu = ImuReading {
            acc_B_mps2: Vector3::new(0.0, 0.0, -G_MPS2),
            rate_B_radps: Vector3::new(0.1, 0.0, 0.0),
            pressure_pa: 101_325.0,
        };
        let mut out = Vec::new();
        let outputs = board.step(&imu, 7.4, &mut out);
        assert_eq!(out, [2, 0x3C, 7, 1, 0xFF]);
        assert_eq!(outputs, [2.0 / 65_535.0, 0.0, 0.0, 1.0]);
        let told = firmware.join().unwrap();
        let of = |kind: u8| told.iter().filter(|item| item.starts_with(&[SIM, kind])).count();
        assert_eq!([of(IMU), of(BARO), of(CELL_VOLT), of(CHIP_DEAD)], [2, 1, 1, 1]);
        // 1 g is 2048 counts, up; 0.1 rad/s 94, right side down.
        let first = told.iter().find(|item| item.starts_with(&[SIM, IMU])).unwrap();
        assert_eq!(first[2..], [0, 0, 0, 0, 0, 8, 94, 0, 0, 0, 0, 0]);
        let frame = told.iter().find(|item| item[0] == FRAME).unwrap();
        assert_eq!(
            (&frame[1..6], frame[8], frame.len()),
            (&[5, 0, 0, 0, 0][..], 9, 6 + 21 + 57 + 14)
        );
    }
}
