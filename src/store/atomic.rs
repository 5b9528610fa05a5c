//! Replaces a file of the store whole or not at all: by the one writer of files, in a folder that is made.

use std::fs;
use std::io;
use std::path::Path;

use haltere_log::written::{self, OutputError};

/// A power cut leaves the old content or the new, and both are whole.
pub fn replace(path: &Path, bytes: &[u8]) -> io::Result<()> {
    make_folder(path)?;
    written::write(path, bytes, &[""; 0]).map_err(without_path)
}

/// The same, for what only its owner may read.
pub fn replace_private(path: &Path, bytes: &[u8]) -> io::Result<()> {
    make_folder(path)?;
    written::write_private(path, bytes).map_err(without_path)
}

fn make_folder(path: &Path) -> io::Result<()> {
    path.parent().map_or(Ok(()), fs::create_dir_all)
}

/// Who asked knows which file.
fn without_path(error: OutputError) -> io::Error {
    match error {
        OutputError::Io { source, .. } => source,
        other => io::Error::other(other.to_string()),
    }
}
