//! Judges a flight by its balance: weighs the causes against what references scatter, and says how the outcome follows.

use haltere_core::checks::Problems;
use haltere_model::rotorcraft::{MOTORS, Rotorcraft};
use nalgebra::Vector4;

use super::causes::{Kind, Laws};
use super::flown::Flown;
use super::hover::Hover;
use super::report::{AXES, AxisChange, HeldOut, Report, Simulator, Smallest};
use super::said;
use super::weigh::{Candidate, Change, Healthy, Rivals, Weighed};
use crate::outcome::{Named, Outcome, Remainder};

/// Fewest references: of one nothing is known of what healthy flights differ by.
const LEAST_REFERENCES: usize = 2;
/// Probability of "nothing" from which on there is no gap: one healthy flight of twelve lies below, of flights drawn from the scatter that
/// `weigh.rs` assumes for four references.
const NO_GAP: f64 = 0.6;
/// Odds below which two causes are not told apart \[Jeffreys 1961: √10, "barely worth mentioning" below it\].
const ODDS: f64 = 3.162;
/// Candidates that are listed.
const LISTED: usize = 6;

/// A vehicle with its references, ready to judge flights.
pub struct Judge<'a> {
    vehicle: &'a Rotorcraft,
    references: &'a [Hover],
    healthy: Healthy,
    rivals: Rivals,
    laws: Laws<'a>,
    flown: Option<&'a Flown>,
}

/// Judges a flight; `held_out`: others of the same state.
pub fn diagnose(
    flight: &Hover,
    held_out: &[Hover],
    references: &[Hover],
    vehicle: &Rotorcraft,
    flown: Option<&Flown>,
) -> Result<Report, Problems> {
    Ok(Judge::with(references, vehicle, flown)?.report(flight, held_out))
}

impl<'a> Judge<'a> {
    /// With the causes that a vehicle can have, and what its references scatter.
    pub fn new(references: &'a [Hover], vehicle: &'a Rotorcraft) -> Result<Self, Problems> {
        Self::with(references, vehicle, None)
    }

    /// The same where a simulator has flown what causes do.
    pub fn with(
        references: &'a [Hover],
        vehicle: &'a Rotorcraft,
        flown: Option<&'a Flown>,
    ) -> Result<Self, Problems> {
        let laws = Laws::of(vehicle, flown.map(|flown| &flown.curves));
        let laws = laws.ok_or_else(|| Problems::one("the vehicle file holds no quadrotor"))?;
        let healthy = Healthy::of(references).filter(|_| references.len() >= LEAST_REFERENCES);
        let healthy = healthy.ok_or_else(|| {
            Problems::one(format!(
                "{} accepted flights of this vehicle are there, at least {LEAST_REFERENCES} are needed, four or more of several \
                 sessions are better: give them as --reference",
                references.len()
            ))
        })?;
        let rivals = Rivals::of(&laws);
        Ok(Self { vehicle, references, healthy, rivals, laws, flown })
    }

    /// What a flight shows.
    pub fn report(&self, flight: &Hover, held_out: &[Hover]) -> Report {
        let change = self.healthy.change(flight);
        let weighed = self.rivals.weigh(&change, &self.healthy);
        let outcome = self.outcome(&weighed, &change);
        let sigma = self.healthy.sigma();
        let explained = set(&weighed).first().copied().filter(|_| outcome.kind().is_explained());
        let adds = explained.map(|candidate| candidate.cause.adds(&candidate.sizes, &self.laws));
        let apart: Vec<Change> = self.references.iter().map(|r| self.healthy.change(r)).collect();
        let balance = (0..MOTORS).map(|axis| AxisChange {
            axis: AXES[axis],
            share: change.balance[axis],
            sigma: sigma[axis],
            references: apart.iter().map(|change| change.balance[axis]).collect(),
            left: adds.map(|adds| change.balance[axis] - adds[axis]),
        });
        let held_out = self.held_out(adds, held_out);
        let candidates: Vec<Named> =
            weighed.causes.iter().take(LISTED).map(|c| self.named(c)).collect();
        let mut report = Report {
            flight: flight.name.clone(),
            vehicle: self.vehicle.name.clone(),
            references: self.references.iter().map(|r| r.name.clone()).collect(),
            can_show: self.can_show(),
            outcome,
            verdict: String::new(),
            balance: balance.collect(),
            shaking: change.shake.map(f64::exp),
            accelerometer_g: change.offset_g,
            nothing: weighed.nothing,
            another_vehicle: weighed.another,
            candidates,
            not_checked: not_checked(flight, &change),
            held_out,
            simulator: self.simulator(),
            hover_s: flight.hover_s,
        };
        report.verdict = said::verdict(&report, &weighed);
        report
    }

    fn outcome(&self, weighed: &Weighed, change: &Change) -> Outcome {
        if weighed.nothing >= NO_GAP {
            return Outcome::NoMaterialGap;
        }
        let set = set(weighed);
        let explained: f64 = set.iter().map(|candidate| candidate.probability).sum();
        // Another vehicle is in the list as a fault is; what is in no list has to be clearly ahead.
        if weighed.another > explained || weighed.something_else > ODDS * explained {
            let sigma = self.healthy.sigma();
            let mut far: Vec<(String, f64)> = (0..MOTORS)
                .map(|axis| (AXES[axis].to_owned(), change.balance[axis] / sigma[axis]))
                .collect();
            far.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
            let remainder = Remainder { share: 1.0, block: "actuators".into(), statistics: far };
            return Outcome::NotInLibrary { remainder };
        }
        let mut effects: Vec<Named> = set.iter().map(|candidate| self.named(candidate)).collect();
        match effects.len() {
            1 => Outcome::Named { effect: effects.remove(0) },
            _ => Outcome::OneOf { effects },
        }
    }

    fn named(&self, candidate: &Candidate) -> Named {
        let unit = match candidate.cause.kind {
            Kind::Load => self.vehicle.mass_kg,
            _ => 1.0,
        };
        Named {
            id: candidate.cause.id(),
            probability: candidate.probability,
            theta: candidate.sizes.iter().map(|size| unit * size).collect(),
            theta_90: candidate.sizes_90.iter().map(|ends| ends.map(|size| unit * size)).collect(),
        }
    }

    /// The smallest sizes at which a flight without any noise is called a gap.
    fn can_show(&self) -> Vec<Smallest> {
        let is_gap = |balance: Vector4<f64>, shake: f64| {
            let change = self.healthy.changed_by(balance, shake);
            self.rivals.weigh(&change, &self.healthy).nothing < NO_GAP
        };
        let of_motor = |kind: Kind, unit: f64| {
            let causes =
                self.rivals.causes().filter(|(c, _)| c.kind == kind && c.motors.len() == 1);
            let smallest = causes.map(|(_, trials)| {
                // By size, so that the first that is seen is the smallest.
                let at = trials.partition_point(|trial| !is_gap(trial.adds, 0.0));
                trials.get(at).map(|trial| unit * trial.sizes[0])
            });
            let worst = smallest.reduce(|a, b| Some(a?.max(b?))).flatten();
            Smallest { kind, size: worst }
        };
        let times = (1..=MOST_SHAKING).map(|tenths| 1.0 + 0.1 * f64::from(tenths));
        let shaking = times.clone().find(|times| is_gap(Vector4::zeros(), times.ln()));
        vec![
            of_motor(Kind::WeakMotor, 1.0),
            of_motor(Kind::Load, self.vehicle.mass_kg),
            Smallest { kind: Kind::Swinging, size: shaking },
        ]
    }

    /// What the simulator has flown, beside the references.
    fn simulator(&self) -> Option<Simulator> {
        let flown = self.flown?;
        let mean = flown.healthy.iter().map(|hover| Vector4::from(hover.balance));
        let mean = mean.sum::<Vector4<f64>>() / flown.healthy.len() as f64;
        let apart = (mean - self.healthy.mean()).into();
        Some(Simulator { flights: flown.flights, lost: flown.lost.clone(), apart })
    }

    /// What is left of other flights; without an explanation, all.
    fn held_out(&self, adds: Option<Vector4<f64>>, flights: &[Hover]) -> Option<HeldOut> {
        let changes: Vec<Vector4<f64>> =
            flights.iter().map(|flight| self.healthy.change(flight).balance).collect();
        let mean_square = |less: Vector4<f64>| {
            let squares = changes.iter().map(|change| (change - less).norm_squared());
            squares.sum::<f64>() / changes.len().max(1) as f64
        };
        let (before, after) =
            (mean_square(Vector4::zeros()), mean_square(adds.unwrap_or_default()));
        let names = flights.iter().map(|flight| flight.name.clone()).collect();
        (before > 0.0).then(|| HeldOut {
            flights: names,
            before,
            after,
            shrink: 1.0 - after / before,
        })
    }
}

/// The causes that the most probable one is not clearly ahead of. What only shakes, at whatever motor, counts where it is more
/// probable than all that has a place: a weak motor at a place shakes as well.
fn set(weighed: &Weighed) -> Vec<&Candidate> {
    let sum = |placed: bool| -> f64 {
        let of = weighed.causes.iter().filter(|c| c.cause.motors.is_empty() != placed);
        of.map(|candidate| candidate.probability).sum()
    };
    let is_placed = sum(true) >= sum(false);
    let kept = || weighed.causes.iter().filter(|c| c.cause.motors.is_empty() != is_placed);
    let most = kept().next().map_or(0.0, |first| first.probability);
    kept().filter(|candidate| candidate.probability * ODDS >= most).collect()
}

/// Largest shaking that is tried, in tenths above 1.
const MOST_SHAKING: u32 = 90;

/// What a flight of motors alone does not show.
fn not_checked(flight: &Hover, change: &Change) -> Vec<String> {
    let mut all = vec![
        "drag, wind, sensors and estimator: they do not show in what the motors hold in hover"
            .to_owned(),
        "current and capacity of the pack".to_owned(),
    ];
    if !flight.by_height {
        all.push("height: none was logged, so hover was chosen by thrust".into());
    }
    if !flight.by_speed {
        all.push(
            "speed: none was logged, so what flew slowly at this height counts as hover".into(),
        );
    }
    if change.shake.is_none() {
        all.push("shaking: the references were logged at another rate".into());
    }
    all
}
