//! The recorder's thread: writes while there is room, leaves out and counts while there is none, and goes on where it
//! stopped. It alone asks the disk anything.

use std::io::{Seek, Write};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::Ordering::{Relaxed, SeqCst};
use std::time::{Duration, Instant, SystemTime};

use mcap::McapError;

use super::budget::tidy;
use super::channels;
use super::channels::Decoded;
use super::pb;
use super::queue::{Batch, Item, Queue, widen};
use super::room::{Limits, Room};
use super::writer::{LogWriter, RecordError};
use haltere_core::time::HostTime;
use haltere_pilot::Recording;

/// Period of flush and sync: what a power cut may cost. As often the room is looked at.
const PERSIST_PERIOD: Duration = Duration::from_secs(1);
/// After a flight it is recorded on for this long, whatever the reserve: how it ended.
const AFTER_FLIGHT: Duration = Duration::from_secs(10);

/// How often it is looked whether logs are within their budget.
const TIDY_PERIOD: Duration = Duration::from_secs(600);

/// The disk, as the thread asks it.
pub(super) struct Disk<W: Write + Seek> {
    /// The log, if it could be begun.
    pub log: Option<LogWriter<W>>,
    /// Begins one.
    pub begin: Box<dyn FnMut() -> Result<LogWriter<W>, RecordError> + Send>,
    /// How much room there is; `None`: nobody knows.
    pub room: Box<dyn FnMut() -> Option<Room> + Send>,
    /// Where.
    pub folder: PathBuf,
    pub limits: Limits,
}

impl<W: Write + Seek> Disk<W> {
    /// One log on a medium that need not leave anything free.
    pub(super) fn of(log: LogWriter<W>) -> Self {
        let folder = log.path().to_owned();
        let gone = folder.clone();
        let begin = move || {
            let reason = "it could not be begun again".to_owned();
            Err(RecordError::Write { path: gone.clone(), reason })
        };
        Self {
            log: Some(log),
            begin: Box::new(begin),
            room: Box::new(|| None),
            folder,
            limits: Limits::default(),
        }
    }

    /// How the recording stands before anything is recorded: a log is begun if there is room. Whatever keeps it from
    /// being begun keeps nobody from flying, and is tried again.
    fn open(&mut self) -> (Recording, String) {
        let room = (self.room)();
        let (state, why) = self.limits.judge(room, false, Recording::Runs, &self.folder);
        if state != Recording::Runs || self.log.is_some() {
            return (state, why);
        }
        match (self.begin)() {
            Ok(log) => {
                self.log = Some(log);
                (Recording::Runs, String::new())
            }
            Err(error) => (Recording::Stopped, error.cause()),
        }
    }
}

/// What the thread came to.
#[derive(Debug, Default)]
pub(super) struct Ended {
    pub error: Option<RecordError>,
}

/// Says so even when the thread ends by a panic.
struct Deserts<'a>(&'a Queue);

impl Drop for Deserts<'_> {
    fn drop(&mut self) {
        self.0.deserted.store(true, SeqCst);
    }
}

/// Where the log ends.
#[derive(Debug, Default)]
struct Tail {
    at: HostTime,
    sequence: u64,
    lost: u64,
}

struct Scribe<'a, W: Write + Seek> {
    disk: Disk<W>,
    queue: &'a Queue,
    tail: Tail,
    /// What is missing since the last entry of the log.
    hole: Option<pb::Hole>,
    state: Recording,
    why: String,
    /// Until then it counts as a flight.
    flight_until: Option<Instant>,
    was_armed: bool,
    tidied: Option<Instant>,
    /// What was said of the budget last: said once.
    over_told: bool,
    /// The log cannot be gone on with, whatever room there is.
    broken: Option<RecordError>,
}

/// Body of the recorder's thread. What comes while the disk takes its time with the beginning waits in the queue.
pub(super) fn write_all<W: Write + Seek>(mut disk: Disk<W>, queue: &Arc<Queue>) -> Ended {
    let _deserts = Deserts(queue);
    let (state, why) = disk.open();
    if let Some(log) = &disk.log {
        queue.file.begin(log.path());
    }
    queue.tell(state, why.clone());
    let mut scribe = Scribe {
        disk,
        queue,
        tail: Tail::default(),
        hole: None,
        state,
        why,
        flight_until: None,
        was_armed: false,
        tidied: None,
        over_told: false,
        broken: None,
    };
    let mut looked = Instant::now();
    loop {
        let wait = PERSIST_PERIOD.saturating_sub(looked.elapsed());
        let Ok(batch) = queue.take(wait) else { break };
        let armed = queue.armed.load(Relaxed);
        let due = looked.elapsed() >= PERSIST_PERIOD;
        if due || armed != scribe.was_armed {
            scribe.look(armed);
        }
        if due {
            // From its end: a look that takes a second leaves a second for what has come meanwhile.
            looked = Instant::now();
        }
        if let Some(mut batch) = batch {
            scribe.take(&batch);
            queue.waiting_B.fetch_sub(batch.size_B(), Relaxed);
            batch.clear();
            let _ = queue.empty.push(batch);
        }
        if queue.is_empty() {
            scribe.put_out();
        }
    }
    scribe.close()
}

impl<W: Write + Seek> Scribe<'_, W> {
    /// Makes permanent what there is, tries again what failed, and looks at the room.
    fn look(&mut self, armed: bool) {
        if std::mem::replace(&mut self.was_armed, armed) || armed {
            self.flight_until = Instant::now().checked_add(AFTER_FLIGHT);
        }
        let flies = armed || self.flight_until.is_some_and(|until| Instant::now() < until);
        self.persist();
        if !flies {
            self.tidy();
        }
        let Disk { limits, folder, room, .. } = &mut self.disk;
        let (mut state, mut why) = limits.judge(room(), flies, self.state, folder);
        if state == Recording::Runs && self.disk.log.is_none() && self.broken.is_none() {
            match (self.disk.begin)() {
                Ok(log) => {
                    self.queue.file.begin(log.path());
                    self.disk.log = Some(log);
                }
                Err(error) => (state, why) = (Recording::Stopped, error.cause()),
            }
        }
        if state != Recording::Stopped
            && let Some(fault) = self.fault()
        {
            (state, why) = (Recording::Stopped, fault);
        }
        self.stand(state, why);
    }

    /// Removes what the budget does not allow.
    fn tidy(&mut self) {
        let Some(budget_B) = self.disk.limits.budget_B else { return };
        if self.tidied.is_some_and(|t| t.elapsed() < TIDY_PERIOD) {
            return;
        }
        self.tidied = Some(Instant::now());
        let (folder, queue) = (&self.disk.folder, self.queue);
        let own = queue.file.path();
        let tidied = tidy(folder, budget_B, own, SystemTime::now(), || !queue.armed.load(Relaxed));
        let gb = |bytes: u64| bytes as f64 * 1e-9;
        let budget = format!("record.budget_gb = {}", gb(budget_B));
        let Ok(tidied) = tidied else { return };
        if let Some(last) = tidied.removed.last() {
            tracing::info!(
                "{budget}: removed {} logs without a flight, {:.3} GB, the last {}",
                tidied.removed.len(),
                gb(tidied.removed_B),
                last.display()
            );
        }
        if let Some((path, error)) = &tidied.failed {
            tracing::warn!("{budget}: {}: cannot be removed: {error}", path.display());
        }
        if tidied.over_B > 0 && !std::mem::replace(&mut self.over_told, true) {
            tracing::warn!(
                "{budget}: logs in {} are {:.3} GB more, and what is left holds flights, or is younger than a day; \
                 move some away",
                folder.display(),
                gb(tidied.over_B)
            );
        }
    }

    fn persist(&mut self) {
        let Some(log) = &mut self.disk.log else { return };
        if let Err(error) = log.persist() {
            self.breaks(&error);
        }
    }

    fn put_out(&mut self) {
        let Some(Err(error)) = self.disk.log.as_mut().map(LogWriter::put_out) else { return };
        self.breaks(&error);
    }

    /// Why what was written does not come to the disk.
    fn fault(&self) -> Option<String> {
        let open = self.disk.log.as_ref();
        let fault =
            open.and_then(|log| Some(format!("{}: {}", log.path().display(), log.fault()?)));
        fault.or_else(|| self.broken.as_ref().map(RecordError::cause))
    }

    /// The MCAP writer itself refuses: nothing more can come of this file.
    fn breaks(&mut self, error: &McapError) {
        if let Some(log) = self.disk.log.take() {
            self.broken = Some(log.error(error));
        }
    }

    /// Tells how it stands, if that has changed.
    fn stand(&mut self, state: Recording, why: String) {
        let changed = std::mem::replace(&mut self.state, state) != state;
        if changed || self.why.is_empty() != why.is_empty() {
            self.why = why;
            self.queue.tell(state, self.why.clone());
        }
    }

    fn take(&mut self, batch: &Batch) {
        if self.state != Recording::Runs {
            return self.leave_out(batch);
        }
        let Some(log) = &mut self.disk.log else { return self.leave_out(batch) };
        if let Some(hole) = self.hole.take() {
            self.tail.lost += hole.lost_raw + hole.lost_topics;
            self.tail.sequence = self.tail.sequence.max(hole.last_sequence);
            self.tail.at = self.tail.at.max(HostTime::from_us(hole.to_us));
            if let Err(error) = log.put(channels::HOLE, HostTime::from_us(hole.to_us), 0, &hole) {
                self.breaks(&error);
                return self.leave_out(batch);
            }
        }
        let written = write_batch(log, batch, &mut self.tail);
        self.queue.size_B.store(log.size_B(), Relaxed);
        if let Err(error) = written {
            self.breaks(&error);
            // Some of it is there; a reader takes what it finds.
            self.leave_out(batch);
        }
        if let Some(fault) = self.fault() {
            self.stand(Recording::Stopped, fault);
        }
    }

    fn leave_out(&mut self, batch: &Batch) {
        if batch.items.is_empty() && batch.hole.is_none() {
            return;
        }
        let mut hole = self.hole.take();
        if let Some(other) = &batch.hole {
            hole = Some(joined(hole, other));
        }
        let hole = widen(hole, &batch.items);
        self.hole = Some(hole);
        self.queue.unrecorded.fetch_add(batch.items.len() as u64, Relaxed);
    }

    fn close(mut self) -> Ended {
        let mut error = self.broken.take();
        if let Some(mut open) = self.disk.log.take() {
            let path = open.path().to_owned();
            let closed = self.end(&mut open).and_then(|()| open.finish());
            if let Err(why) = closed {
                error = Some(RecordError::Write { path, reason: super::writer::reason(&why) });
            }
        } else if self.state == Recording::Stopped {
            let reason = std::mem::take(&mut self.why);
            error = error.or(Some(RecordError::NotBegun { reason }));
        }
        if error.is_none() && self.state == Recording::Stopped {
            let path = self.queue.file.path().unwrap_or(&self.disk.folder).to_owned();
            error = Some(RecordError::Write { path, reason: std::mem::take(&mut self.why) });
        }
        Ended { error }
    }

    fn end(&mut self, open: &mut LogWriter<W>) -> Result<(), McapError> {
        if let Some(hole) = self.hole.take() {
            self.tail.lost += hole.lost_raw + hole.lost_topics;
            self.tail.sequence = self.tail.sequence.max(hole.last_sequence);
            self.tail.at = self.tail.at.max(HostTime::from_us(hole.to_us));
            open.put(channels::HOLE, self.tail.at, 0, &hole)?;
        }
        let closing = pb::Closing {
            host_time_us: self.tail.at.as_us(),
            last_sequence: self.tail.sequence,
            lost_entries: self.tail.lost,
        };
        open.put(channels::CLOSING, self.tail.at, 0, &closing)?;
        if self.queue.eventful.load(Relaxed) { Ok(()) } else { open.note_uneventful() }
    }
}

/// One hole out of two that follow one another.
fn joined(hole: Option<pb::Hole>, next: &pb::Hole) -> pb::Hole {
    let Some(mut hole) = hole else { return *next };
    hole.to_us = hole.to_us.max(next.to_us);
    if hole.first_sequence == 0 {
        hole.first_sequence = next.first_sequence;
    }
    hole.last_sequence = hole.last_sequence.max(next.last_sequence);
    hole.lost_raw = hole.lost_raw.saturating_add(next.lost_raw);
    hole.lost_topics = hole.lost_topics.saturating_add(next.lost_topics);
    hole
}

fn write_batch<W: std::io::Write + std::io::Seek>(
    log: &mut LogWriter<W>,
    batch: &Batch,
    last: &mut Tail,
) -> Result<(), McapError> {
    if let Some(hole) = &batch.hole {
        last.lost += hole.lost_raw + hole.lost_topics;
        last.sequence = last.sequence.max(hole.last_sequence);
        last.at = last.at.max(HostTime::from_us(hole.to_us));
        log.put(channels::HOLE, HostTime::from_us(hole.to_us), 0, hole)?;
    }
    for (at, sequence, item) in &batch.items {
        let (at, sequence, host_time_us) = (*at, *sequence, at.as_us());
        last.at = last.at.max(at);
        last.sequence = last.sequence.max(sequence);
        match item {
            Item::Bytes { out, link, start, end } => {
                let bytes = batch.bytes.get(*start..*end).unwrap_or_default();
                log.raw(*out, *link, at, sequence, bytes)?;
            }
            Item::Event { link, kind } => {
                let message = pb::LinkEvent {
                    sequence,
                    host_time_us,
                    link: u32::from(link.number()),
                    kind: (*kind).into(),
                };
                log.put(channels::EVENT, at, sequence, &message)?;
            }
            Item::Peer { link, address } => {
                let message = pb::LinkPeer {
                    sequence,
                    host_time_us,
                    link: u32::from(link.number()),
                    address: address.to_string(),
                };
                log.put(channels::PEER, at, sequence, &message)?;
            }
            Item::Lost { link, reason, count } => {
                let message = pb::Lost {
                    sequence,
                    host_time_us,
                    link: u32::from(link.number()),
                    reason: reason.name().to_owned(),
                    count: *count,
                };
                log.put(channels::LOST, at, sequence, &message)?;
            }
            Item::File { ticket, fault, start, end } => {
                let data = batch.bytes.get(*start..*end).unwrap_or_default().to_vec();
                let message = pb::FileAnswer {
                    sequence,
                    host_time_us,
                    ticket: *ticket,
                    fault: u32::from(*fault),
                    data,
                };
                log.put(channels::FILE, at, sequence, &message)?;
            }
            Item::Calendar { unix_us } => {
                let message = pb::Calendar { sequence, host_time_us, unix_us: *unix_us };
                log.put(channels::CALENDAR, at, sequence, &message)?;
            }
            Item::Recording { state, start, end } => {
                let why = batch.bytes.get(*start..*end).unwrap_or_default();
                let message = pb::RecordingState {
                    sequence,
                    host_time_us,
                    state: u32::from(state.number()),
                    why: String::from_utf8_lossy(why).into_owned(),
                };
                log.put(channels::RECORDING, at, sequence, &message)?;
            }
            Item::EndAsked => {
                let message = pb::EndAsked { sequence, host_time_us };
                log.put(channels::END_ASKED, at, sequence, &message)?;
            }
            Item::Wake => {
                log.put(channels::WAKE, at, sequence, &pb::Wake { sequence, host_time_us })?;
            }
            Item::Topic(topic) => log.decoded(&Decoded::from_topic(topic))?,
            Item::Glue(glue) => log.decoded(glue)?,
        }
    }
    Ok(())
}
