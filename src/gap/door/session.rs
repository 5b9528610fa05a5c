//! What a diagnosis begins with: a log through gate 0, the bank of its mission, accepted flights, and what was learned.

use std::path::Path;

use rayon::prelude::*;

use super::asked::{Audience, Flights, References, Refused, Simulator, refuse, say_which};
use super::references::{Accepted, each_once, read, same_survey};
use crate::attribute::{Attributor, Settings};
use crate::balance::beside::beside;
use crate::bank::archive::Shelf;
use crate::bank::workshop::{Workshop, WorkshopError};
use crate::commission::{Fitted, NotCommissioned, begun_with, fitted, not_yet};
use crate::diagnosis::{Diagnosis, Observed, judge, observed, unreadable};
use crate::flight::logs::{self, Flown};
use crate::flight::seal::digest_of;
use crate::flight::timeline::NotObservable;
use crate::nominal::Nominal;
use crate::picture::details::{Details, observed_in_detail};
use crate::scene::{Scene, Told};
use crate::shrink::held_out::{Explanation, HeldOut, resize_all};
use haltere_log::record::LogError;
use haltere_log::replay::ReplayError;
use haltere_model::Vehicle;

/// Fewest reference flights that say anything about a spread.
const LEAST_REFERENCES: usize = 8;

/// A log that can be judged, and everything to judge it by.
#[derive(Debug)]
pub struct Session {
    /// What the user said, with the vehicle that is flown.
    pub told: Told,
    /// The vehicle of the file.
    pub file: Vehicle,
    /// The vehicle that is flown, where accepted flights had to say it, or the flight itself.
    pub fitted: Option<Fitted>,
    /// Room, vehicle and companion of the simulator.
    pub scene: Scene,
    /// The bank of the mission.
    pub workshop: Workshop,
    /// What was learned from it.
    pub attributor: Attributor,
    /// The flight.
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
#[derive(Debug)]
pub enum Opened {
    /// It can be judged.
    Ready(Box<Session>),
    /// It cannot: verdict of a fault.
    Fault(Box<Diagnosis>),
}

/// Opens a log. Gate 0 comes before any bank is flown.
///
/// # Errors
/// [`Refused`].
pub fn open(
    flights: &Flights,
    simulator: &Simulator,
    references: &References,
    audience: &dyn Audience,
) -> Result<Opened, Refused> {
    let mut told = simulator.told.clone();
    let log = &flights.log;
    let name = log.display().to_string();
    let fault = |flight, why: String| {
        let mut diagnosis = unreadable(name.clone(), why);
        diagnosis.flight = flight;
        diagnosis.made_with.log_sha256 = hash_of(log);
        Ok(Opened::Fault(Box::new(diagnosis)))
    };
    let flown = match logs::read_flight(log, flights.flight) {
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
        return refuse(format!(
            "{name}: no mission in this log; only a flight that can be flown again can be compared"
        ));
    }
    // Before anything long: flights that cannot stand beside this one.
    let others: Vec<_> = flights.held_out.par_iter().map(|path| logs::read(path)).collect();
    let others = others.into_iter().collect::<Result<Vec<_>, _>>()?;
    for other in &others {
        say_which(audience, &other.path, other.flight);
        same_survey(other, &flown)?;
    }
    each_once(&std::iter::once(&flown).chain(&others).collect::<Vec<_>>())?;
    let Accepted { first, held_out, copies } = read(references, Some(&flown), &others, audience)?;
    enough(&name, &first, copies)?;
    let until_s = flown.scene(&told).until_s;
    if let Some(early) = first.iter().find(|flown| !flown.trace.came_as_far_as(until_s)) {
        return refuse(format!(
            "{}: no reference: its mission ended too early",
            early.path.display()
        ));
    }
    let file = told.vehicle.clone();
    let mut fitted = vehicle_of(&first, &told, &simulator.folder, audience)?;
    if let Some(fitted) = &fitted {
        told.vehicle = fitted.vehicle.clone();
    }
    let mut scene = flown.scene(&told).for_bank(&flown.mission);
    let bank_of = |scene: &Scene| bank_of(simulator, scene, &flown, audience);
    let workshop = match bank_of(&scene) {
        Err(not_flown @ WorkshopError::NotFlown { .. }) => {
            let flights: Vec<_> = std::iter::once(&flown.trace).collect();
            let Some(begun) = begun_with(&simulator.folder, &scene, &flown.mission, &flights)
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
    let (references, reference_details) = accepted(&first, &workshop.nominal)?;
    drop(first);
    let settings = Settings::for_flights();
    let learning = |done| audience.at("learning the bank", done, 1);
    let attributor = workshop.learn(&references, &[], &settings, || learning(0))?;
    learning(1);
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

/// Few accepted flights say nothing about a spread.
fn enough(name: &str, first: &[Flown], copies: usize) -> Result<(), Refused> {
    if (copies > 0 || !first.is_empty()) && first.len() < LEAST_REFERENCES {
        let copies = match copies {
            0 => String::new(),
            n => format!(", beside {n} logs of a flight that is judged or was given already"),
        };
        return refuse(format!(
            "{} reference flights on the mission of {name}{copies}; at least {LEAST_REFERENCES} needed, 20 are better",
            first.len()
        ));
    }
    Ok(())
}

fn bank_of(
    simulator: &Simulator,
    scene: &Scene,
    flown: &Flown,
    audience: &dyn Audience,
) -> Result<Workshop, WorkshopError> {
    let Simulator { folder, library, size, .. } = simulator;
    let tell = |done, of| audience.at("bank", done, of);
    Workshop::open(folder, scene.clone(), flown.mission.clone(), library.clone(), *size, tell)
}

/// The vehicle as accepted flights show it, where they are not as those of its file are.
fn vehicle_of(
    accepted: &[Flown],
    told: &Told,
    folder: &Path,
    audience: &dyn Audience,
) -> Result<Option<Fitted>, Refused> {
    let Some(first) = accepted.first() else { return Ok(None) };
    let scene = first.scene(told).for_bank(&first.mission);
    let tell = |done, of| audience.at("commissioning", done, of);
    match fitted(folder, &scene, &first.mission, accepted, tell) {
        // The bank says which number of the file they fail by.
        Err(NotCommissioned::NotFlown { .. }) => Ok(None),
        found => Ok(found?),
    }
}

impl Session {
    /// Where flights beside the bank are kept.
    pub(super) fn shelf(&self) -> Shelf {
        self.workshop.folder.as_deref().map_or_else(Shelf::none, Shelf::in_folder)
    }

    /// The verdict.
    pub fn judge(&self) -> Diagnosis {
        let mut diagnosis =
            judge(&self.workshop, &self.attributor, self.references.len(), &self.seen);
        if let Ok(observation) = &self.seen.observation {
            let named = diagnosis.effects.iter().map(|effect| effect.id.as_str());
            let is_gap = diagnosis.outcome.is_gap();
            diagnosis.balance = beside(&observation.statistics, &self.references, is_gap, named);
        }
        diagnosis.remarks.extend(self.fitted.as_ref().map(Fitted::words));
        diagnosis.made_with.log_sha256 = hash_of(&self.seen.flown.path);
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
    pub fn resize(&self, explanations: &mut [&mut Explanation], audience: &dyn Audience) {
        let Ok(observation) = &self.seen.observation else { return };
        let model =
            HeldOut::new(&self.scene, &self.workshop.items, &self.references, &self.shelf());
        let name = explanations.first().map(|e| e.name.clone()).unwrap_or_default();
        let shares = resize_all(&model, &observation.statistics, explanations, |done, of| {
            audience.at("sizes", done, of);
        });
        match shares.first() {
            Some(0.0) => audience
                .say(&format!("{name}: makes the simulator no more like this flight at any size")),
            Some(share) => {
                audience
                    .say(&format!("{name}: flown at {share:.2} of the size that the bank says"));
            }
            None => {}
        }
    }
}

/// Statistics and details of accepted flights of one mission.
fn accepted(
    flights: &[Flown],
    nominal: &Nominal,
) -> Result<(Vec<Vec<f64>>, Vec<Details>), Refused> {
    let seen: Vec<_> =
        flights.par_iter().map(|flown| observed_in_detail(&flown.trace, nominal)).collect();
    let of = |(flown, seen): (&Flown, Result<_, NotObservable>)| {
        seen.map_err(|why| Refused::Given(format!("{}: {why}", flown.path.display())))
    };
    let seen: Vec<_> = flights.iter().zip(seen).map(of).collect::<Result<_, _>>()?;
    Ok(seen.into_iter().unzip())
}

/// SHA-256 of a file; empty where it cannot be read, which was said before.
fn hash_of(path: &Path) -> String {
    haltere_log::intake::open(path).and_then(digest_of).unwrap_or_default()
}
