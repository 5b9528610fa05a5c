//! What the makers of telemetry look at, and none of them changes.

use haltere_core::estimate::{Estimate, Health};
use haltere_core::geo::LocalOrigin;
use haltere_core::time::HostTime;

use super::Stations;
use super::endpoint::{Endpoint, GpsClaim};
use crate::board::Board;
use crate::clock::Clock;
use crate::config::PilotConfig;
use crate::flight::Flight;
use crate::input::LinkId;
use crate::navigation::Navigation;
use crate::out::Out;

/// All that a station on one link can be shown.
pub(crate) struct Shown<'a> {
    pub at: HostTime,
    pub link: LinkId,
    pub endpoint: Endpoint,
    pub config: &'a PilotConfig,
    pub origin: &'a LocalOrigin,
    pub estimate: &'a Estimate,
    pub clock: &'a Clock,
    pub out: &'a Out,
    pub navigation: &'a Navigation,
    pub board: &'a Board,
    pub flight: &'a Flight,
    pub stations: &'a Stations,
    /// Whether the vehicle may be armed now. Asked for only where it is told: it takes all checks.
    pub may_arm: &'a dyn Fn() -> bool,
}

impl Shown<'_> {
    /// Time since the start, ms: on the wire it has 32 bits.
    pub fn boot_ms(&self) -> u32 {
        (self.at.as_us() / 1000) as u32
    }

    /// Whether the vehicle has found where it is.
    pub fn is_aligned(&self) -> bool {
        self.estimate.health != Health::NotAligned
    }

    /// Whether positions on Earth are claimed on this link.
    pub fn has_place(&self) -> bool {
        self.endpoint.gps != GpsClaim::None
    }

    /// Height of the landing gear above the floor by the estimate, m.
    pub fn height_above_floor_m(&self) -> f64 {
        -self.estimate.pos_E_m.z() - self.config.flight.gear_height_m
    }
}

/// Whose turn it is in the streams of anchor pairs, of losses and of links: per link, since two that shared one would
/// each see every other entry for ever.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Turns {
    pub pair: usize,
    pub drop: usize,
    pub link: usize,
    /// Whether the station knows where the numbers of events stand.
    pub event_sequence_told: bool,
}
