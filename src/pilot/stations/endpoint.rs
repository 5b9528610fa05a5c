//! What the core is told about a ground endpoint: who it claims to be there, for how many stations.

use serde::{Deserialize, Serialize};

use haltere_core::geo::{Geodetic, LocalOrigin};
use haltere_core::keys::NoNumber;
use haltere_dialect::mav::haltere::MavType;
use haltere_dialect::mav::known;

use super::identity::FLAPPING_WING;
use super::permits::Commanders;

/// Most links to stations in all: link numbers of logs are one byte, tag and board are two of them.
pub const MOST_GROUND_LINKS: usize = 64;

/// Which autopilot clients take us for (STATIONS.md, Which identity).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Identity {
    /// `MAV_AUTOPILOT_GENERIC`.
    #[default]
    Generic,
    /// `MAV_AUTOPILOT_PX4`: what QGroundControl and mavros need to offer control.
    Px4,
}

/// How much of a satellite receiver is claimed, for clients that know no indoor position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub enum GpsClaim {
    /// No global position at all.
    #[serde(rename = "none")]
    None,
    /// Global positions from the origin.
    #[default]
    #[serde(rename = "origin")]
    Origin,
    /// The same, and a receiver with a fix that does not exist: unchanged outdoor scripts wait for it.
    #[serde(rename = "origin+gps")]
    OriginGps,
}

/// Frames that are not for us.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Routing {
    /// Thrown away.
    Off,
    /// Passed on between stations.
    #[default]
    Stations,
    /// Passed on between stations and board.
    Board,
}

impl NoNumber for Identity {}
impl NoNumber for GpsClaim {}
impl NoNumber for Routing {}

/// One ground endpoint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Endpoint {
    /// Which autopilot it shows.
    pub identity: Identity,
    /// `MAV_TYPE` it shows.
    pub vehicle_type: u8,
    /// What it claims of a satellite receiver.
    pub gps: GpsClaim,
    /// Links that it may have at once: 1, or up to [`MOST_STATIONS`](crate::MOST_STATIONS) where stations come to us.
    pub stations: u8,
    /// What its line carries, bytes/s; `None`: more than we ever send.
    pub line_Bps: Option<f64>,
    /// Whether our frames get a signature behind us, which the line has to carry too.
    pub signs: bool,
    /// Systems that may command here.
    pub commanders: Commanders,
}

impl Default for Endpoint {
    fn default() -> Self {
        Self {
            identity: Identity::Generic,
            vehicle_type: FLAPPING_WING,
            gps: GpsClaim::Origin,
            stations: 1,
            line_Bps: None,
            signs: false,
            commanders: Commanders::default(),
        }
    }
}

impl Endpoint {
    /// Whether MAVLink knows this vehicle type.
    pub fn knows_type(vehicle_type: u8) -> bool {
        known::<MavType>(vehicle_type).is_some()
    }
}

haltere_core::keys! {
    /// Where the room lies on Earth.
    #[derive(Copy)]
    pub struct OriginConfig {
        /// Where the survey's origin lies on Earth: latitude. The default is a stand-in on open sea.
        // Nobody takes it for the true place. So near to zero the float32 degrees of older messages (DroneKit,
        // COMMAND_LONG) resolve 1 cm; at 52 degrees it is 42 cm. People are told at the start that it is a stand-in.
        // East and west have no length at the poles.
        latitude_deg: f64 = 0.5, [-89.0..=89.0, "deg"];
        /// Longitude.
        longitude_deg: f64 = 0.5, [-180.0..=180.0, "deg"];
        /// Altitude of the floor above sea level. Zero makes heights above sea level, home and floor one number.
        altitude_m: f64 = 0.0, [-500.0..=9000.0, "m"];
        /// Angle from true north to room north, positive clockwise seen from above.
        north_deg: f64 = 0.0, [-180.0..=180.0, "deg"];
    }
}

impl OriginConfig {
    /// As the core uses it. What was checked is always possible.
    pub fn in_force(&self) -> LocalOrigin {
        let at = |c: &Self| {
            let place = Geodetic::from_deg(c.latitude_deg, c.longitude_deg, c.altitude_m)?;
            LocalOrigin::new(place, c.north_deg.to_radians())
        };
        at(self).or_else(|| at(&Self::default())).unwrap_or_else(LocalOrigin::zero)
    }
}
