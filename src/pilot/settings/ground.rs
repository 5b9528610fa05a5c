//! `[ground]`: ground stations, where they are and who we are to them.

use serde::de::{Error as _, MapAccess, Visitor, value::MapAccessDeserializer};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::address::{Address, HostPort};
use crate::input::MOST_STATIONS;
use crate::stations::endpoint::{
    Endpoint, GpsClaim, Identity, MOST_GROUND_LINKS, OriginConfig, Routing,
};
use crate::stations::guard::{RateLimit, Signing};
use crate::stations::permits::Commanders;
use haltere_core::checks::Problems;
use haltere_core::keys::NoNumber;

/// Most ground endpoints: far more than a flight needs, few enough to serve each at full rate.
const MOST_ENDPOINTS: usize = 8;
/// What one station may send: twenty times what an offboard client at 100 Hz does, and the length of as
/// many average frames.
const MOST_FRAMES_PER_S: f64 = 2000.0;
const MOST_BYTES_PER_S: f64 = 262_144.0;
/// Bits that a serial line sends for a byte.
const BITS_PER_BYTE: f64 = 10.0;

haltere_core::keys! {
    /// `[ground]`: ground stations.
    pub struct GroundConfig {
        /// Ground stations, up to 8 addresses of the forms above. An empty list is allowed. Up to 8 stations share a
        /// udpin or tcpin endpoint. In place of an address a table may stand, with what differs from the keys below, as
        /// in { address = "udpin:0.0.0.0:14551", identity = "px4", vehicle_type = 2, gps = "origin" }. Its key
        /// bytes_per_s, 200 to 1e8, bounds what is sent; serial lines have theirs by their speed.
        // INTERFACES: UDP to this port by default.
        endpoints: Vec<EndpointConfig> = vec![usual_address().into()];
        /// System that the vehicle is. Two vehicles that share a station need two; parameter MAV_SYS_ID.
        // As PX4 has it, since 251 to 255 are stations.
        system_id: u8 = 1, [1.0..=250.0];
        /// Which autopilot stations take us for: "generic", or "px4", which QGroundControl and mavros need.
        /// docs/STATIONS.md says what each program gets with either.
        identity: Identity = Endpoint::default().identity;
        /// MAV_TYPE of the vehicle: 16 flapping wing; 2 quadrotor gives QGroundControl its take-off button.
        vehicle_type: u8 = Endpoint::default().vehicle_type;
        /// What is claimed of a satellite receiver: "none", "origin" (positions on Earth by the origin below), or
        /// "origin+gps" (also a receiver that does not exist, for scripts that wait for its fix).
        gps: GpsClaim = Endpoint::default().gps;
        /// Frames for others: "off", "stations" (passed on between stations), "board" (also to and from the board,
        /// whose system id must then be another one).
        routing: Routing = Routing::default();
        /// Signatures of MAVLink 2: "off" (neither checked nor made), "accept" (made; unsigned frames come in, wrongly
        /// signed ones do not), "require" (made; only signed ones come in). In an endpoint's table it may differ; a
        /// table's trusted = true marks a cable over which SETUP_SIGNING is taken unsigned. docs/SECURITY.md.
        signing: Signing = Signing::default();
        /// System ids that may command: arming, modes, setpoints, missions, parameters, files. "all", or a list, as in
        /// [255]; others may look. In an endpoint's table it may differ.
        commanders: Commanders = Endpoint::default().commanders;
        /// Frames that one station may send in a second. More is thrown away and counted.
        most_frames_per_s: f64 = MOST_FRAMES_PER_S, [20.0..=1e6, "frames/s"];
        /// Bytes that one station may send in a second.
        most_bytes_per_s: f64 = MOST_BYTES_PER_S, [1000.0..=1e9, "bytes/s"];
    } sections {
        /// Where the room lies on Earth.
        origin: OriginConfig;
    } rules endpoints;
}

/// UDP to this port by default (INTERFACES).
fn usual_address() -> Address {
    Address::UdpOut(HostPort { host: "127.0.0.1".into(), port: 14_550 })
}

/// One endpoint: an address, or a table with an address and what differs from `[ground]`.
#[derive(Clone, PartialEq)]
pub struct EndpointConfig {
    /// Where it is.
    pub address: Address,
    /// Which autopilot it shows.
    pub identity: Option<Identity>,
    /// `MAV_TYPE` it shows.
    pub vehicle_type: Option<u8>,
    /// What it claims of a satellite receiver.
    pub gps: Option<GpsClaim>,
    /// What its line carries, bytes/s.
    pub bytes_per_s: Option<f64>,
    /// What it demands of signatures.
    pub signing: Option<Signing>,
    /// Whether `SETUP_SIGNING` is taken from it unsigned: a cable, not a network.
    pub trusted: bool,
    /// Systems that may command on it.
    pub commanders: Option<Commanders>,
}

impl std::fmt::Debug for EndpointConfig {
    /// One text, as the address alone would be: it is one value of a list.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut text = self.address.to_string();
        if let Some(identity) = self.identity {
            text += &format!(" as {identity:?}");
        }
        if let Some(vehicle_type) = self.vehicle_type {
            text += &format!(" of type {vehicle_type}");
        }
        if let Some(gps) = self.gps {
            text += &format!(" claiming {gps:?}");
        }
        if let Some(bytes_per_s) = self.bytes_per_s {
            text += &format!(" at {bytes_per_s} bytes/s");
        }
        if let Some(signing) = self.signing {
            text += &format!(" signing {signing:?}");
        }
        if self.trusted {
            text += " trusted";
        }
        if let Some(commanders) = &self.commanders {
            text += &format!(" commanded by {commanders}");
        }
        write!(f, "{text:?}")
    }
}

impl From<Address> for EndpointConfig {
    fn from(address: Address) -> Self {
        Self {
            address,
            identity: None,
            vehicle_type: None,
            gps: None,
            bytes_per_s: None,
            signing: None,
            trusted: false,
            commanders: None,
        }
    }
}

/// The table form.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    address: Address,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    identity: Option<Identity>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    vehicle_type: Option<u8>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    gps: Option<GpsClaim>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    bytes_per_s: Option<f64>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    signing: Option<Signing>,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    trusted: bool,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    commanders: Option<Commanders>,
}

impl Serialize for EndpointConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if *self == Self::from(self.address.clone()) {
            return self.address.serialize(serializer);
        }
        let Self {
            address,
            identity,
            vehicle_type,
            gps,
            bytes_per_s,
            signing,
            trusted,
            commanders,
        } = self.clone();
        Table { address, identity, vehicle_type, gps, bytes_per_s, signing, trusted, commanders }
            .serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for EndpointConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = EndpointConfig;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("an address in quotes, or { address = \"…\", identity = \"px4\" }")
            }

            fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<EndpointConfig, E> {
                text.parse::<Address>().map(Into::into).map_err(E::custom)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<EndpointConfig, A::Error> {
                let Table {
                    address,
                    identity,
                    vehicle_type,
                    gps,
                    bytes_per_s,
                    signing,
                    trusted,
                    commanders,
                } = Table::deserialize(MapAccessDeserializer::new(map))
                    .map_err(A::Error::custom)?;
                Ok(EndpointConfig {
                    address,
                    identity,
                    vehicle_type,
                    gps,
                    bytes_per_s,
                    signing,
                    trusted,
                    commanders,
                })
            }
        }
        deserializer.deserialize_any(Either)
    }
}

impl NoNumber for EndpointConfig {}

impl GroundConfig {
    /// What the core is told about each endpoint, in their order.
    pub fn for_pilot(&self) -> Vec<Endpoint> {
        self.endpoints
            .iter()
            .map(|endpoint| Endpoint {
                identity: endpoint.identity.unwrap_or(self.identity),
                vehicle_type: endpoint.vehicle_type.unwrap_or(self.vehicle_type),
                gps: endpoint.gps.unwrap_or(self.gps),
                stations: match endpoint.address {
                    Address::UdpIn(_) | Address::TcpIn(_) => MOST_STATIONS,
                    Address::UdpOut(_)
                    | Address::TcpOut(_)
                    | Address::CrtpUdp(_)
                    | Address::Radio(_)
                    | Address::CrtpUsb
                    | Address::Serial { .. } => 1,
                },
                line_Bps: endpoint.bytes_per_s.or(match endpoint.address {
                    Address::Serial { baud, .. } => Some(f64::from(baud) / BITS_PER_BYTE),
                    _ => None,
                }),
                signs: self.signing_of(endpoint) != Signing::Off,
                commanders: endpoint.commanders.unwrap_or(self.commanders),
            })
            .collect()
    }

    /// What an endpoint demands of signatures.
    pub(super) fn signing_of(&self, endpoint: &EndpointConfig) -> Signing {
        endpoint.signing.unwrap_or(self.signing)
    }

    /// What one station may send.
    pub(super) fn rate(&self) -> RateLimit {
        RateLimit { frames_per_s: self.most_frames_per_s, bytes_per_s: self.most_bytes_per_s }
    }

    fn endpoints(&self, key: &str, problems: &mut Problems) {
        if self.endpoints.len() > MOST_ENDPOINTS {
            problems.say(format!(
                "{key}.endpoints: {} entries, allowed 0 to {MOST_ENDPOINTS}; let several stations \
                 share a udpin or tcpin endpoint",
                self.endpoints.len()
            ));
        }
        let mut mav_type = |key: String, number: u8| {
            if !Endpoint::knows_type(number) {
                problems.say(format!(
                    "{key} = {number}: MAVLink knows no such vehicle type; 16 is a flapping wing, 2 a \
                     quadrotor"
                ));
            }
        };
        mav_type(format!("{key}.vehicle_type"), self.vehicle_type);
        for (i, endpoint) in self.endpoints.iter().enumerate() {
            if let Some(number) = endpoint.vehicle_type {
                mav_type(format!("{key}.endpoints[{i}].vehicle_type"), number);
            }
        }
        for (i, endpoint) in self.endpoints.iter().enumerate() {
            if let Some(bytes_per_s) = endpoint.bytes_per_s {
                problems.range(
                    format_args!("{key}.endpoints[{i}].bytes_per_s"),
                    bytes_per_s,
                    200.0..=1e8,
                    "bytes/s",
                );
            }
        }
        let links: usize = self.for_pilot().iter().map(|e| usize::from(e.stations)).sum();
        if links > MOST_GROUND_LINKS {
            problems.say(format!(
                "{key}.endpoints: room for {links} stations, allowed {MOST_GROUND_LINKS}; every udpin \
                 and tcpin endpoint takes {MOST_STATIONS}"
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<GroundConfig, String> {
        toml::from_str(text).map_err(|e| e.to_string())
    }

    #[test]
    fn prop_endpoints_are_addresses_or_tables() {
        let text = r#"
            identity = "generic"
            endpoints = ["udpout:127.0.0.1:14550",
                         { address = "udpin:0.0.0.0:14551", identity = "px4", vehicle_type = 2 },
                         { address = "serial:/dev/ttyS1:57600", gps = "origin+gps" }]
        "#;
        let config = read(text).unwrap();
        let [plain, px4, serial] = config.for_pilot()[..] else { panic!() };
        assert_eq!(plain, Endpoint::default());
        assert_eq!(
            (px4.identity, px4.vehicle_type, px4.stations),
            (Identity::Px4, 2, MOST_STATIONS)
        );
        assert_eq!((serial.gps, serial.line_Bps), (GpsClaim::OriginGps, Some(5760.0)));
        // As a log holds it.
        let again = read(&toml::to_string(&config).unwrap()).unwrap();
        assert_eq!(again, config);
    }

    #[test]
    fn prop_wrong_endpoints_say_what_is_wrong() {
        let refused = |text: &str, says: &str| {
            let error = read(text).unwrap_err();
            assert!(error.contains(says), "{error}");
        };
        refused("endpoints = [\"udp:1\"]", "is no address");
        refused("endpoints = [3]", "an address in quotes");
        refused("endpoints = [{ identity = \"px4\" }]", "address");
        refused("endpoints = [{ address = \"udpin:h:1\", identty = \"px4\" }]", "identty");
        let check = |text: &str, says: &str| {
            let mut problems = Problems::new();
            read(text).unwrap().check("ground", &mut problems);
            let text = problems.to_string();
            assert!(text.contains(says), "{text}");
        };
        check("vehicle_type = 250", "ground.vehicle_type = 250: MAVLink knows no such");
        check(
            "[origin]\nlatitude_deg = 95.0",
            "ground.origin.latitude_deg = 95, allowed -89 to 89",
        );
    }
}
