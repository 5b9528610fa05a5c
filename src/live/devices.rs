//! Tag and board on threads of their own: whatever stations send, the socket over which setpoints go
//! does not wait behind theirs.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use tokio::net::{TcpListener, UdpSocket};

use super::inbox::{Inbox, Shared};
use super::mailbox::Mailbox;
use super::{Port, realtime, tcp, udp};

/// How often it is looked whether to end.
const LOOK: Duration = Duration::from_millis(100);

/// Priority of the threads that carry bytes of tag and board: below the control thread, above everything
/// that stations can keep busy. `None` where SCHED_FIFO is not wanted.
pub(super) type Urgency = Option<u8>;

/// Puts the calling thread there. The control thread has told people if the system does not permit it.
pub(super) fn hurry(urgency: Urgency) {
    if let Some(priority) = urgency {
        let _ = realtime::insist_on_deadlines(priority.saturating_sub(1).max(1));
    }
}

/// Serves a device that is no serial line, on a thread of its own, until the companion ends.
pub(super) fn spawn(
    port: Port,
    inbox: Inbox,
    output: Mailbox,
    urgency: Urgency,
    shared: Arc<Shared>,
) -> std::io::Result<JoinHandle<()>> {
    // A socket belongs to the runtime that it was made in: it is handed over bare.
    let bare = match port {
        Port::UdpIn(socket) => Bare::UdpIn(socket.into_std()?),
        Port::TcpIn(listener) => Bare::TcpIn(listener.into_std()?),
        other => Bare::None(other),
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let name = format!("link-{}", inbox.link().number());
    std::thread::Builder::new().name(name).spawn(move || {
        hurry(urgency);
        runtime.block_on(async move {
            tokio::select! {
                () = serve(bare, inbox, output) => {}
                () = ends(&shared) => {}
            }
        });
    })
}

/// A port on its way from one runtime to the other.
enum Bare {
    UdpIn(std::net::UdpSocket),
    TcpIn(std::net::TcpListener),
    None(Port),
}

async fn serve(bare: Bare, inbox: Inbox, output: Mailbox) {
    let failed = |error: std::io::Error| {
        tracing::error!("link {}: {error}; it stays silent", inbox.link().number());
    };
    match bare {
        Bare::UdpIn(socket) => match UdpSocket::from_std(socket) {
            Ok(socket) => udp::listen(socket, inbox, output).await,
            Err(error) => failed(error),
        },
        Bare::TcpIn(listener) => match TcpListener::from_std(listener) {
            Ok(listener) => tcp::serve(listener, inbox, output).await,
            Err(error) => failed(error),
        },
        Bare::None(Port::UdpOut(to)) => udp::send_to(to, inbox, output).await,
        Bare::None(Port::TcpOut(to)) => tcp::connect(to, inbox, output).await,
        // Serial lines have their own threads; listening ports are in hand.
        Bare::None(Port::Serial(..) | Port::UdpIn(_) | Port::TcpIn(_)) => {}
    }
}

async fn ends(shared: &Shared) {
    while !shared.stopped() {
        tokio::time::sleep(LOOK).await;
    }
}
