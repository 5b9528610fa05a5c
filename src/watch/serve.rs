//! The thread "watch": takes the pilot's records out of the queue, serves pages, and feeds WebSockets.
//!
//! Connections, clients, heads and messages are bounded; whoever is slow loses messages, which are counted,
//! and whoever takes nothing for some seconds is cut off.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::time::Duration;

use futures_util::{SinkExt as _, StreamExt as _};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::broadcast;
use tokio::sync::broadcast::error::RecvError;
use tokio::task::{JoinSet, LocalSet};
use tokio::time::{Instant, MissedTickBehavior, interval, timeout};
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::protocol::{Role, WebSocketConfig};
use tokio_tungstenite::tungstenite::{Bytes, Message, Utf8Bytes};

use super::door::Door;
use super::foxglove::{self, Subscriptions};
use super::http::{self, HEAD_BYTES, Head, Request};
use super::picture::Picture;
use super::{Item, Queue};
use haltere_log::record::Decoded;

/// How often the queue is looked at.
const LOOK: Duration = Duration::from_millis(20);
/// How often a page is sent what moves, and what changes slowly. Less than twice the look, so that a busy
/// computer, where looks come late, sends with each of them.
const FRAME: Duration = Duration::from_millis(30);
const SLOW: Duration = Duration::from_millis(490);
/// Most connections at once, and most of them that are WebSockets.
const MOST_CONNECTIONS: usize = 32;
const MOST_CLIENTS: usize = 8;
/// Least time between two connections: whoever connects a thousand times a second waits in the system.
const ACCEPT_PAUSE: Duration = Duration::from_millis(2);
/// Wait after the system refused a connection: out of descriptors, most likely.
const RETRY: Duration = Duration::from_secs(1);
/// Time for a request to be complete, and for an answer to be taken.
const PATIENCE: Duration = Duration::from_secs(5);
/// Wait before a wrong token is answered.
const WRONG_TOKEN_PAUSE: Duration = Duration::from_millis(500);
/// Messages that may wait for a page: two seconds; for a viewer: one second of everything.
const PAGE_QUEUE: usize = 64;
const VIEWER_QUEUE: usize = 4096;
/// Longest message of a client, bytes.
const CLIENT_MESSAGE_BYTES: usize = 16 << 10;
/// Most messages of a client in [`RATE_PERIOD`]; beyond, it is cut off.
const MOST_MESSAGES: u32 = 100;
const RATE_PERIOD: Duration = Duration::from_secs(1);
/// Longest ping of a page that is answered, bytes.
const PING_BYTES: usize = 64;

const PAGE: &str = include_str!("page/index.html");
const STYLE: &str = include_str!("page/watch.css");
const SCRIPT: &str = include_str!("page/watch.js");

/// What is served.
pub(super) struct Served {
    pub told: Queue,
    pub door: Door,
    pub picture: Picture,
    pub lost: Arc<AtomicU64>,
    pub unix_from_host_us: i64,
    pub ends: Arc<AtomicBool>,
}

/// A message of a channel for viewers.
#[derive(Debug)]
struct Data {
    channel: u32,
    unix_ns: u64,
    payload: Vec<u8>,
}

/// What all connections share. They live on one thread.
struct Hub {
    door: Door,
    picture: RefCell<Picture>,
    /// To pages: JSON.
    pages: broadcast::Sender<Utf8Bytes>,
    /// To viewers.
    viewers: broadcast::Sender<Arc<Data>>,
    clients: RefCell<usize>,
    session: String,
}

/// Serves until the flag is set.
pub(super) async fn serve(listener: std::net::TcpListener, served: Served) {
    let Ok(listener) = TcpListener::from_std(listener) else {
        tracing::error!("watch: the port was lost");
        return;
    };
    let Served { told, door, picture, lost, unix_from_host_us, ends } = served;
    let hub = Rc::new(Hub {
        door,
        picture: RefCell::new(picture),
        pages: broadcast::channel(PAGE_QUEUE).0,
        viewers: broadcast::channel(VIEWER_QUEUE).0,
        clients: RefCell::new(0),
        session: unix_from_host_us.to_string(),
    });
    let local = LocalSet::new();
    local
        .run_until(async {
            let feeding = feed(&hub, &told, &lost, unix_from_host_us, &ends);
            tokio::select! {
                () = feeding => {}
                () = accept(&listener, &hub) => {}
            }
        })
        .await;
}

/// Takes records out of the queue and hands on what clients are to see; ends with the companion.
async fn feed(
    hub: &Hub,
    told: &Queue,
    lost: &AtomicU64,
    unix_from_host_us: i64,
    ends: &AtomicBool,
) {
    let mut look = interval(LOOK);
    look.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (mut framed, mut slowed) = (Instant::now(), Instant::now());
    while !ends.load(Relaxed) {
        look.tick().await;
        while let Some((at, item)) = told.pop() {
            let wanted = hub.viewers.receiver_count() > 0;
            let mut picture = hub.picture.borrow_mut();
            match item {
                Item::Topic(topic) => {
                    picture.topic(at, &topic);
                    if wanted {
                        publish(hub, &Decoded::from_topic(&topic), unix_from_host_us);
                    }
                }
                Item::Mission(progress) => picture.mission(progress),
                Item::Glue(glue) => {
                    picture.glue(at, glue);
                    if wanted {
                        publish(hub, &Decoded::from_glue(at, &glue), unix_from_host_us);
                    }
                }
            }
        }
        let mut picture = hub.picture.borrow_mut();
        let clients = *hub.clients.borrow();
        let watched = hub.pages.receiver_count() > 0;
        let send = |text: String| {
            // Nobody there: nobody misses it.
            let _ = hub.pages.send(text.into());
        };
        // Always taken, so that the next client is not told old news twice.
        let news = picture.news();
        if watched {
            news.into_iter().for_each(send);
            if framed.elapsed() >= FRAME {
                framed = Instant::now();
                send(picture.frame());
            }
        }
        if slowed.elapsed() >= SLOW {
            slowed = Instant::now();
            let slow = picture.slow(lost.load(Relaxed), clients);
            if watched {
                send(slow);
                picture.cuts().into_iter().for_each(send);
            }
        }
    }
}

fn publish(hub: &Hub, decoded: &Decoded, unix_from_host_us: i64) {
    let Some(channel) = foxglove::channel(decoded.channel()) else { return };
    let mut payload = Vec::new();
    decoded.encode(&mut payload);
    let unix_us = decoded.at().as_us().saturating_add_signed(unix_from_host_us);
    let _ = hub.viewers.send(Arc::new(Data {
        channel,
        unix_ns: unix_us.saturating_mul(1000),
        payload,
    }));
}

async fn accept(listener: &TcpListener, hub: &Rc<Hub>) {
    let mut connections = JoinSet::new();
    loop {
        tokio::select! {
            accepted = listener.accept() => {
                let Ok((stream, peer)) = accepted else {
                    tokio::time::sleep(RETRY).await;
                    continue;
                };
                if connections.len() >= MOST_CONNECTIONS {
                    tracing::debug!("watch: {peer} refused, {MOST_CONNECTIONS} are connected");
                } else {
                    let hub = hub.clone();
                    connections.spawn_local(async move { connection(stream, &hub).await });
                }
                tokio::time::sleep(ACCEPT_PAUSE).await;
            }
            Some(_) = connections.join_next() => {}
        }
    }
}

/// One connection, until it ends.
async fn connection(mut stream: TcpStream, hub: &Hub) {
    let _ = stream.set_nodelay(true);
    let Ok(Some((request, rest))) = timeout(PATIENCE, head(&mut stream)).await else { return };
    let Some(key) = &request.websocket_key else {
        return reply(stream, &file(&request)).await;
    };
    let refuse = |(status, why): (&str, &str)| http::answer(status, "text/plain", why, true);
    if let Err(refusal) = hub.door.admit(&request) {
        if refusal.0.starts_with("401") {
            tokio::time::sleep(WRONG_TOKEN_PAUSE).await;
        }
        return reply(stream, &refuse(refusal)).await;
    }
    let for_viewer = request.protocols.iter().any(|p| p == foxglove::PROTOCOL);
    if !for_viewer && request.path != "/live" {
        return reply(stream, &refuse(("404 Not Found", "pages connect to /live\n"))).await;
    }
    let Some(_place) = Place::take(&hub.clients) else {
        return reply(stream, &refuse(("503 Service Unavailable", "all places are taken\n"))).await;
    };
    let upgrade = http::upgrade(key, for_viewer.then_some(foxglove::PROTOCOL));
    if !matches!(timeout(PATIENCE, stream.write_all(&upgrade)).await, Ok(Ok(()))) {
        return;
    }
    let mut config = WebSocketConfig::default();
    config.max_message_size = Some(CLIENT_MESSAGE_BYTES);
    config.max_frame_size = Some(CLIENT_MESSAGE_BYTES);
    let socket =
        WebSocketStream::from_partially_read(stream, rest, Role::Server, Some(config)).await;
    if for_viewer {
        viewer(socket, hub).await;
    } else {
        page(socket, hub).await;
    }
}

/// One of the places for clients.
struct Place<'a>(&'a RefCell<usize>);

impl<'a> Place<'a> {
    fn take(taken: &'a RefCell<usize>) -> Option<Self> {
        let mut n = taken.borrow_mut();
        (*n < MOST_CLIENTS).then(|| {
            *n += 1;
            Self(taken)
        })
    }
}

impl Drop for Place<'_> {
    fn drop(&mut self) {
        *self.0.borrow_mut() -= 1;
    }
}

/// The head of a request, and what came behind it. `None`: it ended, or is none.
async fn head(stream: &mut TcpStream) -> Option<(Request, Vec<u8>)> {
    let mut bytes = Vec::new();
    let mut buffer = [0; 1024];
    loop {
        let n = stream.read(&mut buffer).await.ok()?;
        bytes.extend_from_slice(buffer.get(..n).unwrap_or_default());
        if n == 0 || bytes.len() > HEAD_BYTES {
            return None;
        }
        match http::parse(&bytes) {
            Head::Whole(request, length) => {
                return Some((*request, bytes.get(length..).unwrap_or_default().to_vec()));
            }
            Head::Partial => {}
            Head::Garbage => {
                let answer =
                    http::answer("400 Bad Request", "text/plain", "not understood\n", true);
                let _ = stream.write_all(&answer).await;
                return None;
            }
        }
    }
}

/// What a browser asks for. The page holds nothing of the flight: it needs no token.
fn file(request: &Request) -> Vec<u8> {
    let with_body = match request.method.as_str() {
        "GET" => true,
        "HEAD" => false,
        _ => return http::answer("405 Method Not Allowed", "text/plain", "GET only\n", true),
    };
    let (kind, body) = match request.path.as_str() {
        "/" | "/index.html" => ("text/html", PAGE),
        "/watch.css" => ("text/css", STYLE),
        "/watch.js" => ("text/javascript", SCRIPT),
        _ => return http::answer("404 Not Found", "text/plain", "there is only /\n", with_body),
    };
    http::answer("200 OK", kind, body, with_body)
}

async fn reply(mut stream: TcpStream, answer: &[u8]) {
    let _ = timeout(PATIENCE, async {
        stream.write_all(answer).await?;
        stream.shutdown().await
    })
    .await;
}

type Socket = WebSocketStream<TcpStream>;

/// Sends, or says that the client is to be cut off.
async fn send(socket: &mut Socket, message: Message) -> bool {
    matches!(timeout(PATIENCE, socket.send(message)).await, Ok(Ok(())))
}

/// Counts what a client says.
struct Patience {
    since: Instant,
    messages: u32,
}

impl Patience {
    fn new() -> Self {
        Self { since: Instant::now(), messages: 0 }
    }

    /// Whether it may go on.
    fn holds(&mut self) -> bool {
        if self.since.elapsed() > RATE_PERIOD {
            *self = Self::new();
        }
        self.messages += 1;
        self.messages <= MOST_MESSAGES
    }
}

/// One page.
async fn page(mut socket: Socket, hub: &Hub) {
    let mut messages = hub.pages.subscribe();
    let mut patience = Patience::new();
    let hello = || Message::from(hub.picture.borrow().hello());
    if !send(&mut socket, hello()).await {
        return;
    }
    loop {
        tokio::select! {
            message = messages.recv() => {
                let message = match message {
                    Ok(text) => Message::Text(text),
                    // It missed something: the whole picture again.
                    Err(RecvError::Lagged(_)) => hello(),
                    Err(RecvError::Closed) => return,
                };
                if !send(&mut socket, message).await {
                    return;
                }
            }
            said = socket.next() => match said {
                // Says back what it was told, by which the page measures the way.
                Some(Ok(Message::Text(text))) if text.len() <= PING_BYTES && patience.holds() => {
                    if !send(&mut socket, Message::Text(text)).await {
                        return;
                    }
                }
                // Answered by the library when something is next written.
                Some(Ok(Message::Ping(_) | Message::Pong(_))) if patience.holds() => {}
                _ => break,
            },
        }
    }
    let _ = timeout(PATIENCE, socket.close(None)).await;
}

/// One viewer.
async fn viewer(mut socket: Socket, hub: &Hub) {
    let mut messages = hub.viewers.subscribe();
    let mut wanted = Subscriptions::default();
    let mut patience = Patience::new();
    for text in [foxglove::server_info(&hub.session), foxglove::advertise()] {
        if !send(&mut socket, Message::from(text)).await {
            return;
        }
    }
    loop {
        tokio::select! {
            message = messages.recv() => {
                let message = match message {
                    Ok(data) => match wanted.frame(data.channel, data.unix_ns, &data.payload) {
                        Some(frame) => Message::Binary(Bytes::from(frame)),
                        None => continue,
                    },
                    Err(RecvError::Lagged(missed)) => Message::from(foxglove::missed(missed)),
                    Err(RecvError::Closed) => return,
                };
                if !send(&mut socket, message).await {
                    return;
                }
            }
            said = socket.next() => match said {
                Some(Ok(Message::Text(text))) if patience.holds() => {
                    if let Some(answer) = wanted.said(&text)
                        && !send(&mut socket, Message::from(answer)).await
                    {
                        return;
                    }
                }
                Some(Ok(Message::Ping(_) | Message::Pong(_))) if patience.holds() => {}
                _ => break,
            },
        }
    }
    let _ = timeout(PATIENCE, socket.close(None)).await;
}
