//! What systemd is told: that we are ready, whether the vehicle is armed, that we stop and how much longer that
//! takes, and that the control core still works.
//!
//! The protocol is sd_notify(3): words in a datagram to the socket that `NOTIFY_SOCKET` names; nothing
//! happens without it. The watchdog is fed from the progress of the core (its wake-ups), not from a
//! timer: a core that hangs in a loop, or a thread that died, is not covered up.

use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::sync::Arc;
use std::time::Duration;

use super::shared::Shared;

/// Longest time between looks at the core: its wake-ups come each 10 ms.
const LONGEST: Duration = Duration::from_secs(1);

/// The line to systemd.
#[derive(Debug, Default)]
pub(super) struct Systemd {
    socket: Option<UnixDatagram>,
}

impl Systemd {
    /// As the environment says.
    pub(super) fn from_environment() -> Self {
        let name = std::env::var_os("NOTIFY_SOCKET");
        let Some(name) = name.as_ref().and_then(|n| n.to_str()) else { return Self::default() };
        match connect(name) {
            Ok(socket) => Self { socket: Some(socket) },
            Err(error) => {
                tracing::warn!("NOTIFY_SOCKET = {name}: {error}; systemd is told nothing");
                Self::default()
            }
        }
    }

    /// Says it; nobody listens without a socket.
    pub(super) fn say(&self, words: &str) {
        if let Some(socket) = self.socket.as_ref().filter(|_| !words.is_empty()) {
            // systemd that is gone cannot be told.
            let _ = socket.send(words.as_bytes());
        }
    }

    /// How often it is told how it goes: twice in the time that its watchdog gives, and at least each second.
    pub(super) fn period(&self) -> Duration {
        let ours = |pid: String| pid.parse() == Ok(std::process::id());
        let watched = std::env::var("WATCHDOG_PID").ok().is_none_or(ours);
        let usec = std::env::var("WATCHDOG_USEC").ok().filter(|_| watched);
        usec.and_then(|usec| period(&usec)).unwrap_or(LONGEST)
    }
}

fn period(usec: &str) -> Option<Duration> {
    let usec: u64 = usec.parse().ok().filter(|us| *us > 0)?;
    Some((Duration::from_micros(usec) / 2).min(LONGEST))
}

/// A path, or a name in the abstract space where it begins with @.
fn connect(name: &str) -> std::io::Result<UnixDatagram> {
    let socket = UnixDatagram::unbound()?;
    match name.strip_prefix('@') {
        Some(rest) => socket.connect_addr(&SocketAddr::from_abstract_name(rest)?)?,
        None => socket.connect(name)?,
    }
    socket.set_nonblocking(true)?;
    Ok(socket)
}

/// Whether the core made progress since the last look.
#[derive(Debug)]
pub(super) struct Progress {
    shared: Arc<Shared>,
    seen: u64,
}

impl Progress {
    pub(super) fn new(shared: Arc<Shared>) -> Self {
        Self { shared, seen: 0 }
    }

    pub(super) fn was_made(&mut self) -> bool {
        let steps = self.shared.steps();
        std::mem::replace(&mut self.seen, steps) != steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_words_arrive_and_silence_is_no_progress() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notify");
        let systemd = UnixDatagram::bind(&path).unwrap();
        let notify = Systemd { socket: Some(connect(path.to_str().unwrap()).unwrap()) };
        notify.say("READY=1");
        let mut buffer = [0; 64];
        let n = systemd.recv(&mut buffer).unwrap();
        assert_eq!(&buffer[..n], b"READY=1");
        Systemd::default().say("READY=1");

        let shared = Arc::new(Shared::default());
        let mut progress = Progress::new(shared.clone());
        assert!(!progress.was_made());
        shared.step();
        assert!(progress.was_made());
        assert!(!progress.was_made());
    }

    #[test]
    fn prop_the_watchdog_is_fed_twice_in_its_time() {
        assert_eq!(period("500000"), Some(Duration::from_millis(250)));
        assert_eq!(period("30000000"), Some(LONGEST));
        assert_eq!(period("0"), None);
        assert_eq!(period("x"), None);
    }
}
