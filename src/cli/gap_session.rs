//! What `gap diagnose`, `gap advise` and `gap shrink` begin with: a log through gate 0, the bank of its
//! mission, reference flights, and what was learned.

use std::path::{Path, PathBuf};

use super::gap::{BankOptions, SceneOptions};
use super::gap_references::{Accepted, References, each_once};
use super::which_flight::{WhichFlight, tell};
use crate::progress::Progress;
use haltere_gap::attribute::{Attributor, Settings};
use haltere_gap::bank::workshop::{Workshop, WorkshopError};
use haltere_gap::commission::{Fitted, NotCommissioned, begun_with, fitted, not_yet};
use haltere_gap::diagnosis::{Diagnosis, Observed, judge, observed, unreadable};
use haltere_gap::flight::logs::{self, Flown};
use haltere_gap::nominal::Nominal;
use haltere_gap::picture::details::{Details, details};
use haltere_gap::scene::{Scene, Told};
use haltere_gap::shrink::held_out::{Explanation, HeldOut, resize_all};
use haltere_log::record::LogError;
use haltere_log::replay::ReplayError;
use haltere_model::Vehicle;

/// Fewest reference flights that say anything about a spread.
const LEAST_REFERENCES: usize = 8;

/// A log that can be judged, and everything to judge it by.
pub(super) struct Session {
    /// What the user said, with the vehicle that is flown.
    pub told: Told,
    /// The vehicle of the file.
    pub file: Vehicle,
    /// The vehicle that is flown, where accepted flights had to say it, or the flight itself.
    pub fitted: Option<Fitted>,
    pub scene: Scene,
    pub workshop: Workshop,
    pub attributor: Attributor,
    pub seen: Observed,
    /// The other logs: flights that the fit does not see.
    pub others: Vec<Flown>,
    /// Accepted flights of the airframe on this mission.
    pub references: Vec<Vec<f64>>,
    /// Details of the same.
    pub reference_details: Vec<Details>,
    /// Accepted flights of the airframe on missions of the others.
    pub held_out_references: Vec<Flown>,
}

/// A log may also be none of ours.
pub(super) enum Opened {
    /// It can be judged.
    Ready(Box<Session>),
    /// It cannot: verdict of a fault.
    Fault(Box<Diagnosis>),
}

/// Opens a log. Gate 0 comes before any bank is flown.
pub(super) fn open(
    log: &Path,
    flight: WhichFlight,
    others: &[PathBuf],
    references: &References,
    told: &SceneOptions,
    options: &BankOptions,
) -> anyhow::Result<Opened> {
    let mut told = told.told()?;
    let library = options.library()?;
    let name = log.display().to_string();
    let fault = |flight, why: String| {
        let mut diagnosis = unreadable(name.clone(), why);
        diagnosis.flight = flight;
        Ok(Opened::Fault(Box::new(diagnosis)))
    };
    let flown = match logs::read_flight(log, flight.number()) {
        Ok(flown) => flown,
        // A name or a number that was typed wrongly is no verdict on a flight.
        Err(
            error @ ReplayError::Log(
                LogError::Io { .. } | LogError::NotMcap { .. } | LogError::NoSuchFlight { .. },
            ),
        ) => return Err(error.into()),
        Err(error) => return fault(None, error.to_string()),
    };
    if let Some(why) = flown.faults.first() {
        return fault(flown.flight, why.clone());
    }
    if flown.mission.is_empty() {
        anyhow::bail!(
            "{name}: no mission in this log; only a flight that can be flown again can be compared"
        );
    }
    // Before anything long: flights that cannot stand beside this one.
    let others = others.iter().map(|path| logs::read(path)).collect::<Result<Vec<_>, _>>()?;
    for other in &others {
        tell(&other.path, other.flight);
        same_survey(other, &flown)?;
    }
    each_once(&std::iter::once(&flown).chain(&others).collect::<Vec<_>>())?;
    let Accepted { first, held_out, copies } = references.read(Some(&flown), &others)?;
    if (copies > 0 || !first.is_empty()) && first.len() < LEAST_REFERENCES {
        let copies = match copies {
            0 => String::new(),
            n => format!(", beside {n} logs of a flight that is judged or was given already"),
        };
        anyhow::bail!(
            "{} reference flights on the mission of {name}{copies}; at least {LEAST_REFERENCES} needed, 20 are better",
            first.len()
        );
    }
    let until_s = flown.scene(&told).until_s;
    if let Some(early) = first.iter().find(|flown| !flown.trace.came_as_far_as(until_s)) {
        anyhow::bail!("{}: no reference: its mission ended too early", early.path.display());
    }
    let file = told.vehicle.clone();
    let mut fitted = vehicle_of(&first, &told, &options.folder())?;
    if let Some(fitted) = &fitted {
        told.vehicle = fitted.vehicle.clone();
    }
    let mut scene = flown.scene(&told).for_bank(&flown.mission);
    let progress = Progress::new("bank");
    let bank_of = |scene: &Scene| {
        let (scene, items) = (scene.clone(), flown.mission.clone());
        let tell = |done, of| progress.at(done, of);
        Workshop::open(&options.folder(), scene, items, library.clone(), options.size(), tell)
    };
    let workshop = match bank_of(&scene) {
        Err(not_flown @ WorkshopError::NotFlown { .. }) => {
            let flights: Vec<_> = std::iter::once(&flown.trace).collect();
            let Some(begun) = begun_with(&options.folder(), &scene, &flown.mission, &flights)
            else {
                return Err(not_flown.into());
            };
            told.vehicle = begun.vehicle.clone();
            scene.vehicle = begun.vehicle.clone();
            fitted = Some(begun);
            bank_of(&scene)?
        }
        workshop => workshop?,
    };
    let (references, reference_details) = accepted(first, &workshop.nominal)?;
    let settings = Settings::for_flights();
    let progress = Progress::new("learning the bank");
    let attributor = workshop.learn(&references, &[], &settings, || progress.at(0, 1))?;
    progress.at(1, 1);
    let seen = observed(flown, &workshop.nominal);
    let session = Session {
        told,
        file,
        fitted,
        scene,
        workshop,
        attributor,
        seen,
        others,
        references,
        reference_details,
        held_out_references: held_out,
    };
    Ok(Opened::Ready(Box::new(session)))
}

/// The vehicle as accepted flights show it, where they are not as those of its file are.
fn vehicle_of(accepted: &[Flown], told: &Told, folder: &Path) -> anyhow::Result<Option<Fitted>> {
    let Some(first) = accepted.first() else { return Ok(None) };
    let scene = first.scene(told).for_bank(&first.mission);
    let progress = Progress::new("commissioning");
    let tell = |done, of| progress.at(done, of);
    match fitted(folder, &scene, &first.mission, accepted, tell) {
        // The bank says which number of the file they fail by.
        Err(NotCommissioned::NotFlown { .. }) => Ok(None),
        found => Ok(found?),
    }
}

impl Session {
    /// The verdict.
    pub fn judge(&self) -> Diagnosis {
        let mut diagnosis =
            judge(&self.workshop, &self.attributor, self.references.len(), &self.seen);
        diagnosis.remarks.extend(self.fitted.as_ref().map(Fitted::words));
        diagnosis.commissioned.clone_from(&self.fitted);
        let not_yet = not_yet(&self.workshop.bank, &self.references);
        diagnosis.remarks.extend(not_yet.map(|why| {
            // Where they were found already, a constant more is no way out.
            match self.told.vehicle.commissioned.flights {
                0 => format!(
                    "{why}: `haltere gap commission` finds the constants of the vehicle file by them"
                ),
                _ => why,
            }
        }));
        diagnosis
    }

    /// Searches the sizes of explanations in closed loop on this flight, and says what was found of the
    /// first.
    pub fn resize(&self, explanations: &mut [&mut Explanation]) {
        let Ok(observation) = &self.seen.observation else { return };
        let model = HeldOut::new(&self.scene, &self.workshop.items, &self.references);
        let progress = Progress::new("sizes");
        let name = explanations.first().map(|e| e.name.clone()).unwrap_or_default();
        let shares = resize_all(&model, &observation.statistics, explanations, |done, of| {
            progress.at(done, of);
        });
        match shares.first() {
            Some(0.0) => {
                eprintln!("{name}: makes the simulator no more like this flight at any size")
            }
            Some(share) => eprintln!("{name}: flown at {share:.2} of the size that the bank says"),
            None => {}
        }
    }
}

/// Statistics and details of accepted flights of one mission.
fn accepted(
    flights: Vec<Flown>,
    nominal: &Nominal,
) -> anyhow::Result<(Vec<Vec<f64>>, Vec<Details>)> {
    let (mut rows, mut pictures) = (Vec::new(), Vec::new());
    for reference in flights {
        let path = reference.path.clone();
        pictures.extend(details(&reference.trace, nominal).ok());
        match observed(reference, nominal).observation {
            Ok(observation) => rows.push(observation.statistics),
            Err(why) => anyhow::bail!("{}: {why}", path.display()),
        }
    }
    Ok((rows, pictures))
}

/// Two logs can stand beside one another only on one mission among the same anchors.
pub(super) fn same_flight(one: &Flown, other: &Flown) -> anyhow::Result<()> {
    // Where it is flown to; a companion may be addressed in another way.
    let items = |f: &Flown| -> Vec<_> {
        f.mission
            .iter()
            .map(|i| (i.command, i.x, i.y, i.z.to_bits(), i.param1.to_bits(), i.param2.to_bits()))
            .collect()
    };
    if items(one) != items(other) {
        anyhow::bail!(
            "{}: flew another mission ({} items) than {} ({} items); compare flights of one mission",
            one.path.display(),
            one.mission.len(),
            other.path.display(),
            other.mission.len()
        );
    }
    same_survey(one, other)
}

/// Two logs among the same anchors.
pub(super) fn same_survey(one: &Flown, other: &Flown) -> anyhow::Result<()> {
    if one.trace.survey != other.trace.survey {
        anyhow::bail!(
            "{}: was flown with another anchor survey than {}; diagnose each survey by itself",
            one.path.display(),
            other.path.display()
        );
    }
    Ok(())
}
