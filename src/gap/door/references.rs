//! Accepted flights of an airframe, given as people have them: log by log, or a folder of them.

use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::asked::{Audience, References, Refused, refuse, say_which};
use crate::flight::logs::{self, Flown};
use haltere_log::log_file::has_log_ending;
use haltere_log::replay::ReplayError;

/// Accepted flights, by what they are compared with.
#[derive(Debug, Default)]
pub struct Accepted {
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
        !self.same_mission.is_empty() || !self.held_out.is_empty()
    }
}

/// Reads them. A log that was named and does not fit is an error; one of a folder is left out.
///
/// # Errors
/// [`Refused`].
pub fn read(
    references: &References,
    first: Option<&Flown>,
    others: &[Flown],
    audience: &dyn Audience,
) -> Result<Accepted, Refused> {
    let mut accepted = Accepted::default();
    let (mut named, held_out) = (found(&references.same_mission)?, found(&references.held_out)?);
    let (firsts, of) = (named.len(), named.len() + held_out.len());
    named.extend(held_out);
    let mut taken = Vec::new();
    let mut given: Vec<Flown> = Vec::new();
    for (k, (Found { path, in_folder }, read)) in all_read(named).enumerate() {
        let is_first = k < firsts;
        audience.at("reference flights", k, of);
        let flown = match sound(&path, read, audience) {
            Ok(flown) => flown,
            Err(why) if in_folder => {
                taken.push(format!("left out: {why}"));
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
            Err(why) if in_folder => taken.push(format!("left out: {why}")),
            Err(why) => return Err(why),
            Ok(()) => taken.push(format!(
                "left out: {}: flew another mission than the logs to judge on",
                path.display()
            )),
        }
    }
    audience.at("reference flights", of, of);
    if !others.is_empty() && references.any() && accepted.held_out.is_empty() {
        taken.push(
                "no accepted flight on the mission of a log to judge on: the floor of the shrink is the simulator's; give \
                 some as --held-out-reference"
                    .to_owned(),
            );
    }
    for line in taken {
        audience.say(&line);
    }
    Ok(accepted)
}

/// Accepted flights of one mission: logs, or folders of them. The mission is that of the first; of a folder the flights of another are
/// left out, and it is said.
///
/// # Errors
/// [`Refused`].
pub fn of_one_mission(names: &[PathBuf], audience: &dyn Audience) -> Result<Vec<Flown>, Refused> {
    let named = found(names)?;
    let of = named.len();
    let mut flights: Vec<Flown> = Vec::new();
    for (k, (Found { path, in_folder }, read)) in all_read(named).enumerate() {
        audience.at("reference flights", k, of);
        let read = sound(&path, read, audience).and_then(|flown| {
            flights.first().map_or(Ok(()), |first| same_flight(&flown, first)).map(|()| flown)
        });
        match read {
            Ok(flown) => match again(&flown, &flights, "was given already") {
                Some(why) => audience.say(&why),
                None => flights.push(flown),
            },
            Err(why) if in_folder => audience.say(&format!("left out: {why}")),
            Err(why) => return Err(why),
        }
    }
    audience.at("reference flights", of, of);
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
///
/// # Errors
/// The names of both.
pub fn each_once(flights: &[&Flown]) -> Result<(), Refused> {
    for (k, flown) in flights.iter().enumerate() {
        if let Some(why) = again(flown, flights[..k].iter().copied(), "was given already") {
            return refuse(format!("{why}; leave it out"));
        }
    }
    Ok(())
}

/// Reads logs, in their order and so many at a time as there are cores: a flight takes 30 MB.
fn all_read(found: Vec<Found>) -> impl Iterator<Item = (Found, Result<Flown, ReplayError>)> {
    let mut left = found.into_iter();
    let some = move || {
        let some: Vec<Found> = left.by_ref().take(rayon::current_num_threads()).collect();
        let read = |found: Found| {
            let flown = logs::read(&found.path);
            (found, flown)
        };
        (!some.is_empty()).then(|| some.into_par_iter().map(read).collect::<Vec<_>>())
    };
    std::iter::from_fn(some).flatten()
}

/// A log that can stand for a good flight.
fn sound(
    path: &Path,
    read: Result<Flown, ReplayError>,
    audience: &dyn Audience,
) -> Result<Flown, Refused> {
    let flown = read?;
    match flown.faults.first() {
        Some(fault) => refuse(format!("{}: no reference: {fault}", path.display())),
        None => {
            say_which(audience, path, flown.flight);
            Ok(flown)
        }
    }
}

/// The logs among these names, those of a folder by name.
fn found(names: &[PathBuf]) -> Result<Vec<Found>, Refused> {
    let mut all = Vec::new();
    for name in names {
        if !name.is_dir() {
            all.push(Found { path: name.clone(), in_folder: false });
            continue;
        }
        let entries = std::fs::read_dir(name)
            .map_err(|source| Refused::Given(format!("{}: {source}", name.display())))?;
        let mut paths: Vec<PathBuf> = entries
            .flatten()
            .map(|entry| entry.path())
            .filter(|path| has_log_ending(path))
            .collect();
        if paths.is_empty() {
            return refuse(format!("{}: no log (*.mcap) lies there", name.display()));
        }
        paths.sort();
        all.extend(paths.into_iter().map(|path| Found { path, in_folder: true }));
    }
    Ok(all)
}

/// Two logs can stand beside one another only on one mission among the same anchors.
pub(super) fn same_flight(one: &Flown, other: &Flown) -> Result<(), Refused> {
    // Where it is flown to; a companion may be addressed in another way.
    let items = |f: &Flown| -> Vec<_> {
        f.mission
            .iter()
            .map(|i| (i.command, i.x, i.y, i.z.to_bits(), i.param1.to_bits(), i.param2.to_bits()))
            .collect()
    };
    if items(one) != items(other) {
        return refuse(format!(
            "{}: flew another mission ({} items) than {} ({} items); compare flights of one mission",
            one.path.display(),
            one.mission.len(),
            other.path.display(),
            other.mission.len()
        ));
    }
    same_survey(one, other)
}

/// Two logs among the same anchors.
///
/// # Errors
/// The names of both, where they are not.
pub fn same_survey(one: &Flown, other: &Flown) -> Result<(), Refused> {
    if one.trace.survey != other.trace.survey {
        return refuse(format!(
            "{}: was flown with another anchor survey than {}; diagnose each survey by itself",
            one.path.display(),
            other.path.display()
        ));
    }
    Ok(())
}
