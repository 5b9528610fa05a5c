//! The pilot's thread, its queues and its recorder without their threads and clocks: rounds are made
//! one by one, at times that are given. For measuring what a round costs.

use std::path::Path;
use std::sync::Arc;

use tokio::sync::mpsc::{Receiver, channel};

use super::core::{Core, Rounds};
use super::inbox::{Inbox, input_queues};
use super::mailbox::{Mailbox, mailbox};
use super::pool::Pool;
use super::shared::{OUTPUT_QUEUE_CHUNKS, Shared};
use super::{LiveError, NEWS_QUEUE, OUT_BYTES, SPARE_CHUNKS, Stop, files};
use crate::watch::Feed;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;
use haltere_log::record::{BuildIdentity, Recorder, Session};
use haltere_pilot::{LinkId, Mode, Pilot, PilotConfig};

/// A live core whose rounds somebody else makes.
pub struct ByHand {
    core: Core,
    rounds: Rounds,
    inboxes: Vec<Inbox>,
    boxes: Vec<Mailbox>,
    news: Receiver<Topic>,
}

impl ByHand {
    /// At rest at `began`; its log goes to `logs`.
    ///
    /// # Errors
    /// When the log cannot be begun.
    pub fn new(
        config: PilotConfig,
        survey: &Survey,
        began: HostTime,
        logs: &Path,
    ) -> Result<Self, LiveError> {
        let session = Session {
            build: BuildIdentity::current(),
            started_unix_us: 0,
            pilot_started_at: began,
            config_toml: String::new(),
            survey: survey.clone(),
        };
        let shared = Arc::new(Shared::default());
        let (entrance, arrivals) = input_queues();
        let links = 2 + config.ground_links().count();
        let mut outputs = Vec::new();
        let mut boxes = Vec::new();
        for _ in 0..links {
            let (slot, mailbox) = mailbox(OUTPUT_QUEUE_CHUNKS)?;
            outputs.push(slot);
            boxes.push(mailbox);
        }
        let ready = SPARE_CHUNKS + links * OUTPUT_QUEUE_CHUNKS;
        let (tell, news) = channel(NEWS_QUEUE);
        let (files, _) = files::start(None, None, shared.clone())?;
        let inbox = |n| {
            let link = LinkId::from_number(u8::try_from(n).unwrap_or(u8::MAX));
            Inbox::new(link, &entrance, None, shared.clone())
        };
        let inboxes = (0..links).map(inbox).collect();
        let core = Core {
            board_peer: None,
            rotation: super::rotation::Rotation::never(),
            pilot: Pilot::new(config, survey.clone(), began),
            recorder: Recorder::start(logs, &session)?,
            watch: Feed::unserved(),
            arrivals,
            outputs,
            pool: Pool::new(ready, ready, OUT_BYTES),
            news: tell,
            files,
            stop: Stop::default(),
            shared,
        };
        Ok(Self { core, rounds: Rounds::beginning(began), inboxes, boxes, news })
    }

    /// Bytes came over a link. `false`: there is no such link.
    pub fn bytes(&self, at: HostTime, link: LinkId, bytes: &[u8]) -> bool {
        let inbox = self.inboxes.get(usize::from(link.number()));
        inbox.is_some_and(|inbox| inbox.bytes(at, bytes))
    }

    /// A link opened, at the time of the clock.
    pub fn up(&self, link: LinkId) {
        if let Some(inbox) = self.inboxes.get(usize::from(link.number())) {
            inbox.up();
        }
    }

    /// One round of the pilot's thread at this time.
    pub fn round(&mut self, at: HostTime) {
        let deadline = self.core.pilot.next_deadline();
        self.core.round(&mut self.rounds, deadline, || at);
    }

    /// What the other threads do between two rounds: links take what was sent, the recorder writes.
    /// Number of things that people were told.
    pub fn rest(&mut self) -> usize {
        self.core.recorder.settle();
        self.core.watch.forget();
        for mailbox in &mut self.boxes {
            while let Ok(Some(_)) = mailbox.try_take() {}
        }
        std::iter::from_fn(|| self.news.try_recv().ok()).count()
    }

    /// The mode in force.
    pub fn mode(&self) -> Mode {
        self.core.pilot.mode()
    }

    /// Pieces and entries that were lost around the core.
    pub fn losses(&self) -> u64 {
        self.core.shared.losses().map(|(.., n)| n).sum::<u64>()
            + self.core.recorder.lost()
            + self.core.watch.lost()
    }
}

#[cfg(test)]
mod tests {
    use haltere_dialect::mav::haltere::{MavMessage, PARAM_REQUEST_LIST_DATA};
    use haltere_dialect::mav_stream;

    use super::*;

    /// PARAM_VALUE as its frame says it: the message id's three bytes.
    const PARAM_VALUE_ID: [u8; 3] = [22, 0, 0];

    /// The fault: 24 values were put in a step whether they left or not, and of a list that was asked for beside a computer
    /// at work only the first two or three steps' arrived. The link's thread is heard here five times a second.
    #[test]
    fn regress_a_list_waits_for_a_link_that_does_not_get_rid_of_it() {
        let folder = tempfile::tempdir().unwrap();
        let anchors = concat!(env!("CARGO_MANIFEST_DIR"), "/config/anchors.toml");
        let survey = crate::sources::read_anchors(anchors.as_ref()).unwrap();
        let began = HostTime::from_us(1_000_000);
        let mut flight =
            ByHand::new(PilotConfig::default(), &survey, began, folder.path()).unwrap();
        let station = LinkId::Ground(0);
        flight.up(station);
        let mut ask = Vec::new();
        let list = PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 1 };
        mav_stream::encode(&mut ask, 255, 190, 0, &MavMessage::PARAM_REQUEST_LIST(list));
        let mut arrived = std::collections::BTreeSet::new();
        let mut count = usize::MAX;
        for step in 0..400 {
            let at = began.offset_us(10_000 * step);
            if step == 5 {
                flight.bytes(at, station, &ask);
            }
            flight.round(at);
            if step % 20 == 19 {
                while let Ok(Some(piece)) = flight.boxes[usize::from(station.number())].try_take() {
                    if piece.bytes.get(7..10) == Some(&PARAM_VALUE_ID) {
                        // Payload: value, then how many there are and which it is.
                        count = usize::from(u16::from_le_bytes([piece.bytes[14], piece.bytes[15]]));
                        arrived.insert([piece.bytes[16], piece.bytes[17]]);
                    }
                }
                flight.rest();
            }
        }
        assert_eq!((arrived.len(), flight.losses()), (count, 0));
    }
}
