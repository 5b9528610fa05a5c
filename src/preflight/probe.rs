//! Finds a board by its HEARTBEAT: at an address, or at a serial device with an unknown speed.

use std::io::{ErrorKind, Read, Write};
use std::net::{TcpStream, ToSocketAddrs as _, UdpSocket};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use haltere_dialect::mav_stream::{MavSplitter, encode_payload, heartbeat_of};

use crate::live::usb::{UsbSerial, serial_devices};
use haltere_pilot::settings::Address;

/// Speeds that boards are set to, the most usual first.
pub const BAUDS: [u32; 6] = [921_600, 115_200, 57_600, 460_800, 500_000, 1_500_000];
/// A HEARTBEAT comes once a second.
const WAIT: Duration = Duration::from_millis(1600);
/// Some boards speak only where they are spoken to: ours goes out this often.
const SPEAK_EVERY: Duration = Duration::from_millis(500);
/// Longest single read.
const READ: Duration = Duration::from_millis(100);
/// Serial ports of single-board computers that may lead to a board.
const BOARD_PORTS: [&str; 6] =
    ["/dev/serial0", "/dev/ttyAMA0", "/dev/ttyAMA1", "/dev/ttyS0", "/dev/ttyTHS1", "/dev/ttymxc2"];
/// MAV_AUTOPILOT_INVALID: no autopilot, a station for example.
const NO_AUTOPILOT: u8 = 8;

/// A board that was heard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeardBoard {
    /// Its system id.
    pub system_id: u8,
    /// `MAV_AUTOPILOT`.
    pub autopilot: u8,
}

impl std::fmt::Display for HeardBoard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = match self.autopilot {
            0 => "generic autopilot".to_owned(),
            3 => "ArduPilot".to_owned(),
            12 => "PX4".to_owned(),
            n => format!("autopilot of type {n}"),
        };
        write!(f, "{name}, system {}", self.system_id)
    }
}

/// Serial devices that may be a board: what is on USB and no tag, and the ports of the computer.
pub fn candidates() -> Vec<PathBuf> {
    let usb =
        serial_devices().into_iter().filter(|usb| !usb.is_tag()).map(|usb: UsbSerial| usb.device);
    let own = BOARD_PORTS.iter().map(PathBuf::from).filter(|path| path.exists());
    let mut seen = Vec::new();
    let mut all = Vec::new();
    for path in own.chain(usb) {
        let real = path.canonicalize().unwrap_or_else(|_| path.clone());
        if !seen.contains(&real) {
            seen.push(real);
            all.push(path);
        }
    }
    all
}

/// Waits for a board at `address`. `Err`: why nobody can be heard there.
pub fn at(address: &Address) -> Result<Option<HeardBoard>, String> {
    let failed = |error: &dyn std::fmt::Display| format!("{address}: {error}");
    match address {
        Address::Serial { device, baud } => on_serial(device, *baud),
        Address::UdpIn(at) => {
            let socket = UdpSocket::bind((at.host.as_str(), at.port)).map_err(|e| failed(&e))?;
            Ok(over_udp(&socket))
        }
        Address::UdpOut(to) => {
            let socket = UdpSocket::bind("0.0.0.0:0").map_err(|e| failed(&e))?;
            socket.connect((to.host.as_str(), to.port)).map_err(|e| failed(&e))?;
            Ok(over_udp(&socket))
        }
        Address::TcpOut(to) => {
            let resolved = (to.host.as_str(), to.port).to_socket_addrs().map_err(|e| failed(&e))?;
            let to =
                resolved.into_iter().next().ok_or_else(|| failed(&"the name has no address"))?;
            let mut stream = TcpStream::connect_timeout(&to, WAIT).map_err(|e| failed(&e))?;
            stream.set_read_timeout(Some(READ)).map_err(|e| failed(&e))?;
            let mut other = stream.try_clone().map_err(|e| failed(&e))?;
            Ok(hear(|buffer| stream.read(buffer), |bytes| other.write_all(bytes)))
        }
        Address::CrtpUdp(_) | Address::Radio(_) | Address::CrtpUsb => {
            Err(failed(&"a Crazyflie is looked for by `haltere check --live`"))
        }
        Address::TcpIn(_) => Err(failed(&"a board that connects to us cannot be looked for")),
    }
}

/// Tries one speed.
pub fn on_serial(device: &Path, baud: u32) -> Result<Option<HeardBoard>, String> {
    let failed = |error: &dyn std::fmt::Display| format!("{}: {error}", device.display());
    let port = serialport::new(device.display().to_string(), baud).timeout(READ);
    let mut port = port.open_native().map_err(|e| failed(&e))?;
    let mut other = port.try_clone_native().map_err(|e| failed(&e))?;
    Ok(hear(|buffer| port.read(buffer), |bytes| other.write_all(bytes)))
}

/// Tries every speed; gives the one at which a board was heard.
pub fn speed_of(
    device: &Path,
    mut tell: impl FnMut(u32),
) -> Result<Option<(u32, HeardBoard)>, String> {
    for baud in BAUDS {
        tell(baud);
        if let Some(board) = on_serial(device, baud)? {
            return Ok(Some((baud, board)));
        }
    }
    Ok(None)
}

fn over_udp(socket: &UdpSocket) -> Option<HeardBoard> {
    socket.set_read_timeout(Some(READ)).ok()?;
    let mut buffer = vec![0; 65_536];
    let connected = socket.peer_addr().is_ok();
    hear(
        |out| {
            let n = socket.recv(&mut buffer)?;
            let n = n.min(out.len());
            out[..n].copy_from_slice(&buffer[..n]);
            Ok(n)
        },
        |bytes| if connected { socket.send(bytes).map(|_| ()) } else { Ok(()) },
    )
}

/// Reads until a HEARTBEAT of an autopilot comes or the time is over.
fn hear(
    mut read: impl FnMut(&mut [u8]) -> std::io::Result<usize>,
    mut write: impl FnMut(&[u8]) -> std::io::Result<()>,
) -> Option<HeardBoard> {
    let begin = Instant::now();
    let mut spoken: Option<Instant> = None;
    let mut splitter = MavSplitter::new();
    let mut buffer = [0; 2048];
    while begin.elapsed() < WAIT {
        if spoken.is_none_or(|at| at.elapsed() >= SPEAK_EVERY) {
            spoken = Some(Instant::now());
            // Who cannot be written to may still be heard.
            let _ = write(&own_heartbeat());
        }
        match read(&mut buffer) {
            Ok(0) => return None,
            Ok(n) => splitter.push(buffer.get(..n).unwrap_or_default()),
            Err(error)
                if matches!(
                    error.kind(),
                    ErrorKind::TimedOut
                        | ErrorKind::WouldBlock
                        | ErrorKind::Interrupted
                        | ErrorKind::ConnectionRefused
                ) => {}
            Err(_) => return None,
        }
        while let Some(next) = splitter.next() {
            let Ok(frame) = next else { continue };
            if let Some(beat) = heartbeat_of(&frame)
                && beat.autopilot != NO_AUTOPILOT
            {
                let system_id = frame.header.system_id;
                return Some(HeardBoard { system_id, autopilot: beat.autopilot });
            }
        }
    }
    None
}

/// HEARTBEAT of an onboard computer (MAV_TYPE 18, component 191), as the companion sends it.
fn own_heartbeat() -> Vec<u8> {
    let mut out = Vec::new();
    encode_payload(&mut out, 1, 191, 0, 0, &[0, 0, 0, 0, 18, NO_AUTOPILOT, 0, 4, 3]);
    out
}
