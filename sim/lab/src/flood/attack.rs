//! Those who shout: threads that send as much as they are told to, in every way that hurts.

use std::io::Write as _;
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use haltere_dialect::mav::haltere::{
    COMMAND_LONG_DATA, MISSION_REQUEST_LIST_DATA, MavCmd, MavMessage, PARAM_REQUEST_LIST_DATA,
    PARAM_SET_DATA, TIMESYNC_DATA,
};
use haltere_dialect::mav_stream::encode;
use rand::{RngExt as _, SeedableRng as _};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Sockets of the attacker that claims to be many.
const MANY: usize = 64;
/// Frames between two looks at the clock.
const BATCH: u32 = 32;

/// Running attackers.
pub struct Attack {
    stop: Arc<AtomicBool>,
    sent: Arc<AtomicU64>,
    threads: Vec<JoinHandle<()>>,
}

/// One way to send.
type Sender = Box<dyn FnMut(&[u8]) + Send>;

impl Attack {
    /// Starts them all against the two ports.
    pub fn start(udp: u16, tcp: u16, frames_per_s: u32) -> Result<Self> {
        let (udp, tcp) = ([127, 0, 0, 1], udp).to_socket_addr(tcp);
        let mut attack = Self { stop: Arc::default(), sent: Arc::default(), threads: Vec::new() };
        let each = (frames_per_s / 4).max(1);
        let one = UdpSocket::bind("127.0.0.1:0").context("a socket")?;
        attack.shout(each, 1, move |bytes| drop(one.send_to(bytes, udp)));
        let many: Vec<_> = (0..MANY)
            .map(|_| UdpSocket::bind("127.0.0.1:0"))
            .collect::<Result<_, _>>()
            .context("many sockets")?;
        let mut turn = 0;
        attack.shout(each, 2, move |bytes| {
            turn = (turn + 1) % MANY;
            drop(many[turn].send_to(bytes, udp));
        });
        attack.shout(each, 3, stream(tcp));
        attack.shout(each, 4, stream(tcp));
        attack.come_and_go(tcp);
        Ok(attack)
    }

    fn shout(&mut self, per_s: u32, seed: u64, send: impl FnMut(&[u8]) + Send + 'static) {
        let mut send: Sender = Box::new(send);
        let (stop, sent) = (self.stop.clone(), self.sent.clone());
        self.threads.push(std::thread::spawn(move || {
            let mut chance = Xoshiro256PlusPlus::seed_from_u64(seed);
            let began = Instant::now();
            let mut n = 0_u32;
            while !stop.load(Relaxed) {
                for _ in 0..BATCH {
                    send(&words(&mut chance, n as u8));
                    n = n.wrapping_add(1);
                }
                sent.fetch_add(u64::from(BATCH), Relaxed);
                let due = Duration::from_secs_f64(f64::from(n) / f64::from(per_s));
                if let Some(early) = due.checked_sub(began.elapsed()) {
                    std::thread::sleep(early);
                }
            }
        }));
    }

    /// Connections that are opened and dropped, and one that sends nothing and never reads.
    fn come_and_go(&mut self, to: SocketAddr) {
        let stop = self.stop.clone();
        self.threads.push(std::thread::spawn(move || {
            let _deaf = TcpStream::connect(to);
            while !stop.load(Relaxed) {
                if let Ok(mut stream) = TcpStream::connect_timeout(&to, Duration::from_millis(200))
                {
                    let _ = stream.write_all(&[0xFD, 255, 0]);
                }
                std::thread::sleep(Duration::from_millis(2));
            }
        }));
    }

    /// Ends them; frames that were sent.
    pub fn stop(self) -> u64 {
        self.stop.store(true, Relaxed);
        for thread in self.threads {
            let _ = thread.join();
        }
        self.sent.load(Relaxed)
    }
}

/// A connection that is opened again when it was cut.
fn stream(to: SocketAddr) -> impl FnMut(&[u8]) + Send + 'static {
    let mut open: Option<TcpStream> = None;
    move |bytes| {
        if open.is_none() {
            open = TcpStream::connect_timeout(&to, Duration::from_millis(200)).ok();
            if let Some(stream) = &open {
                let _ = stream.set_write_timeout(Some(Duration::from_millis(200)));
            }
        }
        if let Some(stream) = &mut open
            && stream.write_all(bytes).is_err()
        {
            open = None;
        }
    }
}

/// What is shouted: half of it well formed and asking for something that must be answered.
fn words(chance: &mut Xoshiro256PlusPlus, sequence: u8) -> Vec<u8> {
    let (target_system, target_component) = (1, 1);
    let message = match chance.random_range(0..10_u8) {
        0 => MavMessage::TIMESYNC(TIMESYNC_DATA::default()),
        1 => MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
            target_system,
            target_component,
        }),
        2 => MavMessage::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
            target_system,
            target_component,
            ..Default::default()
        }),
        3 => MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            // Refused, with words for people.
            command: MavCmd::MAV_CMD_DO_SET_MODE as u16,
            target_system,
            target_component,
            ..Default::default()
        }),
        4 => MavMessage::PARAM_SET(PARAM_SET_DATA {
            target_system,
            target_component,
            ..Default::default()
        }),
        5 => {
            // Noise with markers in it.
            let mut bytes: Vec<u8> = (0..200).map(|_| chance.random()).collect();
            bytes[0] = 0xFD;
            bytes[60] = 0xFE;
            return bytes;
        }
        6 => return vec![0xFD; 280],
        7 => return vec![0; 1400],
        n => {
            let mut bytes = Vec::new();
            encode(&mut bytes, 250, 1, sequence, &MavMessage::TIMESYNC(TIMESYNC_DATA::default()));
            if n == 8 {
                let last = bytes.len() - 1;
                bytes[last] ^= 0xFF;
            } else {
                bytes.truncate(7);
            }
            return bytes;
        }
    };
    let mut bytes = Vec::new();
    encode(&mut bytes, 254, 190, sequence, &message);
    bytes
}

trait Ports {
    fn to_socket_addr(self, other: u16) -> (SocketAddr, SocketAddr);
}

impl Ports for ([u8; 4], u16) {
    fn to_socket_addr(self, other: u16) -> (SocketAddr, SocketAddr) {
        (self.into(), (self.0, other).into())
    }
}
