//! Live: the pilot core on a thread of its own, links, recorder, signals, and lines for people.
//!
//! ```text
//! threads of tag and board ─► bounded queue ┐
//! tokio tasks of stations   ─► bounded queue ┴► pilot's thread ─► bounded queue per link
//!                                                     ├─► recorder's thread
//!                                                     └─► thread of the watch page
//! ```

mod by_hand;
pub mod cable;
pub mod clock;
pub mod console;
mod core;
mod datagrams;
mod devices;
mod doors;
mod files;
mod frames;
mod inbox;
mod mailbox;
mod names;
mod notify;
mod packets;
mod pool;
pub mod radio;
pub mod realtime;
mod rotation;
mod seats;
mod serial;
mod shared;
pub mod signals;
mod stations;
mod stop;
mod tcp;
#[cfg(test)]
mod tests;
mod udp;
pub mod usb;
mod usb_device;

pub use by_hand::ByHand;
pub use names::apart;
pub use stop::Stop;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use haltere_dialect::mav_stream;
use serde::Serialize;
use thiserror::Error;
use tokio::net::{TcpListener, UdpSocket};
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinSet;

use self::core::{Core, CoreSummary};
use self::doors::{Gate, Keys};
use self::inbox::{Inbox, input_queues};
use self::mailbox::{Mailbox, mailbox};
use self::notify::{Progress, Systemd};
use self::pool::Pool;
use self::shared::{OUTPUT_QUEUE_CHUNKS, Shared};
use crate::sources::{KeyFileError, Loaded};
use crate::store::{NoPrograms, OwnLogs, Programs, Store};
use crate::watch::{Feed, Watch, WatchError};
use haltere_core::topics::Topic;
use haltere_log::record::{BuildIdentity, Limits, RecordError, Recorder, RecorderSummary, Session};
use haltere_pilot::settings::{Address, Config, HostPort, RadioPlace, TagPort};
use haltere_pilot::{LinkId, Look, Pilot, Quantity, TagProtocol};

/// Largest piece that goes out: a MAVLink frame with a signature, and some.
const OUT_BYTES: usize = mav_stream::MAX_FRAME + 24;
/// Pieces that links have taken and not written yet, beyond those that wait.
const SPARE_CHUNKS: usize = 256;

/// News for people that may wait to be printed.
const NEWS_QUEUE: usize = 256;

/// The core made a step. The status is what the package's scripts look at (`packaging/debian`).
const ALIVE: &str = "WATCHDOG=1\nSTATUS=disarmed";
const ALIVE_ARMED: &str = "WATCHDOG=1\nSTATUS=armed";
/// It was asked to end, and systemd waits for the landing: 10 s from now on, ten feeds.
const MORE_TIME: &str = "STOPPING=1\nEXTEND_TIMEOUT_USEC=10000000";
/// A core that has not made a step between so many feeds hangs.
const MOST_IDLE_FEEDS: u32 = 3;

/// MAVLink severity up to which a text is an error, and a warning.
const SEVERITY_ERROR: u8 = 3;
const SEVERITY_WARNING: u8 = 4;

/// Why the companion does not start, or ended.
#[derive(Debug, Error)]
pub enum LiveError {
    /// A listening link has no port.
    #[error(
        "{key} = \"{address}\": cannot listen there: {why}; name another port, or end what has this one"
    )]
    Listen {
        /// Which key.
        key: String,
        /// Its value.
        address: Address,
        /// Why.
        why: std::io::Error,
    },
    /// There can be no recorder. A log that cannot be begun keeps nobody from flying (`flight.log_required` does).
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The signing key is not used as it is.
    #[error(transparent)]
    Key(#[from] KeyFileError),
    /// The page cannot be served as it was asked for.
    #[error(transparent)]
    Watch(#[from] WatchError),
    /// Threads.
    #[error("the system refuses a thread: {0}")]
    System(#[from] std::io::Error),
    /// The pilot's thread makes no step and does not end: a defect.
    #[error("the pilot's thread hangs; the board's own failsafe is in charge")]
    PilotHangs,
    /// The pilot's thread ended by itself: a defect.
    #[error("the pilot's thread ended unexpectedly; the board's own failsafe is in charge")]
    PilotEnded,
}

/// What a run came to.
#[derive(Debug, Serialize)]
pub struct RunSummary {
    /// The log, if there is one; where there were several, the last.
    pub log: Option<PathBuf>,
    /// Those before it, which had become long.
    pub earlier_logs: Vec<PathBuf>,
    /// Why recording ended early.
    pub recording_error: Option<String>,
    /// Entries that are not in the log.
    pub lost_log_entries: u64,
    /// Wake-ups of the core.
    pub wake_ups: u64,
    /// Wake-ups more than half a control period late.
    pub late_wake_ups: u64,
    /// Largest lateness, s.
    pub worst_lateness_s: f64,
    /// Losses around the core: link number, reason, count.
    pub drops: Vec<(u8, &'static str, u64)>,
    /// What was known of the vehicle at the end, if it stood.
    #[serde(skip)]
    pub at_rest: Vec<(&'static Quantity, Look)>,
    /// It ended while the vehicle was armed: the board's own failsafe is in charge.
    pub ended_armed: bool,
}

/// A link's glue, ready to run.
enum Port {
    Serial(serial::Device, u32),
    UdpIn(UdpSocket),
    UdpOut(HostPort),
    /// A Crazyflie there, a packet a datagram.
    CrtpUdp(HostPort),
    /// By a Crazyradio.
    Radio(RadioPlace),
    /// By its cable.
    CrtpUsb,
    TcpIn(TcpListener),
    TcpOut(HostPort),
    /// No link: the tag is a deck of the board.
    Nothing,
}

/// Runs the companion until `stop` or a defect ends it.
pub fn run(loaded: &Loaded, stop: &Stop) -> Result<RunSummary, LiveError> {
    run_with(loaded, stop, Box::new(NoPrograms))
}

/// The same, with programs that a station can load by name.
pub fn run_with(
    loaded: &Loaded,
    stop: &Stop,
    programs: Box<dyn Programs>,
) -> Result<RunSummary, LiveError> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let summary = runtime.block_on(fly(loaded, stop, programs));
    runtime.shutdown_background();
    summary
}

async fn fly(
    loaded: &Loaded,
    stop: &Stop,
    programs: Box<dyn Programs>,
) -> Result<RunSummary, LiveError> {
    let keys = Keys::load(&loaded.config)?;
    let ports = open_ports(loaded).await?;
    let host_us = i64::try_from(clock::now().as_us()).unwrap_or(0);
    let watch = Watch::open(loaded, clock::unix_us().saturating_sub(host_us)).await?;

    let shared = Arc::new(Shared::default());
    let (entrance, arrivals) = input_queues();
    // By link number: the stations of one endpoint share its queue.
    let mut outputs = Vec::new();
    let mut receivers = Vec::new();
    let mut out_chunks = SPARE_CHUNKS;
    for (_, links) in &ports {
        let room = OUTPUT_QUEUE_CHUNKS * links.len().max(1);
        let (output, receiver) = mailbox(room)?;
        out_chunks += room;
        outputs.extend(links.iter().map(|_| output.clone()));
        receivers.push(receiver);
    }
    let pool = Pool::new(out_chunks, out_chunks, OUT_BYTES);
    let (news, mut read_news) = mpsc::channel(NEWS_QUEUE);
    let started = clock::now();
    let recorder = begin_recording(loaded, started)?;
    let pilot = Pilot::new(loaded.config.pilot(), loaded.survey.clone(), started);
    let own_logs = OwnLogs::default();
    own_logs.add(recorder.file());
    let (files, file_thread) = start_files(loaded, own_logs.clone(), programs, &shared)?;
    let (rotation, log_thread) = rotation::start(loaded, own_logs)?;
    let (watch, feed) = watch.map_or((None, Feed::off()), |(watch, feed)| (Some(watch), feed));
    let watch_ends = Arc::<AtomicBool>::default();
    let watch_thread = watch.map(|watch| watch.start(watch_ends.clone())).transpose()?;
    let core = Core {
        pilot,
        recorder,
        watch: feed,
        arrivals,
        outputs,
        pool,
        news,
        files,
        stop: stop.clone(),
        shared: shared.clone(),
        board_peer: None,
        rotation,
    };

    let key_file = loaded.config.signing.key_file.clone();
    let key_thread = doors::keep(keys.clone(), key_file, shared.clone())?;
    let (pilot_thread, mut ended) = start_pilot(loaded, core)?;
    let mut links = JoinSet::new();
    let mut threads: Vec<_> =
        file_thread.into_iter().chain(key_thread).chain(watch_thread).collect();
    let gates = gates(&loaded.config, &keys);
    let timing = &loaded.config.timing;
    let urgency = timing.realtime.then_some(timing.priority);
    for ((port, own_links), output) in ports.into_iter().zip(receivers) {
        let inbox = |link: LinkId| {
            let gate = gates.get(usize::from(link.number())).cloned().flatten();
            Inbox::new(link, &entrance, gate, shared.clone())
        };
        let inboxes = own_links.into_iter().map(inbox).collect();
        threads.extend(start_link(port, inboxes, output, &mut links, urgency, &shared)?);
    }
    drop(entrance);

    if attend(stop, &mut read_news, &mut ended, Progress::new(shared.clone())).await == End::Hangs {
        return Err(LiveError::PilotHangs);
    }
    let died = pilot_thread.is_finished() && !shared.stopped();
    shared.stop();
    // Off this thread, so that the links can still take what the core sends last.
    let summary = tokio::task::spawn_blocking(move || pilot_thread.join()).await;
    links.abort_all();
    watch_ends.store(true, Ordering::Relaxed);
    for thread in threads {
        // Each looks every 100 ms whether to end.
        let _ = tokio::task::spawn_blocking(move || thread.join()).await;
    }
    // The pilot's thread has let go of it: it closes what is open, and ends.
    let earlier = tokio::task::spawn_blocking(move || log_thread.join()).await;
    let earlier = earlier.ok().and_then(Result::ok).unwrap_or_default();
    match summary {
        Ok(Ok(summary)) if !died => Ok(summarise(summary, earlier, stop.is_armed())),
        _ => Err(LiveError::PilotEnded),
    }
}

/// Why nothing is attended to any more.
#[derive(Debug, PartialEq, Eq)]
enum End {
    /// The pilot's thread has ended, or must at once.
    Now,
    /// It should, and does not move.
    Hangs,
}

/// Reads aloud what is news and tells systemd how it goes, until the end.
async fn attend(
    stop: &Stop,
    news: &mut mpsc::Receiver<Topic>,
    ended: &mut oneshot::Receiver<()>,
    mut progress: Progress,
) -> End {
    let systemd = Systemd::from_environment();
    systemd.say("READY=1");
    let mut feed = tokio::time::interval(systemd.period());
    feed.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    let mut ending = false;
    let mut idle_feeds = 0;
    let end = loop {
        tokio::select! {
            _ = feed.tick() => {
                if progress.was_made() {
                    idle_feeds = 0;
                    systemd.say(if stop.is_armed() { ALIVE_ARMED } else { ALIVE });
                    systemd.say(if ending { MORE_TIME } else { "" });
                } else {
                    idle_feeds += 1;
                }
                if ending && idle_feeds > MOST_IDLE_FEEDS {
                    break End::Hangs;
                }
            }
            () = stop.changed() => {
                if stop.is_at_once() {
                    break End::Now;
                }
                ending = true;
                systemd.say(MORE_TIME);
            }
            _ = &mut *ended => break End::Now,
            Some(topic) = news.recv() => tell(&topic),
        }
    };
    systemd.say("STOPPING=1");
    end
}

/// The gates by link number. Stations of one endpoint each have their own.
fn gates(config: &Config, keys: &Arc<Keys>) -> Vec<Option<Arc<Gate>>> {
    let doors = config.doors();
    let mut gates: Vec<_> =
        [doors.tag, doors.board].map(|door| door.map(|door| Gate::new(door, keys.clone()))).into();
    for (endpoint, door) in config.ground.for_pilot().iter().zip(doors.ground) {
        for _ in 0..endpoint.stations {
            gates.push(Some(Gate::new(door.clone(), keys.clone())));
        }
    }
    gates
}

type FileThread = (files::FileDesk, Option<JoinHandle<()>>);

fn start_files(
    loaded: &Loaded,
    own_logs: OwnLogs,
    programs: Box<dyn Programs>,
    shared: &Arc<Shared>,
) -> Result<FileThread, LiveError> {
    let config = &loaded.config;
    let store = config.store.is_on().then(|| {
        let (directory, logs) = (&config.store.directory, &config.record.directory);
        let store = Store::new(directory, logs, None, programs).with_logs_to_come(own_logs);
        store.sweep();
        store
    });
    Ok(files::start(store, loaded.lost.as_deref(), shared.clone())?)
}

fn begin_recording(
    loaded: &Loaded,
    started: haltere_core::time::HostTime,
) -> Result<Recorder, LiveError> {
    let record = &loaded.config.record;
    if !record.enabled {
        tracing::warn!("record.enabled = false: this flight leaves no log");
        return Ok(Recorder::off());
    }
    let session = Session {
        build: BuildIdentity::current(),
        started_unix_us: clock::unix_us(),
        pilot_started_at: started,
        config_toml: loaded.config.to_log(&loaded.survey),
        survey: loaded.survey.clone(),
    };
    let limits =
        Limits { reserve_B: bytes(record.reserve_gb), budget_B: record.budget_gb.map(bytes) };
    let recorder = Recorder::within(limits, &record.directory, &session)?;
    // Why there is none is said by the core, to stations as well.
    if let Some(path) = recorder.path() {
        tracing::info!("recording to {}", path.display());
    }
    Ok(recorder)
}

/// Of gigabytes as people count them.
fn bytes(gb: f64) -> u64 {
    (gb * 1e9) as u64
}

/// Opens everything that can be refused, before anything runs. In the order of link numbers, with the
/// links of each.
async fn open_ports(loaded: &Loaded) -> Result<Vec<(Port, Vec<LinkId>)>, LiveError> {
    let config = &loaded.config;
    let device = match &config.tag.port {
        TagPort::Auto => serial::Device::AutoTag,
        TagPort::Device(path) => serial::Device::Path(path.clone()),
    };
    let tag = match config.tag.protocol {
        TagProtocol::Crazyflie => Port::Nothing,
        TagProtocol::LpsSniffer | TagProtocol::Mavlink => Port::Serial(device, config.tag.baud),
    };
    let mut ports = vec![(tag, vec![LinkId::Tag])];
    let board = open_port("board.address".into(), &config.board.address).await?;
    ports.push((board, vec![LinkId::Board]));
    let mut next = 0..;
    let endpoints = config.ground.for_pilot();
    for (i, (endpoint, told)) in config.ground.endpoints.iter().zip(endpoints).enumerate() {
        let port = open_port(format!("ground.endpoints[{i}]"), &endpoint.address).await?;
        let links = next.by_ref().take(usize::from(told.stations)).map(LinkId::Ground).collect();
        ports.push((port, links));
    }
    Ok(ports)
}

async fn open_port(key: String, address: &Address) -> Result<Port, LiveError> {
    let refused = |why: std::io::Error| LiveError::Listen { key, address: address.clone(), why };
    Ok(match address {
        Address::UdpIn(at) => Port::UdpIn(udp::bind(at).await.map_err(refused)?),
        Address::TcpIn(at) => Port::TcpIn(tcp::bind(at).await.map_err(refused)?),
        Address::UdpOut(to) => Port::UdpOut(to.clone()),
        Address::TcpOut(to) => Port::TcpOut(to.clone()),
        Address::CrtpUdp(to) => Port::CrtpUdp(to.clone()),
        Address::Radio(place) => Port::Radio(*place),
        Address::CrtpUsb => Port::CrtpUsb,
        Address::Serial { device, baud } => {
            Port::Serial(serial::Device::Path(device.clone()), *baud)
        }
    })
}

fn start_link(
    port: Port,
    inboxes: Vec<Inbox>,
    output: Mailbox,
    links: &mut JoinSet<()>,
    urgency: realtime::Urgency,
    shared: &Arc<Shared>,
) -> Result<Vec<JoinHandle<()>>, LiveError> {
    let Some(inbox) = inboxes.first().cloned() else { return Ok(Vec::new()) };
    let is_ground = matches!(inbox.link(), LinkId::Ground(_));
    match port {
        port if !is_ground => {
            return Ok(devices::spawn(port, inbox, output, urgency, shared.clone())?);
        }
        Port::Serial(device, baud) => {
            return Ok(serial::spawn(device, baud, inbox, output, None)?.into());
        }
        Port::UdpIn(socket) => links.spawn(stations::listen(socket, inboxes, output)),
        Port::TcpIn(listener) => links.spawn(stations::serve(listener, inboxes, output)),
        Port::UdpOut(to) => links.spawn(udp::send_to(to, inbox, output)),
        Port::TcpOut(to) => links.spawn(tcp::connect(to, inbox, output)),
        // Of the board alone.
        Port::CrtpUdp(_) | Port::Radio(_) | Port::CrtpUsb | Port::Nothing => return Ok(Vec::new()),
    };
    Ok(Vec::new())
}

type PilotThread = (JoinHandle<CoreSummary>, oneshot::Receiver<()>);

fn start_pilot(loaded: &Loaded, core: Core) -> Result<PilotThread, LiveError> {
    let timing = loaded.config.timing.clone();
    let (tell_end, ended) = oneshot::channel::<()>();
    let thread = std::thread::Builder::new().name("pilot".into()).spawn(move || {
        // Dropped when this thread ends, even by a panic.
        let _tell_end = tell_end;
        realtime::touch_stack();
        if timing.realtime {
            // Before the first deadline: logging is still allowed here.
            match realtime::insist_on_deadlines(timing.priority) {
                Ok(()) => tracing::info!("control loop under SCHED_FIFO {}", timing.priority),
                Err(why) => tracing::warn!("{why}"),
            }
        }
        core.run()
    })?;
    Ok((thread, ended))
}

fn tell(topic: &Topic) {
    match topic {
        Topic::Text(text) if text.severity <= SEVERITY_ERROR => tracing::error!("{}", text.text),
        Topic::Text(text) if text.severity <= SEVERITY_WARNING => tracing::warn!("{}", text.text),
        Topic::Text(text) => tracing::info!("{}", text.text),
        Topic::Mode(mode) => {
            let armed = if mode.armed { "armed" } else { "disarmed" };
            tracing::info!("mode {}, {armed}: {}", mode.mode, mode.cause);
        }
        _ => {}
    }
}

fn summarise(summary: CoreSummary, earlier: Vec<RecorderSummary>, ended_armed: bool) -> RunSummary {
    let CoreSummary { recording, glue, losses, at_rest } = summary;
    let lost_entries = earlier.iter().map(|log| log.lost_entries).sum::<u64>();
    let earlier_logs = earlier.iter().filter_map(|log| log.path.clone()).collect();
    let error = earlier.into_iter().find_map(|log| log.error).or(recording.error);
    RunSummary {
        log: recording.path,
        earlier_logs,
        recording_error: error.map(|error| error.to_string()),
        lost_log_entries: recording.lost_entries.saturating_add(lost_entries),
        wake_ups: glue.wake_ups,
        late_wake_ups: glue.late_wake_ups,
        worst_lateness_s: glue.worst_lateness_s,
        drops: losses
            .into_iter()
            .map(|((link, reason), count)| (link.number(), reason.name(), count))
            .collect(),
        at_rest,
        ended_armed,
    }
}
