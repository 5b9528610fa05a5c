//! `haltere-sim fly`: missions in lockstep, as fast as the computer is, one log each.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail};
use haltere::cli::{Unwritten, print, print_json};
use haltere::ctl::read_mission;
use haltere::fit::programs::Options as Programs;
use haltere::named_missions::{self, Place, SHAPE_HEIGHT_M, SHAPE_SPEED_MPS, SHAPES};
use haltere::progress::Progress;
use haltere::simulated::campaign::draw;
use haltere::simulated::campaign::file::{Base, CampaignFile};
use haltere::simulated::campaign::flight::{self, Firmware, Keep, TRUTH};
use haltere::simulated::campaign::plan::Plan;
use haltere::simulated::campaign::row::{Outcome, Row};
use haltere::vehicles;
use haltere_gap::bank::library;
use haltere_gap::scene::Scene;
use haltere_log::written;
use haltere_model::rotorcraft::Rotorcraft;
use haltere_pilot::Envelope;
use haltere_pilot::mission_file::{Command, Item, MissionFile};
use rayon::prelude::*;
use serde::Serialize;
use toml::Value;

use crate::firmware::{Crazyflie, FIRMWARE_YAW_DEG};
use crate::leavings;

/// Longest flight, s: a pack is empty before.
const LIMIT_S: f64 = 900.0;
/// Most flights of one mission.
const MOST: u64 = 10_000;
/// Rest over the place of take-off, and at the first corner of a shape, s.
const SETTLE_S: f64 = 4.0;
const CORNER_S: f64 = 2.0;

/// `haltere-sim fly`
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Missions: mission files, or names (`--list` prints them).
    #[arg(value_name = "MISSION", required_unless_present = "list")]
    missions: Vec<String>,
    /// Flights of each mission; each has a seed of its own.
    #[arg(long, value_name = "N", default_value_t = 1)]
    count: u64,
    /// An effect of the vehicle or of the room, as in docs/EFFECTS.md: `I2.x_mm=3`, `P1=0.12`,
    /// `U2=bias:0.2,anchor:3`; may be given several times.
    #[arg(long, value_name = "ID=VALUE")]
    effect: Vec<String>,
    /// Scenario file (room, anchors, start, effects, faults), or the name of a built-in one (`haltere-sim print
    /// scenario`). Without it the vehicle stands in the middle of a 10 × 10 × 7 m hall.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Vehicle file, or the name of a built-in one; without it the Flapper. With --crazyflie a quadrotor too.
    #[arg(long, value_name = "FILE")]
    vehicle: Option<PathBuf>,
    /// A Crazyflie's firmware that you have built for the host, with a clock that is driven, in the place of the simulated
    /// board (docs/CRAZYFLIE.md).
    #[arg(long, value_name = "PROGRAM")]
    crazyflie: Option<PathBuf>,
    /// Configuration of the companion; may be given several times. The anchors are the scenario's.
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// One value of it, for example control.version=raw.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Seed of the first flight of each mission; the next has the next number.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Folder of the logs: MISSION-SEED.mcap, and the truth beside each as CSV.
    #[arg(long, value_name = "DIR", default_value = "flights")]
    out: PathBuf,
    /// Flights at a time; 0: as many as there are cores.
    #[arg(long, value_name = "N", default_value_t = 0)]
    jobs: usize,
    /// Print the names of the missions that are built in, and fly none.
    #[arg(long)]
    list: bool,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// What was flown, for scripts.
#[derive(Serialize)]
struct Flown {
    log: PathBuf,
    mission: String,
    row: Row,
}

/// One flight before it is flown.
struct Due {
    log: PathBuf,
    mission: String,
    plan: Plan,
}

/// Flies. `false`: a flight did not end on its feet where it may be.
pub fn run(options: &Options) -> Result<bool> {
    if options.list {
        print(&(names().join("\n") + "\n"))?;
        return Ok(true);
    }
    if !(1..=MOST).contains(&options.count) {
        bail!("--count {}: allowed 1 to {MOST}", options.count);
    }
    let rotors = rotors(options)?;
    let due = due(options, rotors.as_ref())?;
    leavings::say_before(due.len(), leavings::DECODED_LOG_B, &options.out);
    std::fs::create_dir_all(&options.out).with_context(|| options.out.display().to_string())?;
    let progress = Progress::counted("flights", 0, due.len() as u64);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.jobs).build()?;
    let flown: Vec<Flown> = pool.install(|| {
        due.into_par_iter()
            .map(|Due { log, mission, plan }| {
                let firmware = options.crazyflie.as_deref();
                let firmware =
                    firmware.map(|one| Crazyflie::start(one, rotors.is_none())).transpose()?;
                let firmware = firmware
                    .map(|program| Firmware { program: Box::new(program), rotors: rotors.clone() });
                let row = flight::fly_by(&plan, Some(&Keep { log: &log }), firmware)
                    .with_context(|| log.display().to_string())?;
                if !options.json {
                    progress.print(&line(&log, &row)).map_err(Unwritten)?;
                }
                progress.advance(1);
                Ok(Flown { log, mission, row })
            })
            .collect::<Result<_>>()
    })?;
    progress.end();
    if options.json {
        print_json(&flown)?;
    } else if flown.len() > 1 {
        let logs: Vec<_> = flown.iter().map(|flight| flight.log.clone()).collect();
        leavings::tell(&logs, &options.out);
    }
    Ok(flown.iter().all(|flight| on_its_feet(&flight.row)))
}

/// Missions that need no file.
fn names() -> Vec<String> {
    named_missions::names().into_iter().chain(SHAPES.map(|(name, _)| name.to_owned())).collect()
}

/// The quadrotor that a firmware flies; `None`: it flies wings.
fn rotors(options: &Options) -> Result<Option<Rotorcraft>> {
    let Some(told) = &options.vehicle else { return Ok(None) };
    match vehicles::rotorcraft_text(told) {
        Some(_) if options.crazyflie.is_none() => bail!(
            "--vehicle {}: a quadrotor flies by a firmware of its own alone: --crazyflie PROGRAM",
            told.display()
        ),
        Some(_) => vehicles::rotorcraft(told).map(Some),
        None => Ok(None),
    }
}

/// Every flight; whatever cannot be flown is told before the first one.
fn due(options: &Options, rotors: Option<&Rotorcraft>) -> Result<Vec<Due>> {
    let base = base(options, rotors)?;
    let given = options.missions.iter().map(Path::new);
    let files = options.config.iter().chain(&options.scenario).chain(&options.vehicle);
    let inputs: Vec<&Path> = given.chain(files.map(|file| &**file)).collect();
    let (mut due, mut problems) = (Vec::new(), Vec::new());
    for mission in &options.missions {
        let plan = Plan::of(&base, options.seed, LIMIT_S)?;
        let items = mission_of(mission, &plan)?;
        let stem =
            Path::new(mission).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        for seed in options.seed..options.seed.saturating_add(options.count) {
            let log = options.out.join(format!("{stem}-{seed}.mcap"));
            if log.exists() {
                problems.push(log.display().to_string());
            }
            written::look(&log.with_extension(TRUTH), &inputs).context("--out")?;
            let plan = Plan { mission: items.clone(), ..Plan::of(&base, seed, LIMIT_S)? };
            due.push(Due { log, mission: mission.clone(), plan });
        }
    }
    match problems.first() {
        None => Ok(due),
        Some(first) => bail!(
            "{first} is there already ({} of {} logs): name another folder (--out) or other seeds (--seed), or move it away",
            problems.len(),
            due.len()
        ),
    }
}

/// What all flights share.
fn base(options: &Options, rotors: Option<&Rotorcraft>) -> Result<Base> {
    let file = CampaignFile {
        scenario: options.scenario.clone(),
        vehicle: options.vehicle.clone().filter(|_| rotors.is_none()),
        config: options.config.clone(),
        set: options.set.clone(),
        ..CampaignFile::default()
    };
    let mut base = Base::read(&file, Path::new(""))?;
    if let Some(rotors) = rotors {
        base.vehicle = toml::to_string(&rotors.as_vehicle())?;
    }
    if options.crazyflie.is_some() {
        draw::set(&mut base.scenario, "board.firmware", Value::from("crazyflie"))?;
        draw::set(&mut base.scenario, "start.yaw_deg", Value::Float(FIRMWARE_YAW_DEG))?;
    }
    for text in &options.effect {
        let (spec, values) = library::asked(text).map_err(|why| anyhow!("--effect {why}"))?;
        let Some(values) = values else {
            bail!(
                "--effect {text}: how much of it? Write {text}=VALUE; docs/EFFECTS.md has the ranges"
            );
        };
        for (parameter, value) in spec.parameters.iter().zip(values) {
            let key = format!("effects.on.{}.{}", spec.id, parameter.name);
            draw::set(&mut base.scenario, &key, Value::Float(value))?;
        }
    }
    Ok(base)
}

/// A file, or a mission that is built in, placed in the scenario's room.
fn mission_of(name: &str, plan: &Plan) -> Result<MissionFile> {
    let path = Path::new(name);
    if path.extension().is_some() || path.exists() {
        let origin = plan.config.ground.origin.in_force();
        return Ok(read_mission(path, &origin, |what| eprintln!("{what}"))?);
    }
    let start_NE_m = plan.scenario.start.position_m;
    if let Some((_, corners)) = SHAPES.iter().find(|(shape, _)| *shape == name) {
        return Ok(shape(corners, start_NE_m));
    }
    if !named_missions::names().iter().any(|known| known == name) {
        bail!("{name}: no such file, and no mission of this name: {}", names().join(" "));
    }
    let survey = plan.scenario.told_survey()?;
    let pilot = plan.config.pilot();
    let options = Programs::of(&pilot);
    let scene = Scene {
        room: plan.scenario.room.clone(),
        start_NE_m,
        survey: survey.clone(),
        vehicle: plan.vehicle.clone(),
        pilot: pilot.clone(),
        until_s: None,
    };
    let envelope = Envelope::of(&pilot, &survey);
    Place { scene, envelope, options }.mission(name).map_err(|why| anyhow!("mission {name}: {why}"))
}

/// A shape of the source at its height and speed, around the place of take-off.
fn shape(corners: &[[f64; 2]], [north_m, east_m]: [f64; 2]) -> MissionFile {
    let takeoff = Item { height_m: Some(SHAPE_HEIGHT_M), ..Item::new(Command::Takeoff) };
    let settle = Item { hold_s: Some(SETTLE_S), ..Item::waypoint(north_m, east_m, SHAPE_HEIGHT_M) };
    let speed = Item { speed_mps: Some(SHAPE_SPEED_MPS.into()), ..Item::new(Command::Speed) };
    let corners = corners.iter().enumerate().map(|(i, [n, e])| Item {
        hold_s: (i == 0).then_some(CORNER_S),
        ..Item::waypoint(north_m + n, east_m + e, SHAPE_HEIGHT_M)
    });
    let items = [takeoff, settle, speed].into_iter().chain(corners);
    MissionFile { items: items.chain([Item::new(Command::Land)]).collect() }
}

/// A mission may go near the floor: who stands on it in between and flies on is whole.
fn on_its_feet(row: &Row) -> bool {
    matches!(row.outcome, Outcome::Landed | Outcome::Again) && !row.crashed() && !row.left()
}

fn line(log: &Path, row: &Row) -> String {
    let mean = |value: Option<f64>| value.map_or("-".to_owned(), |m| format!("{m:.2} m"));
    let how = match row.outcome {
        Outcome::Again if on_its_feet(row) => "landed, and stood on the floor before,".to_owned(),
        outcome if row.why.is_empty() => outcome.name().to_owned(),
        outcome => format!("{} ({})", outcome.name(), row.why),
    };
    format!(
        "{}  seed {}  {how} after {:.0} s  estimate off by {}, position by {}",
        log.display(),
        row.seed,
        row.flown_s,
        mean(row.estimate_mean_m),
        mean(row.tracking_mean_m)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Cli {
        #[command(flatten)]
        options: Options,
    }

    fn options(args: &[&str]) -> Options {
        Cli::parse_from(std::iter::once("fly").chain(args.iter().copied())).options
    }

    #[test]
    fn prop_every_name_is_a_mission_that_can_be_flown_in_the_hall() {
        for name in names() {
            let due = due(&options(&[&name, "--count", "3", "--seed", "7"]), None).unwrap();
            assert!(due.iter().all(|flight| flight.plan.mission.items.len() > 2), "{name}");
            assert_eq!(due.iter().map(|flight| flight.plan.seed).collect::<Vec<_>>(), [7, 8, 9]);
        }
    }

    #[test]
    fn prop_what_cannot_be_flown_is_told_before_anything_is_flown() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("refs");
        let out = out.to_str().unwrap();
        for (args, says) in [
            (vec!["squid"], "no mission of this name"),
            (vec!["missing.toml"], "missing.toml"),
            (vec!["plain", "--count", "0"], "--count 0"),
            (vec!["plain", "--effect", "I2"], "how much of it"),
            (vec!["plain", "--effect", "I2.q_mm=3"], "no parameter q_mm"),
            (vec!["plain", "--set", "control.limit.tilt_deg=3"], "control.limit"),
            (vec!["plain", "--scenario", "no.toml"], "no.toml"),
        ] {
            let mut args = args;
            args.extend(["--out", out]);
            let said = format!("{:#}", run(&options(&args)).unwrap_err());
            assert!(said.contains(says), "{args:?}: {said}");
            assert!(!folder.path().join("refs").exists(), "{args:?}");
        }
    }

    #[test]
    fn prop_a_flight_is_kept_with_its_truth_and_never_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().to_str().unwrap();
        let args =
            ["straight", "--count", "2", "--seed", "3", "--effect", "P1.loss=0.05", "--out", out];
        assert!(run(&options(&args)).unwrap());
        for name in ["straight-3.mcap", "straight-4.mcap", "straight-3.truth.csv"] {
            assert!(folder.path().join(name).metadata().unwrap().len() > 10_000, "{name}");
        }
        let refused = run(&options(&args)).unwrap_err().to_string();
        assert!(refused.contains("there already (2 of 2 logs)"), "{refused}");
    }
}
