//! Whether every link of the configuration has its port: device, permission, identity, free address.

use std::io::ErrorKind;
use std::net::{TcpListener, ToSocketAddrs as _, UdpSocket};
use std::path::Path;

use super::Finding;
use crate::live::cable;
use crate::live::radio::{self, Crazyradio};
use crate::live::usb::{UsbSerial, serial_devices};
use haltere_pilot::TagProtocol;
use haltere_pilot::settings::{Address, Config, HostPort, RadioPlace, TagPort};

/// All links.
pub fn examine(config: &Config) -> Vec<Finding> {
    let usb = serial_devices();
    let mut findings = tag(config, &usb);
    findings.extend(address("board.address", &config.board.address, &usb));
    for (i, endpoint) in config.ground.endpoints.iter().enumerate() {
        findings.extend(address(&format!("ground.endpoints[{i}]"), &endpoint.address, &usb));
    }
    let id = config.ground.system_id;
    findings.push(Finding::ok(
        "ground.system_id",
        format!("{id}: each vehicle of one station needs its own"),
    ));
    if config.ground.endpoints.is_empty() {
        findings.push(Finding::warning(
            "ground.endpoints",
            "empty: no station sees this vehicle",
            "name at least one, for example udpin:0.0.0.0:14550",
        ));
    }
    if let Some(at) = config.watch.address.get() {
        findings.extend(address("watch.address", at, &usb));
        findings.extend(token(config, at));
    }
    findings
}

/// Whether the watch page may be served there.
fn token(config: &Config, at: &Address) -> Option<Finding> {
    let key = "watch.token_file";
    let Address::TcpIn(host) = at else { return None };
    let mut resolved = (host.host.as_str(), host.port).to_socket_addrs().ok()?;
    match crate::watch::token::token(&config.watch) {
        Err(error) => Some(Finding::problem(key, error.to_string(), "without it nobody can look")),
        Ok(Some(_)) => Some(Finding::ok(key, "readable by the owner alone".to_owned())),
        Ok(None) if resolved.all(|at| at.ip().is_loopback()) => None,
        Ok(None) => Some(Finding::problem(
            key,
            format!("empty, and others than this computer can reach {at}"),
            "name a file with a token (docs/WATCH.md), or listen at tcpin:127.0.0.1:PORT",
        )),
    }
}

fn listed(usb: &[UsbSerial]) -> String {
    if usb.is_empty() {
        return "no serial device is on USB".to_owned();
    }
    let all: Vec<_> = usb.iter().map(ToString::to_string).collect();
    format!("on USB are {}", all.join(", "))
}

fn tag(config: &Config, usb: &[UsbSerial]) -> Vec<Finding> {
    let key = "tag.port";
    if config.tag.protocol == TagProtocol::Crazyflie {
        return vec![Finding::ok("tag.protocol", "the Loco deck of the board: no port")];
    }
    match &config.tag.port {
        TagPort::Auto => {
            let tags: Vec<_> = usb.iter().filter(|usb| usb.is_tag()).collect();
            match tags.as_slice() {
                [] => vec![Finding::problem(
                    key,
                    format!("auto: no Loco Positioning Node (0483:5740); {}", listed(usb)),
                    "plug the tag in, or name its device in tag.port",
                )],
                [tag] => opens(key, &tag.device, format!("auto: {tag}")),
                [first, ..] => {
                    let mut found = opens(key, &first.device, format!("auto: {first}"));
                    found.push(Finding::warning(
                        key,
                        format!("{} nodes are plugged in; the first is taken", tags.len()),
                        "name the one that is meant in tag.port, below /dev/serial/by-id",
                    ));
                    found
                }
            }
        }
        TagPort::Device(path) => {
            let mut found = serial(key, path, usb);
            let real = path.canonicalize().unwrap_or_else(|_| path.clone());
            let other = usb.iter().find(|usb| usb.device == real && !usb.is_tag());
            if let (Some(other), TagProtocol::LpsSniffer) = (other, config.tag.protocol) {
                found.push(Finding::warning(
                    key,
                    format!("{other} does not say that it is a Loco Positioning Node"),
                    "check that the right device is named; tag.port = \"auto\" finds it by itself",
                ));
            }
            found
        }
    }
}

fn address(key: &str, address: &Address, usb: &[UsbSerial]) -> Vec<Finding> {
    let taken = |error: std::io::Error| {
        let way_out = if error.kind() == ErrorKind::AddrInUse {
            format!(
                "end the program that listens there (`ss -lnp`), or change {key}; a companion \
                     that runs already counts"
            )
        } else {
            format!("name an address of this computer in {key}, or 0.0.0.0 for all of them")
        };
        Finding::problem(key, format!("{address}: cannot listen: {error}"), way_out)
    };
    vec![match address {
        Address::Serial { device, .. } => return serial(key, device, usb),
        Address::UdpIn(at) => match UdpSocket::bind((at.host.as_str(), at.port)) {
            Ok(_) => Finding::ok(key, format!("{address}: free")),
            Err(error) => taken(error),
        },
        Address::TcpIn(at) => match TcpListener::bind((at.host.as_str(), at.port)) {
            Ok(_) => Finding::ok(key, format!("{address}: free")),
            Err(error) => taken(error),
        },
        Address::Radio(place) => dongle(key, address, place),
        Address::CrtpUsb => match cable::find() {
            Ok(_) => Finding::ok(key, format!("{address}: plugged in")),
            Err(why) => Finding::problem(key, why, "the cable, or another board.address"),
        },
        Address::UdpOut(to) | Address::TcpOut(to) | Address::CrtpUdp(to) => {
            resolves(key, address, to)
        }
    }]
}

/// Whether the Crazyradio that is meant is there, new enough and ours to use.
fn dongle(key: &str, address: &Address, place: &RadioPlace) -> Finding {
    let found = radio::find().and_then(|all| {
        let count = all.len();
        let dongle = all.get(usize::from(place.dongle)).copied();
        let dongle = dongle.ok_or_else(|| format!("{count} Crazyradios are on USB, from 0"))?;
        dongle.refusal().map_or(Ok(()), Err)?;
        Crazyradio::open(place).map(|_| dongle)
    });
    match found {
        Ok(dongle) => Finding::ok(key, format!("{address}: {dongle}")),
        Err(why) => Finding::problem(key, format!("{address}: {why}"), "docs/CRAZYFLIE.md, Set-up"),
    }
}

fn resolves(key: &str, address: &Address, to: &HostPort) -> Finding {
    match (to.host.as_str(), to.port).to_socket_addrs().map(|mut all| all.next()) {
        Ok(Some(at)) if at.to_string() == to.to_string() => Finding::ok(key, address.to_string()),
        Ok(Some(at)) => Finding::ok(key, format!("{address}: {at}")),
        Ok(None) => Finding::warning(
            key,
            format!("{address}: the name has no address"),
            format!("write the number of the computer in {key}"),
        ),
        Err(error) => Finding::warning(
            key,
            format!("{address}: the name is not known: {error}"),
            format!("it is looked up again in flight; or write a number in {key}"),
        ),
    }
}

fn serial(key: &str, device: &Path, usb: &[UsbSerial]) -> Vec<Finding> {
    let real = device.canonicalize().unwrap_or_else(|_| device.to_owned());
    let known = usb.iter().find(|usb| usb.device == real);
    let text = match known {
        Some(usb) => usb.to_string(),
        None if real != device => format!("{} ({})", device.display(), real.display()),
        None => device.display().to_string(),
    };
    if !device.exists() {
        return vec![Finding::problem(
            key,
            format!("{}: there is no such device; {}", device.display(), listed(usb)),
            "plug it in, or name the right one; a serial port of a Raspberry Pi must be enabled in \
             raspi-config, with the login console off",
        )];
    }
    opens(key, device, text)
}

/// Opens the device for a moment, without touching its lines.
fn opens(key: &str, device: &Path, text: String) -> Vec<Finding> {
    use rustix::fs::{FlockOperation, Mode, OFlags, flock};
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    vec![match rustix::fs::open(device, flags, Mode::empty()) {
        Ok(file) if !rustix::termios::isatty(&file) => Finding::problem(
            key,
            format!("{}: is no serial device", device.display()),
            format!("name a device such as /dev/ttyACM0 in {key}"),
        ),
        // Who has a device open as we do has it locked.
        Ok(file) if flock(&file, FlockOperation::NonBlockingLockExclusive).is_err() => {
            let way_out = "end that program; a companion that runs already counts";
            Finding::problem(key, format!("{text}: another program has it"), way_out)
        }
        Ok(_) => Finding::ok(key, text),
        Err(rustix::io::Errno::ACCESS | rustix::io::Errno::PERM) => Finding::problem(
            key,
            format!("{text}: permission denied"),
            "sudo usermod -aG dialout $USER, then log in again; or install the udev rule of \
             packaging/",
        ),
        Err(rustix::io::Errno::BUSY) => Finding::problem(
            key,
            format!("{text}: another program uses it"),
            format!(
                "end that program (`fuser {}`); a companion that runs already counts",
                device.display()
            ),
        ),
        Err(error) => Finding::problem(
            key,
            format!("{text}: cannot be opened: {error}"),
            "unplug it and plug it in again; see `dmesg`",
        ),
    }]
}
