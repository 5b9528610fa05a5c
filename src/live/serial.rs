//! A serial link: one thread reads and reopens, one thread writes. Neither ever gives up.

use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use serialport::{SerialPort, TTYPort};

use super::inbox::Inbox;
use super::mailbox::{Mailbox, Outgoing};
use super::realtime::{Urgency, hurry};
use super::{clock, usb};
use haltere_core::drops::DropReason;

/// Longest time without looking whether the companion ends.
const POLL: Duration = Duration::from_millis(100);

/// Wait before the first and before any later attempt to open a device again.
const RETRY_FIRST: Duration = Duration::from_millis(100);
const RETRY_LAST: Duration = Duration::from_secs(2);

/// Bytes per read: more than a USB packet, less than a page.
const READ_BYTES: usize = 2048;

/// Which device.
#[derive(Debug, Clone)]
pub(super) enum Device {
    /// Found by what it says it is.
    AutoTag,
    /// Named.
    Path(PathBuf),
}

/// The half that the writing thread uses; `None` while the device is away.
type Writer = Arc<Mutex<Option<TTYPort>>>;

/// Starts both threads.
pub(super) fn spawn(
    device: Device,
    baud: u32,
    inbox: Inbox,
    output: Mailbox,
    urgency: Urgency,
) -> std::io::Result<[JoinHandle<()>; 2]> {
    let writer = Writer::default();
    let name = format!("link-{}", inbox.link().number());
    let (read_writer, write_inbox) = (writer.clone(), inbox.clone());
    Ok([
        std::thread::Builder::new().name(format!("{name}-in")).spawn(move || {
            hurry(urgency);
            read_forever(&device, baud, &inbox, &read_writer);
        })?,
        std::thread::Builder::new().name(format!("{name}-out")).spawn(move || {
            hurry(urgency);
            write_forever(output, &write_inbox, &writer);
        })?,
    ])
}

fn read_forever(device: &Device, baud: u32, inbox: &Inbox, writer: &Writer) {
    let mut wait = RETRY_FIRST;
    let mut told = String::new();
    while !inbox.stopped() {
        match open(device, baud) {
            Ok((mut port, half, path)) => {
                tracing::info!("{} opened", path.display());
                (wait, told) = (RETRY_FIRST, String::new());
                set(writer, Some(half));
                inbox.up();
                let why = read_until_lost(&mut port, inbox);
                set(writer, None);
                if let Some(why) = why {
                    tracing::warn!("{}: {why}; waiting for it to come back", path.display());
                    inbox.down();
                }
            }
            Err(why) => {
                if why != told {
                    tracing::warn!("{why}; trying again until it works");
                    told = why;
                }
            }
        }
        let resume = clock::now().offset_us(i64::try_from(wait.as_micros()).unwrap_or(0));
        while !inbox.stopped() && clock::now() < resume {
            std::thread::sleep(POLL.min(wait));
        }
        wait = (wait * 2).min(RETRY_LAST);
    }
}

fn set(writer: &Writer, port: Option<TTYPort>) {
    *writer.lock().unwrap_or_else(PoisonError::into_inner) = port;
}

fn open(device: &Device, baud: u32) -> Result<(TTYPort, TTYPort, PathBuf), String> {
    let path = match device {
        Device::Path(path) => path.clone(),
        Device::AutoTag => usb::find_tag().ok_or_else(|| {
            "no Loco Positioning Node on USB: plug it in, or name its device in tag.port".to_owned()
        })?,
    };
    let failed = |error: serialport::Error| {
        format!(
            "{}: cannot be opened: {error}; check the name, that no other program has it, and that you may use it \
             (group dialout)",
            path.display()
        )
    };
    let mut port = serialport::new(path.display().to_string(), baud)
        .timeout(POLL)
        .open_native()
        .map_err(failed)?;
    if is_pseudo_terminal(&path)
        && let Err(error) = port.set_exclusive(false)
    {
        tracing::debug!("{}: stays exclusive: {error}", path.display());
    }
    // A sniffer stays silent without DTR. A pseudo-terminal has none: no error then.
    if let Err(error) = port.write_data_terminal_ready(true) {
        tracing::debug!("{}: no DTR: {error}", path.display());
    }
    let half = port.try_clone_native().map_err(failed)?;
    Ok((port, half, path))
}

/// A real line forgets who had it for itself when that one dies. A pseudo-terminal remembers as long as
/// its other end lives, and would refuse the companion that is started again after a crash.
fn is_pseudo_terminal(path: &Path) -> bool {
    path.canonicalize().is_ok_and(|real| real.starts_with("/dev/pts"))
}

/// `None`: the companion ends.
fn read_until_lost(port: &mut TTYPort, inbox: &Inbox) -> Option<String> {
    let mut buffer = [0; READ_BYTES];
    while !inbox.stopped() {
        match port.read(&mut buffer) {
            Ok(0) => return Some("unplugged".into()),
            Ok(length) => {
                let at = clock::now();
                inbox.bytes(at, buffer.get(..length).unwrap_or_default());
            }
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
            Err(error) => return Some(error.to_string()),
        }
    }
    None
}

fn write_forever(mut output: Mailbox, inbox: &Inbox, writer: &Writer) {
    while let Some(Outgoing { bytes, .. }) = output.wait() {
        let bytes = inbox.seal(bytes);
        let mut port = writer.lock().unwrap_or_else(PoisonError::into_inner);
        let written = port.as_mut().is_some_and(|port| port.write_all(&bytes).is_ok());
        if !written {
            inbox.lost(DropReason::LinkWriteFailed);
        }
    }
}
