//! The flight log of a run in lockstep: what the core lived through and said, as the companion records it.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Context, Result, bail};
use haltere::config::Loaded;
use haltere::lockstep::{HOST_START_US, Listener, Tap};
use haltere::pilot::{Input, Pilot};
use haltere::record::{BuildIdentity, Recorder, Session};
use haltere::time::HostTime;
use haltere::topics::Topic;
use haltere::watch::Feed;

/// MAVLink severity up to which a text is a warning.
const SEVERITY_WARNING: u8 = 4;

/// The recorder, and the time of the newest input.
type Shared = Arc<Mutex<(Recorder, HostTime)>>;

/// A log in the making.
pub struct Tape(Shared);

fn lock(tape: &Shared) -> MutexGuard<'_, (Recorder, HostTime)> {
    tape.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Tape {
    /// Begins the log that the configuration asks for.
    pub fn start(loaded: &Loaded) -> Result<Self> {
        let start = HostTime::from_us(HOST_START_US);
        let record = &loaded.config.record;
        let recorder = if record.enabled {
            let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
            let session = Session {
                build: BuildIdentity::current(),
                started_unix_us: i64::try_from(unix.as_micros()).unwrap_or(i64::MAX),
                pilot_started_at: start,
                config_toml: loaded.config.to_toml(),
                survey: loaded.survey.clone(),
            };
            Recorder::start_waiting(&record.directory, &session)?
        } else {
            Recorder::off()
        };
        Ok(Self(Arc::new(Mutex::new((recorder, start)))))
    }

    /// Where it is written.
    pub fn path(&self) -> Option<PathBuf> {
        lock(&self.0).0.path().map(PathBuf::from)
    }

    /// Hears every input.
    pub fn listener(&self) -> Listener {
        let tape = self.0.clone();
        Box::new(move |at, input| {
            let mut tape = lock(&tape);
            tape.1 = at;
            if matches!(input, Input::Wake) {
                tape.0.commit(at);
            }
            tape.0.input(at, input);
        })
    }

    /// Hears every output.
    pub fn tap(&self) -> Tap {
        let tape = self.0.clone();
        Box::new(move |_, link, bytes| {
            let mut tape = lock(&tape);
            let at = tape.1;
            tape.0.output(at, link, bytes);
        })
    }

    /// Records what the core tells about itself, and shows it to people and to the watch page.
    pub fn topics(&self, now: HostTime, pilot: &mut Pilot, watch: &mut Feed) {
        let mut tape = lock(&self.0);
        pilot.drain_topics(|topic| {
            match &topic {
                Topic::Text(text) if text.severity <= SEVERITY_WARNING => {
                    tracing::warn!("{}", text.text)
                }
                Topic::Text(text) => tracing::info!("{}", text.text),
                Topic::Mode(mode) => tracing::info!("mode {}: {}", mode.mode, mode.cause),
                _ => {}
            }
            watch.topic(now, &topic);
            tape.0.topic(now, topic);
        });
    }

    /// Closes it, once nobody writes any more.
    pub fn finish(self) -> Result<Option<String>> {
        let (recorder, _) = Arc::into_inner(self.0)
            .context("the log is still being written")?
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        let summary = recorder.finish();
        match summary.error {
            Some(error) => bail!(error),
            None => Ok(summary.path.map(|path| path.display().to_string())),
        }
    }
}
