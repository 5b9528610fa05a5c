//! TCP links: a server for many clients, or a client that reconnects.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::broadcast;
use tokio::time::Instant;

use super::clock;
use super::frames::WholeFrames;
use super::inbox::{Inbox, OUTPUT_QUEUE_CHUNKS};
use super::mailbox::{Mailbox, Outgoing, Refused};
use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_pilot::settings::HostPort;

/// Most clients of one port.
const MOST_CLIENTS: usize = 16;
/// Bytes per read.
const READ_BYTES: usize = 4096;
/// A client that takes nothing for so long is cut off: TCP would wait for minutes.
const WRITE_PATIENCE: Duration = Duration::from_secs(2);
/// Least time between two clients.
pub(super) const ACCEPT_PAUSE: Duration = Duration::from_millis(50);
/// Wait before a server is called again.
pub(super) const RETRY: Duration = Duration::from_secs(1);

/// Binds `tcpin`.
pub(super) async fn bind(at: &HostPort) -> std::io::Result<TcpListener> {
    TcpListener::bind((at.host.as_str(), at.port)).await
}

/// The next client, not before `next`: whoever connects a thousand times a second waits in the system's
/// queue, where nothing of ours has to look at it.
pub(super) async fn accept_after(
    listener: &TcpListener,
    next: Instant,
) -> std::io::Result<(TcpStream, SocketAddr)> {
    tokio::time::sleep_until(next).await;
    listener.accept().await
}

/// Serves all clients of a bound port until the output ends.
pub(super) async fn serve(listener: TcpListener, inbox: Inbox, mut output: Mailbox) {
    let (everyone, _) = broadcast::channel::<Vec<u8>>(OUTPUT_QUEUE_CHUNKS);
    let mut clients = tokio::task::JoinSet::new();
    let mut next = Instant::now();
    inbox.up();
    loop {
        tokio::select! {
            accepted = accept_after(&listener, next) => {
                next = Instant::now() + ACCEPT_PAUSE;
                let Ok((stream, peer)) = accepted else {
                    // Out of descriptors, most likely: do not spin.
                    tokio::time::sleep(RETRY).await;
                    continue;
                };
                if clients.len() >= MOST_CLIENTS {
                    tracing::warn!("{peer} refused: {MOST_CLIENTS} clients are connected");
                    continue;
                }
                tracing::info!("{peer} connected");
                let (inbox, output) = (inbox.clone(), everyone.subscribe());
                clients.spawn(async move {
                    serve_one(stream, &inbox, output).await;
                    tracing::info!("{peer} disconnected");
                });
            }
            bytes = output.recv() => {
                let Some(Outgoing { bytes, .. }) = bytes else { return };
                // Nobody connected: nobody misses it.
                let _ = everyone.send(inbox.seal(bytes).to_vec());
            }
            Some(_) = clients.join_next() => {}
        }
    }
}

async fn serve_one(stream: TcpStream, inbox: &Inbox, mut output: broadcast::Receiver<Vec<u8>>) {
    let _ = stream.set_nodelay(true);
    let (mut reader, mut writer) = stream.into_split();
    let mut frames = WholeFrames::default();
    let mut buffer = vec![0; READ_BYTES];
    loop {
        tokio::select! {
            read = reader.read(&mut buffer) => {
                let at = clock::now();
                match read {
                    Ok(0) | Err(_) => return,
                    Ok(length) => {
                        frames.push(buffer.get(..length).unwrap_or_default());
                        while let Some(bytes) = frames.next() {
                            inbox.bytes(at, &bytes);
                        }
                    }
                }
            }
            bytes = output.recv() => match bytes {
                Ok(bytes) => {
                    let write = tokio::time::timeout(WRITE_PATIENCE, writer.write_all(&bytes));
                    if !matches!(write.await, Ok(Ok(()))) {
                        inbox.lost(DropReason::LinkWriteFailed);
                        return;
                    }
                }
                Err(broadcast::error::RecvError::Lagged(n)) => {
                    for _ in 0..n {
                        inbox.lost(DropReason::OutputQueueFull);
                    }
                }
                Err(broadcast::error::RecvError::Closed) => return,
            },
        }
    }
}

/// Keeps a connection to a server until the output ends.
pub(super) async fn connect(to: HostPort, inbox: Inbox, mut output: Mailbox) {
    let mut told = false;
    loop {
        match TcpStream::connect((to.host.as_str(), to.port)).await {
            Ok(stream) => {
                tracing::info!("tcpout:{to} connected");
                told = false;
                inbox.up();
                let ended = talk(stream, &inbox, &mut output, |inbox, at, bytes| {
                    inbox.bytes(at, bytes);
                })
                .await;
                inbox.down();
                if ended {
                    return;
                }
                tracing::warn!("tcpout:{to} disconnected; calling again until it answers");
            }
            Err(error) if !told => {
                tracing::warn!("tcpout:{to}: {error}; calling again until it answers");
                told = true;
            }
            Err(_) => {}
        }
        tokio::time::sleep(RETRY).await;
        // What was due meanwhile is of no use now.
        loop {
            match output.try_take() {
                Ok(Some(_)) => inbox.lost(DropReason::LinkWriteFailed),
                Ok(None) => break,
                Err(Refused::Full | Refused::Gone) => return,
            }
        }
    }
}

/// Carries bytes until the output ends (`true`) or the connection does (`false`).
pub(super) async fn talk(
    stream: TcpStream,
    inbox: &Inbox,
    output: &mut Mailbox,
    mut take: impl FnMut(&Inbox, HostTime, &[u8]),
) -> bool {
    let _ = stream.set_nodelay(true);
    let (mut reader, mut writer) = stream.into_split();
    let mut buffer = vec![0; READ_BYTES];
    loop {
        tokio::select! {
            read = reader.read(&mut buffer) => {
                let at = clock::now();
                match read {
                    Ok(0) | Err(_) => return false,
                    Ok(length) => take(inbox, at, buffer.get(..length).unwrap_or_default()),
                }
            }
            outgoing = output.recv() => {
                let Some(Outgoing { bytes, .. }) = outgoing else { return true };
                let bytes = inbox.seal(bytes);
                let write = tokio::time::timeout(WRITE_PATIENCE, writer.write_all(&bytes));
                if !matches!(write.await, Ok(Ok(()))) {
                    inbox.lost(DropReason::LinkWriteFailed);
                    return false;
                }
            }
        }
    }
}
