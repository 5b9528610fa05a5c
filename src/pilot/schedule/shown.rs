//! What stations are shown, from all parts: the streams, and what is told at once.

use haltere_dialect::mav::haltere::{MISSION_ITEM_REACHED_DATA, MavMessage};

use haltere_core::time::HostTime;

use super::act::Act;
use crate::input::LinkId;
use crate::stations::shown::Shown;
use crate::stations::{streams, telemetry_global};

impl Act<'_> {
    /// Sends one message of a stream. `false`: it is none of ours, or has nothing to say yet.
    pub(crate) fn send_telemetry(&mut self, at: HostTime, link: LinkId, msg_id: u32) -> bool {
        let Some(stream) = streams::of(msg_id) else { return false };
        let mut turns = self.stations.ground_mut(link).map(|g| g.turns).unwrap_or_default();
        let may_arm = || self.sight(self.clock.now).may_arm().is_ok();
        let shown = Shown {
            at,
            link,
            endpoint: self.stations.endpoint_on(link),
            config: self.config,
            origin: self.origin,
            estimate: self.estimate,
            clock: self.clock,
            out: self.out,
            navigation: self.navigation,
            board: self.board,
            flight: self.flight,
            stations: self.stations,
            may_arm: &may_arm,
        };
        let message = stream.message(&shown, &mut turns);
        if let Some(ground) = self.stations.ground_mut(link) {
            ground.turns = turns;
        }
        let Some(message) = message else { return false };
        self.out.message(link, &message);
        true
    }

    pub(crate) fn tell_reached(&mut self, at: HostTime, seq: u16) {
        self.tell_program_progress(at, seq);
        self.out.tell_all(&MavMessage::MISSION_ITEM_REACHED(MISSION_ITEM_REACHED_DATA { seq }));
    }

    /// HEARTBEAT and CURRENT_MODE at once where the mode shown or the arming has changed: clients that
    /// asked for it give up soon (STATIONS.md).
    pub(crate) fn tell_mode(&mut self, at: HostTime) {
        let shown = (self.flight.shown_mode().custom_mode(), self.board.link.is_armed());
        if self.out.told.mode == Some(shown) {
            return;
        }
        self.out.told.mode = Some(shown);
        for n in 0..self.stations.grounds.len() {
            let link = self.stations.grounds[n].link;
            if self.out.is_open(link) {
                self.send_telemetry(at, link, streams::HEARTBEAT);
                self.send_telemetry(at, link, streams::CURRENT_MODE);
            }
        }
    }

    pub(crate) fn origin_message(&self) -> MavMessage {
        telemetry_global::origin_at(self.clock.now, self.origin)
    }

    pub(crate) fn home_message(&self) -> MavMessage {
        let home_E_m = self.flight.guidance.home_E_m();
        telemetry_global::home_at(self.clock.now, self.origin, home_E_m)
    }
}
