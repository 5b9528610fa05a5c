//! Why a file is no log that can be used, and how one ends that is.

use std::path::PathBuf;

use thiserror::Error;

use super::writer::reason;
use crate::written::OutputError;
use haltere_core::checks::schema::NotReadable;

/// Why a file cannot be used as a log.
#[derive(Debug, Error)]
pub enum LogError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Io {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file is something else.
    #[error(
        "{}: byte 0: not an MCAP file; a flight log is named YYYYMMDD-HHMMSS-NN.mcap and lies in \
         record.directory", path.display()
    )]
    NotMcap {
        /// Which file.
        path: PathBuf,
    },
    /// The file ends or is damaged before its first message is complete.
    #[error(
        "{}: byte {offset}: {why} before the head of the log is complete, and there is no second copy of it; \
         without configuration and survey nothing can be made of the rest", path.display()
    )]
    NoHead {
        /// Which file.
        path: PathBuf,
        /// Where reading stopped.
        offset: u64,
        /// Why.
        why: String,
    },
    /// The recovered copy cannot be written.
    #[error("{}: cannot be written: {}", path.display(), reason(source))]
    Copy {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: mcap::McapError,
    },
    /// The name of the new log is taken.
    #[error("{}: exists already, and no log is written over a file; name another one", path.display())]
    Exists {
        /// Which file.
        path: PathBuf,
    },
    /// The new log cannot be put in its place.
    #[error(transparent)]
    Output(OutputError),
    /// The part that was asked for is not in the log.
    #[error(
        "{}: nothing between {from_s} and {to_s} s; the log runs from 0 to {end_s:.1} s",
        path.display()
    )]
    NothingThere {
        /// Which file.
        path: PathBuf,
        /// Begin that was asked for, s.
        from_s: f64,
        /// End that was asked for, s.
        to_s: f64,
        /// Where the log ends, s.
        end_s: f64,
    },
    /// It holds fewer flights than the number that was asked for, or none.
    #[error("{}: no flight {asked}; the log holds {there}", path.display())]
    NoSuchFlight {
        /// Which file.
        path: PathBuf,
        /// Number that was asked for.
        asked: usize,
        /// The flights that it holds.
        there: String,
    },
    /// A log of a newer build.
    #[error(
        "{}: {why}, or read it with the build that wrote it (haltere {version}, source {source_hash})",
        path.display()
    )]
    Newer {
        /// Which file.
        path: PathBuf,
        /// Version that wrote it.
        version: String,
        /// Source that wrote it.
        source_hash: String,
        /// Which version of the schema.
        why: NotReadable,
    },
    /// Several logs that another program has put into one file.
    #[error(
        "{}: byte {offset}: a second session begins here, recorded from {second}, the first from {first}: logs \
         that were put into one file; take the logs themselves",
        path.display()
    )]
    Merged {
        /// Which file.
        path: PathBuf,
        /// Where the second begins.
        offset: u64,
        /// When the first was recorded.
        first: String,
        /// When the second was.
        second: String,
    },
    /// One log that another program has put into a file twice.
    #[error(
        "{}: byte {offset}: the session from {first} begins here once more: one log that was put into a file twice; take \
         the log itself",
        path.display()
    )]
    Twice {
        /// Which file.
        path: PathBuf,
        /// Where it begins again; 0: it lies within itself.
        offset: u64,
        /// When it was recorded.
        first: String,
    },
    /// An MCAP file of another program.
    #[error("{}: byte {offset}: {why}; it was not written by haltere", path.display())]
    Foreign {
        /// Which file.
        path: PathBuf,
        /// Where.
        offset: u64,
        /// What is there.
        why: String,
    },
}

impl From<OutputError> for LogError {
    fn from(error: OutputError) -> Self {
        match error {
            OutputError::Exists { path } | OutputError::OverLog { path } => Self::Exists { path },
            other => Self::Output(other),
        }
    }
}

/// How a log ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LogEnd {
    /// Closed properly.
    Complete,
    /// The file stops in mid-record: power loss, or a copy that was cut.
    Cut {
        /// Offset of the record that is not complete.
        offset: u64,
    },
    /// Records are not what was written. They are left out, and the rest is used.
    Damaged {
        /// Offset of the first of them.
        offset: u64,
        /// What is wrong with it.
        why: String,
        /// Places where records were left out.
        places: u64,
        /// Where the file ends without having been closed.
        cut: Option<u64>,
    },
}

impl std::fmt::Display for LogEnd {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            LogEnd::Complete => write!(f, "complete"),
            LogEnd::Cut { offset } => write!(f, "cut at byte {offset}"),
            LogEnd::Damaged { offset, why, places, cut } => {
                match places {
                    0 | 1 => write!(f, "damaged at byte {offset}: {why}")?,
                    n => write!(f, "damaged in {n} places, first at byte {offset}: {why}")?,
                }
                match cut {
                    Some(cut) => write!(f, "; cut at byte {cut}"),
                    None => Ok(()),
                }
            }
        }
    }
}
