//! `haltere-sim kills`: the companion is killed in flight, at a random moment, and started again.
//!
//! Endpoint and companion are processes over the real wires. What has to follow: the board flies its
//! own failsafe to the floor, and the companion that comes back sends no setpoint into a flight that it
//! did not begin, but arms again once the vehicle stands. Truth tells what became of the vehicle, the
//! second companion's log what it sent.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use haltere::ctl::{GroundStation, Mode};
use haltere::pilot::LinkId;
use haltere::record::{Entry, LogReader};
use haltere::report::truth::{self, TruthRow};
use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream::MavSplitter;
use rand::rngs::Xoshiro256PlusPlus;
use rand::{RngExt, SeedableRng};
use serde::Serialize;
use serde_json::json;

use crate::demo::newest_log;
use crate::firmware::Which;
use crate::progress::Progress;
use crate::rig::{Companion, Endpoint, Wiring, free_port, now_us};
use crate::scenario::Scenario;
use crate::stop::Stop;

/// `haltere-sim kills`
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Folder for the flights; made if it is missing.
    #[arg(long, value_name = "DIR", default_value = "kills")]
    pub output: PathBuf,
    /// How often the companion is killed.
    #[arg(long, value_name = "N", default_value_t = 10)]
    pub count: usize,
    /// Flights at a time; each is two processes in real time. With a real firmware always one.
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub jobs: usize,
    /// Seed of the moments.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    #[command(flatten)]
    pub firmware: Which,
    /// Keep the logs of all flights, not only of those that went wrong.
    #[arg(long)]
    pub keep: bool,
    /// Print the result as JSON on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Moments of the kill after take-off was asked for, s: from standing with the motors on, over climb,
/// hold and way, into the landing.
const KILL_S: std::ops::Range<f64> = 0.1..14.0;
/// When the companion is started again, s after the kill: before the board notices (0.5 s), during its
/// descent, and after it.
const RESTART_S: std::ops::Range<f64> = 0.05..6.0;
/// The flight, s after take-off was asked for: two points, then landing.
const POINTS: [(f64, [f64; 3]); 2] = [(4.0, [6.0, 5.5, 1.5]), (8.0, [5.0, 5.0, 1.0])];
const LAND_S: f64 = 11.0;
const HEIGHT_M: f64 = 1.2;
/// Farther sideways than this is no descent over the place any more, m: the walls are 3.5 m away.
const MOST_DRIFT_M: f64 = 2.0;
const ALIGN_TIMEOUT: Duration = Duration::from_secs(60);
/// Time for the board to come down and disarm, after the kill or the restart.
const DOWN: Duration = Duration::from_secs(10);
/// A real firmware notices after 2 s, sinks at half a metre a second and makes sure that it stands.
const DOWN_BY_FIRMWARE: Duration = Duration::from_secs(20);

/// What is drawn for a flight.
#[derive(Debug, Clone, Copy, Serialize)]
struct Trial {
    n: usize,
    kill_s: f64,
    restart_s: f64,
}

/// What came of it.
#[derive(Debug, Clone, Serialize)]
struct Outcome {
    trial: Trial,
    /// Where it was when the companion died: height, m, and speed, m/s.
    height_m: f64,
    speed_mps: f64,
    /// On the floor at the end.
    landed: bool,
    /// Largest way sideways after the kill, m.
    drift_m: f64,
    /// Speed at which it met the floor, m/s; 0 when it stood there.
    impact_mps: f64,
    /// The plant calls it a crash: it met the floor at more than 2 m/s, or something else at all. How the
    /// board comes down is the board's own doing (INTERFACES.md: 82 % of the thrust of the last second).
    hard: bool,
    /// Setpoints with thrust that the second companion sent before it was asked to arm.
    recaptured: usize,
    /// It armed again when it was asked to.
    arms_again: bool,
}

impl Outcome {
    fn ok(&self) -> bool {
        // A wreck need not arm again.
        let usable = self.arms_again || self.hard;
        self.landed && self.drift_m < MOST_DRIFT_M && self.recaptured == 0 && usable
    }
}

/// Runs them. `false`: one went wrong.
pub fn run(options: &Options) -> Result<bool> {
    if options.count == 0 || options.jobs == 0 {
        bail!("--count and --jobs: at least 1");
    }
    // PX4 has fixed ports, and two firmwares want more than this computer's two cores.
    let jobs = if options.firmware.is_real() { 1 } else { options.jobs };
    let folder = std::path::absolute(&options.output).context("--output")?;
    std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let stop = Stop::on_signals()?;
    let mut rng = Xoshiro256PlusPlus::seed_from_u64(options.seed);
    let trials: Vec<Trial> = (0..options.count)
        .map(|n| Trial {
            n,
            kill_s: rng.random_range(KILL_S),
            restart_s: rng.random_range(RESTART_S),
        })
        .collect();
    let progress = Progress::new("kills", 0, trials.len() as u64);
    let next = AtomicUsize::new(0);
    let outcomes = Mutex::new(Vec::new());
    std::thread::scope(|scope| {
        for _ in 0..jobs {
            scope.spawn(|| {
                while let Some(trial) = trials.get(next.fetch_add(1, Relaxed)) {
                    if stop.asked() {
                        return;
                    }
                    let own = folder.join(format!("{:04}", trial.n));
                    let outcome = fly(trial, &own, &options.firmware);
                    let tidy = !options.keep && outcome.as_ref().is_ok_and(Outcome::ok);
                    if tidy {
                        let _ = std::fs::remove_dir_all(&own);
                    }
                    if let Ok(mut all) = outcomes.lock() {
                        all.push((*trial, outcome));
                    }
                    progress.advance(1);
                }
            });
        }
    });
    progress.end();
    if stop.asked() {
        bail!("stopped by a signal");
    }
    let mut outcomes = outcomes.into_inner().unwrap_or_default();
    outcomes.sort_by_key(|(trial, _)| trial.n);
    tell(options, &outcomes)
}

fn fly(trial: &Trial, folder: &Path, which: &Which) -> Result<Outcome> {
    if folder.exists() {
        std::fs::remove_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let truth = folder.join("truth.csv");
    let logs = folder.join("log");
    let between = which.between()?;
    let [how, what] = between.arguments();
    let mut endpoint = Endpoint::start([
        "--seed".into(),
        (trial.n as u64 + 1).to_string().into(),
        how,
        what,
        "--truth".into(),
        truth.clone().into_os_string(),
    ])?;
    let board = between.address(&endpoint)?;
    let ground = free_port()?;
    let wiring = Wiring {
        tag: endpoint.told("tag")?,
        tag_protocol: endpoint.told("tag_protocol")?,
        board: &board,
        endpoints: &[format!("udpout:127.0.0.1:{ground}")],
        logs: &logs,
    };
    let config = wiring.write(folder, &Scenario::load(None)?, "kills")?;
    let ground = format!("udpin:127.0.0.1:{ground}");

    let mut first = Companion::start(&config, &[], folder.join("first.txt"))?;
    let mut firmware = between.start(&folder.join("firmware"))?;
    let killed_us = {
        let mut station = GroundStation::connect(&ground)?;
        arm(&mut station).with_context(|| first.last_words())?;
        let began = Instant::now();
        std::thread::scope(|scope| {
            let killer = scope.spawn(|| {
                std::thread::sleep(Duration::from_secs_f64(trial.kill_s));
                first.kill().map(|()| now_us())
            });
            // From some moment on nobody answers: that is the point.
            let _ = mission(&mut station, began);
            killer.join().unwrap_or_else(|_| bail!("the killer panicked"))
        })?
    };
    std::thread::sleep(Duration::from_secs_f64(trial.restart_s));
    let mut second = Companion::start(&config, &[], folder.join("second.txt"))?;
    std::thread::sleep(if which.is_real() { DOWN_BY_FIRMWARE } else { DOWN });
    let asked_us = now_us();
    let arms_again = second.runs() && {
        let mut station = GroundStation::connect(&ground)?;
        arm(&mut station).and_then(|()| Ok(station.disarm()?)).is_ok()
    };
    second.stop()?;
    if let Some(firmware) = &mut firmware {
        firmware.stop()?;
    }
    endpoint.stop()?;

    let file = std::fs::File::open(&truth).with_context(|| truth.display().to_string())?;
    let rows = truth::read(std::io::BufReader::new(file))?;
    let recaptured = setpoints(&newest_log(&logs)?, asked_us)?;
    judge(trial, &rows, killed_us, asked_us, recaptured, arms_again)
}

fn arm(station: &mut GroundStation) -> Result<()> {
    let deadline = Instant::now() + ALIGN_TIMEOUT;
    loop {
        match station.arm() {
            Ok(()) => return Ok(()),
            Err(error) if error.is_temporary() && Instant::now() < deadline => {
                station.listen(Duration::from_millis(300))?;
            }
            Err(error) => return Err(error).context("arming"),
        }
    }
}

/// Take-off, two points, landing, until nobody answers.
fn mission(station: &mut GroundStation, began: Instant) -> Result<()> {
    let until = |station: &mut GroundStation, s: f64| -> Result<()> {
        while began.elapsed().as_secs_f64() < s {
            station.listen(Duration::from_millis(50))?;
        }
        Ok(())
    };
    station.takeoff(HEIGHT_M)?;
    for (at_s, [north_m, east_m, height_m]) in POINTS {
        until(station, at_s)?;
        station.goto(north_m, east_m, height_m)?;
    }
    until(station, LAND_S)?;
    station.set_mode(Mode::Land)?;
    until(station, KILL_S.end)
}

/// Setpoints with thrust in a log, before a time, µs.
fn setpoints(log: &Path, before_us: u64) -> Result<usize> {
    let reader = LogReader::open(log)?;
    let mut splitter = MavSplitter::new();
    let mut found = 0;
    for entry in reader.entries() {
        let Entry::Output { at, link: LinkId::Board, bytes, .. } = entry else { continue };
        if at.as_us() >= before_us {
            break;
        }
        splitter.push(&bytes);
        while let Some(next) = splitter.next() {
            let Ok(Ok(MavMessage::SET_ATTITUDE_TARGET(setpoint))) = next.map(|f| f.decode()) else {
                continue;
            };
            found += usize::from(setpoint.thrust > 0.0);
        }
    }
    Ok(found)
}

fn judge(
    trial: &Trial,
    rows: &[TruthRow],
    killed_us: u64,
    asked_us: u64,
    recaptured: usize,
    arms_again: bool,
) -> Result<Outcome> {
    let of_fall = |row: &&TruthRow| (killed_us..asked_us).contains(&row.at.as_us());
    let rows: Vec<&TruthRow> = rows.iter().filter(of_fall).collect();
    let (Some(first), Some(last)) = (rows.first(), rows.last()) else {
        bail!("the truth file does not cover the time after the kill");
    };
    let speed = |row: &TruthRow| {
        let v = row.vel_E_mps;
        v.x().hypot(v.y()).hypot(v.z())
    };
    let sideways = |row: &TruthRow| {
        let (a, b) = (first.pos_E_m, row.pos_E_m);
        (b.x() - a.x()).hypot(b.y() - a.y())
    };
    let impacts = rows.windows(2).filter(|w| !w[0].on_ground && w[1].on_ground);
    Ok(Outcome {
        trial: *trial,
        height_m: -first.pos_E_m.z(),
        speed_mps: speed(first),
        landed: last.on_ground && speed(last) < 0.05,
        drift_m: rows.iter().map(|row| sideways(row)).fold(0.0, f64::max),
        impact_mps: impacts.map(|w| speed(w[0])).fold(0.0, f64::max),
        hard: rows.iter().any(|row| row.crashed),
        recaptured,
        arms_again,
    })
}

fn tell(options: &Options, outcomes: &[(Trial, Result<Outcome>)]) -> Result<bool> {
    let flown: Vec<&Outcome> = outcomes.iter().filter_map(|(_, o)| o.as_ref().ok()).collect();
    let ok = outcomes.iter().all(|(_, o)| o.as_ref().is_ok_and(Outcome::ok));
    let count = |is: &dyn Fn(&Outcome) -> bool| flown.iter().filter(|o| is(o)).count();
    let most = |of: &dyn Fn(&Outcome) -> f64| flown.iter().map(|o| of(o)).fold(0.0, f64::max);
    let airborne = count(&|o| o.height_m > 0.15);
    let failed: Vec<(&Trial, String)> = outcomes
        .iter()
        .filter_map(|(trial, o)| Some((trial, format!("{:#}", o.as_ref().err()?))))
        .collect();
    let mut out = std::io::stdout().lock();
    if options.json {
        let result = json!({
            "ok": ok, "kills": outcomes.len(), "airborne": airborne,
            "landed": count(&|o| o.landed), "hard": count(&|o| o.hard),
            "recaptured": count(&|o| o.recaptured > 0), "arm_again": count(&|o| o.arms_again),
            "largest_drift_m": most(&|o| o.drift_m), "hardest_impact_mps": most(&|o| o.impact_mps),
            "outcomes": flown, "not_flown": failed,
        });
        writeln!(out, "{}", serde_json::to_string_pretty(&result)?)?;
        return Ok(ok);
    }
    writeln!(out, "killed                     {}, {airborne} of them in the air", outcomes.len())?;
    writeln!(out, "landed by the board        {}", count(&|o| o.landed))?;
    writeln!(out, "came down hard             {}", count(&|o| o.hard))?;
    writeln!(out, "captured again unasked     {}", count(&|o| o.recaptured > 0))?;
    writeln!(out, "armed again when asked     {}", count(&|o| o.arms_again))?;
    writeln!(out, "farthest sideways, m       {:.2}", most(&|o| o.drift_m))?;
    writeln!(out, "hardest on the floor, m/s  {:.2}", most(&|o| o.impact_mps))?;
    for o in flown.iter().filter(|o| o.hard) {
        writeln!(out, "hard: {}", serde_json::to_string(o)?)?;
    }
    for o in flown.iter().filter(|o| !o.ok()) {
        writeln!(out, "WRONG: {}", serde_json::to_string(o)?)?;
    }
    for (trial, why) in &failed {
        writeln!(out, "NOT FLOWN: {}: {why}", trial.n)?;
    }
    Ok(ok)
}
