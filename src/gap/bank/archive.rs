//! Flights of one scene and mission that every diagnosis flies alike, kept so that they are flown once: those of
//! the healthy vehicle and of effects in the middle of their range, on the missions of the experiments.
//!
//! An archive is a cache: one that cannot be read or written costs time and no answer.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use rayon::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::bank::bank_file::{Row, from_disk, to_disk};
use crate::bank::fly::fly_observed_into;
use crate::bank::jitter::jittered;
use crate::bank::kept_file::{self, Kind};
use crate::bank::library::with_effect;
use crate::flight::statistics::statistics_of;
use crate::flight::trace::Trace;
use crate::nominal::Nominal;
use crate::scene::Scene;
use haltere_model::effects::EffectSpec;

const KIND: Kind = Kind { what: "archive of flights", magic: b"HALTFLYS", version: 1 };

/// A flight.
#[derive(Debug, Clone)]
pub struct Job {
    /// Seed.
    pub seed: u64,
    /// Whether it has benign jitter.
    pub jitter: bool,
    /// Effect with its parameters, in the order of its specification.
    pub effect: Option<(&'static EffectSpec, Vec<f64>)>,
}

/// Statistics of flights that were flown; `None`: lost.
type Rows = BTreeMap<String, Option<Vec<f64>>>;

#[derive(Serialize, Deserialize)]
struct OnDisk {
    flights: BTreeMap<String, Option<Row>>,
}

/// Where the archives of all missions lie.
#[derive(Debug, Clone)]
pub struct Shelf {
    folder: Option<PathBuf>,
}

impl Shelf {
    /// In a folder, which is made when something is to be kept.
    pub fn in_folder(folder: &Path) -> Self {
        Self { folder: Some(folder.to_owned()) }
    }

    /// Nothing is kept.
    pub fn none() -> Self {
        Self { folder: None }
    }

    fn path(&self, scene: &Scene, items: &[MISSION_ITEM_INT_DATA], what: &str) -> Option<PathBuf> {
        let folder = self.folder.as_ref()?;
        Some(folder.join(format!("{}.flights", scene.key(items, what))))
    }

    /// Of a mission what goes by a name: as it was kept, or made and kept.
    pub(crate) fn kept<T: Serialize + DeserializeOwned>(
        &self,
        kind: Kind,
        scene: &Scene,
        items: &[MISSION_ITEM_INT_DATA],
        make: impl FnOnce() -> T,
    ) -> T {
        let path = self.path(scene, items, kind.what);
        let kept = path.as_deref().and_then(|path| kept_file::recall(kind, path));
        kept.unwrap_or_else(|| {
            let made = make();
            if let Some(path) = path {
                kept_file::remember(kind, &path, &made);
            }
            made
        })
    }

    /// What was kept of a mission.
    pub fn open<'a>(&self, scene: &'a Scene, items: &'a [MISSION_ITEM_INT_DATA]) -> Archive<'a> {
        let path = self.path(scene, items, "archive");
        let kept = path.as_deref().and_then(|path| kept_file::recall::<OnDisk>(KIND, path));
        let rows: Rows = kept.map_or_else(Rows::new, |disk| {
            disk.flights.into_iter().map(|(key, row)| (key, row.map(from_disk))).collect()
        });
        Archive { scene, items, path, rows, grown: false }
    }
}

/// Flights of one scene and mission.
#[derive(Debug)]
pub struct Archive<'a> {
    scene: &'a Scene,
    items: &'a [MISSION_ITEM_INT_DATA],
    path: Option<PathBuf>,
    rows: Rows,
    grown: bool,
}

impl Archive<'_> {
    /// Statistics of these flights, in their order, `None` for lost ones; flies those that were not kept, and
    /// remembers them. `tick` hears of every flight.
    pub fn fly(&mut self, jobs: &[Job], tick: &(impl Fn() + Sync)) -> Vec<Option<Vec<f64>>> {
        let keys: Vec<String> = jobs.iter().map(key).collect();
        let known = |key: &String| self.rows.contains_key(key);
        let new: Vec<(&String, &Job)> = keys.iter().zip(jobs).filter(|(k, _)| !known(k)).collect();
        (new.len()..jobs.len()).for_each(|_| tick());
        let wanted: Vec<Job> = new.iter().map(|(_, job)| (*job).clone()).collect();
        let flown = fly(self.scene, self.items, &wanted, tick);
        let flown: Rows = new.into_iter().map(|(key, _)| key.clone()).zip(flown).collect();
        self.grown |= !flown.is_empty();
        self.rows.extend(flown);
        keys.iter().map(|key| self.rows.get(key)?.clone()).collect()
    }

    /// Writes what is new.
    pub fn keep(&self) {
        let Some(path) = self.path.as_deref().filter(|_| self.grown) else { return };
        let flights = self.rows.iter().map(|(k, row)| (k.clone(), row.as_deref().map(to_disk)));
        let disk = OnDisk { flights: flights.collect() };
        kept_file::remember(KIND, path, &disk);
    }
}

/// Statistics of flights, on all cores; `None`: could not be flown or observed.
pub fn fly(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    jobs: &[Job],
    tick: &(impl Fn() + Sync),
) -> Vec<Option<Vec<f64>>> {
    let nominal = Nominal::of_scene(scene);
    jobs.par_iter()
        .map_init(
            || Trace::new(scene.survey.clone()),
            |trace, job| {
                let row = (|| {
                    let mut plant = scene.plant(job.seed);
                    if job.jitter {
                        plant = jittered(plant).ok()?;
                    }
                    if let Some((spec, theta)) = &job.effect {
                        plant.effects = with_effect(plant.effects, spec, theta).ok()?;
                    }
                    fly_observed_into(trace, scene, items, plant, scene.pilot.clone()).ok()?;
                    statistics_of(trace, &nominal).ok()
                })();
                tick();
                row
            },
        )
        .collect()
}

/// Everything that tells flights of one scene and mission apart. Debug output of numbers is exact.
fn key(job: &Job) -> String {
    let jitter = if job.jitter { "" } else { " without jitter" };
    match &job.effect {
        None => format!("{}{jitter}", job.seed),
        Some((spec, theta)) => format!("{}{jitter} {} {theta:?}", job.seed, spec.id),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use super::*;
    use crate::bank::{library, missions};

    #[test]
    fn prop_kept_flights_are_not_flown_again_and_are_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let shelf = Shelf::in_folder(folder.path());
        let scene = Scene::lab().unwrap();
        let items = missions::plain(&scene);
        let p1 = library::whole().into_iter().find(|s| s.id == "P1").unwrap();
        let theta = p1.parameters.iter().map(|p| p.default).collect();
        let job = |seed, jitter, effect| Job { seed, jitter, effect };
        let jobs = [job(7, true, None), job(7, false, None), job(8, true, Some((p1, theta)))];
        let ticks = AtomicUsize::new(0);
        let tick = || {
            ticks.fetch_add(1, Ordering::Relaxed);
        };
        let mut first = shelf.open(&scene, &items);
        let flown = first.fly(&jobs, &tick);
        first.keep();
        let mut second = shelf.open(&scene, &items);
        assert_eq!(second.rows.len(), 3);
        let kept = second.fly(&jobs, &tick);
        // NaN differs from itself: compare as text.
        assert_eq!(format!("{kept:?}"), format!("{flown:?}"));
        assert_ne!(format!("{:?}", kept[0]), format!("{:?}", kept[1]), "jitter is something");
        assert!(!second.grown && ticks.into_inner() == 6, "told of kept flights too");
        // Another mission has another archive; a damaged one is as none.
        assert!(shelf.open(&scene, &missions::diagnostic(&scene)).rows.is_empty());
        let path = second.path.clone().unwrap();
        std::fs::write(&path, b"HALTFLYS").unwrap();
        assert!(shelf.open(&scene, &items).rows.is_empty());
    }
}
