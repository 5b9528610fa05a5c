//! The log of a flight in lockstep: what the core was given and what it sent, as the companion writes it.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use anyhow::{Context, Result, bail};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_log::record::{BuildIdentity, Recorder, Session};
use haltere_model::lockstep::{HOST_START_US, Listener, Tap};
use haltere_pilot::settings::Config;
use haltere_pilot::{Input, Pilot};

/// Wall clock of the first log, µs since 1970: logs of one flight are equal byte for byte.
const STARTED_UNIX_US: i64 = 1_790_000_000_000_000;

/// A recorder that hears a world: what the core is given and what it sends, in order.
pub struct Reels(Arc<Mutex<Reel>>);

/// Recorder and the time that its outputs stand at.
struct Reel {
    recorder: Recorder,
    at: HostTime,
}

impl Reels {
    /// Outputs before the first input stand at `start`.
    pub fn new(recorder: Recorder, start: HostTime) -> Self {
        Self(Arc::new(Mutex::new(Reel { recorder, at: start })))
    }

    fn lock(reels: &Mutex<Reel>) -> MutexGuard<'_, Reel> {
        reels.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What hears every input.
    pub fn listener(&self) -> Listener {
        let heard = self.0.clone();
        Box::new(move |at, input| {
            let mut reel = Self::lock(&heard);
            reel.at = at;
            if matches!(input, Input::Wake) {
                // Before the input: what is committed is whole.
                reel.recorder.commit(at);
            }
            reel.recorder.input(at, input);
        })
    }

    /// What hears every output.
    pub fn tap(&self) -> Tap {
        let sent = self.0.clone();
        Box::new(move |_, link, bytes| {
            let mut reel = Self::lock(&sent);
            let at = reel.at;
            reel.recorder.output(at, link, bytes);
        })
    }

    /// The recorder, between two inputs.
    pub fn with<T>(&self, use_it: impl FnOnce(&mut Recorder) -> T) -> T {
        use_it(&mut Self::lock(&self.0).recorder)
    }

    /// The recorder, once listener and tap are gone.
    pub fn into_recorder(self) -> Result<Recorder> {
        let reel = Arc::into_inner(self.0).context("the log is still being written")?;
        Ok(reel.into_inner().unwrap_or_else(PoisonError::into_inner).recorder)
    }
}

/// A log in the making.
pub struct Tape {
    reels: Reels,
    path: PathBuf,
    /// The log grows here and is moved when it is whole.
    _work: tempfile::TempDir,
}

impl Tape {
    /// Nothing stands at `path` until [`Tape::end`].
    pub fn begin(path: &Path, config: &Config, survey: &Survey) -> Result<Self> {
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let work = tempfile::tempdir_in(folder).with_context(|| folder.display().to_string())?;
        let session = Session {
            build: BuildIdentity::current(),
            started_unix_us: STARTED_UNIX_US,
            pilot_started_at: HostTime::from_us(HOST_START_US),
            config_toml: config.to_log(survey),
            survey: survey.clone(),
        };
        let recorder = Recorder::start_waiting(work.path(), &session)?;
        let reels = Reels::new(recorder, session.pilot_started_at);
        Ok(Self { reels, path: path.to_owned(), _work: work })
    }

    /// What hears every input.
    pub fn listener(&self) -> Listener {
        self.reels.listener()
    }

    /// What hears every output.
    pub fn tap(&self) -> Tap {
        self.reels.tap()
    }

    /// Records what the core tells about itself; without this the log holds what replay makes the same of.
    pub fn topics(&self, now: HostTime, pilot: &mut Pilot) {
        self.reels.with(|recorder| pilot.drain_topics(|topic| recorder.topic(now, topic)));
    }

    /// The log is whole; its length, bytes. Whoever holds listener or tap must be gone.
    pub fn end(self) -> Result<u64> {
        let path = &self.path;
        let summary = self.reels.into_recorder()?.finish();
        if let Some(error) = summary.error {
            return Err(error.into());
        }
        if summary.lost_entries > 0 {
            bail!("{}: the recorder lost {} entries", path.display(), summary.lost_entries);
        }
        let written = summary.path.context("nothing was recorded")?;
        let bytes = std::fs::metadata(&written)?.len();
        std::fs::rename(&written, path).with_context(|| path.display().to_string())?;
        Ok(bytes)
    }
}
