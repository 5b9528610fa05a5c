//! Accepted flights of an airframe, given as people have them: log by log, or a folder of them.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use clap::Args;

use super::gap_session::same_flight;
use super::which_flight::tell;
use crate::progress::Progress;
use haltere_gap::flight::logs::{self, Flown};
use haltere_log::log_file::has_log_ending;

/// Where accepted flights lie.
#[derive(Debug, Clone, Args)]
pub(super) struct References {
    /// Accepted flights of this airframe on the mission of the first log, eight or more: logs, or folders of logs. Of a
    /// folder those that flew the mission of another log here are taken as `--held-out-reference`, others are left
    /// out, and it is said which. Those of the mission of another log count there, too. All names that follow are taken, so the log to diagnose comes first.
    #[arg(long, value_name = "LOG|FOLDER", num_args = 1..)]
    reference: Vec<PathBuf>,
    /// Accepted flights of this airframe on the missions of the other logs: logs, or folders of logs.
    #[arg(long, value_name = "LOG|FOLDER", num_args = 1..)]
    held_out_reference: Vec<PathBuf>,
}

/// Accepted flights, by what they are compared with.
#[derive(Debug, Default)]
pub(super) struct Accepted {
    /// On the mission of the first log.
    pub first: Vec<Flown>,
    /// On missions of the others.
    pub held_out: Vec<Flown>,
    /// Logs on the mission of the first that were not counted: of a flight that is judged, or of one that was given already.
    pub copies: usize,
}

/// A name that was given, or that lies in a folder that was given.
struct Found {
    path: PathBuf,
    in_folder: bool,
}

impl References {
    /// Whether any were given.
    pub fn any(&self) -> bool {
        !self.reference.is_empty() || !self.held_out_reference.is_empty()
    }

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

    /// Reads them. A log that was named and does not fit is an error; one of a folder is left out.
    pub fn read(&self, first: Option<&Flown>, others: &[Flown]) -> anyhow::Result<Accepted> {
        let mut accepted = Accepted::default();
        let (named, held_out) = (found(&self.reference)?, found(&self.held_out_reference)?);
        let of = named.len() + held_out.len();
        let progress = Progress::new("reference flights");
        let mut taken = Vec::new();
        let mut given: Vec<Flown> = Vec::new();
        let named = named.into_iter().map(|found| (found, true));
        for (k, (Found { path, in_folder }, is_first)) in
            named.chain(held_out.into_iter().map(|found| (found, false))).enumerate()
        {
            progress.at(k, of);
            let flown = match sound(&path) {
                Ok(flown) => flown,
                Err(why) if in_folder => {
                    taken.push(format!("left out: {why:#}"));
                    continue;
                }
                Err(why) => return Err(why),
            };
            // The flights that are judged may lie beside those that they are judged by, and a flight counts once.
            let judged = first.into_iter().chain(others);
            let before = if is_first { &given } else { &accepted.held_out };
            let known = again(&flown, judged, "is judged");
            if let Some(why) = known.or_else(|| again(&flown, before, "was given already")) {
                taken.push(why);
                let on_first = first.is_some_and(|first| same_flight(&flown, first).is_ok());
                accepted.copies += usize::from(is_first && on_first);
                continue;
            }
            if !is_first {
                taken.push(format!("held-out reference: {}", path.display()));
                accepted.held_out.push(flown);
                continue;
            }
            given.push(flown.clone());
            let fits = first.map_or(Ok(()), |first| same_flight(&flown, first));
            let of_others = || others.iter().any(|other| same_flight(&flown, other).is_ok());
            match fits {
                Ok(()) if first.is_some() => {
                    // On one mission the same flights are behind the verdict and behind the floor of the shrink.
                    if of_others() {
                        taken.push(format!("reference, also held out: {}", path.display()));
                        accepted.held_out.push(flown.clone());
                    } else {
                        taken.push(format!("reference: {}", path.display()));
                    }
                    accepted.first.push(flown);
                }
                _ if (in_folder || first.is_none()) && of_others() => {
                    taken.push(format!("held-out reference: {}", path.display()));
                    accepted.held_out.push(flown);
                }
                Err(why) if in_folder => taken.push(format!("left out: {why:#}")),
                Err(why) => return Err(why),
                Ok(()) => taken.push(format!(
                    "left out: {}: flew another mission than the logs to judge on",
                    path.display()
                )),
            }
        }
        progress.at(of, of);
        if !others.is_empty() && self.any() && accepted.held_out.is_empty() {
            taken.push(
                "no accepted flight on the mission of a log to judge on: the floor of the shrink is the simulator's; give \
                 some as --held-out-reference"
                    .to_owned(),
            );
        }
        for line in taken {
            eprintln!("{line}");
        }
        Ok(accepted)
    }
}

/// Accepted flights of one mission: logs, or folders of them. The mission is that of the first; of a folder the flights of another are
/// left out, and it is said.
pub(super) fn of_one_mission(names: &[PathBuf]) -> anyhow::Result<Vec<Flown>> {
    let named = found(names)?;
    let of = named.len();
    let progress = Progress::new("reference flights");
    let mut flights: Vec<Flown> = Vec::new();
    for (k, Found { path, in_folder }) in named.into_iter().enumerate() {
        progress.at(k, of);
        let read = sound(&path).and_then(|flown| {
            flights.first().map_or(Ok(()), |first| same_flight(&flown, first)).map(|()| flown)
        });
        match read {
            Ok(flown) => match again(&flown, &flights, "was given already") {
                Some(why) => eprintln!("{why}"),
                None => flights.push(flown),
            },
            Err(why) if in_folder => eprintln!("left out: {why:#}"),
            Err(why) => return Err(why),
        }
    }
    progress.at(of, of);
    Ok(flights)
}

/// That this log is of the flight of another, which is judged or was given already; `None`: it is of none.
fn again<'a>(
    flown: &Flown,
    others: impl IntoIterator<Item = &'a Flown>,
    what: &str,
) -> Option<String> {
    let other = others.into_iter().find(|other| other.is_of_the_flight_of(flown))?;
    let (path, other) = (flown.path.display(), other.path.display());
    Some(format!("not counted: {path}: is the flight of {other}, which {what}"))
}

/// Refuses logs of which two are of one flight: what is judged on flights that were fitted says nothing, and twice the same says it
/// once.
pub(super) fn each_once(flights: &[&Flown]) -> anyhow::Result<()> {
    for (k, flown) in flights.iter().enumerate() {
        if let Some(why) = again(flown, flights[..k].iter().copied(), "was given already") {
            anyhow::bail!("{why}; leave it out");
        }
    }
    Ok(())
}

/// A log that can stand for a good flight.
fn sound(path: &Path) -> anyhow::Result<Flown> {
    let flown = logs::read(path)?;
    match flown.faults.first() {
        Some(fault) => anyhow::bail!("{}: no reference: {fault}", path.display()),
        None => {
            tell(path, flown.flight);
            Ok(flown)
        }
    }
}

/// The logs among these names, those of a folder by name.
fn found(names: &[PathBuf]) -> anyhow::Result<Vec<Found>> {
    let mut all = Vec::new();
    for name in names {
        if !name.is_dir() {
            all.push(Found { path: name.clone(), in_folder: false });
            continue;
        }
        let entries = std::fs::read_dir(name).with_context(|| name.display().to_string())?;
        let mut paths: Vec<PathBuf> = entries
            .flatten()
            .map(|entry| entry.path())
            .filter(|path| has_log_ending(path))
            .collect();
        if paths.is_empty() {
            anyhow::bail!("{}: no log (*.mcap) lies there", name.display());
        }
        paths.sort();
        all.extend(paths.into_iter().map(|path| Found { path, in_folder: true }));
    }
    Ok(all)
}
