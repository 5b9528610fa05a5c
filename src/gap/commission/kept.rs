//! The vehicle that a diagnosis flies: that of the file where accepted flights are as its flights are, else the one that they were
//! commissioned to. It is kept as a vehicle file beside the banks, under a hash of file, accepted flights, room, mission and program.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use haltere_log::{intake, written};
use haltere_model::Vehicle;
use serde::Serialize;

use super::begun::begun;
use super::constants::{CONSTANTS, Constant};
use super::crossed::{BENIGN_FLIGHTS, judge_as_is};
use super::{
    Hand, LEAST_FLIGHTS, LEAST_FLOWN, MEAN_FLIGHTS, NotCommissioned, commission_by, moved_far,
    observed, seeds, why_not_yet,
};
use crate::bank::archive::Shelf;
use crate::bank::bank_file::{Row, from_disk, to_disk};
use crate::bank::kept_file::Kind;
use crate::flight::logs::Flown;
use crate::flight::trace::Trace;
use crate::nominal::Nominal;
use crate::scene::Scene;

/// Flights that show whether the file will do: as many as the means and limits of commissioning are of.
const FLIGHTS_AS_IS: usize = MEAN_FLIGHTS + BENIGN_FLIGHTS;
const AS_IS: Kind = Kind { what: "flights of the file", magic: b"HALTASIS", version: 1 };
/// Constants that are listed in words.
const SHOWN: usize = 4;
/// Largest vehicle file that is read, bytes: some hundred times one.
const MOST_BYTES: u64 = 1 << 20;

/// A vehicle as accepted flights show it, where they are not as flights of its file are.
#[derive(Debug, Clone, Serialize)]
pub struct Fitted {
    /// The vehicle.
    pub vehicle: Vehicle,
    /// Its file among the banks.
    pub file: PathBuf,
    /// Constants that moved by more than their prior's sigma, the farthest first; of one that was begun with all that were taken.
    pub moved: Vec<Moved>,
}

/// A constant that moved.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Moved {
    /// Key in the vehicle file, with its axis.
    pub key: &'static str,
    /// As the user's file says.
    pub file: f64,
    /// As found.
    pub value: f64,
    /// By how many sigma of its prior.
    pub sigmas: f64,
}

impl Fitted {
    fn of(file: &Vehicle, vehicle: Vehicle, kept: PathBuf) -> Self {
        let is_begun = vehicle.commissioned.flights == 0;
        let row = |constant: &Constant| {
            let (of_file, value) = (constant.value(file), constant.value(&vehicle));
            let sigmas = constant.sigmas(file, value);
            Moved { key: constant.key, file: of_file, value, sigmas }
        };
        let mut moved: Vec<Moved> =
            CONSTANTS.iter().map(row).filter(|m| is_begun || moved_far(m.sigmas)).collect();
        moved.retain(|m| m.value != m.file);
        moved.sort_by(|a, b| b.sigmas.abs().total_cmp(&a.sigmas.abs()));
        Self { vehicle, file: kept, moved }
    }

    /// In words, for a report.
    pub fn words(&self) -> String {
        let shown = |m: &Moved| format!("{} {:.3} (file {:.3})", m.key, m.value, m.file);
        let far: Vec<String> = self.moved.iter().take(SHOWN).map(shown).collect();
        let far = match (far.is_empty(), self.moved.len().saturating_sub(SHOWN)) {
            (true, _) => "no constant moved by more than its prior's sigma".to_owned(),
            (false, 0) => far.join(", "),
            (false, more) => format!("{}, and {more} more", far.join(", ")),
        };
        if self.vehicle.commissioned.flights == 0 {
            return format!(
                "the simulator does not fly this mission with the vehicle file; it was begun with what the log itself shows: {far}; \
                 that vehicle is kept in {}: name the file of your own (--vehicle), or let `haltere gap budget` say what else differs",
                self.file.display()
            );
        }
        format!(
            "the simulator of the vehicle file does not fly as the accepted flights do; it was commissioned to {} of them first: {far}; \
             that vehicle is kept in {}, and `haltere gap commission` says how near it comes",
            self.vehicle.commissioned.flights,
            self.file.display()
        )
    }
}

/// The vehicle as accepted flights of one mission show it; `None`: as its file says, which they do not contradict, or which was commissioned
/// already, or of which too few flights were given to say. `folder`: where banks lie; `progress`: done, of how many.
pub fn fitted(
    folder: &Path,
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    accepted: &[Flown],
    progress: impl Fn(usize, usize) + Sync,
) -> Result<Option<Fitted>, NotCommissioned> {
    let traces: Vec<&Trace> = accepted.iter().map(|flown| &flown.trace).collect();
    fitted_to(folder, scene, items, &traces, &progress)
}

/// The vehicle to begin with where the bank of a mission is not flown with the file as it is, by flights of that mission; `None`: they
/// give none that flies.
pub fn begun_with(
    folder: &Path,
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    flights: &[&Trace],
) -> Option<Fitted> {
    let vehicle = begun(scene, items, flights)?;
    let kept = folder.join(format!("{}.toml", scene.key(items, &format!("{vehicle:?}"))));
    remember(&kept, &vehicle);
    Some(Fitted::of(&scene.vehicle, vehicle, kept))
}

fn fitted_to(
    folder: &Path,
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    accepted: &[&Trace],
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Option<Fitted>, NotCommissioned> {
    let file = &scene.vehicle;
    if accepted.len() < LEAST_FLIGHTS || file.commissioned.flights > 0 {
        return Ok(None);
    }
    let seen = observed(accepted, LEAST_FLIGHTS, &Nominal::of_scene(scene))?;
    let kept = folder.join(format!("{}.toml", scene.key(items, &format!("{seen:?}"))));
    let vehicle = match recall(&kept) {
        Some(vehicle) => vehicle,
        None => {
            let vehicle = found(folder, scene, items, accepted, &seen, progress)?;
            remember(&kept, &vehicle);
            vehicle
        }
    };
    let commissioned = vehicle.commissioned.flights > 0;
    Ok(commissioned.then(|| Fitted::of(file, vehicle, kept)))
}

/// The vehicle of the file if its simulator keeps the limits, or if commissioning brings it no nearer.
fn found(
    folder: &Path,
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    accepted: &[&Trace],
    seen: &[Vec<f64>],
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Vehicle, NotCommissioned> {
    let file = &scene.vehicle;
    let hand = Hand::of(&CONSTANTS, scene, items, accepted.len(), progress);
    let hand = Hand { of: FLIGHTS_AS_IS + hand.of, ..hand };
    let nominal = hand.nominal(file);
    let as_is = || {
        [(MEAN_FLIGHTS, false), (BENIGN_FLIGHTS, true)]
            .map(|(flights, jitter)| hand.rows(file, &nominal, &seeds(flights), jitter))
    };
    // They are the same whichever flights were accepted.
    let flown: BTreeMap<u64, Option<Row>> =
        Shelf::in_folder(folder).kept(AS_IS, scene, items, || {
            as_is();
            hand.known().iter().map(|(key, row)| (*key, row.as_deref().map(to_disk))).collect()
        });
    hand.known().extend(flown.into_iter().map(|(key, row)| (key, row.map(from_disk))));
    hand.done.store(0, Ordering::Relaxed);
    let [own, benign] = as_is();
    let flies = own.len() >= LEAST_FLOWN && benign.len() * 2 > BENIGN_FLIGHTS;
    if flies && why_not_yet(&judge_as_is(&own, &benign, seen).blocks).is_none() {
        return Ok(file.clone());
    }
    let found = commission_by(&hand, accepted)?;
    // Of a file that is not flown there is no before.
    let nearer = found.whole.before.is_nan() || found.whole.after < found.whole.before;
    Ok(if nearer { found.vehicle } else { file.clone() })
}

/// What was kept; a file that is not there is as none, and so is one that cannot be read, which is said.
fn recall(path: &Path) -> Option<Vehicle> {
    if !path.exists() {
        return None;
    }
    let read = intake::text(path, MOST_BYTES).map_err(|e| e.to_string());
    let read = read.and_then(|text| Vehicle::from_toml(&text).map_err(|e| e.to_string()));
    read.inspect_err(|why| tracing::warn!("{}: {why}; found anew", path.display())).ok()
}

/// Keeps it. What cannot be written costs time the next time and nothing now, and is said.
fn remember(path: &Path, vehicle: &Vehicle) {
    if let Some(folder) = path.parent() {
        // Where it cannot be made, writing says why.
        let _ = std::fs::create_dir_all(folder);
    }
    let text = toml::to_string(vehicle).map_err(|e| e.to_string());
    let written =
        text.and_then(|text| written::write::<&Path>(path, text, &[]).map_err(|e| e.to_string()));
    if let Err(why) = written {
        tracing::warn!("{}: {why}; this will be found again next time", path.display());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::fly::fly_observed;
    use crate::bank::missions;

    #[test]
    fn prop_the_file_is_left_alone_where_it_will_do_and_what_was_kept_is_taken() {
        let scene = Scene::lab().unwrap();
        let items = missions::plain(&scene);
        let fly = |k| fly_observed(&scene, &items, scene.plant(300 + k), scene.pilot.clone());
        let traces: Vec<Trace> = (0..LEAST_FLIGHTS as u64).map(|k| fly(k).unwrap()).collect();
        let accepted: Vec<&Trace> = traces.iter().collect();
        let folder = tempfile::tempdir().unwrap();
        let ask = |scene: &Scene, accepted: &[&Trace]| {
            fitted_to(folder.path(), scene, &items, accepted, &|_, _| ()).unwrap()
        };
        assert!(ask(&scene, &accepted[1..]).is_none(), "too few to say");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(ask(&scene, &accepted).is_none(), "flown by the file's own vehicle");
        let mut files = std::fs::read_dir(folder.path()).unwrap().map(|file| file.unwrap().path());
        let kept = files.find(|path| path.extension().is_some_and(|end| end == "toml")).unwrap();
        let read = || Vehicle::from_toml(&std::fs::read_to_string(&kept).unwrap()).unwrap();
        assert_eq!(read(), scene.vehicle);
        // As if the flights had shown another resistance.
        let mut shown = scene.vehicle.clone();
        shown.commissioned.flights = 8;
        shown.battery.resistance_ohm *= 3.0;
        remember(&kept, &shown);
        let found = ask(&scene, &accepted).unwrap();
        assert_eq!((&found.vehicle, &found.file), (&shown, &kept));
        let keys: Vec<&str> = found.moved.iter().map(|m| m.key).collect();
        assert_eq!(keys, ["battery.resistance_ohm"]);
        assert!(
            found.words().contains("battery.resistance_ohm 0.") && found.words().contains(".toml")
        );
        // Given as the vehicle file it is not found anew, from other flights neither.
        assert!(ask(&Scene { vehicle: shown, ..scene.clone() }, &accepted).is_none());
        std::fs::write(&kept, "[body]\nmass").unwrap();
        assert!(ask(&scene, &accepted).is_none(), "a damaged one is found anew");
        assert_eq!(read(), scene.vehicle);
    }
}
