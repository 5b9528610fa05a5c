//! The mission protocol's upload side: one session per endpoint, replaced whole or not at all.

use haltere_dialect::mav::haltere::{
    MISSION_ACK_DATA, MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA, MISSION_REQUEST_DATA,
    MISSION_REQUEST_INT_DATA, MavMessage, MavMissionResult, MavMissionType,
};

use crate::time::HostTime;

use super::mission::{MOST_ITEMS, StoredItem, from_wire, is_plan};
use super::tilt_step::Envelope;

/// An item that does not come is asked for again after this time, µs (the guide says 1.5 s for
/// links of any kind; ours are local).
const RETRY_US: i64 = 300_000;
/// A client that is silent for so long has given up, µs.
const GIVE_UP_US: i64 = 10_000_000;
/// After so many unanswered MISSION_REQUEST_INT the older MISSION_REQUEST is tried (GROUND.md:
/// DroneKit answers only that).
const TRIES_BEFORE_OLD: u32 = 2;

#[derive(Debug)]
struct Session {
    system_id: u8,
    component_id: u8,
    mission_type: MavMissionType,
    count: u16,
    items: Vec<StoredItem>,
    asked_at: HostTime,
    heard_at: HostTime,
    tries: u32,
}

/// State of the upload on one endpoint.
#[derive(Debug, Default)]
pub(super) struct MissionTransfer {
    session: Option<Session>,
}

/// What came of a message.
#[derive(Debug)]
pub(super) enum Progress {
    /// Answer this to the client.
    Answer(MavMessage),
    /// All items are here: put them in force, then answer.
    Complete {
        items: Vec<StoredItem>,
        answer: (u8, u8, MavMissionType),
    },
    /// Refused: answer, and say why to people.
    Refused {
        answer: MavMessage,
        why: String,
    },
    Nothing,
}

/// The acknowledgement of the protocol.
pub(super) fn ack(
    to: (u8, u8),
    mission_type: MavMissionType,
    result: MavMissionResult,
    opaque_id: u32,
) -> MavMessage {
    MavMessage::MISSION_ACK(MISSION_ACK_DATA {
        target_system: to.0,
        target_component: to.1,
        mavtype: result,
        mission_type,
        opaque_id,
    })
}

impl MissionTransfer {
    /// Whether an upload is under way that this client did not begin.
    pub fn is_taken_by_other(&self, from: (u8, u8)) -> bool {
        self.session.as_ref().is_some_and(|s| (s.system_id, s.component_id) != from)
    }

    /// Whether an upload is under way.
    pub fn is_busy(&self) -> bool {
        self.session.is_some()
    }

    /// A client announces items.
    pub fn count(&mut self, from: (u8, u8), m: &MISSION_COUNT_DATA, at: HostTime) -> Progress {
        if !is_plan(m.mission_type) {
            let answer = ack(from, m.mission_type, MavMissionResult::MAV_MISSION_UNSUPPORTED, 0);
            return Progress::Refused { answer, why: "fence and rally not supported".to_owned() };
        }
        if usize::from(m.count) > MOST_ITEMS {
            let answer = ack(from, m.mission_type, MavMissionResult::MAV_MISSION_NO_SPACE, 0);
            let why = format!("mission of {} items, at most {MOST_ITEMS} allowed", m.count);
            return Progress::Refused { answer, why };
        }
        if m.count == 0 {
            self.session = None;
            let answer = (from.0, from.1, m.mission_type);
            return Progress::Complete { items: Vec::new(), answer };
        }
        let session = Session {
            system_id: from.0,
            component_id: from.1,
            mission_type: m.mission_type,
            count: m.count,
            items: Vec::with_capacity(usize::from(m.count)),
            asked_at: at,
            heard_at: at,
            tries: 1,
        };
        let request = session.request();
        self.session = Some(session);
        Progress::Answer(request)
    }

    /// An item came.
    pub fn item(
        &mut self,
        from: (u8, u8),
        m: &MISSION_ITEM_INT_DATA,
        envelope: &Envelope,
        at: HostTime,
    ) -> Progress {
        let Some(session) = &mut self.session else { return Progress::Nothing };
        if (session.system_id, session.component_id) != from
            || usize::from(m.seq) != session.items.len()
        {
            // A repeated or foreign item: the retry asks for the right one.
            return Progress::Nothing;
        }
        session.heard_at = at;
        match from_wire(m, envelope) {
            Ok(item) => session.items.push(StoredItem { wire: m.clone(), item }),
            Err((result, why)) => {
                let answer = ack(from, session.mission_type, result, 0);
                self.session = None;
                return Progress::Refused { answer, why };
            }
        }
        if session.items.len() < usize::from(session.count) {
            session.asked_at = at;
            session.tries = 1;
            return Progress::Answer(session.request());
        }
        let mission_type = session.mission_type;
        let items = self.session.take().map(|s| s.items).unwrap_or_default();
        Progress::Complete { items, answer: (from.0, from.1, mission_type) }
    }

    /// The client breaks off.
    pub fn cancel(&mut self, from: (u8, u8)) {
        self.session.take_if(|s| (s.system_id, s.component_id) == from);
    }

    /// Repeats the request for an item that did not come.
    pub fn tick(&mut self, at: HostTime) -> Progress {
        let Some(session) = &mut self.session else { return Progress::Nothing };
        if at.seconds_since(session.heard_at) * 1e6 > GIVE_UP_US as f64 {
            let answer = ack(
                (session.system_id, session.component_id),
                session.mission_type,
                MavMissionResult::MAV_MISSION_OPERATION_CANCELLED,
                0,
            );
            let why = format!("mission upload: item {} never came", session.items.len());
            self.session = None;
            return Progress::Refused { answer, why };
        }
        if at.seconds_since(session.asked_at) * 1e6 < RETRY_US as f64 {
            return Progress::Nothing;
        }
        session.asked_at = at;
        session.tries += 1;
        Progress::Answer(session.request())
    }
}

impl Session {
    fn request(&self) -> MavMessage {
        let seq = self.items.len() as u16;
        if self.tries == TRIES_BEFORE_OLD + 1 {
            return MavMessage::MISSION_REQUEST(MISSION_REQUEST_DATA {
                seq,
                target_system: self.system_id,
                target_component: self.component_id,
                mission_type: self.mission_type,
            });
        }
        MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
            seq,
            target_system: self.system_id,
            target_component: self.component_id,
            mission_type: self.mission_type,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_dialect::mav::haltere::{MavCmd, MavFrame};

    const CLIENT: (u8, u8) = (255, 190);
    fn envelope() -> Envelope {
        let volume = super::super::mission::Volume {
            north_m: [-5.0, 5.0],
            east_m: [-5.0, 5.0],
            height_m: 3.0,
        };
        Envelope::new(volume, &Default::default(), 6.0)
    }

    fn at(s: f64) -> HostTime {
        HostTime::from_us((s * 1e6) as u64)
    }

    fn count(n: u16) -> MISSION_COUNT_DATA {
        MISSION_COUNT_DATA { count: n, ..Default::default() }
    }

    fn item(seq: u16) -> MISSION_ITEM_INT_DATA {
        MISSION_ITEM_INT_DATA {
            seq,
            command: MavCmd::MAV_CMD_NAV_WAYPOINT,
            frame: MavFrame::MAV_FRAME_LOCAL_NED,
            z: -1.0,
            ..Default::default()
        }
    }

    #[test]
    fn prop_items_are_asked_for_in_order_and_put_in_force_together() {
        let mut transfer = MissionTransfer::default();
        assert!(matches!(transfer.count(CLIENT, &count(2), at(0.0)), Progress::Answer(_)));
        assert!(matches!(transfer.item(CLIENT, &item(1), &envelope(), at(0.1)), Progress::Nothing));
        assert!(matches!(
            transfer.item(CLIENT, &item(0), &envelope(), at(0.1)),
            Progress::Answer(_)
        ));
        assert!(matches!(transfer.item((1, 1), &item(1), &envelope(), at(0.1)), Progress::Nothing));
        match transfer.item(CLIENT, &item(1), &envelope(), at(0.2)) {
            Progress::Complete { items, .. } => assert_eq!(items.len(), 2),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn prop_a_bad_item_ends_the_upload() {
        let mut transfer = MissionTransfer::default();
        transfer.count(CLIENT, &count(1), at(0.0));
        let far = MISSION_ITEM_INT_DATA { x: 900_000, ..item(0) };
        assert!(matches!(
            transfer.item(CLIENT, &far, &envelope(), at(0.1)),
            Progress::Refused { .. }
        ));
        assert!(matches!(transfer.item(CLIENT, &item(0), &envelope(), at(0.2)), Progress::Nothing));
    }

    #[test]
    fn prop_silence_is_asked_again_then_given_up() {
        let mut transfer = MissionTransfer::default();
        transfer.count(CLIENT, &count(1), at(0.0));
        assert!(matches!(transfer.tick(at(0.1)), Progress::Nothing));
        assert!(matches!(
            transfer.tick(at(0.35)),
            Progress::Answer(MavMessage::MISSION_REQUEST_INT(_))
        ));
        assert!(matches!(transfer.tick(at(0.7)), Progress::Answer(MavMessage::MISSION_REQUEST(_))));
        assert!(matches!(
            transfer.tick(at(1.1)),
            Progress::Answer(MavMessage::MISSION_REQUEST_INT(_))
        ));
        assert!(matches!(transfer.tick(at(11.0)), Progress::Refused { .. }));
        assert!(matches!(transfer.tick(at(12.0)), Progress::Nothing));
    }

    #[test]
    fn prop_too_many_items_are_refused() {
        let mut transfer = MissionTransfer::default();
        let Progress::Refused { answer: MavMessage::MISSION_ACK(ack), .. } =
            transfer.count(CLIENT, &count(MOST_ITEMS as u16 + 1), at(0.0))
        else {
            panic!("not refused")
        };
        assert_eq!(ack.mavtype, MavMissionResult::MAV_MISSION_NO_SPACE);
    }
}
