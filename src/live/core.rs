//! The pilot's thread: sleeps to the deadline, feeds the core, sends and records what it yields.
//!
//! It never waits for anything but the deadline, and never logs: what people should read goes
//! through a queue to another thread.

use std::collections::BTreeMap;
use std::sync::Arc;

use tokio::sync::mpsc::Sender;
use tokio::sync::mpsc::error::TrySendError;

use super::clock;
use super::files::FileDesk;
use super::inbox::{Arrival, Arrivals, Outgoing, Shared, What};
use crate::drops::DropReason;
use crate::pilot::{Input, LinkId, Pilot};
use crate::record::{GlueState, Recorder, RecorderSummary};
use crate::time::HostTime;
use crate::topics::Topic;
use crate::watch::Feed;

/// Longest sleep: how soon the end of the program is noticed, µs.
const LONGEST_SLEEP_US: i64 = 50_000;

/// Most chunks of tag and board taken in at one wake-up, and of stations, which come second: a flood
/// must not keep the core from its deadline.
const MOST_FROM_DEVICES: usize = 1024;
const MOST_FROM_STATIONS: usize = 256;
/// Stations wait for the next wake-up when they have taken so much time of this one, s: a fifth of the
/// period of the control step.
const STATIONS_S: f64 = 0.002;

/// Most answers of the disk taken in at one wake-up: each may hold 16 kB.
const MOST_FILE_ANSWERS: usize = 16;

/// Lateness that counts, s: half a period of the 100 Hz control step.
const LATE_S: f64 = 0.005;

/// Period of the glue's own record, µs.
const GLUE_PERIOD_US: i64 = 1_000_000;

/// Period in which the core is told the calendar, which may be set while it runs, µs.
const CALENDAR_PERIOD_US: i64 = 60_000_000;

/// What the thread needs.
pub(super) struct Core {
    pub pilot: Pilot,
    pub recorder: Recorder,
    pub watch: Feed,
    pub arrivals: Arrivals,
    /// By link number.
    pub outputs: Vec<Sender<Outgoing>>,
    /// What people should read.
    pub news: Sender<Topic>,
    pub files: FileDesk,
    pub shared: Arc<Shared>,
}

/// What the flight came to, seen from the glue.
#[derive(Debug)]
pub(super) struct CoreSummary {
    pub recording: RecorderSummary,
    pub glue: GlueState,
    pub losses: Losses,
}

/// Losses of which the core knows.
type Losses = BTreeMap<(LinkId, DropReason), u64>;

impl Core {
    /// Runs until asked to stop, then closes the log.
    pub(super) fn run(mut self) -> CoreSummary {
        let mut glue = GlueState::default();
        let mut losses = Losses::new();
        let mut glue_due = clock::now().offset_us(GLUE_PERIOD_US);
        let mut calendar_due = clock::now();
        while !self.shared.stopped() {
            let deadline = self.pilot.next_deadline();
            clock::sleep_until(deadline.min(clock::now().offset_us(LONGEST_SLEEP_US)));
            self.take_arrivals();
            self.take_file_answers();
            self.report_losses(&mut losses);

            let now = clock::now();
            if now >= calendar_due {
                calendar_due = now.offset_us(CALENDAR_PERIOD_US);
                self.feed(now, Input::Calendar { unix_us: clock::unix_us() });
            }
            let lateness_s = now.seconds_since(deadline);
            glue.wake_ups += 1;
            glue.late_wake_ups += u64::from(lateness_s > LATE_S);
            glue.worst_lateness_s = glue.worst_lateness_s.max(lateness_s);
            self.feed(now, Input::Wake);
            self.send_outputs(now);
            self.hand_out_tasks();
            self.publish_topics(now);

            if now >= glue_due {
                glue_due = now.offset_us(GLUE_PERIOD_US);
                self.recorder.glue(now, &glue);
                self.watch.glue(now, &glue);
            }
            self.recorder.commit(now);
            self.shared.step();
        }
        self.report_losses(&mut losses);
        self.recorder.glue(clock::now(), &glue);
        CoreSummary { recording: self.recorder.finish(), glue, losses }
    }

    fn take_arrivals(&mut self) {
        for _ in 0..MOST_FROM_DEVICES {
            let Ok(arrival) = self.arrivals.devices.try_recv() else { break };
            self.take(arrival);
        }
        let began = clock::now();
        for _ in 0..MOST_FROM_STATIONS {
            let Ok(arrival) = self.arrivals.stations.try_recv() else { return };
            self.take(arrival);
            if clock::now().seconds_since(began) > STATIONS_S {
                return;
            }
        }
    }

    fn take(&mut self, Arrival { at, link, what }: Arrival) {
        match what {
            What::Bytes(bytes, _share) => self.feed(at, Input::Bytes { link, bytes: &bytes }),
            What::Up => self.feed(at, Input::LinkUp { link }),
            What::Down => self.feed(at, Input::LinkDown { link }),
        }
    }

    fn take_file_answers(&mut self) {
        for _ in 0..MOST_FILE_ANSWERS {
            let Some((ticket, answer)) = self.files.answer() else { return };
            let (result, bytes) = match answer {
                Ok(bytes) => (Ok(()), bytes),
                Err((fault, why)) => (Err(fault), why),
            };
            self.feed(clock::now(), Input::File { ticket, result, bytes: &bytes });
        }
    }

    fn hand_out_tasks(&mut self) {
        let Self { pilot, files, .. } = self;
        pilot.drain_file_requests(|request| files.submit(request));
    }

    /// The only way into the core: what it lives through is what is recorded.
    fn feed(&mut self, at: HostTime, input: Input<'_>) {
        self.recorder.input(at, input);
        self.pilot.handle(at, input);
    }

    fn send_outputs(&mut self, now: HostTime) {
        let Self { pilot, recorder, outputs, shared, .. } = self;
        pilot.drain_output(|link, bytes| {
            recorder.output(now, link, bytes);
            let Some(output) = outputs.get(usize::from(link.number())) else { return };
            match output.try_send(Outgoing { link, bytes: bytes.to_vec() }) {
                Ok(()) => {}
                Err(TrySendError::Full(_)) => shared.lost(link, DropReason::OutputQueueFull),
                Err(TrySendError::Closed(_)) => shared.lost(link, DropReason::LinkWriteFailed),
            }
        });
    }

    fn publish_topics(&mut self, now: HostTime) {
        let Self { pilot, recorder, news, watch, .. } = self;
        pilot.drain_topics(|topic| {
            if matches!(topic, Topic::Text(_) | Topic::Mode(_)) {
                // Only for reading along; the log has it all.
                let _ = news.try_send(topic.clone());
            }
            watch.topic(now, &topic);
            recorder.topic(now, topic);
        });
    }

    /// Tells the core what was lost since it was last told. Losses of recorder and watch page
    /// belong to no link; they stand with the tag's.
    fn report_losses(&mut self, told: &mut Losses) {
        let recorder = (LinkId::Tag, DropReason::RecorderQueueFull, self.recorder.lost());
        let watch = (LinkId::Tag, DropReason::WatchQueueFull, self.watch.lost());
        let shared = self.shared.clone();
        for (link, reason, total) in shared.losses().chain([recorder, watch]) {
            let before = told.get(&(link, reason)).copied().unwrap_or(0);
            if total > before {
                told.insert((link, reason), total);
                self.feed(clock::now(), Input::Lost { link, reason, count: total - before });
            }
        }
    }
}
