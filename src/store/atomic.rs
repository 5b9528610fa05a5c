//! Replaces a file whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;

/// Ending of what is being written. A leftover of a power cut is removed the next time.
const BESIDE: &str = "new";

/// Modes of what is written; the process's umask takes away from them.
pub(super) const PUBLIC: u32 = 0o666;
pub(super) const PRIVATE: u32 = 0o600;

/// Bytes of one write: in tests one, so that the cut can come behind each.
const PIECE_BYTES: usize = if cfg!(test) { 1 } else { 1 << 16 };

/// Writes beside, syncs, renames, syncs the folder. `rename` is atomic on POSIX file systems: a
/// power cut leaves the old content or the new, and both are whole.
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace_with(path, bytes, PUBLIC, |_| Ok(()))
}

/// The same, for what only its owner may read.
pub fn replace_private(path: &Path, bytes: &[u8]) -> io::Result<()> {
    replace_with(path, bytes, PRIVATE, |_| Ok(()))
}

/// The same; `cut` is asked before each step and may end it there, as a power cut would.
pub(super) fn replace_with(
    path: &Path,
    bytes: &[u8],
    mode: u32,
    mut cut: impl FnMut(Step) -> io::Result<()>,
) -> io::Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let mut beside = path.as_os_str().to_owned();
    beside.push(".");
    beside.push(BESIDE);
    let beside = Path::new(&beside);
    match fs::remove_file(beside) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    // Made anew: a leftover could have another mode.
    let mut file = OpenOptions::new().write(true).create_new(true).mode(mode).open(beside)?;
    for (n, piece) in bytes.chunks(PIECE_BYTES).enumerate() {
        cut(Step::Written(n))?;
        file.write_all(piece)?;
    }
    cut(Step::Sync)?;
    file.sync_all()?;
    drop(file);
    cut(Step::Rename)?;
    fs::rename(beside, path)?;
    cut(Step::SyncFolder)?;
    File::open(folder)?.sync_all()
}

/// Where a power cut may come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// Before this piece.
    Written(usize),
    Sync,
    Rename,
    SyncFolder,
}
