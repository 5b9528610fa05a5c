//! `--flight N`: one flight of a log that may hold several.

use std::num::NonZeroUsize;
use std::path::Path;

use clap::Args;

use haltere_log::record::LogFlight;

/// Which flight.
#[derive(Debug, Clone, Copy, Args)]
pub(super) struct WhichFlight {
    /// Which flight of the first log, from 1, if it holds several. Without it the last flight is taken, as of every other
    /// log; which one that was is said.
    #[arg(long, value_name = "N")]
    flight: Option<NonZeroUsize>,
}

impl WhichFlight {
    /// Its number, if one was asked for.
    pub fn number(self) -> Option<usize> {
        self.flight.map(NonZeroUsize::get)
    }

    /// The same for one of several logs.
    pub fn of_log(self, place: usize) -> Option<usize> {
        self.number().filter(|_| place == 0)
    }
}

/// Says which flight of a log was taken, where it holds others too.
pub(super) fn tell(log: &Path, flight: Option<LogFlight>) {
    if let Some(words) = flight.and_then(|flight| flight.words()) {
        eprintln!("{}: {words}", log.display());
    }
}
