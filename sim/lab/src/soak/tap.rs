//! Taps on the two wires of the companion: they pass everything on and note when it passed.
//!
//! The tag's line is a second pseudo-terminal behind the endpoint's; a chunk counts from the moment its
//! last byte was written. The board's line is a pair of sockets; a setpoint counts from the moment it
//! was received here, which is when it was on the wire.

use std::fs::{File, OpenOptions};
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::AsFd as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, Result};
use haltere::live::realtime::insist_on_deadlines;
use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream::MavSplitter;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;

use haltere::rig::pty::{Dtr, TagPty};
use haltere::rig::stop::Stop;
use haltere::rig::{free_port, now_us};

/// Longest wait without looking whether to end.
const LOOK: Duration = Duration::from_millis(50);
/// Above the endpoint, below the companion: what is measured is not delayed by what measures.
const PRIORITY: u8 = 45;
/// Largest datagram.
const DATAGRAM_BYTES: usize = 65_536;

/// When something passed, µs of the monotonic clock.
#[derive(Debug, Default)]
pub struct Passed {
    /// Chunks of the tag that hold at least one frame.
    pub tag_us: Vec<u64>,
    /// Setpoints with thrust, and their thrust.
    pub setpoints_us: Vec<u64>,
}

/// Both taps, running.
#[derive(Debug)]
pub struct Taps {
    /// The tag's device for the companion.
    pub tag: String,
    /// The board's address for the companion.
    pub board: String,
    passed: Arc<Mutex<Passed>>,
    stop: Stop,
    threads: Vec<JoinHandle<()>>,
}

/// The board's side, made before the endpoint is started.
#[derive(Debug)]
pub struct BoardSide {
    socket: UdpSocket,
    /// For the endpoint's `--board`.
    pub address: String,
}

impl BoardSide {
    /// Binds it.
    pub fn new() -> Result<Self> {
        let socket = UdpSocket::bind("127.0.0.1:0").context("a socket for the board's line")?;
        let port = socket.local_addr().context("the board's line")?.port();
        Ok(Self { socket, address: format!("udpout:127.0.0.1:{port}") })
    }
}

impl Taps {
    /// Begins to pass on, between the endpoint's tag device and its board, and the companion.
    pub fn start(tag: &Path, board: BoardSide) -> Result<Self> {
        let passed = Arc::<Mutex<Passed>>::default();
        let stop = Stop::default();
        let mut taps =
            Self { tag: String::new(), board: String::new(), passed, stop, threads: Vec::new() };
        taps.tap_tag(tag)?;
        taps.tap_board(board.socket)?;
        Ok(taps)
    }

    /// Forgets what has passed so far, and gives it.
    pub fn take(&self) -> Passed {
        std::mem::take(&mut *self.passed.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn spawn(&mut self, name: &str, mut work: impl FnMut() + Send + 'static) -> Result<()> {
        let stop = self.stop.clone();
        let thread = std::thread::Builder::new().name(name.into()).spawn(move || {
            let _ = insist_on_deadlines(PRIORITY);
            while !stop.asked() {
                work();
            }
        });
        self.threads.push(thread.with_context(|| format!("a thread for the {name}"))?);
        Ok(())
    }

    fn tap_tag(&mut self, device: &Path) -> Result<()> {
        let mut far = open_line(device)?;
        let mut near = TagPty::new(None)?;
        self.tag = near.device().display().to_string();
        let passed = self.passed.clone();
        let (mut buffer, mut back) = ([0; 4096], Vec::new());
        self.spawn("tag's line", move || {
            let patience = Timespec::try_from(LOOK).unwrap_or_default();
            let _ = poll(&mut [PollFd::new(&far.as_fd(), PollFlags::IN)], Some(&patience));
            back.clear();
            let dtr = near.read(&mut back);
            let _ = std::io::Write::write_all(&mut far, &back);
            match std::io::Read::read(&mut far, &mut buffer) {
                Ok(n) if n > 0 && dtr != Dtr::Low => {
                    near.write(buffer.get(..n).unwrap_or_default());
                    let at = now_us();
                    passed.lock().unwrap_or_else(PoisonError::into_inner).tag_us.push(at);
                }
                Ok(1..) => {}
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                // The endpoint closes its end: a line that is hung up is always ready, and above the endpoint's
                // priority looking again at once would keep it from ever closing.
                Ok(0) | Err(_) => std::thread::sleep(LOOK),
            }
        })
    }

    fn tap_board(&mut self, board: UdpSocket) -> Result<()> {
        let port = free_port()?;
        self.board = format!("udpin:127.0.0.1:{port}");
        let companion = UdpSocket::bind("127.0.0.1:0").context("the companion's line")?;
        companion.connect(("127.0.0.1", port)).context("the companion's line")?;
        for socket in [&board, &companion] {
            socket.set_read_timeout(Some(LOOK)).context("the board's line")?;
        }
        let endpoint = Arc::<Mutex<Option<SocketAddr>>>::default();
        let known = endpoint.clone();
        let (from_board, to_companion) =
            (board.try_clone().context("a socket")?, companion.try_clone().context("a socket")?);
        let mut buffer = vec![0; DATAGRAM_BYTES];
        self.spawn("board's line", move || {
            if let Ok((n, from)) = from_board.recv_from(&mut buffer) {
                *known.lock().unwrap_or_else(PoisonError::into_inner) = Some(from);
                let _ = to_companion.send(buffer.get(..n).unwrap_or_default());
            }
        })?;
        let passed = self.passed.clone();
        let mut buffer = vec![0; DATAGRAM_BYTES];
        self.spawn("companion's line", move || {
            let Ok(n) = companion.recv(&mut buffer) else { return };
            let at = now_us();
            let bytes = buffer.get(..n).unwrap_or_default();
            let to = *endpoint.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(to) = to {
                let _ = board.send_to(bytes, to);
            }
            if holds_thrust(bytes) {
                passed.lock().unwrap_or_else(PoisonError::into_inner).setpoints_us.push(at);
            }
        })
    }
}

impl Drop for Taps {
    fn drop(&mut self) {
        self.stop.ask();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

/// Whether a datagram asks for thrust.
fn holds_thrust(bytes: &[u8]) -> bool {
    let mut splitter = MavSplitter::new();
    splitter.push(bytes);
    while let Some(next) = splitter.next() {
        let Ok(frame) = next else { continue };
        if let Ok(MavMessage::SET_ATTITUDE_TARGET(setpoint)) = frame.decode() {
            return setpoint.thrust > 0.0;
        }
    }
    false
}

/// The endpoint's tag, as a host opens it; reads do not wait.
fn open_line(device: &Path) -> Result<File> {
    let flags = OFlags::NOCTTY | OFlags::NONBLOCK;
    OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(flags.bits().cast_signed())
        .open(device)
        .with_context(|| device.display().to_string())
}
