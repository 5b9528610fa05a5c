//! A bank of hovers that a simulator of the user's own has flown: what each cause does to the balance there, in place of a formula, and
//! how far its healthy hover lies from real ones.
//!
//! Every flight with a cause has a twin without one, of the same seed and the same jitter, so that what the two differ by is
//! the cause's alone. Between the sizes that were flown the balance is interpolated. How the program is spoken to is in
//! docs/INTERFACES.md, section 6; who speaks is an argument, so that nothing here starts or waits for anything.

use std::collections::BTreeMap;

use haltere_log::import::motors::{Dropped, MotorFlight, MotorRow};
use haltere_model::random::Stream;
use haltere_model::rotorcraft::{MOTORS, Rotorcraft};
use nalgebra::Vector4;
use serde::{Deserialize, Serialize};

use super::causes::{Cause, Curves, Kind};
use super::hover::Hover;

/// Losses of thrust and loads, the latter as shares of the mass, that are flown.
const LOSSES: [f64; 3] = [0.1, 0.2, 0.35];
const LOADS: [f64; 3] = [0.03, 0.07, 0.14];
/// Healthy flights: one for each size.
const HEALTHY: usize = LOSSES.len();
/// Flights of a bank: with each cause at one motor, of which there are two, at each size, and the healthy ones.
pub const FLIGHTS: usize = HEALTHY + 2 * MOTORS * HEALTHY;
/// The hover that is asked for: high enough above the ground's cushion, and three times as long as is needed.
const HEIGHT_M: f64 = 1.0;
const DURATION_S: f64 = 15.0;
const RATE_HZ: f64 = 100.0;
/// Jitter of the mass and of the thrust of each motor, as shares: what healthy flights of one vehicle differ by from session to session.
const JITTER_MASS: f64 = 0.01;
const JITTER_THRUST: f64 = 0.02;
/// Most rows of an answer: the hover at 2 kHz.
const MOST_ROWS: usize = 30_000;

/// A flight that is asked for.
#[derive(Debug, Clone, Serialize)]
pub struct Request<'a> {
    /// Its number, which the answer repeats.
    pub flight: usize,
    mission: &'static str,
    height_m: f64,
    duration_s: f64,
    rate_hz: f64,
    seed: u64,
    jitter: Jitter,
    effects: Vec<Effect>,
    vehicle: &'a Rotorcraft,
}

/// Factors of constants of the vehicle.
#[derive(Debug, Clone, Serialize)]
struct Jitter {
    mass: f64,
    thrust: [f64; MOTORS],
}

/// A cause to be flown: `weak_motor`, whose size is the loss, or `load`, whose size is kg.
#[derive(Debug, Clone, Serialize)]
struct Effect {
    id: Kind,
    motor: usize,
    size: f64,
}

/// What a program answers.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct Answer {
    /// Number of the flight.
    pub flight: usize,
    /// Names of the columns.
    #[serde(default)]
    columns: Vec<String>,
    /// A row for each instant.
    #[serde(default)]
    rows: Vec<Vec<f64>>,
    /// Why it was not flown.
    error: Option<String>,
}

/// The bank.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Flown {
    /// Hovers without a cause.
    pub healthy: Vec<Hover>,
    /// Flights that were asked for.
    pub flights: usize,
    /// Those that are not there, by the reason.
    pub lost: BTreeMap<String, usize>,
    /// What sizes, as shares, add to the balance, the smallest first.
    pub curves: Curves,
}

/// Flies the bank of a vehicle. `fly` is given what to fly, and gives the answer or why there is none.
pub fn fly_bank(
    vehicle: &Rotorcraft,
    fly: &mut dyn FnMut(&Request<'_>) -> Result<Answer, String>,
) -> Result<Flown, String> {
    let mut bank = Flown::default();
    let mut one = |bank: &mut Flown, twin: usize, effects: Vec<Effect>| {
        let request = Request::of(vehicle, bank.flights, twin, effects);
        bank.flights += 1;
        let hover =
            fly(&request).and_then(Answer::into_flight).and_then(|f| Hover::of(&f, vehicle));
        hover.map_err(|why| *bank.lost.entry(why).or_default() += 1).ok()
    };
    let healthy: Vec<Option<Hover>> =
        (0..HEALTHY).map(|twin| one(&mut bank, twin, Vec::new())).collect();
    if healthy.iter().all(Option::is_none) {
        return Err(format!(
            "no healthy flight of the simulator can be used: {}",
            bank.lost_words()
        ));
    }
    for cause in Cause::all().into_iter().filter(|cause| cause.motors.len() == 1) {
        let (sizes, unit) = match cause.kind {
            Kind::Load => (LOADS, vehicle.mass_kg),
            _ => (LOSSES, 1.0),
        };
        let mut curve = Vec::new();
        for (twin, share) in sizes.into_iter().enumerate() {
            let Some(healthy) = &healthy[twin] else { continue };
            let effect = Effect { id: cause.kind, motor: cause.motors[0], size: unit * share };
            if let Some(hover) = one(&mut bank, twin, vec![effect]) {
                let adds = Vector4::from(hover.balance) - Vector4::from(healthy.balance);
                curve.push((share, adds));
            }
        }
        if !curve.is_empty() {
            bank.curves.0.push((cause, curve));
        }
    }
    bank.healthy = healthy.into_iter().flatten().collect();
    Ok(bank)
}

impl<'a> Request<'a> {
    fn of(vehicle: &'a Rotorcraft, flight: usize, twin: usize, effects: Vec<Effect>) -> Self {
        let seed = twin as u64 + 1;
        let mut rng = Stream::new(seed, "jitter of another simulator");
        let mut factor = |share: f64| 1.0 + share * rng.between(-1.0, 1.0);
        let jitter = Jitter {
            mass: factor(JITTER_MASS),
            thrust: [(); MOTORS].map(|()| factor(JITTER_THRUST)),
        };
        Self {
            flight,
            mission: "hover",
            height_m: HEIGHT_M,
            duration_s: DURATION_S,
            rate_hz: RATE_HZ,
            seed,
            jitter,
            effects,
            vehicle,
        }
    }
}

impl Answer {
    /// The flight of the table, or what is wrong with it.
    fn into_flight(self) -> Result<MotorFlight, String> {
        if let Some(why) = self.error {
            return Err(format!(
                "the simulator says: {}",
                why.chars().take(200).collect::<String>()
            ));
        }
        if self.rows.len() > MOST_ROWS {
            return Err(format!("more than {MOST_ROWS} rows"));
        }
        let place = |name: &str| self.columns.iter().position(|column| column == name);
        let due = |name: &str| place(name).ok_or_else(|| format!("no column {name}"));
        let t_s = due("t_s")?;
        let motors = [due("m1")?, due("m2")?, due("m3")?, due("m4")?];
        let [supply_v, height_m, speed_mps] = ["supply_v", "height_m", "speed_mps"].map(place);
        let mut flight = MotorFlight {
            name: format!("simulated {}", self.flight),
            commands: "m1 to m4".into(),
            rows: Vec::new(),
            dropped: Dropped::default(),
        };
        for row in &self.rows {
            if row.len() != self.columns.len() {
                return Err(format!(
                    "a row of {} values under {} columns",
                    row.len(),
                    self.columns.len()
                ));
            }
            let command_frac = motors.map(|at| row[at]);
            if let Some(off) = command_frac.iter().find(|u| !(0.0..=1.01).contains(*u)) {
                return Err(format!("a command is {off}, allowed 0 to 1"));
            }
            let at = |place: Option<usize>| place.map(|at| row[at]);
            flight.push(MotorRow {
                t_s: row[t_s],
                command_frac,
                supply_v: at(supply_v),
                height_m: at(height_m),
                speed_mps: at(speed_mps),
                accel_g: [None; 3],
            });
        }
        Ok(flight)
    }
}

impl Flown {
    /// What could not be flown, in words; nothing where all was.
    pub fn lost_words(&self) -> String {
        let told =
            self.lost.iter().map(|(why, count)| format!("{count} of {}: {why}", self.flights));
        told.collect::<Vec<_>>().join("; ")
    }
}
