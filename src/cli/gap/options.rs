//! Options that several commands share: the bank, the room and the vehicle, accepted flights.

use std::path::PathBuf;

use anyhow::Context as _;
use clap::Args;
use clap::builder::RangedU64ValueParser;

use crate::vehicles;
use haltere_core::checks::Problems;
use haltere_gap::bank::make_bank::BankSize;
use haltere_gap::bank::workshop::default_folder;
use haltere_gap::bank::{LEAST_DRAWS, LEAST_NULLS};
use haltere_gap::door::{References, Simulator};
use haltere_gap::scene::Told;
use haltere_model::Vehicle;
use haltere_model::effects::EffectSpec;
use haltere_model::room::Room;

/// Sizes of a bank.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum Size {
    /// More than twice the full one.
    Large,
    /// For verdicts.
    Full,
    /// For a first look.
    Small,
    /// For tests of the program.
    Smallest,
}

/// Where banks lie, and what they hold.
#[derive(Debug, Clone, Args)]
pub struct BankOptions {
    /// Folder of the banks; the user's cache by default.
    #[arg(long, value_name = "DIR")]
    pub banks: Option<PathBuf>,
    /// Size of a bank: `full` for verdicts, `large` has more than twice as many flights, `small` half of them for a first
    /// look, `smallest` is for tests of the program: verdicts from it mean nothing.
    #[arg(long, value_name = "SIZE", default_value = "full")]
    pub size: Size,
    /// Nominal flights in a bank.
    #[arg(long, value_name = "N")]
    pub seeds: Option<usize>,
    /// Flights with benign jitter in a bank.
    #[arg(long, value_name = "N", value_parser = at_least(LEAST_NULLS))]
    pub jitter: Option<usize>,
    /// Flights per effect in a bank.
    #[arg(long, value_name = "N", value_parser = at_least(LEAST_DRAWS))]
    pub draws: Option<usize>,
    /// Only these effects in the library.
    #[arg(long, value_name = "ID", conflicts_with = "without")]
    pub only: Vec<String>,
    /// Effects that are left out of the library.
    #[arg(long, value_name = "ID")]
    pub without: Vec<String>,
}

/// What a bank needs is refused before it is flown.
fn at_least(count: usize) -> RangedU64ValueParser<usize> {
    RangedU64ValueParser::new().range(count as u64..)
}

impl BankOptions {
    /// Folder of the banks.
    pub fn folder(&self) -> PathBuf {
        self.banks.clone().unwrap_or_else(default_folder)
    }

    /// Flights in a bank.
    pub fn size(&self) -> BankSize {
        let base = match self.size {
            Size::Large => BankSize { seeds: 24, jitter: 720, draws: 40 },
            Size::Full => BankSize::default(),
            Size::Small => BankSize::SMALL,
            Size::Smallest => BankSize { seeds: 4, jitter: 16, draws: LEAST_DRAWS },
        };
        BankSize {
            seeds: self.seeds.unwrap_or(base.seeds),
            jitter: self.jitter.unwrap_or(base.jitter),
            draws: self.draws.unwrap_or(base.draws),
        }
    }

    /// Flights of this bank, as a share of those of the full one with the standard library.
    pub fn share(&self) -> f64 {
        let all = haltere_gap::bank::library::standard();
        let flights = |size: &BankSize, library: &[&EffectSpec]| {
            (size.seeds + size.jitter + size.draws_of_all(library)) as f64
        };
        // What is wrong with the library is said where it is asked for.
        let kept = self.library().unwrap_or_default();
        flights(&self.size(), &kept) / flights(&BankSize::default(), &all)
    }

    /// The standard library without what is left out; an unknown id is refused.
    pub fn library(&self) -> anyhow::Result<Vec<&'static EffectSpec>> {
        let all = haltere_gap::bank::library::standard();
        let asked = self.without.iter().map(|id| ("--without", id));
        for (option, id) in asked.chain(self.only.iter().map(|id| ("--only", id))) {
            if !all.iter().any(|spec| spec.id == id) {
                let known: Vec<_> = all.iter().map(|spec| spec.id).collect();
                anyhow::bail!("{option} {id}: no such effect, the library has {}", known.join(" "));
            }
        }
        if !self.only.is_empty() {
            return Ok(all.into_iter().filter(|s| self.only.iter().any(|id| id == s.id)).collect());
        }
        Ok(all.into_iter().filter(|s| !self.without.iter().any(|id| id == s.id)).collect())
    }
}

/// Where accepted flights lie.
#[derive(Debug, Clone, Args)]
pub(super) struct ReferenceOptions {
    /// Accepted flights of this airframe on the mission of the first log, eight or more: logs, or folders of logs. Of a
    /// folder those that flew the mission of another log here are taken as `--held-out-reference`, others are left
    /// out, and it is said which. Those of the mission of another log count there, too. All names that follow are taken, so the log to diagnose comes first.
    #[arg(long, value_name = "LOG|FOLDER", num_args = 1..)]
    reference: Vec<PathBuf>,
    /// Accepted flights of this airframe on the missions of the other logs: logs, or folders of logs.
    #[arg(long, value_name = "LOG|FOLDER", num_args = 1..)]
    held_out_reference: Vec<PathBuf>,
}

impl ReferenceOptions {
    /// Names of flights that are no logs of ours, those of a folder by name.
    pub fn files(&self) -> anyhow::Result<Vec<PathBuf>> {
        let mut files = Vec::new();
        for name in &self.reference {
            if !name.is_dir() {
                files.push(name.clone());
                continue;
            }
            let entries = std::fs::read_dir(name).with_context(|| name.display().to_string())?;
            let mut paths: Vec<PathBuf> =
                entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file()).collect();
            paths.sort();
            files.extend(paths);
        }
        Ok(files)
    }

    /// As the library takes them.
    pub fn references(&self) -> References {
        References {
            same_mission: self.reference.clone(),
            held_out: self.held_out_reference.clone(),
        }
    }
}

/// What flights are compared with, as these options say.
pub(super) fn simulator(told: &SceneOptions, options: &BankOptions) -> anyhow::Result<Simulator> {
    Ok(Simulator {
        told: told.told()?,
        library: options.library()?,
        size: options.size(),
        folder: options.folder(),
    })
}

/// The room of a flight.
#[derive(Debug, Clone, Args)]
pub(super) struct RoomOptions {
    /// Walls and ceiling, m: north from, to, east from, to, ceiling. By default the box of the
    /// anchors.
    #[arg(long, value_name = "N0,N1,E0,E1,H", value_delimiter = ',', allow_hyphen_values = true)]
    room: Option<Vec<f64>>,
}

/// What is said of a flight beside its log.
#[derive(Debug, Clone, Args)]
pub struct SceneOptions {
    #[command(flatten)]
    room: RoomOptions,
    /// Vehicle file (TOML) of the nominal simulator, or the name of a built-in one; without it the Flapper.
    #[arg(long, value_name = "FILE")]
    vehicle: Option<PathBuf>,
}

impl SceneOptions {
    /// Both, read and checked.
    pub fn told(&self) -> anyhow::Result<Told> {
        Ok(Told { room: self.room.room()?, vehicle: self.vehicle()? })
    }

    /// The vehicle file, if one was named.
    pub fn vehicle_file(&self) -> Option<&PathBuf> {
        self.vehicle.as_ref()
    }

    fn vehicle(&self) -> anyhow::Result<Vehicle> {
        let Some(path) = &self.vehicle else { return Ok(Vehicle::default()) };
        let name = || path.display().to_string();
        let text = vehicles::read(path)?;
        let vehicle = Vehicle::from_toml(&text).with_context(name)?;
        let mut problems = Problems::new();
        vehicle.check("vehicle", &mut problems);
        problems.into_result().map_err(anyhow::Error::new).with_context(name)?;
        Ok(vehicle)
    }
}

impl RoomOptions {
    /// The room, if one was told.
    pub fn room(&self) -> anyhow::Result<Option<Room>> {
        let Some(numbers) = &self.room else { return Ok(None) };
        let [n0, n1, e0, e1, ceiling_m] = numbers[..] else {
            anyhow::bail!("--room needs five numbers: N0,N1,E0,E1,H");
        };
        let room = Room { north_m: [n0, n1], east_m: [e0, e1], ceiling_m };
        let mut problems = Problems::new();
        room.check("--room", &mut problems);
        problems.into_result().map_err(anyhow::Error::new)?;
        Ok(Some(room))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    const GAP: &str = include_str!("../../../docs/GAP.md");
    const GLOSSARY: &str = include_str!("../../../docs/GLOSSARY.md");
    const TUTORIAL: &str = include_str!("../../../docs/TUTORIAL_GAP.md");

    /// Outcomes were eight and nine, the small bank an eighth and a quarter of the full one.
    #[test]
    fn regress_pages_say_the_numbers_of_the_code() {
        let share = |size| {
            let (banks, seeds, jitter, draws) = (None, None, None, None);
            let (only, without) = (Vec::new(), Vec::new());
            BankOptions { banks, size, seeds, jitter, draws, only, without }.share()
        };
        assert!((0.45..0.55).contains(&share(Size::Small)), "{}", share(Size::Small));
        assert!((2.0..3.0).contains(&share(Size::Large)), "{}", share(Size::Large));
        assert!(GAP.contains("`--size small` has half of the flights"));
        assert!(TUTORIAL.contains("is half of the full one"));
        // A row of the table each: a key and an exit code.
        let is_outcome = |line: &&str| {
            let cells: Vec<&str> = line.split('|').map(str::trim).collect();
            cells.len() > 3 && cells[1].starts_with('`') && cells[2].parse::<u8>().is_ok()
        };
        let outcomes = GAP.lines().filter(is_outcome).count();
        let words = ["seven", "eight", "nine", "ten"][outcomes - 7];
        assert!(GAP.contains(&format!("Exactly one of the following {words}.")), "{outcomes}");
        assert!(GLOSSARY.contains(&format!("exactly one of {words}")), "{outcomes}");
        assert!(TUTORIAL.contains(&format!("one of {words} outcomes")), "{outcomes}");
    }
}
