//! Endpoints that stations come to: each gets a link of its own in the core.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};

use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::sync::Notify;
use tokio::task::{JoinError, JoinSet};
use tokio::time::{Duration, Instant, interval};

use super::clock;
use super::frames::WholeFrames;
use super::inbox::Inbox;
use super::mailbox::{Mailbox, Outgoing, Refused, Slot, mailbox};
use super::seats::{Places, Seat};
use super::shared::OUTPUT_QUEUE_CHUNKS;
use super::tcp::{ACCEPT_PAUSE, RETRY, accept_after, talk};
use super::udp::{DATAGRAM_BYTES, send};
use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;

/// A client that was silent for so long gives its place to a new one when all are taken, s. Longer than over UDP
/// (`seats::LEFT_S`), where who comes has shown a frame: here it has not spoken yet, and may only look at ports.
const GIVE_WAY_S: f64 = 10.0;
/// A connection that showed no signature where one is demanded is cut after this time.
const SHOW_WITHIN: Duration = Duration::from_millis(if cfg!(test) { 700 } else { 10_000 });
/// How often the silent ones are looked for.
const LOOK: Duration = Duration::from_secs(1);

/// Serves a bound `udpin` socket until the output ends; one inbox per place.
pub(super) async fn listen(socket: UdpSocket, inboxes: Vec<Inbox>, mut output: Mailbox) {
    let Some(first) = inboxes.first().cloned() else { return };
    let mut places = Places::new(inboxes.len());
    let mut buffer = vec![0; DATAGRAM_BYTES];
    let mut look = interval(LOOK);
    let mut full_told = false;
    loop {
        tokio::select! {
            // Ours first: it is never much, and a flood comes without end.
            biased;
            outgoing = output.recv() => {
                let Some(Outgoing { link, bytes, .. }) = outgoing else { return };
                let Some(n) = inboxes.iter().position(|i| i.link() == link) else { continue };
                // Somebody who left meanwhile misses nothing.
                let (Some(peer), Some(inbox)) = (places.peer(n), inboxes.get(n)) else { continue };
                if !send(&socket, &inbox.seal(bytes), peer).await {
                    inbox.lost(DropReason::LinkWriteFailed);
                }
            }
            _ = look.tick() => {
                for n in places.forget(clock::now()) {
                    if let Some(inbox) = inboxes.get(n) {
                        tracing::info!("link {} is silent, forgotten", inbox.link().number());
                        inbox.down();
                    }
                }
            }
            received = socket.recv_from(&mut buffer) => {
                let at = clock::now();
                // An error here is about an earlier datagram of ours that nobody took.
                let Ok((length, peer)) = received else { continue };
                let bytes = buffer.get(..length).unwrap_or_default();
                // Strangers without a signature do not take the place of those who have one.
                if !places.knows(peer) && !first.would_open(bytes) {
                    continue;
                }
                let seat = places.heard(peer, at, bytes);
                let n = match seat {
                    Seat::Known(n) | Seat::New(n) | Seat::Taken(n, _) => n,
                    Seat::Full => {
                        first.lost(DropReason::StationsFull);
                        if !std::mem::replace(&mut full_told, true) {
                            refused(peer, inboxes.len());
                        }
                        continue;
                    }
                };
                let Some(inbox) = inboxes.get(n) else { continue };
                if let Seat::Taken(_, before) = seat {
                    tracing::info!("link {}: {before} was silent and gives way", inbox.link().number());
                    inbox.down();
                }
                if seat != Seat::Known(n) {
                    full_told = false;
                    tracing::info!("{peer} joined as link {}", inbox.link().number());
                    inbox.up();
                }
                inbox.bytes(at, bytes);
            }
        }
    }
}

/// A client of a `tcpin` port, as its task and the port see it.
#[derive(Debug)]
struct Client {
    writer: Slot,
    life: Arc<Life>,
    peer: SocketAddr,
}

/// What a client did, and whether it must go.
#[derive(Debug)]
struct Life {
    /// It sent a frame that may pass.
    spoke: AtomicBool,
    /// When it came, then when it was last heard, µs of the host.
    heard_us: AtomicU64,
    cut: Notify,
}

impl Life {
    fn begin(at: HostTime) -> Arc<Self> {
        let heard_us = at.as_us().into();
        Arc::new(Self { spoke: AtomicBool::new(false), heard_us, cut: Notify::new() })
    }

    fn heard(&self, at: HostTime) {
        self.spoke.store(true, Relaxed);
        self.heard_us.store(at.as_us(), Relaxed);
    }

    /// Sorts those who give way: who never sent a frame first, then the longest silent. `None`: it stays.
    fn gives_way(&self, now: HostTime) -> Option<(bool, u64)> {
        let (spoke, heard_us) = (self.spoke.load(Relaxed), self.heard_us.load(Relaxed));
        let silent = now.seconds_since(HostTime::from_us(heard_us)) > GIVE_WAY_S;
        (!spoke || silent).then_some((spoke, heard_us))
    }
}

/// Cuts the client who gives way when all places are taken, and waits until its place is free.
async fn make_room(clients: &mut [Option<Client>], tasks: &mut JoinSet<usize>) {
    let now = clock::now();
    let order = |client: &Option<Client>| client.as_ref().and_then(|c| c.life.gives_way(now));
    let ways = clients.iter().enumerate().filter_map(|(n, c)| Some((order(c)?, n)));
    let Some((_, n)) = ways.min() else { return };
    if let Some(Some(client)) = clients.get(n) {
        tracing::info!("{} was silent and gives way", client.peer);
        client.life.cut.notify_one();
    }
    while clients.iter().all(Option::is_some) {
        match tasks.join_next().await {
            Some(ended) => free(clients, ended),
            None => return,
        }
    }
}

fn free(clients: &mut [Option<Client>], ended: Result<usize, JoinError>) {
    if let Ok(n) = ended
        && let Some(client) = clients.get_mut(n)
    {
        *client = None;
    }
}

/// Serves all clients of a bound `tcpin` port until the output ends; one inbox per place.
pub(super) async fn serve(listener: TcpListener, inboxes: Vec<Inbox>, mut output: Mailbox) {
    let mut clients: Vec<Option<Client>> = inboxes.iter().map(|_| None).collect();
    let mut tasks = JoinSet::new();
    let mut next = Instant::now();
    let mut full_told = false;
    loop {
        tokio::select! {
            accepted = accept_after(&listener, next) => {
                next = Instant::now() + ACCEPT_PAUSE;
                let Ok((stream, peer)) = accepted else {
                    // Out of descriptors, most likely: do not spin.
                    tokio::time::sleep(RETRY).await;
                    continue;
                };
                if clients.iter().all(Option::is_some) {
                    make_room(&mut clients, &mut tasks).await;
                }
                let place = clients.iter().position(Option::is_none);
                let Some((n, inbox)) = place.and_then(|n| Some((n, inboxes.get(n)?.clone()))) else {
                    if !std::mem::replace(&mut full_told, true) {
                        refused(peer, inboxes.len());
                    }
                    if let Some(first) = inboxes.first() {
                        first.lost(DropReason::StationsFull);
                    }
                    continue;
                };
                full_told = false;
                let Ok((writer, mut own_output)) = mailbox(OUTPUT_QUEUE_CHUNKS) else {
                    tracing::warn!("{peer} refused: no more descriptors; raise the limit (ulimit -n)");
                    inbox.lost(DropReason::StationsFull);
                    continue;
                };
                tracing::info!("{peer} connected as link {}", inbox.link().number());
                let life = Life::begin(clock::now());
                clients[n] = Some(Client { writer, life: life.clone(), peer });
                tasks.spawn(async move {
                    inbox.up();
                    serve_one(stream, &inbox, &mut own_output, &life).await;
                    inbox.down();
                    tracing::info!("{peer} disconnected");
                    n
                });
            }
            outgoing = output.recv() => {
                let Some(outgoing) = outgoing else { return };
                let Some(n) = inboxes.iter().position(|i| i.link() == outgoing.link) else { continue };
                let (Some(inbox), Some(Some(client))) = (inboxes.get(n), clients.get(n)) else {
                    continue;
                };
                if client.writer.put(outgoing) == Err(Refused::Full) {
                    inbox.lost(DropReason::OutputQueueFull);
                }
            }
            Some(ended) = tasks.join_next() => free(&mut clients, ended),
        }
    }
}

/// Said once, until somebody finds a place again.
fn refused(peer: SocketAddr, places: usize) {
    tracing::warn!(
        "{peer} refused: all {places} places of this endpoint are taken by stations that speak; end one, \
         or add an endpoint (ground.endpoints)"
    );
}

/// One client, until it leaves. Where signatures are demanded it must have shown one in time: places
/// are few, and holding one costs nothing.
async fn serve_one(stream: TcpStream, inbox: &Inbox, output: &mut Mailbox, life: &Life) {
    let mut frames = WholeFrames::default();
    let must_show = inbox.is_shut();
    let talks = talk(stream, inbox, output, |inbox, at, bytes| {
        frames.push(bytes);
        while let Some(frame) = frames.next() {
            if inbox.bytes(at, &frame) {
                life.heard(at);
            }
        }
    });
    let stays_mute = async {
        tokio::time::sleep(SHOW_WITHIN).await;
        if !must_show || life.spoke.load(Relaxed) {
            std::future::pending::<()>().await;
        }
    };
    tokio::select! {
        _ = talks => {}
        () = life.cut.notified() => {}
        () = stays_mute => {
            inbox.lost(DropReason::MavUnsigned);
            tracing::info!("link {} showed no signature", inbox.link().number());
        }
    }
}
