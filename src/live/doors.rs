//! The doors of `guard` with a clock, locks and a disk: one gate per link, one ring of keys for all, and
//! a thread that keeps key and time over a restart.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use haltere_dialect::signing::SigningKey;

use super::clock;
use super::shared::Shared;
use crate::sources::{KeyFileError, read_key, read_time, time_file};
use crate::store::{replace, replace_private};
use haltere_core::drops::{DropReason, Drops};
use haltere_core::time::HostTime;
use haltere_log::record::utc_text;
use haltere_pilot::LinkId;
use haltere_pilot::guard::{Door, DoorConfig, KeyRing, Signing, TimeNews};
use haltere_pilot::settings::Config;

/// How often it is looked whether key or time must be written.
const LOOK: Duration = Duration::from_millis(250);

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic elsewhere must not open or shut the doors.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Key and time, shared by all gates.
#[derive(Debug, Default)]
pub(super) struct Keys {
    ring: Mutex<KeyRing>,
    /// A key that came over a link and is not on disk yet.
    offered: Mutex<Option<SigningKey>>,
}

impl Keys {
    /// With the key of the file, where one is needed.
    pub(super) fn load(config: &Config) -> Result<Arc<Self>, KeyFileError> {
        let file = &config.signing.key_file;
        if file.as_os_str().is_empty() {
            return Ok(Arc::default());
        }
        let key = match read_key(file) {
            Ok(key) => Some(key),
            Err(KeyFileError::Missing { .. }) if config.may_be_given_key() => {
                tracing::warn!("{}: no key yet; waiting for SETUP_SIGNING", file.display());
                None
            }
            Err(error) => return Err(error),
        };
        let kept = read_time(file).unwrap_or_else(|why| {
            tracing::warn!("{why}");
            0
        });
        Ok(Arc::new(Self { ring: Mutex::new(KeyRing::new(key, kept)), offered: Mutex::default() }))
    }

    fn write(&self, file: &Path, ends: bool) -> std::io::Result<()> {
        let offered = lock(&self.offered).take();
        if let Some(key) = offered
            && let Err(error) = replace_private(file, key.to_file().as_bytes())
        {
            lock(&self.offered).get_or_insert(key);
            return Err(error);
        }
        let due = {
            let ring = lock(&self.ring);
            let now_us = clock::unix_us();
            let newest = ring.newest(now_us);
            if ends { ring.has_key().then_some(newest) } else { ring.due_to_keep(now_us) }
        };
        if let Some(time) = due {
            replace(&time_file(file), format!("{time}\n").as_bytes())?;
            lock(&self.ring).was_kept(time);
        }
        Ok(())
    }
}

/// Starts the thread that writes key and time.
pub(super) fn keep(
    keys: Arc<Keys>,
    file: PathBuf,
    shared: Arc<Shared>,
) -> std::io::Result<Option<JoinHandle<()>>> {
    if file.as_os_str().is_empty() {
        return Ok(None);
    }
    let thread = std::thread::Builder::new().name("keys".into()).spawn(move || {
        let mut told = false;
        loop {
            let ends = shared.stopped();
            match keys.write(&file, ends) {
                Ok(()) => told = false,
                Err(error) if !told => {
                    told = true;
                    tracing::error!(
                        "{}: key or time cannot be written: {error}; after a restart old frames could \
                         be taken for new",
                        file.display()
                    );
                }
                Err(_) => {}
            }
            if ends {
                return;
            }
            std::thread::sleep(LOOK);
        }
    })?;
    Ok(Some(thread))
}

fn tell(link: LinkId, news: TimeNews) {
    let link = link.number();
    match news {
        TimeNews::Taken { from: (system, component), unix_us } => {
            tracing::warn!(
                "the clock of this computer was never set: signatures go by the time of system {system}, \
                 component {component} on link {link}, {}",
                utc_text(unix_us)
            );
        }
        TimeNews::Ahead { from: (system, component), by_s } => tracing::warn!(
            "system {system}, component {component} on link {link} signs {by_s} s ahead of our clock: one \
             of the two clocks is wrong; it is heard, and may not hear us; set both clocks"
        ),
        TimeNews::KeptUnused { by_s } => tracing::warn!(
            "the time that was kept beside the signing key is {by_s} s ahead of our clock, at most a day is \
             believed: the clock counts"
        ),
    }
}

/// One link's door.
#[derive(Debug)]
pub(super) struct Gate {
    door: Mutex<Door>,
    keys: Arc<Keys>,
}

impl Gate {
    pub(super) fn new(config: DoorConfig, keys: Arc<Keys>) -> Arc<Self> {
        Arc::new(Self { door: Mutex::new(Door::new(config)), keys })
    }

    /// Whether nobody comes in without a signature.
    pub(super) fn is_shut(&self) -> bool {
        lock(&self.door).signing() == Signing::Require
    }

    /// Somebody else speaks now.
    pub(super) fn reopen(&self) {
        lock(&self.door).reopen();
    }

    /// What may pass of these bytes.
    pub(super) fn admit(
        &self,
        link: LinkId,
        at: HostTime,
        bytes: &[u8],
        passed: &mut Vec<u8>,
        shared: &Shared,
    ) {
        let mut drops = Drops::default();
        let mut door = lock(&self.door);
        let mut ring = lock(&self.keys.ring);
        let unix_us = clock::unix_us();
        let offer = door.admit(&mut ring, at, unix_us, bytes, passed, &mut drops);
        let news = ring.take_news();
        drop(ring);
        if let Some(news) = news {
            tell(link, news);
        }
        if let Some(offer) = offer {
            tracing::warn!("a new signing key came over link {}", link.number());
            *lock(&self.keys.offered) = Some(offer.key);
        }
        for (reason, count) in drops.iter() {
            shared.lost_many(link, reason, count);
        }
    }

    /// Whether a stranger with these bytes may come in, or why not.
    pub(super) fn would_open(&self, bytes: &[u8]) -> Result<(), DropReason> {
        let door = lock(&self.door);
        door.would_open(&lock(&self.keys.ring), clock::unix_us(), bytes)
    }

    /// Brings a frame into the form in which it goes out.
    pub(super) fn seal(&self, link: LinkId, frame: &mut Vec<u8>) {
        let door = lock(&self.door);
        door.seal(&mut lock(&self.keys.ring), link.number(), clock::unix_us(), frame);
    }
}
