//! A flight log for other programs: its decoded topics as tables, the frames of a link as a
//! telemetry log.

mod csv;
pub mod parquet;
mod stream;
mod tables;
mod tlog;
mod tum;

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

pub use stream::{Exported, stream_tables, write_tables};
pub use tables::{Column, Table, Values};
pub use tlog::{LinkTraffic, TlogCount, links, write_tlog};
pub use tum::write_tum;

use crate::import::truth::TruthError;
use crate::record::LogReader;
use crate::written::{Old, Output, OutputError};

/// Form of an exported table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// Text with commas (RFC 4180): a head line, an empty cell where there is no value.
    Csv,
    /// Apache Parquet.
    Parquet,
}

impl Form {
    /// Ending of a file's name.
    pub fn ending(self) -> &'static str {
        match self {
            Form::Csv => "csv",
            Form::Parquet => "parquet",
        }
    }
}

/// Why something could not be exported.
#[derive(Debug, Error)]
pub enum ExportError {
    /// It may not be written, or cannot.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The log holds no such topic.
    #[error("--topic {topic}: not in this log; it holds {}", there.join(", "))]
    NoTopic {
        /// The one that was asked for.
        topic: String,
        /// Those of the log.
        there: Vec<String>,
    },
    /// There is nothing to be exported.
    #[error("{}: holds no decoded topics", path.display())]
    NoTopics {
        /// Which log.
        path: PathBuf,
    },
    /// The truth cannot be read.
    #[error(transparent)]
    Truth(#[from] TruthError),
    /// It cannot be laid beside the log as it is.
    #[error(
        "{}: its clock is not the companion's, so its track does not belong to these times; `haltere-lab flights LOG \
         --truth` finds the offset, and `evo` takes one with --t_offset", path.display()
    )]
    OtherClock {
        /// Which.
        path: PathBuf,
    },
    /// A file cannot be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Write {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
}

/// A new file of what is in a log; an old one of that name only goes if that was asked for.
pub fn create(log: &LogReader, path: &Path, overwrite: bool) -> Result<Output, OutputError> {
    Output::begin(path, &[log.path()], if overwrite { Old::Goes } else { Old::Stays })
}

/// What a table should say about where it came from.
fn about(log: &LogReader) -> Vec<(String, String)> {
    let session = log.session();
    let name = crate::log_file::shown_name(log.path());
    [
        ("haltere.log", name),
        ("haltere.started_unix_us", session.started_unix_us.to_string()),
        ("haltere.pilot_started_us", session.pilot_started_at.as_us().to_string()),
        ("haltere.program_version", session.build.program_version.clone()),
        ("haltere.git_commit", session.build.git_commit.clone()),
    ]
    .map(|(key, value)| (key.to_owned(), value))
    .into()
}

#[cfg(test)]
mod tests;
