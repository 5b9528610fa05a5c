//! The pilot's thread, its queues and its recorder without their threads and clocks: rounds are made
//! one by one, at times that are given. For measuring what a round costs.

use std::path::Path;
use std::sync::Arc;

use tokio::sync::mpsc::{Receiver, channel};

use super::core::{Core, Rounds};
use super::inbox::{Inbox, OUTPUT_QUEUE_CHUNKS, Shared, input_queues};
use super::mailbox::{Mailbox, mailbox};
use super::pool::Pool;
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
