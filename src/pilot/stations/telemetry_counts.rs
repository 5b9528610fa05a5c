//! What clients see of counters: anchor pairs, losses, links. Entries take turns, one a message.

use haltere_dialect::mav::haltere::{
    HALTERE_DROPS_DATA, HALTERE_LINK_DATA, HALTERE_PAIR_DATA, MavMessage,
};

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

use super::Stations;
use crate::Pilot;
use crate::input::LinkId;
use crate::out::Out;

impl Stations {
    /// Links with a station take turns: one message each.
    pub(crate) fn next_link(
        &mut self,
        at: HostTime,
        link: LinkId,
        out: &mut Out,
    ) -> Option<MavMessage> {
        let LinkId::Ground(own) = link else { return None };
        let mut cursor = self.grounds.get(usize::from(own))?.link_cursor;
        let total = self.grounds.len();
        for _ in 0..total {
            cursor = (cursor + 1) % total;
            let ground = self.grounds.get(cursor)?;
            if out.is_open(ground.link) {
                let wire = |count: u64| u32::try_from(count).unwrap_or(u32::MAX);
                let counts = ground.counts;
                let message = MavMessage::HALTERE_LINK(HALTERE_LINK_DATA {
                    time_usec: at.as_us(),
                    received: wire(counts.received),
                    lost: wire(counts.lost),
                    sent: wire(counts.sent),
                    routed: wire(counts.routed),
                    delayed: wire(ground.streams.delayed),
                    received_bytes: wire(counts.received_B),
                    sent_bytes: wire(counts.sent_B),
                    link: ground.link.number(),
                    endpoint: ground.endpoint_number,
                    own: u8::from(ground.link == link),
                });
                self.grounds.get_mut(usize::from(own))?.link_cursor = cursor;
                return Some(message);
            }
        }
        None
    }
}

impl Pilot {
    /// Pairs take turns: one message each.
    pub(crate) fn next_pair(&mut self, at: HostTime, link: LinkId) -> Option<MavMessage> {
        if self.navigation.pairs.is_empty() {
            return None;
        }
        let LinkId::Ground(n) = link else { return None };
        let cursor = &mut self.stations.grounds.get_mut(usize::from(n))?.pair_cursor;
        *cursor = (*cursor + 1) % self.navigation.pairs.len();
        let pair = self.navigation.pairs.get(*cursor)?;
        Some(MavMessage::HALTERE_PAIR(HALTERE_PAIR_DATA {
            time_usec: at.as_us(),
            innovation: pair.innovation_m as f32,
            test_ratio: pair.test_ratio as f32,
            accepted: pair.accepted,
            rejected: pair.rejected,
            anchor_a: pair.anchor_a.0,
            anchor_b: pair.anchor_b.0,
        }))
    }

    /// Counted reasons take turns: one message each.
    pub(crate) fn next_drop(&mut self, at: HostTime, link: LinkId) -> Option<MavMessage> {
        let LinkId::Ground(n) = link else { return None };
        let mut cursor = self.stations.grounds.get(usize::from(n))?.drop_cursor;
        let core = self.out.drops.len() - 1;
        let reasons = DropReason::ALL.len();
        for _ in 0..self.out.drops.len() * reasons {
            cursor = (cursor + 1) % (self.out.drops.len() * reasons);
            let (link, reason) = (cursor / reasons, cursor % reasons);
            let reason = DropReason::ALL[reason];
            let count = self.out.lost(&self.navigation.estimator, link, reason);
            if count > 0 {
                self.stations.grounds[usize::from(n)].drop_cursor = cursor;
                return Some(MavMessage::HALTERE_DROPS(HALTERE_DROPS_DATA {
                    time_usec: at.as_us(),
                    count: u32::try_from(count).unwrap_or(u32::MAX),
                    link: if link == core { u8::MAX } else { link as u8 },
                    reason: reason.name().into(),
                }));
            }
        }
        None
    }
}
