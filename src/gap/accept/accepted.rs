//! Writes accepted changes to files, and takes them back.
//!
//! Beside every changed file lies `FILE.haltere-undo`: for each change, newest last, the text before
//! and the SHA-256 of the text after. Undo refuses when the file is no longer what was written. The way back is
//! written first and removed last: a power cut between the two leaves a change on record that is not in the file,
//! and the next run of either drops it.

use haltere_log::written;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::flight::seal::digest;

/// Largest file that is edited, bytes: configurations are a few kilobytes.
const MOST_BYTES: u64 = 1 << 20;

/// Pairs of lines that are compared at most.
const MOST_COMPARED: usize = 4_000_000;

/// Why a file was not written or not taken back.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// The system.
    #[error("{}: {source}", path.display())]
    Io {
        /// File.
        path: PathBuf,
        /// What it says.
        source: std::io::Error,
    },
    /// It may not be written, or cannot.
    #[error(transparent)]
    Output(#[from] written::OutputError),
    /// No configuration is that large.
    #[error("{}: {found} bytes, at most {MOST_BYTES} are edited", path.display())]
    TooLarge {
        /// File.
        path: PathBuf,
        /// Its size.
        found: u64,
    },
    /// Edited since.
    #[error(
        "{}: was edited since `gap accept` wrote it (SHA-256 {found}, written was {written}); take the \
         change back by hand: the text before is in {}",
        path.display(), undo.display()
    )]
    EditedSince {
        /// File.
        path: PathBuf,
        /// As found.
        found: String,
        /// As written.
        written: String,
        /// Where the text before is.
        undo: PathBuf,
    },
    /// Nothing to take back.
    #[error("{}: nothing to take back: {} is missing or empty", path.display(), undo.display())]
    Nothing {
        /// File.
        path: PathBuf,
        /// File of changes.
        undo: PathBuf,
    },
    /// The file of changes is damaged.
    #[error("{}: damaged: {why}", path.display())]
    Damaged {
        /// Which.
        path: PathBuf,
        /// What.
        why: String,
    },
}

/// One change.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Change {
    /// What was accepted.
    what: String,
    /// Text before; absent: there was no file.
    before: Option<String>,
    /// SHA-256 of the text after.
    after_sha256: String,
}

impl Change {
    /// The file is as before it: it was to be written, or was taken back, when the power went.
    fn is_not_in(&self, now: Option<&str>) -> bool {
        self.before.as_deref() == now
            && now.is_none_or(|now| digest(now.as_bytes()) != self.after_sha256)
    }
}

/// A line that changes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LineChange {
    /// Number of the line in the text before (removed) or after (added), from 1.
    pub number: usize,
    /// `-` removed, `+` added.
    pub sign: char,
    /// The line.
    pub text: String,
}

fn undo_path(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_os_string();
    name.push(".haltere-undo");
    PathBuf::from(name)
}

/// Reads a file to be edited; `None`: there is none yet.
pub fn read(path: &Path) -> Result<Option<String>, FileError> {
    let io = |source| FileError::Io { path: path.to_owned(), source };
    match std::fs::metadata(path) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(io(error)),
        Ok(data) if data.len() > MOST_BYTES => {
            return Err(FileError::TooLarge { path: path.to_owned(), found: data.len() });
        }
        Ok(_) => {}
    }
    haltere_log::intake::text(path, MOST_BYTES).map(Some).map_err(io)
}

/// Lines that differ, by the longest common subsequence.
pub fn lines_changed(before: &str, after: &str) -> Vec<LineChange> {
    let (a, b): (Vec<&str>, Vec<&str>) = (before.lines().collect(), after.lines().collect());
    // Equal heads and tails are most of every file.
    let head = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    let tail =
        a[head..].iter().rev().zip(b[head..].iter().rev()).take_while(|(x, y)| x == y).count();
    let (mid_a, mid_b) = (&a[head..a.len() - tail], &b[head..b.len() - tail]);
    // The table of the subsequence is as large as the product: a file that changes in far places is
    // told as a whole between them.
    if mid_a.len().saturating_mul(mid_b.len()) > MOST_COMPARED {
        let line = |sign| {
            move |(k, text): (usize, &&str)| LineChange {
                number: head + k + 1,
                sign,
                text: (*text).to_owned(),
            }
        };
        let removed = mid_a.iter().enumerate().map(line('-'));
        return removed.chain(mid_b.iter().enumerate().map(line('+'))).collect();
    }
    let width = mid_b.len() + 1;
    let mut common = vec![0usize; (mid_a.len() + 1) * width];
    for i in (0..mid_a.len()).rev() {
        for j in (0..mid_b.len()).rev() {
            common[i * width + j] = if mid_a[i] == mid_b[j] {
                common[(i + 1) * width + j + 1] + 1
            } else {
                common[(i + 1) * width + j].max(common[i * width + j + 1])
            };
        }
    }
    let (mut i, mut j, mut out) = (0, 0, Vec::new());
    let mut say = |sign, number, text: &str| {
        out.push(LineChange { number: head + number + 1, sign, text: text.to_owned() });
    };
    while i < mid_a.len() || j < mid_b.len() {
        if i < mid_a.len() && j < mid_b.len() && mid_a[i] == mid_b[j] {
            (i, j) = (i + 1, j + 1);
        } else if i < mid_a.len()
            && (j == mid_b.len() || common[(i + 1) * width + j] >= common[i * width + j + 1])
        {
            say('-', i, mid_a[i]);
            i += 1;
        } else {
            say('+', j, mid_b[j]);
            j += 1;
        }
    }
    out
}

fn write_whole(path: &Path, text: &str) -> Result<(), FileError> {
    Ok(written::write::<&Path>(path, text, &[])?)
}

fn changes(undo: &Path) -> Result<Vec<Change>, FileError> {
    let Some(text) = read(undo)? else { return Ok(Vec::new()) };
    serde_json::from_str(&text)
        .map_err(|e| FileError::Damaged { path: undo.to_owned(), why: e.to_string() })
}

/// Writes a change, with the way back first. `before` is what [`read`] gave.
pub fn write(
    path: &Path,
    before: Option<&str>,
    after: &str,
    what: &str,
) -> Result<PathBuf, FileError> {
    let undo = undo_path(path);
    let mut all = changes(&undo)?;
    if all.last().is_some_and(|last| last.is_not_in(before)) {
        all.pop();
    }
    all.push(Change {
        what: what.to_owned(),
        before: before.map(str::to_owned),
        after_sha256: digest(after.as_bytes()),
    });
    write_whole(&undo, &json(&all, &undo)?)?;
    write_whole(path, after)?;
    Ok(undo)
}

fn json(all: &[Change], undo: &Path) -> Result<String, FileError> {
    serde_json::to_string_pretty(all)
        .map_err(|e| FileError::Damaged { path: undo.to_owned(), why: e.to_string() })
}

/// Takes the newest change of a file back. Says what it was; no lines: the file was without it already.
pub fn undo(path: &Path, dry_run: bool) -> Result<(String, Vec<LineChange>), FileError> {
    let undo = undo_path(path);
    let mut all = changes(&undo)?;
    let Some(last) = all.pop() else {
        return Err(FileError::Nothing { path: path.to_owned(), undo });
    };
    let there = read(path)?;
    if last.is_not_in(there.as_deref()) {
        if !dry_run {
            keep(&all, &undo)?;
        }
        return Ok((last.what, Vec::new()));
    }
    let now = there.unwrap_or_default();
    let found = digest(now.as_bytes());
    if found != last.after_sha256 {
        let (path, written) = (path.to_owned(), last.after_sha256);
        return Err(FileError::EditedSince { path, found, written, undo });
    }
    let lines = lines_changed(&now, last.before.as_deref().unwrap_or_default());
    if dry_run {
        return Ok((last.what, lines));
    }
    let io = |source| FileError::Io { path: path.to_owned(), source };
    match &last.before {
        Some(text) => write_whole(path, text)?,
        None => std::fs::remove_file(path).map_err(io)?,
    }
    keep(&all, &undo)?;
    Ok((last.what, lines))
}

/// What can still be taken back.
fn keep(all: &[Change], undo: &Path) -> Result<(), FileError> {
    if all.is_empty() {
        return std::fs::remove_file(undo)
            .map_err(|source| FileError::Io { path: undo.to_owned(), source });
    }
    write_whole(undo, &json(all, undo)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_changes_are_taken_back_in_order_and_never_over_an_edit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.toml");
        std::fs::write(&path, "a = 1\n").unwrap();
        write(&path, Some("a = 1\n"), "a = 2\n", "one").unwrap();
        write(&path, Some("a = 2\n"), "a = 3\n", "two").unwrap();
        std::fs::write(&path, "a = 4\n").unwrap();
        assert!(matches!(undo(&path, false), Err(FileError::EditedSince { .. })));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "a = 4\n");
        std::fs::write(&path, "a = 3\n").unwrap();
        assert_eq!(undo(&path, true).unwrap().0, "two");
        assert_eq!(undo(&path, false).unwrap().0, "two");
        assert_eq!(undo(&path, false).unwrap().0, "one");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "a = 1\n");
        assert!(matches!(undo(&path, false), Err(FileError::Nothing { .. })));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left behind");
    }

    #[test]
    fn prop_a_new_file_is_taken_away_and_a_damaged_record_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("new.toml");
        assert_eq!(read(&path).unwrap(), None);
        write(&path, None, "a = 2\n", "one").unwrap();
        undo(&path, false).unwrap();
        assert!(!path.exists());
        std::fs::write(undo_path(&path), "{garbage").unwrap();
        assert!(matches!(undo(&path, false), Err(FileError::Damaged { .. })));
    }

    /// Undo told of an edit that nobody had made, and pointed at the record to mend by hand.
    #[test]
    fn regress_a_power_cut_between_record_and_file_is_no_edit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.toml");
        let text = || std::fs::read_to_string(&path).unwrap();
        for before in [Some("a = 1\n"), None] {
            std::fs::write(&path, "a = 1\n").unwrap();
            if before.is_none() {
                std::fs::remove_file(&path).unwrap();
            }
            write(&path, before, "a = 2\n", "one").unwrap();
            write(&path, Some("a = 2\n"), "a = 3\n", "two").unwrap();
            std::fs::write(&path, "a = 2\n").unwrap();
            assert_eq!(undo(&path, false).unwrap(), ("two".to_owned(), Vec::new()));
            assert_eq!(text(), "a = 2\n", "the one before stays");
            // Cut again, and accepted again.
            write(&path, Some("a = 2\n"), "a = 3\n", "two").unwrap();
            std::fs::write(&path, "a = 2\n").unwrap();
            write(&path, Some("a = 2\n"), "a = 4\n", "three").unwrap();
            assert_eq!(undo(&path, false).unwrap().0, "three");
            assert_eq!(undo(&path, false).unwrap().0, "one");
            assert_eq!(read(&path).unwrap().as_deref(), before);
            assert!(matches!(undo(&path, false), Err(FileError::Nothing { .. })));
        }
    }

    #[test]
    fn prop_lines_are_numbered_as_in_their_own_text() {
        let line = |number, sign, text: &str| LineChange { number, sign, text: text.into() };
        assert_eq!(
            lines_changed("a\nb\nc\n", "a\nx\nc\nd\n"),
            [line(2, '-', "b"), line(2, '+', "x"), line(4, '+', "d")]
        );
        assert!(lines_changed("a\n", "a\n").is_empty());
    }
}
