//! Campaign files: a base scenario, a mission, distributions over keys, and how many flights.
//!
//! `docs/CAMPAIGNS.md` documents every key. Unknown keys are refused.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use haltere_core::checks::Problems;
use haltere_pilot::mission_file::{Item, MissionFile};
use haltere_pilot::settings::Config;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use toml::{Table, Value};

use super::draw::{self, Draw};
use super::entry::Entry;
use super::judge::Fence;
use crate::ctl::read_mission;
use crate::simulated::built_in::{self, Kind};
use crate::simulated::faults::Phase;
use crate::simulated::scenario::Scenario;
use crate::sources::{self, Sources};
use crate::vehicles;

/// A campaign, as in a file. The default names no file and is none that can be flown: what flies single missions takes what
/// it needs of it.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CampaignFile {
    /// For people.
    pub name: String,
    /// Of all random numbers; `--seed` wins.
    #[serde(default)]
    pub seed: u64,
    /// How many flights. Absent: each combination of the grids once.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flights: Option<u64>,
    /// Base scenario, relative to this file, or a built-in one by name. Absent: the defaults of a scenario.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scenario: Option<PathBuf>,
    /// Vehicle file, relative to this file, or a built-in one by name. Absent: the nominal vehicle.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vehicle: Option<PathBuf>,
    /// Mission file, relative to this file; or the items stand here.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mission: Option<PathBuf>,
    /// Configuration files of the companion, relative to this file; later ones win.
    #[serde(default)]
    pub config: Vec<PathBuf>,
    /// `section.key=value` for the companion.
    #[serde(default)]
    pub set: Vec<String>,
    /// Longest flight from the start of its mission, s.
    #[serde(default = "limit_s")]
    pub limit_s: f64,
    /// Where the vehicle may be. Absent: in the room.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fence: Option<Fence>,
    /// The mission's items.
    #[serde(rename = "item", default, skip_serializing_if = "Vec::is_empty")]
    pub items: Vec<Item>,
    /// Distributions by key of the scenario; `mission.…` and `config.…` reach the other two.
    #[serde(default)]
    pub vary: BTreeMap<String, Draw>,
    /// Faults of the catalogue, one each flight.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub faults: Option<FaultGrid>,
}

/// `[faults]`: a grid of faults, phases and repetitions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FaultGrid {
    /// Names of the catalogue; empty: all.
    pub names: Vec<String>,
    /// Parts of the flight; empty: all.
    pub phases: Vec<Phase>,
    /// Flights of each fault in each phase.
    pub repeats: u64,
    /// Every so-manieth flight is flown in the companion's default volume, and judged by the room; 0: none.
    pub default_volume_every: u64,
}

impl Default for FaultGrid {
    fn default() -> Self {
        Self { names: Vec::new(), phases: Vec::new(), repeats: 1, default_volume_every: 0 }
    }
}

fn limit_s() -> f64 {
    120.0
}

/// Most flights of a campaign.
const MOST_FLIGHTS: u64 = 10_000_000;
/// Changes whenever the same file would mean other flights.
const FORMAT: u32 = 2;

/// A campaign with all files that it names.
#[derive(Debug, Clone)]
pub struct Campaign {
    /// The file.
    pub file: CampaignFile,
    /// SHA-256 over everything that determines its flights.
    pub digest: String,
    /// How many flights.
    pub flights: u64,
    /// The three trees that keys are set in.
    pub base: Base,
    /// Faults that are flown.
    pub faults: Vec<Entry>,
    /// Phases that they come in.
    pub phases: Vec<Phase>,
    /// As the user named it, for commands that fly a flight again.
    pub source: String,
}

/// What is the same for all flights before their keys are set.
#[derive(Debug, Clone)]
pub struct Base {
    /// The scenario.
    pub scenario: Table,
    /// Where its anchor file lies.
    pub scenario_folder: PathBuf,
    /// The mission.
    pub mission: Table,
    /// The companion's configuration, every key.
    pub config: Table,
    /// The vehicle file's text.
    pub vehicle: String,
}

impl Campaign {
    /// Reads a campaign, of a file or by its name, and all files that it names.
    pub fn load(path: &Path, seed: Option<u64>) -> Result<Self> {
        let file = Kind::Campaign.find(Path::new(""), path);
        let text = Kind::Campaign.read(&file)?;
        let folder = file.parent().unwrap_or(Path::new("."));
        Self::parse(&text, folder, seed, &path.display().to_string(), Vec::new())
            .with_context(|| format!("{}", path.display()))
    }

    /// The same from a text; `folder` is where its files lie, `catalogue` what `[faults]` may name.
    pub fn parse(
        text: &str,
        folder: &Path,
        seed: Option<u64>,
        source: &str,
        catalogue: Vec<Entry>,
    ) -> Result<Self> {
        let mut file: CampaignFile = toml::from_str(text)?;
        file.seed = seed.unwrap_or(file.seed);
        let mut problems = Problems::new();
        problems.range("limit_s", file.limit_s, 1.0..=3600.0, "s");
        if let Some(fence) = &file.fence {
            fence.check("fence", &mut problems);
        }
        for (key, draw) in &file.vary {
            draw.check(&format!("vary.{key}"), &mut problems);
        }
        if file.mission.is_some() != file.items.is_empty() {
            problems.say("a campaign needs either mission = FILE or [[item]] tables, and not both");
        }
        let (faults, phases) = match &file.faults {
            None => (Vec::new(), Vec::new()),
            Some(grid) => chosen(grid, catalogue, &mut problems),
        };
        if !problems.is_empty() {
            bail!(problems);
        }
        let base = Base::read(&file, folder)?;
        let grid = grid_size(&file, faults.len() as u64 * phases.len() as u64)?;
        let flights = match file.flights {
            Some(flights) => flights,
            None if grid > 1 => grid,
            None => bail!("flights is missing: how many? (only a grid counts by itself)"),
        };
        if !(1..=MOST_FLIGHTS).contains(&flights) {
            bail!("flights = {flights}, allowed 1 to {MOST_FLIGHTS}");
        }
        let digest = digest(&file, &base, &faults)?;
        Ok(Self { file, digest, flights, base, faults, phases, source: source.to_owned() })
    }
}

fn chosen(grid: &FaultGrid, all: Vec<Entry>, problems: &mut Problems) -> (Vec<Entry>, Vec<Phase>) {
    if all.is_empty() {
        problems.say("faults: the catalogue is the laboratory's, `haltere-lab faults` flies it");
    }
    for name in grid.names.iter().filter(|n| !all.iter().any(|e| e.name == **n)) {
        problems.say(format!(
            "faults.names: `{name}` is not in the catalogue; `haltere-lab faults --list` prints it"
        ));
    }
    if !(1..=1000).contains(&grid.repeats) {
        problems.say(format!("faults.repeats = {}, allowed 1 to 1000", grid.repeats));
    }
    let wanted = |e: &Entry| grid.names.is_empty() || grid.names.contains(&e.name);
    let phases = if grid.phases.is_empty() { Phase::ALL.to_vec() } else { grid.phases.clone() };
    (all.into_iter().filter(wanted).collect(), phases)
}

fn grid_size(file: &CampaignFile, faults: u64) -> Result<u64> {
    let repeats = file.faults.as_ref().map_or(1, |grid| grid.repeats);
    let of_faults = faults.max(1).checked_mul(repeats);
    file.vary
        .values()
        .try_fold(of_faults, |all, draw| Some(all?.checked_mul(draw.grid_size())))
        .flatten()
        .filter(|size| *size <= MOST_FLIGHTS)
        .with_context(|| format!("the grids have more than {MOST_FLIGHTS} combinations"))
}

impl Base {
    /// Reads the files that a campaign names.
    pub fn read(file: &CampaignFile, folder: &Path) -> Result<Self> {
        let (scenario, scenario_folder) = match &file.scenario {
            None => (Scenario::default(), folder.to_owned()),
            Some(name) => {
                let path = Kind::Scenario.find(folder, name);
                let text = Kind::Scenario.read(&path)?;
                let scenario = toml::from_str(&text).with_context(|| path.display().to_string())?;
                (scenario, path.parent().unwrap_or(Path::new(".")).to_owned())
            }
        };
        // With every default, so that a key may reach into a list that the file leaves out.
        let scenario = Table::try_from(&scenario).context("scenario")?;
        let vehicle = match &file.vehicle {
            Some(name) => vehicle(folder, name)?,
            None => String::new(),
        };
        let config = if file.config.is_empty() {
            Config::default()
        } else {
            let files = file.config.iter().map(|name| folder.join(name)).collect();
            // Not the environment: flights depend on the campaign alone.
            sources::load(&Sources { files, ..Sources::default() })?
        };
        let mut config: Table = toml::from_str(&config.to_toml())?;
        for line in &file.set {
            let (key, text) = line
                .split_once('=')
                .with_context(|| format!("set: `{line}`: write section.key=value"))?;
            draw::set(&mut config, key.trim(), plain(text.trim())).context("set")?;
        }
        let mission = match &file.mission {
            Some(name) => {
                let typed = Config::from_toml("config", &config.to_string())?;
                let origin = typed.ground.origin.in_force();
                read_mission(&folder.join(name), &origin, |what| eprintln!("{what}"))?
            }
            None => MissionFile { items: file.items.clone() },
        };
        Ok(Self { scenario, scenario_folder, mission: Table::try_from(&mission)?, config, vehicle })
    }
}

/// The text of a vehicle file, or of the built-in vehicle of that name.
fn vehicle(folder: &Path, told: &Path) -> Result<String> {
    let file = folder.join(told);
    let named = told.to_str().filter(|_| !file.is_file()).and_then(vehicles::text);
    named.map_or_else(|| vehicles::read(&file), Ok)
}

/// A value as on the command line: TOML, or a bare word.
fn plain(text: &str) -> Value {
    let parsed = toml::from_str::<Table>(&format!("v = {text}"));
    parsed.ok().and_then(|mut t| t.remove("v")).unwrap_or_else(|| Value::String(text.to_owned()))
}

fn digest(file: &CampaignFile, base: &Base, faults: &[Entry]) -> Result<String> {
    let anchors = match base.scenario.get("anchors_file").and_then(Value::as_str) {
        Some(name) => {
            let file = built_in::survey(&base.scenario_folder, Path::new(name));
            built_in::read(&file).with_context(|| file.display().to_string())?
        }
        None => String::new(),
    };
    let mut hash = Sha256::new();
    let mut part = |name: &str, text: &str| {
        hash.update(format!("{name} {}\n", text.len()));
        hash.update(text);
    };
    part("format", &FORMAT.to_string());
    // Where the files lie does not matter, what stands in them does.
    let bare = CampaignFile {
        scenario: None,
        vehicle: None,
        mission: None,
        config: Vec::new(),
        ..file.clone()
    };
    part("campaign", &toml::to_string(&bare)?);
    part("scenario", &toml::to_string(&base.scenario)?);
    part("anchors", &anchors);
    part("mission", &toml::to_string(&base.mission)?);
    part("config", &toml::to_string(&base.config)?);
    part("vehicle", &base.vehicle);
    for entry in faults {
        part(&entry.name, &entry.text);
    }
    Ok(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}
