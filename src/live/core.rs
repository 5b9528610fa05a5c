//! The pilot's thread: sleeps to the deadline, feeds the core, sends and records what it yields.
//!
//! It never waits for anything but the deadline, and never logs: what people should read goes
//! through a queue to another thread.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;

use tokio::sync::mpsc::Sender;

use super::clock;
use super::console;
use super::files::FileDesk;
use super::inbox::{Arrival, Arrivals, What};
use super::mailbox::{Outgoing, Refused, Slot};
use super::pool::Pool;
use super::rotation::{Pair, Rotation};
use super::shared::{MOST_LINKS, Shared, Waits};
use super::stop::Stop;
use crate::watch::Feed;
use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;
use haltere_log::record::{GlueState, Recorder, RecorderSummary};
use haltere_pilot::{Input, LinkId, Look, Mode, Pilot, Quantity};

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
    pub outputs: Vec<Slot>,
    /// Buffers for what goes out.
    pub pool: Pool,
    /// What people should read.
    pub news: Sender<Topic>,
    pub files: FileDesk,
    pub stop: Stop,
    pub shared: Arc<Shared>,
    /// Who spoke last on the board's link, if that has many ends.
    pub board_peer: Option<SocketAddr>,
    pub rotation: Rotation,
}

/// What the flight came to, seen from the glue.
#[derive(Debug)]
pub(super) struct CoreSummary {
    pub recording: RecorderSummary,
    pub glue: GlueState,
    pub losses: Losses,
    /// What was known of the vehicle at the end, if it stood: name, what it came to, and what to do.
    pub at_rest: Vec<(&'static Quantity, Look)>,
}

/// What the thread carries from one wake-up to the next.
#[derive(Debug)]
pub(super) struct Rounds {
    glue: GlueState,
    losses: Losses,
    glue_due: HostTime,
    calendar_due: HostTime,
    end_asked: bool,
    /// Links that are open, by number.
    up: [bool; MOST_LINKS],
    /// Links of which the core was told that more waits for them than they take.
    full: [bool; MOST_LINKS],
    /// Of logs that were closed: entries that found no room, and that were left out.
    lost_before: [u64; 2],
}

impl Rounds {
    pub(super) fn beginning(now: HostTime) -> Self {
        Self {
            glue: GlueState::default(),
            losses: Losses::new(),
            glue_due: now.offset_us(GLUE_PERIOD_US),
            calendar_due: now,
            end_asked: false,
            up: [false; MOST_LINKS],
            full: [false; MOST_LINKS],
            lost_before: [0; 2],
        }
    }

    fn late(&mut self, lateness_s: f64) {
        self.glue.wake_ups += 1;
        self.glue.late_wake_ups += u64::from(lateness_s > LATE_S);
        self.glue.worst_lateness_s = self.glue.worst_lateness_s.max(lateness_s);
    }
}

/// Losses of which the core knows.
type Losses = BTreeMap<(LinkId, DropReason), u64>;

impl Core {
    /// Runs until the core has ended what it was asked to end, or must stop at once; then closes the log.
    pub(super) fn run(mut self) -> CoreSummary {
        let mut rounds = Rounds::beginning(clock::now());
        while !self.shared.stopped() && !self.pilot.may_end() {
            let deadline = self.pilot.next_deadline();
            clock::sleep_until(deadline.min(clock::now().offset_us(LONGEST_SLEEP_US)));
            self.round(&mut rounds, deadline, clock::now);
        }
        self.shared.stop();
        self.report_losses(&mut rounds);
        self.recorder.glue(clock::now(), &rounds.glue);
        let Rounds { glue, losses, .. } = rounds;
        let stands = self.pilot.mode() == Mode::Disarmed;
        let at_rest = if stands { self.pilot.at_rest(clock::now()).collect() } else { Vec::new() };
        CoreSummary { recording: self.recorder.finish(), glue, losses, at_rest }
    }

    /// What is done at a wake-up: takes what has come, lets the core work, hands on what it yields.
    /// In steady flight it neither allocates nor takes a lock (`tests/allocation.rs`).
    pub(super) fn round(
        &mut self,
        rounds: &mut Rounds,
        deadline: HostTime,
        now: impl Fn() -> HostTime,
    ) {
        self.take_arrivals(rounds);
        self.take_file_answers();
        self.report_losses(rounds);
        self.report_recording();

        let now = now();
        if self.stop.is_asked() && !std::mem::replace(&mut rounds.end_asked, true) {
            self.feed(now, Input::EndAsked);
        }
        if now >= rounds.calendar_due {
            rounds.calendar_due = now.offset_us(CALENDAR_PERIOD_US);
            self.feed(now, Input::Calendar { unix_us: clock::unix_us() });
        }
        self.report_backlogs(now, rounds);
        rounds.late(now.seconds_since(deadline));
        self.feed(now, Input::Wake);
        self.send_outputs(now);
        self.hand_out_tasks();
        self.publish_topics(now);

        if now >= rounds.glue_due {
            rounds.glue_due = now.offset_us(GLUE_PERIOD_US);
            self.recorder.glue(now, &rounds.glue);
            self.watch.glue(now, &rounds.glue);
            self.watch.mission(now, self.pilot.mission_progress());
            if self.rotation.is_due(self.recorder.size_B(), now) && self.may_begin_anew(rounds) {
                self.rotation.ask(self.pilot.settings());
            }
        }
        if let Some(next) = self.rotation.next(now) {
            self.hand_over(now, rounds, next);
        }
        self.recorder.commit(now);
        let armed = self.pilot.mode() != Mode::Disarmed;
        self.recorder.set_armed(armed);
        if self.pilot.was_sent_a_mission() {
            self.recorder.set_eventful();
        }
        self.stop.set_armed(armed);
        self.shared.step();
    }

    /// Whether another core may go on from here with a log of its own.
    fn may_begin_anew(&self, rounds: &Rounds) -> bool {
        !rounds.end_asked && self.files.is_idle() && self.pilot.may_begin_anew()
    }

    /// Another core takes over, and its log begins. It is told what this one knew from outside: which links are open;
    /// who speaks for the board, the calendar and how the recording stands come as for the first time.
    fn hand_over(&mut self, now: HostTime, rounds: &mut Rounds, next: Box<Pair>) {
        if !self.may_begin_anew(rounds) {
            return self.rotation.forget(next, now);
        }
        self.report_losses(rounds);
        self.recorder.glue(now, &rounds.glue);
        let Pair { pilot, recorder } = *next;
        let [queue_full, left_out] = &mut rounds.lost_before;
        *queue_full = queue_full.saturating_add(self.recorder.lost());
        *left_out = left_out.saturating_add(self.recorder.unrecorded());
        let pilot = std::mem::replace(&mut self.pilot, pilot);
        let recorder = std::mem::replace(&mut self.recorder, recorder);
        self.rotation.close(Box::new(Pair { pilot, recorder }));
        self.board_peer = None;
        rounds.calendar_due = now;
        rounds.full = [false; MOST_LINKS];
        for number in (0..).zip(rounds.up).filter_map(|(number, is_up)| is_up.then_some(number)) {
            self.feed(now, Input::LinkUp { link: LinkId::from_number(number) });
        }
    }

    fn take_arrivals(&mut self, rounds: &mut Rounds) {
        for _ in 0..MOST_FROM_DEVICES {
            let Ok(arrival) = self.arrivals.devices.try_recv() else { break };
            self.take(arrival, rounds);
        }
        let began = clock::now();
        for _ in 0..MOST_FROM_STATIONS {
            let Ok(arrival) = self.arrivals.stations.try_recv() else { return };
            self.take(arrival, rounds);
            if clock::now().seconds_since(began) > STATIONS_S {
                return;
            }
        }
    }

    fn take(&mut self, arrival: Arrival, rounds: &mut Rounds) {
        let Arrival { from, at, link, what } = arrival;
        let number = usize::from(link.number());
        if let (Some(is_up), Some(is_full)) =
            (rounds.up.get_mut(number), rounds.full.get_mut(number))
            && !matches!(what, What::Bytes(..))
        {
            *is_up = matches!(what, What::Up);
            // The core begins anew with it.
            *is_full = false;
        }
        if let Some(address) = from
            && self.board_peer.replace(address) != Some(address)
        {
            self.feed(at, Input::Peer { link, address });
        }
        match what {
            What::Bytes(bytes, _share) => self.feed(at, Input::Bytes { link, bytes: &bytes }),
            What::Up => self.feed(at, Input::LinkUp { link }),
            What::Down => self.feed(at, Input::LinkDown { link }),
        }
    }

    /// Tells the core of which links more waits than they take, when that has changed.
    fn report_backlogs(&mut self, now: HostTime, rounds: &mut Rounds) {
        for (number, (told, is_up)) in (0..).zip(rounds.full.iter_mut().zip(rounds.up)) {
            let link = LinkId::from_number(number);
            let is_full = is_up && matches!(link, LinkId::Ground(_)) && self.shared.is_full(link);
            if std::mem::replace(told, is_full) != is_full {
                self.feed(now, Input::Backlog { link, is_full });
            }
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
        let Self { pilot, recorder, outputs, pool, shared, .. } = self;
        let board = pilot.board_address();
        pilot.drain_output(|link, bytes| {
            recorder.output(now, link, bytes);
            let Some(output) = outputs.get(usize::from(link.number())) else { return };
            let piece = pool.lend(bytes).ok_or(Refused::Full);
            let to = board.filter(|_| link == LinkId::Board);
            let waits = Waits::new(shared, link);
            let outgoing = piece.map(|bytes| Outgoing { link, to, bytes, _waits: waits });
            match outgoing.and_then(|outgoing| output.put(outgoing)) {
                Ok(()) => {}
                Err(Refused::Full) => shared.lost(link, DropReason::OutputQueueFull),
                Err(Refused::Gone) => shared.lost(link, DropReason::LinkWriteFailed),
            }
        });
    }

    fn publish_topics(&mut self, now: HostTime) {
        let Self { pilot, recorder, news, watch, .. } = self;
        pilot.drain_topics(|topic| {
            if matches!(topic, Topic::Text(_) | Topic::Mode(_)) {
                // Only for reading along; the log has it all.
                if news.try_send(topic.clone()).is_err() {
                    console::lose_line();
                }
            }
            watch.topic(now, &topic);
            recorder.topic(now, topic);
        });
    }

    /// Tells the core how the recording stands, when that has changed.
    fn report_recording(&mut self) {
        if let Some((state, why)) = self.recorder.news() {
            self.feed(clock::now(), Input::Recording { state, why: &why });
        }
    }

    /// Tells the core what was lost since it was last told. Losses of recorder, watch page and lines for
    /// people belong to no link; they stand with the tag's.
    fn report_losses(&mut self, rounds: &mut Rounds) {
        let Rounds { losses: told, lost_before: [queue_full, left_out], .. } = rounds;
        let queue_full = queue_full.saturating_add(self.recorder.lost());
        let left_out = left_out.saturating_add(self.recorder.unrecorded());
        let recorder = (LinkId::Tag, DropReason::RecorderQueueFull, queue_full);
        let watch = (LinkId::Tag, DropReason::WatchQueueFull, self.watch.lost());
        let unrecorded = (LinkId::Tag, DropReason::RecordingStopped, left_out);
        let lines = (LinkId::Tag, DropReason::OutputLineLost, console::lost_lines());
        let shared = self.shared.clone();
        for (link, reason, total) in shared.losses().chain([recorder, unrecorded, watch, lines]) {
            let before = told.get(&(link, reason)).copied().unwrap_or(0);
            if total > before {
                told.insert((link, reason), total);
                self.feed(clock::now(), Input::Lost { link, reason, count: total - before });
            }
        }
    }
}
