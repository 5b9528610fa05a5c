//! The log of a flight in lockstep: what the core was given and what it sent, as the companion writes it.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result, bail};
use haltere::config::Config;
use haltere::lockstep::{HOST_START_US, Listener, Tap};
use haltere::pilot::Input;
use haltere::record::{BuildIdentity, Recorder, Session};
use haltere::survey::Survey;
use haltere::time::HostTime;

/// Wall clock of the first log, µs since 1970: logs of one flight are equal byte for byte.
const STARTED_UNIX_US: i64 = 1_790_000_000_000_000;

/// Recorder and the time that its outputs stand at.
struct Reels {
    recorder: Recorder,
    at: HostTime,
}

/// A log in the making.
pub struct Tape {
    reels: Arc<Mutex<Reels>>,
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
            config_toml: config.to_toml(),
            survey: survey.clone(),
        };
        let recorder = Recorder::start_waiting(work.path(), &session)?;
        let reels = Arc::new(Mutex::new(Reels { recorder, at: session.pilot_started_at }));
        Ok(Self { reels, path: path.to_owned(), _work: work })
    }

    /// What hears every input.
    pub fn listener(&self) -> Listener {
        let heard = self.reels.clone();
        Box::new(move |at, input| {
            let mut reels = heard.lock().unwrap_or_else(PoisonError::into_inner);
            reels.at = at;
            if matches!(input, Input::Wake) {
                // Before the input: what is committed is whole.
                reels.recorder.commit(at);
            }
            reels.recorder.input(at, input);
        })
    }

    /// What hears every output.
    pub fn tap(&self) -> Tap {
        let sent = self.reels.clone();
        Box::new(move |_, link, bytes| {
            let mut reels = sent.lock().unwrap_or_else(PoisonError::into_inner);
            let at = reels.at;
            reels.recorder.output(at, link, bytes);
        })
    }

    /// The log is whole; its length, bytes. Whoever holds listener or tap must be gone.
    pub fn end(self) -> Result<u64> {
        let path = &self.path;
        let reels = Arc::into_inner(self.reels).context("the tape is still in use")?;
        let reels = reels.into_inner().unwrap_or_else(PoisonError::into_inner);
        let summary = reels.recorder.finish();
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
