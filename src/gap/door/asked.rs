//! What is asked of a diagnosis, who waits for it, and why there may be none.

use std::path::{Path, PathBuf};

use crate::attribute::AttributeError;
use crate::bank::library;
use crate::bank::make_bank::BankSize;
use crate::bank::workshop::{WorkshopError, default_folder};
use crate::commission::NotCommissioned;
use crate::flight::beside_truth::{NoTruth, TruePoint};
use crate::scene::Told;
use crate::shrink::held_out::NotMeasured;
use haltere_log::record::LogFlight;
use haltere_log::replay::ReplayError;
use haltere_model::effects::EffectSpec;

/// The flights that are judged.
#[derive(Debug, Clone, Default)]
pub struct Flights {
    /// The log that is diagnosed.
    pub log: PathBuf,
    /// Which flight in it, from 1; `None`: the last.
    pub flight: Option<usize>,
    /// Flights that the fit does not see: on them it is measured how far the gap closes.
    pub held_out: Vec<PathBuf>,
}

/// What flights are compared with.
#[derive(Debug, Clone)]
pub struct Simulator {
    /// Room and vehicle that it flies.
    pub told: Told,
    /// Effects that can be named.
    pub library: Vec<&'static EffectSpec>,
    /// Flights in its bank.
    pub size: BankSize,
    /// Where banks are kept.
    pub folder: PathBuf,
}

impl Default for Simulator {
    fn default() -> Self {
        Self {
            told: Told::default(),
            library: library::standard(),
            size: BankSize::default(),
            folder: default_folder(),
        }
    }
}

/// Accepted flights of the same airframe: logs, or folders of logs.
#[derive(Debug, Clone, Default)]
pub struct References {
    /// On the mission of the flight that is judged, eight or more; those of the mission of a held-out flight count there, too.
    pub same_mission: Vec<PathBuf>,
    /// On the missions of the held-out flights.
    pub held_out: Vec<PathBuf>,
}

/// What is wanted beside the verdict, and who is told how far it is.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Cells, onset, floor plan and signature.
    pub picture: bool,
    /// Experiments that would tell apart what is left open; takes about as long as everything else.
    pub advice: bool,
    /// Where the flight truly was; it is compared with the estimate and decides nothing.
    pub truth: Option<&'a Truth>,
    /// Who waits.
    pub audience: &'a dyn Audience,
}

impl Default for Options<'_> {
    fn default() -> Self {
        Self { picture: false, advice: false, truth: None, audience: &() }
    }
}

/// Where the truth of a flight stands.
#[derive(Debug, Clone)]
pub enum Truth {
    /// In the log: motion capture.
    Captured,
    /// In a file of this name.
    File(Vec<TruePoint>, String),
}

/// Who waits for a diagnosis.
pub trait Audience: Sync {
    /// So many steps of a stage are done, of how many.
    fn at(&self, _stage: &'static str, _done: usize, _of: usize) {}
    /// What a person may want to know: which flight of a log, which references count.
    fn say(&self, _line: &str) {}
}

impl Audience for () {}

/// Why there is no diagnosis.
#[derive(Debug, thiserror::Error)]
#[allow(missing_docs)]
pub enum Refused {
    /// What was given does not fit together.
    #[error("{0}")]
    Given(String),
    #[error(transparent)]
    Log(#[from] ReplayError),
    #[error(transparent)]
    Bank(#[from] WorkshopError),
    #[error(transparent)]
    Learn(#[from] AttributeError),
    #[error(transparent)]
    NotCommissioned(#[from] NotCommissioned),
    #[error(transparent)]
    NotMeasured(#[from] NotMeasured),
    #[error(transparent)]
    NoTruth(#[from] NoTruth),
}

/// A refusal of what was given.
pub(super) fn refuse<T>(why: String) -> Result<T, Refused> {
    Err(Refused::Given(why))
}

/// Says which flight of a log was taken, where it holds others too.
pub fn say_which(audience: &dyn Audience, log: &Path, flight: Option<LogFlight>) {
    if let Some(words) = flight.and_then(|flight| flight.words()) {
        audience.say(&format!("{}: {words}", log.display()));
    }
}
