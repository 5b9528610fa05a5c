//! The flight log of a run in lockstep: what the core lived through and said, as the companion records it.

use std::path::PathBuf;
use std::time::{SystemTime, UNIX_EPOCH};

use anyhow::{Result, bail};
use haltere::sources::Loaded;
use haltere::tape::Reels;
use haltere::watch::Feed;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;
use haltere_log::record::{BuildIdentity, Recorder, Session};
use haltere_model::lockstep::{HOST_START_US, Listener, Tap};
use haltere_pilot::Pilot;

/// MAVLink severity up to which a text is a warning.
const SEVERITY_WARNING: u8 = 4;

/// A log in the making.
pub struct Tape(Reels);

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
                config_toml: loaded.config.to_log(&loaded.survey),
                survey: loaded.survey.clone(),
            };
            Recorder::start_waiting(&record.directory, &session)?
        } else {
            Recorder::off()
        };
        Ok(Self(Reels::new(recorder, start)))
    }

    /// Where it is written.
    pub fn path(&self) -> Option<PathBuf> {
        self.0.with(|recorder| recorder.path().map(PathBuf::from))
    }

    /// Hears every input.
    pub fn listener(&self) -> Listener {
        self.0.listener()
    }

    /// Hears every output.
    pub fn tap(&self) -> Tap {
        self.0.tap()
    }

    /// Records what the core tells about itself, and shows it to people and to the watch page.
    pub fn topics(&self, now: HostTime, pilot: &mut Pilot, watch: &mut Feed) {
        let tell = |topic: &Topic| match topic {
            Topic::Text(text) if text.severity <= SEVERITY_WARNING => {
                tracing::warn!("{}", text.text)
            }
            Topic::Text(text) => tracing::info!("{}", text.text),
            Topic::Mode(mode) => tracing::info!("mode {}: {}", mode.mode, mode.cause),
            _ => {}
        };
        self.0.with(|recorder| {
            pilot.drain_topics(|topic| {
                tell(&topic);
                watch.topic(now, &topic);
                recorder.topic(now, topic);
            })
        });
    }

    /// Closes it, once nobody writes any more.
    pub fn finish(self) -> Result<Option<String>> {
        let summary = self.0.into_recorder()?.finish();
        match summary.error {
            Some(error) => bail!(error),
            None => Ok(summary.path.map(|path| path.display().to_string())),
        }
    }
}
