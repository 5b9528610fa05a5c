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

/// Most ground endpoints: far more than a flight needs, few enough to serve each at full rate.
const MOST_ENDPOINTS: usize = 8;
/// What one station may send: twenty times what an offboard client at 100 Hz does, and the length of as
/// many average frames.
const MOST_FRAMES_PER_S: f64 = 2000.0;
const MOST_BYTES_PER_S: f64 = 262_144.0;
/// Systems that a vehicle may be: as PX4 has it, since 251 to 255 are stations.
const SYSTEM_IDS: std::ops::RangeInclusive<f64> = 1.0..=250.0;
/// Bits that a serial line sends for a byte.
const BITS_PER_BYTE: f64 = 10.0;

/// `[ground]`: ground stations.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GroundConfig {
    /// Where they are.
    pub endpoints: Vec<EndpointConfig>,
    /// System that we are: two vehicles of one station differ in it.
    pub system_id: u8,
    /// Which autopilot clients take us for, where an endpoint does not say otherwise.
    pub identity: Identity,
    /// `MAV_TYPE`, where an endpoint does not say otherwise.
    pub vehicle_type: u8,
    /// What is claimed of a satellite receiver, where an endpoint does not say otherwise.
    pub gps: GpsClaim,
    /// What becomes of frames that are not for us.
    pub routing: Routing,
    /// What is demanded of signatures, where an endpoint does not say otherwise.
    pub signing: Signing,
    /// Systems that may command, where an endpoint does not say otherwise.
    pub commanders: Commanders,
    /// Frames that one station may send in a second.
    pub most_frames_per_s: f64,
    /// Bytes that one station may send in a second.
    pub most_bytes_per_s: f64,
    /// Where the room lies on Earth.
    pub origin: OriginConfig,
}

impl Default for GroundConfig {
    fn default() -> Self {
        // INTERFACES: UDP to this port by default.
        let address = Address::UdpOut(HostPort { host: "127.0.0.1".into(), port: 14_550 });
        let endpoint = Endpoint::default();
        Self {
            endpoints: vec![address.into()],
            system_id: 1,
            identity: endpoint.identity,
            vehicle_type: endpoint.vehicle_type,
            gps: endpoint.gps,
            routing: Routing::default(),
            signing: Signing::default(),
            commanders: endpoint.commanders,
            most_frames_per_s: MOST_FRAMES_PER_S,
            most_bytes_per_s: MOST_BYTES_PER_S,
            origin: OriginConfig::default(),
        }
    }
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
                    Address::UdpOut(_) | Address::TcpOut(_) | Address::Serial { .. } => 1,
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

    pub(super) fn check(&self, key: &str, problems: &mut Problems) {
        if self.endpoints.len() > MOST_ENDPOINTS {
            problems.say(format!(
                "{key}.endpoints: {} entries, allowed 0 to {MOST_ENDPOINTS}; let several stations \
                 share a udpin or tcpin endpoint",
                self.endpoints.len()
            ));
        }
        problems.range(format_args!("{key}.system_id"), f64::from(self.system_id), SYSTEM_IDS, "");
        problems.range(
            format_args!("{key}.most_frames_per_s"),
            self.most_frames_per_s,
            20.0..=1e6,
            "frames/s",
        );
        problems.range(
            format_args!("{key}.most_bytes_per_s"),
            self.most_bytes_per_s,
            1000.0..=1e9,
            "bytes/s",
        );
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
        self.origin.check(&format!("{key}.origin"), problems);
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
