//! Addresses of links, in the MAVLink habit: `udpout:127.0.0.1:14550`, `serial:/dev/ttyAMA0:921600`.

use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use haltere_core::keys::NoNumber;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::radio::RadioPlace;

/// Slowest and fastest line that makes sense, baud. 12 Mbaud is the limit of USB full speed.
const BAUD_RANGE: std::ops::RangeInclusive<u32> = 9_600..=12_000_000;

/// What every message about an address ends with.
const FORMS: &str = "udpin:HOST:PORT, udpout:HOST:PORT, tcpin:HOST:PORT, tcpout:HOST:PORT or \
                     serial:DEVICE:BAUD; for a Crazyflie radio:DONGLE/CHANNEL/RATE/ADDRESS, crtpusb:auto or \
                     crtpudp:HOST:PORT";

/// Where a link leads.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Address {
    /// Listen for datagrams, answer whoever sends.
    UdpIn(HostPort),
    /// Send datagrams there.
    UdpOut(HostPort),
    /// Listen for connections.
    TcpIn(HostPort),
    /// Connect there.
    TcpOut(HostPort),
    /// A Crazyflie there, one packet of CRTP a datagram.
    CrtpUdp(HostPort),
    /// A Crazyflie by a Crazyradio.
    Radio(RadioPlace),
    /// The Crazyflie that is plugged in.
    CrtpUsb,
    /// A serial device.
    Serial {
        /// Path of the device.
        device: PathBuf,
        /// Speed.
        baud: u32,
    },
}

impl NoNumber for Address {}

/// Host name or number, and port.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HostPort {
    /// Name, IPv4 number, or IPv6 number without brackets.
    pub host: String,
    /// Port, never 0.
    pub port: u16,
}

/// Why a text is no address.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum AddressError {
    /// Unknown first word.
    #[error("{0:?} is no address: allowed {FORMS}")]
    Kind(String),
    /// Host or port is missing.
    #[error("{0:?} lacks a host or a port: allowed {FORMS}")]
    Parts(String),
    /// Not a port number.
    #[error("{address:?}: port {port:?}, allowed 1 to 65535")]
    Port {
        /// The whole text.
        address: String,
        /// What stands in the place of the port.
        port: String,
    },
    /// Not a place on the air.
    #[error("{0:?}: {1}; as in radio:0/80/2M/E7E7E7E7E7")]
    Radio(String, &'static str),
    /// Not the word.
    #[error("{0:?}: allowed crtpusb:auto, the Crazyflie that is plugged in")]
    CrtpUsb(String),
    /// Not a speed.
    #[error("{address:?}: speed {baud:?}, allowed {} to {} baud", BAUD_RANGE.start(), BAUD_RANGE.end())]
    Baud {
        /// The whole text.
        address: String,
        /// What stands in the place of the speed.
        baud: String,
    },
}

impl Address {
    /// Whether packets of a Crazyflie come from there.
    pub fn is_crazyflie(&self) -> bool {
        matches!(self, Address::CrtpUdp(_) | Address::Radio(_) | Address::CrtpUsb)
    }

    /// The thing that two links cannot share.
    pub fn resource(&self) -> String {
        match self {
            Address::UdpIn(at) => format!("UDP port {}", at.port),
            Address::TcpIn(at) => format!("TCP port {}", at.port),
            Address::UdpOut(to) => format!("UDP to {to}"),
            Address::TcpOut(to) => format!("TCP to {to}"),
            Address::CrtpUdp(to) => format!("the Crazyflie at {to}"),
            Address::Radio(place) => format!("Crazyradio {}", place.dongle),
            Address::CrtpUsb => "the Crazyflie on USB".to_owned(),
            Address::Serial { device, .. } => device.display().to_string(),
        }
    }

    /// How a client on the same computer writes it, in the spelling of pymavlink: the other end of the link.
    pub fn for_client(&self) -> String {
        let here = |host: &str| match host {
            "0.0.0.0" | "::" => "127.0.0.1".to_owned(),
            host => host.to_owned(),
        };
        let place = |at: &HostPort| HostPort { host: here(&at.host), port: at.port };
        match self {
            Address::UdpIn(at) => format!("udpout:{}", place(at)),
            Address::UdpOut(to) => format!("udpin:{to}"),
            Address::TcpIn(at) => format!("tcp:{}", place(at)),
            Address::TcpOut(to) => format!("tcpin:{to}"),
            Address::CrtpUdp(_) | Address::Radio(_) | Address::CrtpUsb | Address::Serial { .. } => {
                self.to_string()
            }
        }
    }
}

impl FromStr for Address {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let (kind, rest) = text.split_once(':').ok_or_else(|| AddressError::Kind(text.into()))?;
        let network = || {
            let (host, port) =
                rest.rsplit_once(':').ok_or_else(|| AddressError::Parts(text.into()))?;
            let host = host.strip_prefix('[').and_then(|h| h.strip_suffix(']')).unwrap_or(host);
            if host.is_empty() {
                return Err(AddressError::Parts(text.into()));
            }
            match port.parse() {
                Ok(port) if port != 0 => Ok(HostPort { host: host.into(), port }),
                _ => Err(AddressError::Port { address: text.into(), port: port.into() }),
            }
        };
        match kind {
            "udpin" => network().map(Address::UdpIn),
            "udpout" => network().map(Address::UdpOut),
            "tcpin" => network().map(Address::TcpIn),
            "tcpout" => network().map(Address::TcpOut),
            "crtpudp" => network().map(Address::CrtpUdp),
            "radio" => RadioPlace::read(rest)
                .map(Address::Radio)
                .map_err(|why| AddressError::Radio(text.into(), why)),
            "crtpusb" if rest == "auto" => Ok(Address::CrtpUsb),
            "crtpusb" => Err(AddressError::CrtpUsb(text.into())),
            "serial" => {
                // Names below /dev/serial/by-path hold colons: the last one counts.
                let (device, baud) =
                    rest.rsplit_once(':').ok_or_else(|| AddressError::Parts(text.into()))?;
                if device.is_empty() {
                    return Err(AddressError::Parts(text.into()));
                }
                match baud.parse() {
                    Ok(baud) if BAUD_RANGE.contains(&baud) => {
                        Ok(Address::Serial { device: device.into(), baud })
                    }
                    _ => Err(AddressError::Baud { address: text.into(), baud: baud.into() }),
                }
            }
            _ => Err(AddressError::Kind(text.into())),
        }
    }
}

impl TryFrom<String> for Address {
    type Error = AddressError;

    fn try_from(text: String) -> Result<Self, AddressError> {
        text.parse()
    }
}

impl From<Address> for String {
    fn from(address: Address) -> String {
        address.to_string()
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Address::UdpIn(at) => write!(f, "udpin:{at}"),
            Address::UdpOut(to) => write!(f, "udpout:{to}"),
            Address::TcpIn(at) => write!(f, "tcpin:{at}"),
            Address::TcpOut(to) => write!(f, "tcpout:{to}"),
            Address::CrtpUdp(to) => write!(f, "crtpudp:{to}"),
            Address::Radio(place) => write!(f, "radio:{place}"),
            Address::CrtpUsb => f.write_str("crtpusb:auto"),
            Address::Serial { device, baud } => write!(f, "serial:{}:{baud}", device.display()),
        }
    }
}

impl fmt::Display for HostPort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.host.contains(':') {
            write!(f, "[{}]:{}", self.host, self.port)
        } else {
            write!(f, "{}:{}", self.host, self.port)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_client_is_told_its_own_end() {
        for (ours, theirs) in [
            ("udpout:127.0.0.1:14550", "udpin:127.0.0.1:14550"),
            ("udpin:0.0.0.0:14540", "udpout:127.0.0.1:14540"),
            ("udpin:[::1]:14540", "udpout:[::1]:14540"),
            ("tcpin:0.0.0.0:5760", "tcp:127.0.0.1:5760"),
            ("tcpout:10.0.0.2:5760", "tcpin:10.0.0.2:5760"),
            ("serial:/dev/ttyUSB0:57600", "serial:/dev/ttyUSB0:57600"),
        ] {
            assert_eq!(ours.parse::<Address>().unwrap().for_client(), theirs);
        }
    }

    #[test]
    fn prop_addresses_survive_a_round_trip() {
        for text in [
            "udpin:0.0.0.0:14550",
            "udpout:ground.local:14550",
            "tcpin:[::]:5760",
            "tcpout:10.0.0.2:5760",
            "crtpudp:127.0.0.1:19850",
            "radio:0/80/2M/E7E7E7E7E7",
            "radio:1/125/250K/00000000A5",
            "crtpusb:auto",
            "serial:/dev/ttyAMA0:921600",
            "serial:/dev/serial/by-path/pci-0000:00:14.0-usb-0:2:1.0:115200",
        ] {
            assert_eq!(text.parse::<Address>().unwrap().to_string(), text);
        }
        let Address::TcpIn(at) = "tcpin:[::]:5760".parse().unwrap() else { panic!() };
        assert_eq!(at, HostPort { host: "::".into(), port: 5760 });
        // As Bitcraze's clients write it.
        let theirs: Address = "radio://0/80/2M/e7e7e7e7e7".parse().unwrap();
        assert_eq!(theirs, Address::Radio(RadioPlace::FACTORY));
    }

    #[test]
    fn prop_bad_addresses_say_what_is_allowed() {
        let check = |text: &str, says: &str| {
            let error = text.parse::<Address>().unwrap_err().to_string();
            assert!(error.contains(says), "{error}");
            assert!(error.contains(text), "{error}");
        };
        check("", "is no address: allowed udpin:HOST:PORT, udpout");
        check("udp:1.2.3.4:5", "is no address");
        check("/dev/ttyUSB0", "is no address");
        check("udpin:14550", "lacks a host or a port");
        check("udpin::14550", "lacks a host or a port");
        check("udpout:127.0.0.1:0", "port \"0\", allowed 1 to 65535");
        check("tcpin:0.0.0.0:70000", "port \"70000\", allowed 1 to 65535");
        check("radio:x/80/2M/E7E7E7E7E7", "the dongle is a number");
        check("radio:0/126/2M/E7E7E7E7E7", "the channel is 0 to 125");
        check("radio:0/80/3M/E7E7E7E7E7", "the rate is 250K, 1M or 2M");
        check("radio:0/80/2M", "the address is 1 to 10");
        check("radio:0/80/2M/+7E7E7E7E7", "the address is 1 to 10");
        check("radio:0/80/2M/E7E7E7E7E7/1", "the last part");
        check("crtpusb:0", "allowed crtpusb:auto");
        check("serial:/dev/ttyUSB0", "lacks a host or a port: allowed");
        check("serial:/dev/ttyUSB0:fast", "speed \"fast\", allowed 9600 to 12000000 baud");
        check("serial:/dev/ttyUSB0:0", "speed \"0\"");
    }
}
