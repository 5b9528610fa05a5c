//! Scenarios and campaigns that come with the program, by name: nothing of them is looked for on the disk.
//!
//! They are embedded as the files that they are in the repository, below a folder that no disk has, so that one may name
//! another as files do. A file of the user that has the same name wins.

use std::path::{Component, Path, PathBuf};

use anyhow::{Context as _, Result, anyhow, bail};
use clap::ValueEnum;

use crate::vehicles;

/// In place of a folder on the disk.
const ROOT: &str = "built-in:";

macro_rules! files {
    ($($path:literal),* $(,)?) => {
        /// Path below [`ROOT`], text.
        const FILES: &[(&str, &str)] = &[$(($path, include_str!(concat!("../../sim/", $path)))),*];
    };
}

files![
    "campaigns/lab.toml",
    "scenarios/anchors-corridor.toml",
    "scenarios/anchors-few.toml",
    "scenarios/ardupilot-unkind.toml",
    "scenarios/cluttered.toml",
    "scenarios/corridor.toml",
    "scenarios/draughty.toml",
    "scenarios/few-anchors.toml",
    "scenarios/lab.toml",
    "scenarios/mishaps.toml",
    "scenarios/px4-unkind.toml",
    "scenarios/sample.toml",
    "scenarios/weak-battery.toml",
    "scenarios/zurich.toml",
];

/// Anchor surveys lie beside the scenarios that name them, and are none.
const SURVEY: &str = "anchors-";

/// What has a name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Kind {
    /// Room, anchors, effects, faults.
    Scenario,
    /// Many flights.
    Campaign,
    /// What flies.
    Vehicle,
}

impl Kind {
    fn folder(self) -> &'static str {
        match self {
            Self::Scenario => "scenarios",
            Self::Campaign => "campaigns",
            Self::Vehicle => "vehicles",
        }
    }

    /// Names of those that are there, in order.
    pub fn names(self) -> Vec<&'static str> {
        if self == Self::Vehicle {
            return vehicles::names();
        }
        let name = |path: &'static str| {
            path.strip_prefix(self.folder())?.strip_prefix('/')?.strip_suffix(".toml")
        };
        let all = FILES.iter().filter_map(|(path, _)| name(path));
        all.filter(|name| !name.starts_with(SURVEY)).collect()
    }

    /// Where the file lies that somebody named `told` in a file of `folder`: on the disk, or in the program.
    pub fn find(self, folder: &Path, told: &Path) -> PathBuf {
        let file = folder.join(told);
        let name = told.to_str().filter(|name| !file.is_file() && self.names().contains(name));
        match name {
            Some(name) => [ROOT, self.folder(), &format!("{name}.toml")].iter().collect(),
            None => file,
        }
    }

    /// As it is typed.
    fn word(self) -> &'static str {
        self.folder().trim_end_matches('s')
    }

    /// The text of a file that [`Kind::find`] found; why there is none says which names there are.
    pub fn read(self, file: &Path) -> Result<String> {
        read(file).with_context(|| match file.exists() {
            true => file.display().to_string(),
            false => self.unknown(&file.display().to_string()),
        })
    }

    fn unknown(self, told: &str) -> String {
        let (word, names) = (self.word(), self.names().join(", "));
        format!(
            "{word} {told}: allowed are a file, or by name {names}; \
             `haltere-sim print {word} NAME > FILE` begins one of your own"
        )
    }
}

/// The text of a file on the disk or in the program.
pub fn read(file: &Path) -> Result<String> {
    let Ok(inside) = file.strip_prefix(ROOT) else {
        return Ok(haltere_log::intake::text(file, 16 << 20)?);
    };
    // `campaigns/../scenarios/lab.toml`: no disk takes that apart for us.
    let mut plain = PathBuf::new();
    for part in inside.components() {
        match part {
            Component::ParentDir => drop(plain.pop()),
            Component::Normal(name) => plain.push(name),
            _ => {}
        }
    }
    let found = FILES.iter().find(|(path, _)| plain == Path::new(path));
    found.map(|(_, text)| (*text).to_owned()).ok_or_else(|| anyhow!("is not in the program"))
}

/// Where the survey lies that a scenario of `folder` names: on the disk, or in the program, so that a scenario that was
/// printed finds its anchors.
pub fn survey(folder: &Path, told: &Path) -> PathBuf {
    let file = folder.join(told);
    let inside = Path::new(Kind::Scenario.folder()).join(told);
    let named = told.to_str().is_some_and(|name| name.starts_with(SURVEY));
    let known = named && FILES.iter().any(|(path, _)| inside == Path::new(path));
    if known && !file.is_file() { Path::new(ROOT).join(inside) } else { file }
}

/// The text of this name, as it comes with the program.
pub fn text(kind: Kind, name: &str) -> Result<String> {
    if !kind.names().contains(&name) {
        bail!("{}", kind.unknown(name));
    }
    match kind {
        Kind::Vehicle => Ok(vehicles::text(name).unwrap_or_default()),
        kind => {
            kind.read(&[ROOT, kind.folder(), &format!("{name}.toml")].iter().collect::<PathBuf>())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulated::campaign::file::{Base, Campaign, CampaignFile};
    use crate::simulated::scenario::Scenario;

    fn on_disk(folder: &str) -> Vec<String> {
        let all = Path::new(env!("CARGO_MANIFEST_DIR")).join("sim").join(folder);
        let mut all: Vec<String> = std::fs::read_dir(all)
            .unwrap()
            .map(|entry| format!("{folder}/{}", entry.unwrap().file_name().to_str().unwrap()))
            .collect();
        all.sort();
        all
    }

    #[test]
    fn prop_every_file_is_in_the_program() {
        let disk = [on_disk("campaigns"), on_disk("scenarios")].concat();
        assert_eq!(disk, FILES.iter().map(|(path, _)| (*path).to_owned()).collect::<Vec<_>>());
        let names: Vec<String> =
            vehicles::names().iter().map(|name| format!("vehicles/{name}.toml")).collect();
        for file in on_disk("vehicles") {
            assert!(names.contains(&file), "{file} is not among {names:?}");
        }
    }

    /// A scenario and a campaign that lean on other files are the same by name as by file.
    #[test]
    fn prop_by_name_it_is_what_the_file_is() {
        let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("sim");
        for name in Kind::Scenario.names() {
            let file = here.join(format!("scenarios/{name}.toml"));
            let of_file = Scenario::load(Some(&file)).unwrap();
            assert_eq!(Scenario::load(Some(Path::new(name))).unwrap(), of_file, "{name}");
        }
        let corridor = Scenario::load(Some(Path::new("corridor"))).unwrap();
        assert_ne!(corridor.anchors_toml(), Scenario::load(None).unwrap().anchors_toml());
        for name in Kind::Campaign.names() {
            let file = here.join(format!("campaigns/{name}.toml"));
            let of_file = Campaign::load(&file, None).unwrap();
            let of_name = Campaign::load(Path::new(name), None).unwrap();
            assert_eq!(of_name.digest, of_file.digest, "{name}");
            assert_eq!(of_name.source, name);
        }
    }

    /// Three of twelve named files that lie beside them in the sources.
    #[test]
    fn regress_what_is_printed_flies_in_an_empty_folder() {
        use crate::simulated::campaign::flight;
        use crate::simulated::campaign::plan::Plan;
        use crate::simulated::campaign::row::Outcome;
        use haltere_pilot::mission_file::{Command, Item, MissionFile};
        let takeoff = Item { height_m: Some(0.8), ..Item::new(Command::Takeoff) };
        let hop = MissionFile { items: vec![takeoff, Item::new(Command::Land)] };
        for kind in [Kind::Scenario, Kind::Campaign, Kind::Vehicle] {
            for name in kind.names() {
                let folder = tempfile::tempdir().unwrap();
                let path = folder.path().join(format!("mine-{name}.toml"));
                let text = super::text(kind, name).unwrap();
                std::fs::write(&path, text).unwrap();
                let fails = |error: anyhow::Error| -> ! { panic!("{name}: {error:#}") };
                let plan = if kind == Kind::Campaign {
                    let campaign = Campaign::load(&path, None).unwrap_or_else(|e| fails(e));
                    campaign.plan(0).unwrap_or_else(|e| fails(e))
                } else {
                    let own = Some(path.clone());
                    let file = match kind {
                        Kind::Scenario => CampaignFile { scenario: own, ..Default::default() },
                        _ => CampaignFile { vehicle: own, ..Default::default() },
                    };
                    let base = Base::read(&file, Path::new("")).unwrap_or_else(|e| fails(e));
                    Plan::of(&base, 1, 60.0).unwrap_or_else(|e| fails(e))
                };
                let plan = Plan { mission: hop.clone(), ..plan };
                let row = flight::fly(&plan, None).unwrap_or_else(|e| fails(e));
                // What breaks on purpose, and boards that want to be set up first, may end otherwise.
                let unkind = ["mishaps", "px4-unkind", "ardupilot-unkind"].contains(&name);
                let landed = matches!(row.outcome, Outcome::Landed | Outcome::Again);
                assert!(landed || unkind || kind == Kind::Campaign, "{name}: {row:?}");
            }
        }
    }

    #[test]
    fn prop_a_file_wins_over_a_name_and_a_folder_does_not() {
        let folder = tempfile::tempdir().unwrap();
        let find = || Kind::Scenario.find(folder.path(), Path::new("lab"));
        std::fs::create_dir(folder.path().join("lab")).unwrap();
        assert_eq!(find(), Path::new("built-in:/scenarios/lab.toml"));
        std::fs::remove_dir(folder.path().join("lab")).unwrap();
        std::fs::write(folder.path().join("lab"), "seed = 9\n").unwrap();
        assert_eq!(find(), folder.path().join("lab"));
        let text = "name = 'x'\nflights = 1\nscenario = 'lab'\nvehicle = 'delfly-nimble'\n[[item]]\ncommand = 'land'\n";
        let campaign = Campaign::parse(text, folder.path(), None, "x", Vec::new()).unwrap();
        assert_eq!(campaign.base.scenario["seed"].as_integer(), Some(9));
        assert!(campaign.base.vehicle.contains("DelFly Nimble"));
    }

    #[test]
    fn prop_what_is_not_there_says_what_is() {
        for (error, says) in [
            (
                Scenario::load(Some(Path::new("labs"))).unwrap_err(),
                ["scenario labs: ", "few-anchors, lab, "],
            ),
            (
                Campaign::load(Path::new("a/lab.toml"), None).unwrap_err(),
                ["campaign a/lab.toml: ", "by name lab;"],
            ),
        ] {
            let error = format!("{error:#}");
            for needed in says {
                assert!(error.contains(needed) && !error.contains("anchors-few"), "{error}");
            }
        }
        assert!(read(Path::new("built-in:/scenarios/../../etc/passwd")).is_err());
    }
}
