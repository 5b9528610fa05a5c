//! Ground stations and clients: their links, who may command, what they are answered, sent and served.

pub(crate) mod clients;
pub(crate) mod commands;
pub(crate) mod endpoint;
pub(crate) mod ground;
pub mod guard;
pub(crate) mod identity;
pub(crate) mod mission_transfer;
pub(crate) mod permits;
mod place;
pub(crate) mod radio;
pub(crate) mod routing;
pub mod services;
pub(crate) mod shown;
pub(crate) mod streams;
pub(crate) mod telemetry;
pub(crate) mod telemetry_counts;
pub(crate) mod telemetry_estimator;
pub(crate) mod telemetry_global;
pub(crate) mod telemetry_imu;
pub(crate) mod unheard;

use haltere_core::time::HostTime;

use crate::config::PilotConfig;
use crate::input::LinkId;
use crate::out::Out;
use crate::out::voice::Severity;

use commands::Asker;
use endpoint::{Endpoint, Identity};
use ground::GroundLink;
use services::Services;

/// The links to stations, and what clients have asked for.
#[derive(Debug)]
pub(crate) struct Stations {
    pub(crate) grounds: Vec<GroundLink>,
    pub(crate) services: Services,
    pub(crate) askers: Vec<Asker>,
    /// What a client last asked for, by number; 0: nothing yet.
    pub(crate) intended_mode: u32,
    pub(crate) sent_a_mission: bool,
    /// Since when setpoints come that the mode does not follow.
    pub(crate) unobeyed_since: Option<HostTime>,
}

impl Stations {
    pub(crate) fn new(config: &PilotConfig, at: HostTime) -> Self {
        let grounds = (0..)
            .zip(config.ground_links())
            .map(|(n, (number, endpoint))| GroundLink::new(LinkId::Ground(n), endpoint, number, at))
            .collect();
        Self {
            grounds,
            services: Services::new(config),
            askers: Vec::new(),
            intended_mode: 0,
            sent_a_mission: false,
            unobeyed_since: None,
        }
    }

    pub(crate) fn ground_mut(&mut self, link: LinkId) -> Option<&mut GroundLink> {
        let LinkId::Ground(n) = link else { return None };
        self.grounds.get_mut(usize::from(n))
    }

    pub(crate) fn endpoint_on(&self, link: LinkId) -> Endpoint {
        let LinkId::Ground(n) = link else { return Endpoint::default() };
        self.grounds.get(usize::from(n)).map_or_else(Endpoint::default, |g| g.endpoint)
    }

    pub(crate) fn identity_on(&self, link: LinkId) -> Identity {
        self.endpoint_on(link).identity
    }

    /// Whether a link shows the identity `px4`.
    pub(crate) fn is_px4(&self, link: LinkId) -> bool {
        self.endpoint_on(link).identity == Identity::Px4
    }

    /// What the line of a link carries, bytes/s; `None`: more than we ever send.
    pub(crate) fn line_Bps(&self, link: LinkId) -> Option<f64> {
        let LinkId::Ground(n) = link else { return None };
        self.grounds.get(usize::from(n))?.streams.line_Bps()
    }

    /// The station of a link is gone: what it left behind must hold nobody up.
    pub(crate) fn station_left(&mut self, at: HostTime, n: u8, out: &mut Out) {
        let Some(ground) = self.grounds.get_mut(usize::from(n)) else { return };
        let link = ground.link;
        if !out.is_open(link) {
            return;
        }
        let counts = ground.counts;
        ground.begin_anew(at);
        out.closes(link);
        self.askers.retain(|asker| asker.client.link != link);
        out.say(
            at,
            Severity::Info,
            format!(
                "station on link {} left: {} frames received, {} lost, {} sent",
                link.number(),
                counts.received,
                counts.lost,
                counts.sent
            ),
        );
    }
}
