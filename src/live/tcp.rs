//! TCP links: a server for many clients, or a client that reconnects.

use std::net::SocketAddr;
use std::time::Duration;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::broadcast;
use tokio::time::Instant;

use super::clock;
use super::frames::WholeFrames;
use super::inbox::Inbox;
use super::mailbox::{Mailbox, Outgoing, Refused};
use super::shared::OUTPUT_QUEUE_CHUNKS;
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

/// Bytes, and which of the clients is meant; `None`: all of them.
type ForOne = (Option<SocketAddr>, Vec<u8>);

/// Serves all clients of a bound port until the output ends. Whose bytes come is told: of two boards the core
/// hears one, and speaks to that one.
pub(super) async fn serve(listener: TcpListener, inbox: Inbox, mut output: Mailbox) {
    let (everyone, _) = broadcast::channel::<ForOne>(OUTPUT_QUEUE_CHUNKS);
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
                    serve_one(stream, peer, &inbox, output).await;
                    tracing::info!("{peer} disconnected");
                });
            }
            bytes = output.recv() => {
                let Some(Outgoing { bytes, to, .. }) = bytes else { return };
                // Nobody connected: nobody misses it.
                let _ = everyone.send((to, inbox.seal(bytes).to_vec()));
            }
            Some(_) = clients.join_next() => {}
        }
    }
}

async fn serve_one(
    stream: TcpStream,
    peer: SocketAddr,
    inbox: &Inbox,
    mut output: broadcast::Receiver<ForOne>,
) {
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
                            inbox.bytes_from(at, Some(peer), &bytes);
                        }
                    }
                }
            }
            bytes = output.recv() => match bytes {
                Ok((Some(to), _)) if to != peer => {}
                Ok((_, bytes)) => {
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

#[cfg(test)]
mod tests {
    use std::io::{Read as _, Write as _};
    use std::sync::Arc;

    use haltere_dialect::mav::haltere::{HEARTBEAT_DATA, MavMessage};
    use haltere_dialect::mav_stream;

    use super::super::inbox::{What, input_queues};
    use super::super::mailbox::mailbox;
    use super::super::pool::Pool;
    use super::super::shared::Shared;
    use super::*;
    use haltere_pilot::LinkId;

    #[test]
    fn regress_two_boards_on_one_port_are_told_apart_and_one_is_spoken_to() {
        let (entrance, arrivals) = input_queues();
        let inbox = Inbox::new(LinkId::Board, &entrance, None, Arc::new(Shared::default()));
        let (output, receiver) = mailbox(OUTPUT_QUEUE_CHUNKS).unwrap();
        let pool = Pool::new(8, 8, 64);
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap();
        listener.set_nonblocking(true).unwrap();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let serving = std::thread::spawn(move || {
            runtime.block_on(async {
                serve(TcpListener::from_std(listener).unwrap(), inbox, receiver).await;
            });
        });
        let mut frame = Vec::new();
        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        mav_stream::encode(&mut frame, 1, 1, 0, &message);
        let mut boards = [(); 2].map(|()| std::net::TcpStream::connect(port).unwrap());
        for board in &mut boards {
            let patience = Duration::from_secs(5);
            board.set_read_timeout(Some(patience)).unwrap();
            board.write_all(&frame).unwrap();
            let from = std::iter::repeat_with(|| arrivals.devices.recv_timeout(patience))
                .find_map(|a| {
                    a.map(|a| matches!(a.what, What::Bytes(..)).then_some(a.from)).unwrap()
                })
                .unwrap();
            assert_eq!(from, Some(board.local_addr().unwrap()), "whose bytes they are");
        }
        let to = Some(boards[1].local_addr().unwrap());
        for (to, bytes) in [(to, b"one"), (None, b"all")] {
            let waits = super::super::shared::Waits::new(&Default::default(), LinkId::Board);
            let bytes = pool.lend(bytes).unwrap();
            let outgoing = Outgoing { link: LinkId::Board, to, bytes, _waits: waits };
            assert!(output.put(outgoing).is_ok());
        }
        let mut first = [0; 3];
        boards[0].read_exact(&mut first).unwrap();
        assert_eq!(&first, b"all");
        let mut second = [0; 6];
        boards[1].read_exact(&mut second).unwrap();
        assert_eq!(&second, b"oneall");
        drop(output);
        serving.join().unwrap();
    }
}
