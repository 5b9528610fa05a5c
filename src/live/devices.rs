//! Tag and board on threads of their own: whatever stations send, the socket over which setpoints go
//! does not wait behind theirs.

use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use tokio::net::TcpListener;

use super::inbox::Inbox;
use super::mailbox::Mailbox;
use super::realtime::{Urgency, hurry};
use super::shared::Shared;
use super::{Port, cable, datagrams, radio, serial, tcp};

/// How often it is looked whether to end.
const LOOK: Duration = Duration::from_millis(100);

/// Serves tag or board until the companion ends.
pub(super) fn spawn(
    port: Port,
    inbox: Inbox,
    output: Mailbox,
    urgency: Urgency,
    shared: Arc<Shared>,
) -> std::io::Result<Vec<JoinHandle<()>>> {
    let name = format!("link-{}", inbox.link().number());
    let thread = std::thread::Builder::new().name(name);
    let spawned = match port {
        Port::Serial(device, baud) => {
            return Ok(serial::spawn(device, baud, inbox, output, urgency)?.into());
        }
        Port::UdpIn(socket) => {
            let socket = socket.into_std()?;
            thread.spawn(move || {
                hurry(urgency);
                datagrams::listen(&socket, &inbox, output);
            })
        }
        Port::Nothing => return Ok(Vec::new()),
        Port::CrtpUdp(to) => thread.spawn(move || {
            hurry(urgency);
            datagrams::send_packets_to(&to, &inbox, output);
        }),
        Port::Radio(place) => thread.spawn(move || {
            hurry(urgency);
            radio::serve(&place, &inbox, output);
        }),
        Port::CrtpUsb => thread.spawn(move || {
            hurry(urgency);
            cable::serve(&inbox, output);
        }),
        Port::UdpOut(to) => thread.spawn(move || {
            hurry(urgency);
            datagrams::send_to(&to, &inbox, output);
        }),
        Port::TcpIn(listener) => {
            // A socket belongs to the runtime that it was made in: it is handed over bare.
            let listener = listener.into_std()?;
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
            thread.spawn(move || {
                hurry(urgency);
                runtime.block_on(until_the_end(&shared, async {
                    match TcpListener::from_std(listener) {
                        Ok(listener) => tcp::serve(listener, inbox, output).await,
                        Err(error) => tracing::error!("the board's link: {error}; it stays silent"),
                    }
                }));
            })
        }
        Port::TcpOut(to) => {
            let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
            thread.spawn(move || {
                hurry(urgency);
                runtime.block_on(until_the_end(&shared, tcp::connect(to, inbox, output)));
            })
        }
    };
    Ok(vec![spawned?])
}

async fn until_the_end(shared: &Shared, serve: impl Future<Output = ()>) {
    tokio::select! {
        () = serve => {}
        () = ends(shared) => {}
    }
}

async fn ends(shared: &Shared) {
    while !shared.stopped() {
        tokio::time::sleep(LOOK).await;
    }
}
