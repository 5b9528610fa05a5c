//! Which of the vehicles that are heard is meant. Pure.

use std::fmt;
use std::net::{IpAddr, SocketAddr};
use std::str::FromStr;

use haltere_dialect::mav::haltere::{MavMessage, MavType};

use super::vehicle::Vehicle;

/// Identity of a ground station (QGroundControl's).
pub(super) const OWN_SYSTEM: u8 = 255;
/// Component of an autopilot.
pub(super) const AUTOPILOT: u8 = 1;
/// Most vehicles that are told apart.
const MOST: usize = 16;

/// A vehicle that was heard.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Caller {
    /// Its system id.
    pub system: u8,
    /// Where it speaks from; `None`: the wire has one other end.
    pub from: Option<SocketAddr>,
    is_vehicle: bool,
}

impl Caller {
    /// Whether it is the same vehicle.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        (self.system, self.from) == (other.system, other.from)
    }
}

/// Where a vehicle speaks from, as somebody wants it: any port of a host, or one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place(IpAddr, Option<u16>);

impl Place {
    fn fits(self, at: SocketAddr) -> bool {
        at.ip().to_canonical() == self.0 && self.1.is_none_or(|port| port == at.port())
    }
}

impl FromStr for Place {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let whole = text.parse::<SocketAddr>().map(|at| (at.ip(), Some(at.port())));
        let (ip, port) =
            whole.or_else(|_| text.parse::<IpAddr>().map(|ip| (ip, None))).map_err(|_| {
                "allowed IP or IP:PORT in numbers, as the error about two vehicles names them"
                    .to_owned()
            })?;
        Ok(Self(ip.to_canonical(), port))
    }
}

/// The vehicle that somebody wants.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Wanted {
    /// Its system id; `None`: any.
    pub system: Option<u8>,
    /// Where it speaks from; `None`: from anywhere.
    pub from: Option<Place>,
}

impl Wanted {
    fn fits(&self, caller: &Caller) -> bool {
        self.system.is_none_or(|system| system == caller.system)
            && self.from.is_none_or(|from| caller.from.is_some_and(|at| from.fits(at)))
    }
}

impl fmt::Display for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(system) = self.system {
            write!(f, " with system id {system}")?;
        }
        match self.from {
            Some(Place(ip, Some(port))) => write!(f, " at {}", SocketAddr::new(ip, port)),
            Some(Place(ip, None)) => write!(f, " at {ip}"),
            None => Ok(()),
        }
    }
}

/// Those who were heard, and what they told.
#[derive(Debug, Default)]
pub(super) struct Callers(Vec<(Caller, Vehicle)>);

impl Callers {
    /// Somebody spoke.
    pub fn hear(&mut self, from: Option<SocketAddr>, system: u8, component: u8, said: &MavMessage) {
        if component != AUTOPILOT || system == OWN_SYSTEM || system == 0 {
            return;
        }
        let known = self.0.iter().position(|(c, _)| c.system == system && c.from == from);
        let index = known.unwrap_or(self.0.len());
        if known.is_none() {
            if self.0.len() >= MOST {
                return;
            }
            let caller = Caller { system, from, is_vehicle: false };
            self.0.push((caller, Vehicle::default()));
        }
        let Some((caller, vehicle)) = self.0.get_mut(index) else { return };
        vehicle.take(said);
        if let MavMessage::HEARTBEAT(beat) = said {
            caller.is_vehicle |= beat.mavtype != MavType::MAV_TYPE_GCS as u8;
        }
    }

    /// All vehicles that fit.
    pub fn fitting(&self, wanted: &Wanted) -> Vec<Caller> {
        self.0.iter().map(|(c, _)| *c).filter(|c| c.is_vehicle && wanted.fits(c)).collect()
    }

    /// What one of them told.
    pub fn vehicle(&self, of: &Caller) -> Vehicle {
        let told = self.0.iter().find(|(caller, _)| caller.is_same(of));
        told.map(|(_, vehicle)| vehicle.clone()).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use haltere_dialect::mav::haltere::{HEARTBEAT_DATA, LOCAL_POSITION_NED_DATA};

    use super::*;

    fn at(port: u16) -> Option<SocketAddr> {
        Some(SocketAddr::from(([127, 0, 0, 1], port)))
    }

    fn beat(mavtype: MavType) -> MavMessage {
        MavMessage::HEARTBEAT(HEARTBEAT_DATA { mavtype: mavtype as u8, ..Default::default() })
    }

    #[test]
    fn prop_vehicles_are_told_apart_by_address_and_number_and_stations_are_none() {
        let vehicle = beat(MavType::MAV_TYPE_FLAPPING_WING);
        let mut callers = Callers::default();
        callers.hear(at(1), 1, 1, &vehicle);
        callers.hear(at(1), 1, 1, &vehicle);
        callers.hear(at(1), 255, 190, &beat(MavType::MAV_TYPE_GCS));
        callers.hear(at(1), 7, 1, &beat(MavType::MAV_TYPE_GCS));
        callers.hear(at(1), 1, 191, &vehicle);
        let here = LOCAL_POSITION_NED_DATA { x: 3.0, ..Default::default() };
        callers.hear(at(1), 1, 1, &MavMessage::LOCAL_POSITION_NED(here));
        let any = Wanted::default();
        assert_eq!(callers.fitting(&any).len(), 1);
        let vehicle_1 = callers.vehicle(&callers.fitting(&any)[0]);
        assert_eq!(
            vehicle_1.position_m,
            Some([3.0, 0.0, 0.0]),
            "what it told before it was chosen"
        );
        // The same number from another address, and another number from the same: three.
        callers.hear(at(2), 1, 1, &vehicle);
        callers.hear(at(1), 2, 1, &vehicle);
        assert_eq!(callers.fitting(&any).len(), 3);
        let system = Wanted { system: Some(2), from: None };
        assert_eq!(callers.fitting(&system).iter().map(|c| c.from).collect::<Vec<_>>(), [at(1)]);
        let from = Wanted { system: Some(1), from: Some("127.0.0.1:2".parse().unwrap()) };
        assert_eq!(callers.fitting(&from).len(), 1);
        let host = Wanted { system: None, from: Some("127.0.0.1".parse().unwrap()) };
        assert_eq!(callers.fitting(&host).len(), 3);
        assert_eq!(from.to_string(), " with system id 1 at 127.0.0.1:2");
        assert!("host:1".parse::<Place>().unwrap_err().contains("IP:PORT"));
        // Strangers without end are not followed without end.
        for port in 10..1000 {
            callers.hear(at(port), 1, 1, &vehicle);
        }
        assert_eq!(callers.0.len(), MOST);
    }
}
