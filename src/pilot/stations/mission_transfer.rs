//! The upload side of the mission protocol: one session for the whole vehicle, all items or none.
//!
//! Source: the guide's "Mission Protocol" page: time-out 1500 ms, 250 ms between items, 5 retries.
//! An item is asked for every 250 ms until 5 times 1500 ms have passed without one; links of ours
//! are fast and lossy rather than slow. The older MISSION_REQUEST is tried once a client has left
//! two MISSION_REQUEST_INT unanswered and never answered one (DroneKit knows no other); later it
//! would do harm: MAVSDK answers it with a refusal, which ends its upload.

use haltere_dialect::mav::haltere::{
    MISSION_ACK_DATA, MISSION_ITEM_INT_DATA, MISSION_REQUEST_DATA, MISSION_REQUEST_INT_DATA,
    MavMessage, MavMissionResult,
};

use haltere_core::time::HostTime;

use crate::input::LinkId;

/// An item that does not come is asked for again after this time, s.
const RETRY_S: f64 = 0.25;
/// A client that is silent for so long has given up, s: 5 times 1500 ms.
const GIVE_UP_S: f64 = 7.5;
/// After so many unanswered MISSION_REQUEST_INT the older MISSION_REQUEST is tried.
const TRIES_BEFORE_OLD: u32 = 2;
/// The last item of a finished upload may be repeated for so long, s: its answer was lost.
const ECHO_S: f64 = 10.0;

/// A client: link, system id, component id.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Client {
    pub link: LinkId,
    pub peer: (u8, u8),
}

#[derive(Debug)]
struct Session {
    client: Client,
    mission_type: u8,
    /// Index of the first item, and how many there are to come.
    first: u16,
    count: u16,
    /// Only a part of the list is replaced.
    partial: bool,
    items: Vec<MISSION_ITEM_INT_DATA>,
    asked_at: HostTime,
    heard_at: HostTime,
    tries: u32,
    /// The client uses float items.
    old: bool,
}

/// An upload that ended well, in case its client did not hear so.
#[derive(Debug)]
struct Finished {
    client: Client,
    mission_type: u8,
    last_seq: u16,
    answer: MavMessage,
    at: HostTime,
}

/// State of the upload.
#[derive(Debug, Default)]
pub(crate) struct MissionTransfer {
    session: Option<Session>,
    finished: Option<Finished>,
}

/// All items of an upload.
#[derive(Debug, PartialEq)]
pub(crate) struct Upload {
    pub client: Client,
    pub mission_type: u8,
    pub first: u16,
    pub partial: bool,
    pub items: Vec<MISSION_ITEM_INT_DATA>,
}

/// What came of a message.
#[derive(Debug, PartialEq)]
pub(crate) enum Progress {
    /// Send this to the client.
    Answer(Client, MavMessage),
    /// All items are here.
    Complete(Upload),
    /// The client is silent: tell it, and people why.
    GivenUp(Client, MavMessage, String),
    Nothing,
}

/// The acknowledgement of the protocol.
pub(crate) fn ack(
    to: (u8, u8),
    mission_type: u8,
    result: MavMissionResult,
    opaque_id: u32,
) -> MavMessage {
    MavMessage::MISSION_ACK(MISSION_ACK_DATA {
        target_system: to.0,
        target_component: to.1,
        mavtype: result as u8,
        mission_type,
        opaque_id,
    })
}

impl MissionTransfer {
    /// Whether nobody uploads, or repeats the end of an upload.
    pub fn is_idle(&self, at: HostTime) -> bool {
        let echoes = |f: &Finished| at.seconds_since(f.at) < ECHO_S;
        self.session.is_none() && !self.finished.as_ref().is_some_and(echoes)
    }

    /// Whether somebody else uploads.
    pub fn is_taken_by_other(&self, client: Client) -> bool {
        self.session.as_ref().is_some_and(|s| s.client != client)
    }

    /// A client announces items; at least one. What it had begun before is forgotten.
    pub fn begin(
        &mut self,
        client: Client,
        mission_type: u8,
        first: u16,
        count: u16,
        partial: bool,
        at: HostTime,
    ) -> Progress {
        let session = Session {
            client,
            mission_type,
            first,
            count,
            partial,
            items: Vec::with_capacity(usize::from(count)),
            asked_at: at,
            heard_at: at,
            tries: 1,
            old: false,
        };
        let request = session.request();
        self.session = Some(session);
        self.finished = None;
        Progress::Answer(client, request)
    }

    /// Whether an item is the one that was asked for.
    pub fn wants(&self, client: Client, mission_type: u8, seq: u16) -> bool {
        self.session.as_ref().is_some_and(|s| {
            s.client == client && s.mission_type == mission_type && s.next() == u32::from(seq)
        })
    }

    /// An item came; `float`: in the older message. Repeated and foreign ones change nothing.
    pub fn item(
        &mut self,
        client: Client,
        item: MISSION_ITEM_INT_DATA,
        float: bool,
        at: HostTime,
    ) -> Progress {
        if !self.wants(client, item.mission_type, item.seq) {
            return self.echo(client, &item, at);
        }
        let Some(session) = &mut self.session else { return Progress::Nothing };
        session.heard_at = at;
        session.asked_at = at;
        session.tries = 1;
        session.old = float;
        session.items.push(item);
        if session.items.len() < usize::from(session.count) {
            return Progress::Answer(client, session.request());
        }
        match self.session.take() {
            Some(Session { client, mission_type, first, partial, items, .. }) => {
                Progress::Complete(Upload { client, mission_type, first, partial, items })
            }
            None => Progress::Nothing,
        }
    }

    /// The last item of an upload that is over: its client waits for the answer.
    fn echo(&mut self, client: Client, item: &MISSION_ITEM_INT_DATA, at: HostTime) -> Progress {
        match &self.finished {
            Some(done)
                if done.client == client
                    && done.mission_type == item.mission_type
                    && done.last_seq == item.seq
                    && at.seconds_since(done.at) < ECHO_S =>
            {
                Progress::Answer(client, done.answer.clone())
            }
            _ => Progress::Nothing,
        }
    }

    /// Remembers how an upload was answered.
    pub fn finish(&mut self, upload: &Upload, answer: MavMessage, at: HostTime) {
        let Some(last) = upload.items.last() else { return };
        self.finished = Some(Finished {
            client: upload.client,
            mission_type: upload.mission_type,
            last_seq: last.seq,
            answer,
            at,
        });
    }

    /// The client breaks off, or the upload is refused.
    pub fn cancel(&mut self, client: Client) {
        self.session.take_if(|s| s.client == client);
    }

    /// Its link is gone.
    pub fn cancel_link(&mut self, link: LinkId) {
        self.session.take_if(|s| s.client.link == link);
    }

    /// Repeats the request for an item that did not come.
    pub fn tick(&mut self, at: HostTime) -> Progress {
        let Some(session) = &mut self.session else { return Progress::Nothing };
        let client = session.client;
        if at.seconds_since(session.heard_at) > GIVE_UP_S {
            let cancelled = MavMissionResult::MAV_MISSION_OPERATION_CANCELLED;
            let answer = ack(client.peer, session.mission_type, cancelled, 0);
            let why =
                format!("upload given up: item {} never came", session.next().saturating_add(1));
            self.session = None;
            return Progress::GivenUp(client, answer, why);
        }
        if at.seconds_since(session.asked_at) < RETRY_S {
            return Progress::Nothing;
        }
        session.asked_at = at;
        session.tries += 1;
        Progress::Answer(client, session.request())
    }
}

impl Session {
    /// Index of the item to come. Wider than an index: the last may be the largest.
    fn next(&self) -> u32 {
        u32::from(self.first) + self.items.len() as u32
    }

    fn request(&self) -> MavMessage {
        let seq = self.next().min(u32::from(u16::MAX)) as u16;
        let (target_system, target_component) = self.client.peer;
        let mission_type = self.mission_type;
        let first_try_of_old = self.items.is_empty() && self.tries == TRIES_BEFORE_OLD + 1;
        if self.old || first_try_of_old {
            return MavMessage::MISSION_REQUEST(MISSION_REQUEST_DATA {
                seq,
                target_system,
                target_component,
                mission_type,
            });
        }
        MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
            seq,
            target_system,
            target_component,
            mission_type,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_dialect::mav::haltere::MavMissionType;

    const QGC: Client = Client { link: LinkId::Ground(0), peer: (255, 190) };
    const OTHER: Client = Client { link: LinkId::Ground(1), peer: (255, 190) };
    const PLAN: u8 = MavMissionType::MAV_MISSION_TYPE_MISSION as u8;

    fn at(s: f64) -> HostTime {
        HostTime::from_us((s * 1e6) as u64)
    }

    fn item(seq: u16) -> MISSION_ITEM_INT_DATA {
        MISSION_ITEM_INT_DATA { seq, ..Default::default() }
    }

    fn asks_int(progress: &Progress, wanted: u16) -> bool {
        matches!(progress, Progress::Answer(_, MavMessage::MISSION_REQUEST_INT(r)) if r.seq == wanted)
    }

    #[test]
    fn prop_items_are_asked_for_in_order_and_come_together() {
        let mut transfer = MissionTransfer::default();
        assert!(asks_int(&transfer.begin(QGC, PLAN, 0, 2, false, at(0.0)), 0));
        assert!(transfer.is_taken_by_other(OTHER) && !transfer.is_taken_by_other(QGC));
        assert_eq!(transfer.item(QGC, item(1), false, at(0.1)), Progress::Nothing);
        assert!(asks_int(&transfer.item(QGC, item(0), false, at(0.1)), 1));
        // Repeated, foreign, of another list.
        assert_eq!(transfer.item(QGC, item(0), false, at(0.1)), Progress::Nothing);
        assert_eq!(transfer.item(OTHER, item(1), false, at(0.1)), Progress::Nothing);
        let fence = MISSION_ITEM_INT_DATA {
            mission_type: MavMissionType::MAV_MISSION_TYPE_FENCE as u8,
            ..item(1)
        };
        assert_eq!(transfer.item(QGC, fence, false, at(0.1)), Progress::Nothing);
        let Progress::Complete(upload) = transfer.item(QGC, item(1), false, at(0.2)) else {
            panic!("not complete")
        };
        assert_eq!(upload.items.len(), 2);
        // Its answer is lost: the client repeats the last item and is answered again.
        let answer = ack(QGC.peer, PLAN, MavMissionResult::MAV_MISSION_ACCEPTED, 7);
        transfer.finish(&upload, answer.clone(), at(0.2));
        assert_eq!(transfer.item(QGC, item(1), false, at(1.0)), Progress::Answer(QGC, answer));
        assert_eq!(transfer.item(OTHER, item(1), false, at(1.0)), Progress::Nothing);
        assert_eq!(transfer.item(QGC, item(1), false, at(11.0)), Progress::Nothing);
    }

    #[test]
    fn prop_silence_is_asked_again_then_given_up() {
        let mut transfer = MissionTransfer::default();
        transfer.begin(QGC, PLAN, 0, 1, false, at(0.0));
        assert_eq!(transfer.tick(at(0.1)), Progress::Nothing);
        assert!(asks_int(&transfer.tick(at(0.26)), 0));
        // DroneKit's word, once.
        let old = transfer.tick(at(0.52));
        assert!(matches!(old, Progress::Answer(_, MavMessage::MISSION_REQUEST(_))), "{old:?}");
        assert!(asks_int(&transfer.tick(at(0.78)), 0));
        assert!(matches!(transfer.tick(at(7.6)), Progress::GivenUp(..)));
        assert_eq!(transfer.tick(at(8.0)), Progress::Nothing);
    }

    #[test]
    fn prop_the_older_request_is_kept_to_who_answered_it_and_kept_from_others() {
        let mut transfer = MissionTransfer::default();
        transfer.begin(QGC, PLAN, 0, 3, false, at(0.0));
        let next = transfer.item(QGC, item(0), true, at(0.1));
        assert!(matches!(next, Progress::Answer(_, MavMessage::MISSION_REQUEST(_))));
        transfer.begin(QGC, PLAN, 0, 3, false, at(0.0));
        transfer.item(QGC, item(0), false, at(0.1));
        for n in 1..20 {
            assert!(asks_int(&transfer.tick(at(0.1 + 0.26 * f64::from(n))), 1));
        }
    }

    /// Numerical Recipes' linear congruential generator, 0 to 1.
    struct Luck(u32);

    impl Luck {
        fn draw(&mut self) -> f64 {
            self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(self.0) / f64::from(u32::MAX)
        }
    }

    /// One packet in ten lost in either direction, some doubled: every item arrives, in order.
    #[test]
    fn prop_500_items_arrive_through_ten_percent_loss() {
        for seed in 1..6 {
            let mut luck = Luck(seed);
            let mut transfer = MissionTransfer::default();
            let (mut t, mut done) = (0.0, None);
            let mut answer = transfer.begin(QGC, PLAN, 0, 500, false, at(t));
            while done.is_none() && t < 200.0 {
                t += 0.01;
                let request = match &answer {
                    Progress::Answer(_, MavMessage::MISSION_REQUEST_INT(r)) => Some(r.seq),
                    Progress::Answer(_, MavMessage::MISSION_REQUEST(r)) => Some(r.seq),
                    Progress::GivenUp(.., why) => panic!("{why}"),
                    _ => None,
                };
                answer = Progress::Nothing;
                if let Some(seq) = request.filter(|_| luck.draw() > 0.1) {
                    for _ in 0..1 + usize::from(luck.draw() < 0.1) {
                        if luck.draw() > 0.1 {
                            match transfer.item(QGC, item(seq), false, at(t)) {
                                Progress::Complete(upload) => done = Some(upload),
                                Progress::Nothing => {}
                                next => answer = next,
                            }
                        }
                    }
                }
                if answer == Progress::Nothing {
                    answer = transfer.tick(at(t));
                }
            }
            let upload = done.expect("complete");
            assert!(upload.items.iter().map(|i| i.seq).eq(0..500), "seed {seed}, {t} s");
            assert!(t < 60.0, "seed {seed} took {t} s");
        }
    }
}
