//! Where the data of a fit come from.

use crate::report::flight::Flight;
use haltere_log::import::{Recording, stand::Stand};
use haltere_pilot::settings::Config;

/// One file, read.
#[derive(Debug, Clone)]
pub enum Source {
    /// Our own log.
    Log {
        /// Name of the file.
        name: String,
        /// Its columns; truth in it if it was given.
        flight: Box<Flight>,
        /// The configuration it was flown with.
        config: Box<Config>,
    },
    /// A recording with motion capture.
    Recording(Recording),
    /// A thrust stand.
    Stand(Stand),
}

impl Source {
    /// Name of the file.
    pub fn name(&self) -> String {
        match self {
            Source::Log { name, .. } => name.clone(),
            Source::Recording(r) => r.name.clone(),
            Source::Stand(s) => s.name.clone(),
        }
    }

    /// What kind of file it is, for messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Source::Log { .. } => "our own log",
            Source::Recording(_) => "a recording with motion capture",
            Source::Stand(_) => "a thrust stand",
        }
    }
}

/// Names of several.
pub fn names(sources: &[Source]) -> Vec<String> {
    sources.iter().map(Source::name).collect()
}
