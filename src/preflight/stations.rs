//! The endpoint that each ground station or client library finds by itself, as `docs/STATIONS.md` has it.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use haltere_pilot::settings::{Address, EndpointConfig, HostPort};
use haltere_pilot::{GpsClaim, Identity};

/// Where pymavlink, and what is built on it, looks for names of modes, below the user's home.
const MAP_PLACE: &str = ".pymavlink/custom_mode_map.json";
/// Names of our modes, for what is built on pymavlink.
const MAP: &str = include_str!("../../stations/custom_mode_map.json");
/// `MAV_TYPE_QUADROTOR` of MAVLink: with it QGroundControl shows its button for the take-off.
const QUADROTOR: u8 = 2;

/// A program that people command a vehicle with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Client {
    /// `udpin:127.0.0.1:14550`.
    Pymavlink,
    /// `udpin://0.0.0.0:14540`, as its published examples have it.
    Mavsdk,
    /// Finds the vehicle by itself.
    Qgroundcontrol,
    /// `mavproxy.py --master=udpin:127.0.0.1:14550`.
    Mavproxy,
    /// `udpin:127.0.0.1:14550`.
    Dronekit,
}

impl Client {
    /// Port of this computer at which it listens unless it is told otherwise.
    pub fn port(self) -> u16 {
        if self == Self::Mavsdk { 14_540 } else { 14_550 }
    }

    /// Whether it knows modes by a map of pymavlink.
    pub fn wants_map(self) -> bool {
        matches!(self, Self::Mavproxy | Self::Dronekit)
    }

    /// Its endpoint at a port.
    fn endpoint(self, port: u16) -> EndpointConfig {
        let address = Address::UdpOut(HostPort { host: "127.0.0.1".into(), port });
        let plain = EndpointConfig::from(address);
        match self {
            Self::Pymavlink | Self::Mavproxy => plain,
            // Both wait for a global position.
            Self::Mavsdk | Self::Dronekit => {
                EndpointConfig { gps: Some(GpsClaim::OriginGps), ..plain }
            }
            Self::Qgroundcontrol => EndpointConfig {
                identity: Some(Identity::Px4),
                vehicle_type: Some(QUADROTOR),
                ..plain
            },
        }
    }

    /// What is typed there to reach the vehicle at a port.
    pub fn typed(self, port: u16) -> String {
        match self {
            Self::Pymavlink => {
                format!(
                    "mavutil.mavlink_connection(\"udpin:127.0.0.1:{port}\"), then wait_heartbeat()"
                )
            }
            Self::Mavsdk => format!("udpin://0.0.0.0:{port}, the default of its examples"),
            Self::Qgroundcontrol if port == self.port() => {
                "nothing, it finds the vehicle by itself".into()
            }
            Self::Qgroundcontrol => format!("a comm link, UDP, port {port}"),
            Self::Mavproxy => format!("mavproxy.py --master=udpin:127.0.0.1:{port}"),
            Self::Dronekit => format!("connect(\"udpin:127.0.0.1:{port}\")"),
        }
    }
}

/// An endpoint for each of these, the usual port for the first that wants it and the next ones for the others, with the
/// port.
pub fn endpoints(clients: &[Client]) -> Vec<(Client, u16, EndpointConfig)> {
    let mut all: Vec<(Client, u16, EndpointConfig)> = Vec::new();
    for client in clients {
        let free = |port: &u16| all.iter().all(|(_, taken, _)| taken != port);
        let port = (client.port()..u16::MAX).find(free).unwrap_or(client.port());
        all.push((*client, port, client.endpoint(port)));
    }
    all
}

/// Where the map of modes belongs in a home folder, unless it is there already.
pub fn map_is_due(home: &Path) -> Option<PathBuf> {
    let place = home.join(MAP_PLACE);
    (!place.exists()).then_some(place)
}

/// Lays the map of modes there.
pub fn lay_map(place: &Path) -> Result<(), String> {
    let wrote = place
        .parent()
        .map_or(Ok(()), std::fs::create_dir_all)
        .and_then(|()| std::fs::write(place, MAP));
    wrote.map_err(|why| format!("{}: cannot be written: {why}", place.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_each_station_has_the_endpoint_that_it_finds() {
        let all = [Client::Qgroundcontrol, Client::Mavsdk, Client::Mavproxy, Client::Pymavlink];
        let lines: Vec<String> = endpoints(&all)
            .into_iter()
            .map(|(_, _, endpoint)| toml::Value::try_from(endpoint).unwrap().to_string())
            .collect();
        let expected = [
            r#"{ address = "udpout:127.0.0.1:14550", identity = "px4", vehicle_type = 2 }"#,
            r#"{ address = "udpout:127.0.0.1:14540", gps = "origin+gps" }"#,
            r#""udpout:127.0.0.1:14551""#,
            r#""udpout:127.0.0.1:14552""#,
        ];
        assert_eq!(lines, expected);
    }

    #[test]
    fn prop_a_map_that_is_there_stays() {
        let home = tempfile::tempdir().unwrap();
        let place = map_is_due(home.path()).unwrap();
        lay_map(&place).unwrap();
        assert_eq!(std::fs::read_to_string(&place).unwrap(), MAP);
        assert_eq!(map_is_due(home.path()), None);
    }
}
