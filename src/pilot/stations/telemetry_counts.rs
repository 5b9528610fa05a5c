//! What clients see of counters: anchor pairs, losses, links. Entries take turns, one a message.

use haltere_dialect::mav::haltere::{
    HALTERE_DROPS_DATA, HALTERE_LINK_DATA, HALTERE_PAIR_DATA, MavMessage,
};

use haltere_core::drops::DropReason;

use super::shown::{Shown, Turns};

/// HALTERE_LINK: links with a station take turns.
pub(crate) fn link(shown: &Shown<'_>, turns: &mut Turns) -> Option<MavMessage> {
    let grounds = &shown.stations.grounds;
    let total = grounds.len();
    let mut cursor = turns.link;
    for _ in 0..total {
        cursor = (cursor + 1) % total;
        let ground = grounds.get(cursor)?;
        if shown.out.is_open(ground.link) {
            let wire = |count: u64| u32::try_from(count).unwrap_or(u32::MAX);
            let counts = ground.counts;
            turns.link = cursor;
            return Some(MavMessage::HALTERE_LINK(HALTERE_LINK_DATA {
                time_usec: shown.at.as_us(),
                received: wire(counts.received),
                lost: wire(counts.lost),
                sent: wire(counts.sent),
                routed: wire(counts.routed),
                delayed: wire(ground.streams.delayed),
                received_bytes: wire(counts.received_B),
                sent_bytes: wire(counts.sent_B),
                link: ground.link.number(),
                endpoint: ground.endpoint_number,
                own: u8::from(ground.link == shown.link),
            }));
        }
    }
    None
}

/// HALTERE_PAIR: pairs take turns.
pub(crate) fn pair(shown: &Shown<'_>, turns: &mut Turns) -> Option<MavMessage> {
    let pairs = &shown.navigation.pairs;
    if pairs.is_empty() {
        return None;
    }
    turns.pair = (turns.pair + 1) % pairs.len();
    let pair = pairs.get(turns.pair)?;
    Some(MavMessage::HALTERE_PAIR(HALTERE_PAIR_DATA {
        time_usec: shown.at.as_us(),
        innovation: pair.innovation_m as f32,
        test_ratio: pair.test_ratio as f32,
        accepted: pair.accepted,
        rejected: pair.rejected,
        anchor_a: pair.anchor_a.0,
        anchor_b: pair.anchor_b.0,
    }))
}

/// HALTERE_DROPS: counted reasons take turns.
pub(crate) fn drop(shown: &Shown<'_>, turns: &mut Turns) -> Option<MavMessage> {
    let links = shown.out.drops.len();
    let core = links - 1;
    let reasons = DropReason::ALL.len();
    let mut cursor = turns.drop;
    for _ in 0..links * reasons {
        cursor = (cursor + 1) % (links * reasons);
        let (link, reason) = (cursor / reasons, DropReason::ALL[cursor % reasons]);
        let count = shown.out.lost(&shown.navigation.estimator, link, reason);
        if count > 0 {
            turns.drop = cursor;
            return Some(MavMessage::HALTERE_DROPS(HALTERE_DROPS_DATA {
                time_usec: shown.at.as_us(),
                count: u32::try_from(count).unwrap_or(u32::MAX),
                link: if link == core { u8::MAX } else { link as u8 },
                reason: reason.name().into(),
            }));
        }
    }
    None
}
