//! The diagnosis without a simulator on the flights of CrazyPAD, whose causes are known: real vehicles, and effects that nobody
//! taught it.
//!
//! References are four healthy flights of the vehicle and the kind of log, the first by name; a healthy one is judged by four
//! others. What is scored is the table of the issue, from the reports alone.

mod score;
mod state;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use clap::Args;
use haltere::cli::{print, print_json};
use haltere::vehicles;
use haltere_gap::balance::judge::Judge;
use haltere_gap::balance::{Hover, Report};
use haltere_gap::outcome::Ending;
use haltere_log::import::motors::read_usdlog;
use haltere_model::random::Stream;
use haltere_model::rotorcraft::Rotorcraft;
use nalgebra::Vector4;
use state::Done;

/// References that a flight is judged by.
const REFERENCES: usize = 4;

/// Scores `haltere gap diagnose --import usdlog` on the flights of CrazyPAD, by state.
#[derive(Debug, Args)]
pub struct Options {
    /// Folder that holds `motor_data` and `controller_data`, with a folder for each state.
    folder: PathBuf,
    /// Only states that have this in their names; healthy flights always count.
    #[arg(long, value_name = "TEXT")]
    state: Vec<String>,
    /// Prints every report as JSON.
    #[arg(long)]
    json: bool,
}

/// A flight with what is known of it.
struct Flight {
    vehicle: String,
    kind: String,
    state: String,
    done: Done,
    /// What it holds, and how long reading took; or why it cannot be judged.
    hover: Result<Hover, String>,
    took: Duration,
}

/// A flight with what was said of it.
pub struct Judged {
    /// Vehicle and kind of log, state, name.
    place: [String; 3],
    done: Done,
    /// Whether the references were those of the other vehicle.
    by_another: bool,
    report: Option<Report>,
    took: Duration,
}

/// Reads, judges, scores and prints.
pub fn run(options: &Options) -> anyhow::Result<ExitCode> {
    let vehicle = vehicles::rotorcraft(Path::new("crazyflie-2.1"))?;
    let flights = flights(&options.folder, &options.state, &vehicle)?;
    let judged = judged(&flights, &vehicle);
    match options.json {
        true => {
            let all: Vec<_> = judged.iter().map(|j| (&j.place, j.by_another, &j.report)).collect();
            print_json(&all)?;
        }
        false => {
            print(&(score::flights(&judged) + &score::table(&judged)))?;
            print(&drawn(&flights, &vehicle))?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn flights(folder: &Path, states: &[String], vehicle: &Rotorcraft) -> anyhow::Result<Vec<Flight>> {
    let mut all = Vec::new();
    for kind in ["motor_data", "controller_data"] {
        for state in sorted(&folder.join(kind))? {
            let name = name_of(&state);
            let Some(done) = Done::of(&name) else { continue };
            let is_asked = states.is_empty() || states.iter().any(|part| name.contains(part));
            if done != Done::Healthy && !is_asked {
                continue;
            }
            for path in sorted(&state)? {
                let begun = Instant::now();
                let read = read_usdlog(&path).map_err(|why| why.to_string());
                let hover = read.and_then(|flight| Hover::of(&flight, vehicle));
                let vehicle = name_of(&path).split('_').next().unwrap_or_default().to_owned();
                let (kind, state) = (kind.to_owned(), name.clone());
                let took = begun.elapsed();
                all.push(Flight { vehicle, kind, state, done: done.clone(), hover, took });
            }
        }
    }
    Ok(all)
}

fn sorted(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    Ok(paths)
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Every flight by references of its own vehicle, and the healthy ones by those of each other vehicle.
fn judged(flights: &[Flight], vehicle: &Rotorcraft) -> Vec<Judged> {
    let mut all = Vec::new();
    for flight in flights {
        let mut vehicles: Vec<&str> = flights.iter().map(|f| f.vehicle.as_str()).collect();
        vehicles.sort_unstable();
        vehicles.dedup();
        for of in vehicles {
            let by_another = of != flight.vehicle;
            if by_another && flight.done != Done::Healthy {
                continue;
            }
            let is_reference = |other: &&Flight| {
                let alike = other.kind == flight.kind && other.vehicle == of;
                alike && other.done == Done::Healthy && !std::ptr::eq(*other, flight)
            };
            let references: Vec<Hover> = flights
                .iter()
                .filter(is_reference)
                .filter_map(|reference| reference.hover.clone().ok())
                .take(REFERENCES)
                .collect();
            // What is foretold are the other flights of the state.
            let is_fellow = |other: &&Flight| {
                let alike = other.kind == flight.kind && other.vehicle == flight.vehicle;
                alike && other.state == flight.state && !std::ptr::eq(*other, flight)
            };
            let held_out: Vec<Hover> =
                flights.iter().filter(is_fellow).filter_map(|f| f.hover.clone().ok()).collect();
            let begun = Instant::now();
            let judge = Judge::new(&references, vehicle).ok();
            let hover = flight.hover.as_ref().ok();
            let report = judge.zip(hover).map(|(judge, hover)| judge.report(hover, &held_out));
            let name = hover.map_or_else(String::new, |hover| hover.name.clone());
            let place = [format!("{of} {}", flight.kind), flight.state.clone(), name];
            let (done, took) = (flight.done.clone(), flight.took + begun.elapsed());
            all.push(Judged { place, done, by_another, report, took });
        }
    }
    all
}

/// Other vehicles that are drawn for each kind of log.
const DRAWN: usize = 100;
/// What they differ by: thrust of each motor, vertical force, and offsets of the accelerometer, forward, left, up, g.
const TRIMS: f64 = 0.06;
const FORCE: f64 = 0.04;
const OFFSETS_G: [f64; 3] = [0.02, 0.02, 0.01];

/// How many vehicles that are drawn are called another one, by the references of those that are there.
fn drawn(flights: &[Flight], vehicle: &Rotorcraft) -> String {
    let healthy = |kind: &str| -> Vec<Hover> {
        let of = flights.iter().filter(|f| f.done == Done::Healthy && f.kind == kind);
        of.filter_map(|f| f.hover.clone().ok()).take(REFERENCES).collect()
    };
    let row = |kind: &str| {
        let references = healthy(kind);
        let judge = Judge::new(&references, vehicle).ok()?;
        let to_balance = vehicle.to_balance()?;
        let mut rng = Stream::new(1, kind);
        let another = (0..DRAWN).filter(|_| {
            let mut hover = references[0].clone();
            let trims = to_balance * Vector4::from_fn(|_, _| TRIMS * rng.normal());
            hover.balance = [0, 1, 2, 3].map(|axis| match axis {
                0 => hover.balance[0] + trims[0] + FORCE * rng.normal(),
                _ => trims[axis],
            });
            for (offset, usual) in hover.offset_g.iter_mut().zip(OFFSETS_G) {
                let apart = f64::sqrt(2.0) * usual * rng.normal();
                *offset = offset.map(|offset| offset + apart);
            }
            judge.report(&hover, &[]).outcome.kind() == Ending::NotInLibrary
        });
        Some(format!("another vehicle, drawn [{kind}]: {} of {DRAWN}\n", another.count()))
    };
    ["motor_data", "controller_data"].into_iter().filter_map(row).collect()
}

/// The bounds that the flights at hand keep; those that are kept back decide.
#[test]
fn val_causes_that_nobody_taught_are_found_on_real_flights() {
    let Some(folder) = crate::recordings::crazypad() else {
        println!("not checked: no data");
        return;
    };
    let vehicle = vehicles::rotorcraft(Path::new("crazyflie-2.1")).unwrap();
    let judged = judged(&flights(&folder, &[], &vehicle).unwrap(), &vehicle);
    print!("{}{}", score::flights(&judged), score::table(&judged));
    let value =
        |key: &str| score::rows(&judged).into_iter().find(|row| row.key == key).unwrap().value;
    assert_eq!(value("healthy"), 0.0);
    assert!(value("wrong") <= 0.05);
    assert!(value("small") >= 0.8);
    assert!(value("named") >= 0.6);
}
