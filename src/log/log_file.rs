//! A log that is being written, for who does not write it: where it lies, and how far it has come.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::Relaxed;

use haltere_core::time::HostTime;

/// A log that may be begun later, for who asks from elsewhere.
#[derive(Debug)]
pub struct LogFile {
    path: OnceLock<PathBuf>,
    settled_us: AtomicU64,
}

impl Default for LogFile {
    fn default() -> Self {
        Self { path: OnceLock::new(), settled_us: AtomicU64::new(0) }
    }
}

impl LogFile {
    /// One that nobody writes any more.
    pub fn complete(path: PathBuf) -> Self {
        Self { path: path.into(), settled_us: AtomicU64::new(u64::MAX) }
    }

    /// Where it lies, once it is begun.
    pub fn path(&self) -> Option<&Path> {
        self.path.get().map(PathBuf::as_path)
    }

    /// Whether what was recorded until then is on the disk, or never comes there.
    pub fn has_settled(&self, until: HostTime) -> bool {
        self.settled_us.load(Relaxed) >= until.as_us()
    }

    pub(crate) fn begin(&self, path: &Path) {
        let _ = self.path.set(path.to_owned());
    }

    pub(crate) fn settle(&self, until_us: u64) {
        self.settled_us.fetch_max(until_us, Relaxed);
    }
}
