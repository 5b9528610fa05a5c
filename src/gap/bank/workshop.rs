//! The workshop: for a scene and a mission, the bank (from disk, or flown anew) and what was
//! learned from it. One file per mission and build; another configuration, room, survey, library
//! or program gives another file.

use std::path::{Path, PathBuf};

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;

use crate::attribute::{AttributeError, Attributor, Learned, Settings, between_hours};
use crate::bank::bank_file::{self, BankFileError};
use crate::bank::kept_file::{self, Kind};
use crate::bank::make_bank::{self, BankSize, Recipe};
use crate::bank::not_flown;
use crate::bank::one_flight::End;
use crate::bank::{Bank, LEAST_NULLS};
use crate::flight::statistics::specs;
use crate::nominal::Nominal;
use crate::scene::Scene;
use haltere_model::effects::{Block, EffectSpec};

/// Seed of the banks that a diagnosis uses.
pub const BANK_SEED: u64 = 20_211_117;

const LEARNED: Kind = Kind { what: "learned limits", magic: b"HALTLRND", version: 3 };

/// Why there is no workshop.
#[derive(Debug, thiserror::Error)]
pub enum WorkshopError {
    /// The bank cannot be kept or read.
    #[error(transparent)]
    File(#[from] BankFileError),
    /// The folder for banks cannot be made.
    #[error("{}: cannot be made: {source}", path.display())]
    Folder {
        /// Which.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The simulator does not fly this mission to its end.
    #[error(
        "{flown} of {of} simulated flights of this mission came to its end, at least {LEAST_NULLS} are needed: {why}"
    )]
    NotFlown {
        /// Flights that did.
        flown: usize,
        /// Flights that were tried.
        of: usize,
        /// What became of the others, and what of the vehicle is the reason.
        why: String,
    },
    /// Not all parts of the bank were flown.
    #[error(
        "{}: of {of} parts the {what} of parts {missing} are not there; `--part I/{of}` flies them", folder.display()
    )]
    Parts {
        /// Where they were looked for.
        folder: PathBuf,
        /// Which flights.
        what: &'static str,
        /// Number of parts.
        of: usize,
        /// Those that are not there.
        missing: String,
    },
    /// Nothing can be learned from the bank.
    #[error(transparent)]
    Learn(#[from] AttributeError),
}

/// Everything that is needed to judge flights of one mission.
#[derive(Debug, Clone)]
pub struct Workshop {
    /// Room, survey and companion.
    pub scene: Scene,
    /// The mission.
    pub items: Vec<MISSION_ITEM_INT_DATA>,
    /// Candidates.
    pub library: Vec<&'static EffectSpec>,
    /// What the nominal chain predicts.
    pub nominal: Nominal,
    /// The bank.
    pub bank: Bank,
    /// Its hash.
    pub bank_hash: u64,
    /// Flights that could not be flown for it, by effect; empty when it came from disk.
    pub lost: Vec<(String, usize)>,
    /// Where what is learned from it is kept; `None`: nowhere.
    pub folder: Option<PathBuf>,
}

impl Settings {
    /// For flights by [`specs`].
    pub fn for_flights() -> Self {
        Self::default().beside_flights()
    }

    /// These choices for flights by [`specs`].
    pub fn beside_flights(self) -> Self {
        let resolution = specs().iter().map(|s| s.resolution).collect();
        let sessions = specs().iter().map(between_hours).collect();
        let relative = specs().iter().map(|s| s.relative).collect();
        Self { resolution, relative, sessions, ..self }
    }
}

impl Workshop {
    /// Takes the bank from `folder`, or flies it and keeps it there. `progress`: done, of how many.
    pub fn open(
        folder: &Path,
        scene: Scene,
        items: Vec<MISSION_ITEM_INT_DATA>,
        library: Vec<&'static EffectSpec>,
        size: BankSize,
        progress: impl Fn(usize, usize) + Sync,
    ) -> Result<Self, WorkshopError> {
        std::fs::create_dir_all(folder)
            .map_err(|source| WorkshopError::Folder { path: folder.to_owned(), source })?;
        let path = folder.join(format!("{}.bank", key(&scene, &items, &library, size)));
        let nominal = Nominal::of_scene(&scene);
        let (bank, bank_hash, lost) = if path.exists() {
            let (bank, hash) = bank_file::read(&path)?;
            (bank, hash, Vec::new())
        } else {
            let recipe =
                Recipe { scene: &scene, items: &items, library: &library, size, seed: BANK_SEED };
            let made = make_bank::make(&recipe, progress);
            enough(&recipe, made.bank.jitter.len(), || made.ends.clone())?;
            let hash = bank_file::write(&path, &made.bank)?;
            (made.bank, hash, made.lost)
        };
        let folder = Some(folder.to_owned());
        Ok(Self { scene, items, library, nominal, bank, bank_hash, lost, folder })
    }

    /// Learns the bank, or takes from disk what was learned from the same flights before. `references`: statistics
    /// of accepted flights of this airframe on this mission; `calibration`: more of them, for the limits of the
    /// gate alone. `long` is called before what takes half a minute.
    pub fn learn(
        &self,
        references: &[Vec<f64>],
        calibration: &[Vec<f64>],
        settings: &Settings,
        long: impl FnOnce(),
    ) -> Result<Attributor, AttributeError> {
        let blocks: Vec<Block> = specs().iter().map(|s| s.block).collect();
        // Debug output of numbers is exact.
        let from = format!(
            "{:016x} {references:?} {calibration:?} {settings:?} {}",
            self.bank_hash,
            crate::BANK_HASH
        );
        let name = format!("{:016x}.learned", kept_file::fnv(from.as_bytes()));
        let path = self.folder.as_ref().map(|folder| folder.join(name));
        let learned = path.as_deref().and_then(|path| kept_file::recall(LEARNED, path));
        let new = learned.is_none();
        if new {
            long();
        }
        let attributor =
            Attributor::with(&self.bank, references, calibration, &blocks, settings, learned)?;
        if let Some(path) = path.filter(|_| new) {
            let learned = attributor.learned();
            // Limits without flights behind them are infinite, which JSON does not know: those are learned again.
            if readable(&learned) {
                kept_file::remember(LEARNED, &path, &learned);
            }
        }
        Ok(attributor)
    }

    /// The specification of an effect of the library.
    pub fn spec(&self, id: &str) -> Option<&'static EffectSpec> {
        self.library.iter().copied().find(|spec| spec.id == id)
    }
}

/// Refuses a mission of which too few healthy flights came to their end, and says why.
pub(super) fn enough(
    recipe: &Recipe<'_>,
    flown: usize,
    ends: impl FnOnce() -> Vec<(End, usize, u64)>,
) -> Result<(), WorkshopError> {
    if flown >= LEAST_NULLS {
        return Ok(());
    }
    let why = not_flown::why(recipe, &ends());
    Err(WorkshopError::NotFlown { flown, of: recipe.size.jitter, why })
}

fn readable(learned: &Learned) -> bool {
    let text = serde_json::to_string(learned);
    text.and_then(|text| serde_json::from_str::<Learned>(&text)).is_ok()
}

/// Name of a bank: hash of everything that its flights depend on.
pub(super) fn key(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    library: &[&'static EffectSpec],
    size: BankSize,
) -> String {
    let ids: Vec<&str> = library.iter().map(|spec| spec.id).collect();
    scene.key(items, &format!("{ids:?} {size:?} {BANK_SEED}"))
}

/// Where banks are kept unless the user says otherwise: the user's cache.
pub fn default_folder() -> PathBuf {
    cache().join("gap-banks")
}

/// The bank that was flown last, of those in a folder that this program can read.
pub fn latest(folder: &Path) -> Option<Bank> {
    let files = std::fs::read_dir(folder).ok()?.filter_map(|entry| {
        let path = entry.ok()?.path();
        let at = path.metadata().and_then(|of| of.modified()).ok()?;
        path.extension().is_some_and(|end| end == "bank").then_some((at, path))
    });
    let mut files: Vec<_> = files.collect();
    files.sort();
    let names = || specs().iter().map(|spec| &spec.name);
    let mut banks = files.iter().rev().filter_map(|(_, path)| Some(bank_file::read(path).ok()?.0));
    banks.find(|bank| bank.names.iter().eq(names()))
}

/// Where it is kept how long the stages of a diagnosis took on this computer.
pub fn costs_file() -> PathBuf {
    cache().join("stages.json")
}

fn cache() -> PathBuf {
    let home = || std::env::var_os("HOME").map(|home| PathBuf::from(home).join(".cache"));
    std::env::var_os("XDG_CACHE_HOME")
        .map(PathBuf::from)
        .or_else(home)
        .unwrap_or_else(std::env::temp_dir)
        .join("haltere")
}
