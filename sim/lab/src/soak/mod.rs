//! `haltere-lab soak`: one companion flies for as long as wanted, and is watched from outside.
//!
//! Endpoint and companion are processes, with taps on the wires between them. Flights follow one
//! another: take-off, a round of way points and holds, landing. The vehicle has a battery that lasts
//! for all of them. Seen are times on the wires, memory and processor time, and from the companion's
//! own log how late its control steps were and what it threw away. Time for which the computer itself
//! stood still is measured beside it and is not held against the companion.

mod asked;
mod report;
mod stalls;
mod tap;
mod wire;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use haltere::ctl::GroundStation;
use haltere::progress::Progress;
use haltere::rig::newest_log;
use haltere::rig::stop::Stop;
use haltere::rig::{Companion, Endpoint, Wiring, free_port, now_us};
use haltere::simulated::scenario::Scenario;
use haltere_model::Vehicle;

use self::asked::Asked;
use self::stalls::{Stalls, Watch};
use self::tap::{BoardSide, Taps};
use self::wire::Wire;
use crate::flood::measure::{Phase, phases};

/// `haltere-lab soak`
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Folder for configuration and log; made if it is missing.
    #[arg(long, value_name = "DIR", default_value = "soak")]
    pub output: PathBuf,
    /// How long, minutes.
    #[arg(long, value_name = "MIN", default_value_t = 2.0)]
    pub minutes: f64,
    /// Keep all processors busy meanwhile with so many threads of idle work.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub load: usize,
    /// Set a configuration value of the companion, as `haltere fly --set`.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Longest gap between two setpoints in flight that is allowed, ms; time for which a processor of
    /// this computer stood still does not count.
    #[arg(long, value_name = "MS", default_value_t = 20.0)]
    pub longest_gap_ms: f64,
    /// For a computer that does other things too, or is a guest of one: what depends on how much of it the
    /// companion gets is measured and printed, and judged by its middle; counts and memory as ever.
    #[arg(long)]
    pub shared: bool,
    /// Print the result as JSON on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Bounds of issue and source: share of the UWB chunks after which a setpoint is on the wire within
/// one control period and 2 ms.
const LATENCY_MS: f64 = 12.0;
const LATENCY_SHARE: f64 = 0.99;
/// Memory that may come after the first flight, bytes: an hour at 0.6 kB/s; 0.26 were seen (docs/REALTIME.md).
const MOST_GROWTH_B: u64 = 2 << 20;
/// Most memory, bytes, and processor time as a share of one core.
const MOST_MEMORY_B: u64 = 30 << 20;
const MOST_CPU: f64 = 0.05;
/// Most times a second that the companion's threads go to sleep: 1271 to 1422 were seen (2026-11-23), and some
/// more. Unlike seconds it does not depend on what else a computer does; a loop that polls is seen at once.
const MOST_SLEEPS_PER_S: f64 = 1600.0;
/// Middle of the time between setpoints, ms: the 100 Hz of the loop, and a twentieth.
const MIDDLE_GAP_MS: [f64; 2] = [9.5, 10.5];
/// Most for the middle of the way from UWB to setpoint, ms: one control period.
const MIDDLE_LATENCY_MS: f64 = 10.0;
/// A battery that lasts, mAh: the largest that the vehicle file takes.
const CAPACITY_MAH: f64 = 10_000.0;

const ALIGN_TIMEOUT: Duration = Duration::from_secs(30);
const LANDING: Duration = Duration::from_secs(40);
/// A flight during which processors stood still for longer than this, ms, may end early: half of the
/// silence that the companion takes for the loss of its IMU (`supervisor.imu_loss_s`).
const DISTURBED_MS: f64 = 100.0;
/// Flights that may end in trouble before it is given up.
const MOST_TROUBLE: usize = 5;
/// One flight's way points: north, east, height, m, and the time for each.
const ROUND: [[f64; 3]; 5] =
    [[6.0, 5.0, 1.2], [6.0, 6.0, 1.4], [5.0, 6.0, 1.0], [4.5, 5.0, 1.2], [5.0, 5.0, 1.2]];
const LEG: Duration = Duration::from_secs(6);
/// Rounds of one flight.
const ROUNDS: usize = 4;

/// Runs it. `false`: a bound is broken.
pub fn run(options: &Options) -> Result<bool> {
    if !(options.minutes > 0.0 && options.minutes <= 24.0 * 60.0) {
        bail!("--minutes {}: allowed above 0 to 1440", options.minutes);
    }
    let folder = std::path::absolute(&options.output).context("--output")?;
    std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    let logs = folder.join("log");
    if logs.exists() {
        std::fs::remove_dir_all(&logs).with_context(|| logs.display().to_string())?;
    }
    let stop = Stop::on_signals()?;
    let board = BoardSide::new()?;
    let vehicle = vehicle_file(&folder)?;
    let mut endpoint = Endpoint::start([
        "--seed".into(),
        "1".into(),
        "--board".into(),
        board.address.clone().into(),
        "--vehicle".into(),
        vehicle.into_os_string(),
    ])?;
    let taps = Taps::start(Path::new(endpoint.told("tag")?), board)?;
    let ground = free_port()?;
    let wiring = Wiring {
        tag: &taps.tag,
        tag_protocol: endpoint.told("tag_protocol")?,
        board: &taps.board,
        endpoints: &[format!("udpout:127.0.0.1:{ground}")],
        logs: &logs,
    };
    let config = wiring.write(&folder, &Scenario::load(None)?, "haltere-lab soak")?;
    let output = folder.join("companion.txt");
    let mut companion = Companion::start(&config, &options.overrides, output)?;
    let load = Load::start(options.load);
    let watched = Watched { companion: &companion, taps: &taps, processors: Watch::start()? };
    let seen = fly(options, &stop, &watched, &format!("udpin:127.0.0.1:{ground}"));
    drop(load);
    let stopped = companion.stop();
    endpoint.stop()?;
    let seen = seen.with_context(|| companion.last_words())?;
    stopped?;
    let log = newest_log(&logs)?;
    let steps = control_steps(&log, &seen.windows_us)?;
    report::tell(options, &seen, &steps, &log)
}

/// A vehicle whose battery lasts.
fn vehicle_file(folder: &Path) -> Result<PathBuf> {
    let mut vehicle = Vehicle::default();
    vehicle.battery.capacity_mah = CAPACITY_MAH;
    let file = folder.join("vehicle.toml");
    let text = toml::to_string(&vehicle).context("the vehicle as a file")?;
    haltere_log::written::write::<&Path>(&file, text, &[])?;
    Ok(file)
}

/// What was seen from outside.
#[derive(Debug, Default)]
struct Seen {
    flights: usize,
    /// Flights that were not flown to their end, and why.
    trouble: Vec<String>,
    /// Those of them that the computer may be the reason of.
    disturbed: usize,
    /// For how long processors stood still in the newest flight, ms.
    stood_ms: f64,
    wire: Wire,
    /// What a station asked in flight, and when it had its answers.
    asked: Asked,
    /// When processors stood still.
    stalls: Stalls,
    /// Begin and end of each flight, µs.
    windows_us: Vec<[u64; 2]>,
    /// Memory after the first flight and at the end, and the most of all, bytes.
    memory_B: [u64; 3],
    /// Share of a core, all the time.
    cpu: f64,
    /// How often threads of the companion went to sleep, each second.
    sleeps_per_s: f64,
}

/// What is looked at during a flight.
struct Watched<'a> {
    companion: &'a Companion,
    taps: &'a Taps,
    processors: Watch,
}

fn fly(options: &Options, stop: &Stop, watched: &Watched<'_>, ground: &str) -> Result<Seen> {
    let companion = watched.companion;
    let mut station = GroundStation::connect(ground)?;
    let began = Instant::now();
    let end = Duration::from_secs_f64(options.minutes * 60.0);
    let (cpu_s, sleeps) = (companion.cpu_s()?, companion.sleeps()?);
    let progress = Progress::counted("s", 0, end.as_secs());
    let mut seen = Seen::default();
    while began.elapsed() < end {
        if let Err(why) = one_flight(&mut station, &mut seen, watched, &|| {
            progress.reach(began.elapsed().as_secs());
            !stop.asked() && began.elapsed() < end
        }) {
            // What went wrong is told in the end; the hour goes on, if the vehicle does.
            let why = format!("after {:.0} s: {why:#}", began.elapsed().as_secs_f64());
            tracing::warn!("{why}");
            seen.trouble.push(why);
            seen.disturbed += usize::from(std::mem::take(&mut seen.stood_ms) > DISTURBED_MS);
            let _ = station.land();
            let _ = station.wait_landed(LANDING);
        }
        if stop.asked() {
            bail!("stopped by a signal");
        }
        if seen.trouble.len() > MOST_TROUBLE {
            bail!("{}", seen.trouble.join("\n"));
        }
        if seen.memory_B[0] == 0 {
            seen.memory_B[0] = companion.memory_B()?;
        }
    }
    seen.memory_B[1] = companion.memory_B()?;
    let took_s = began.elapsed().as_secs_f64();
    seen.cpu = (companion.cpu_s()? - cpu_s) / took_s;
    seen.sleeps_per_s = companion.sleeps()?.saturating_sub(sleeps) as f64 / took_s;
    progress.end();
    Ok(seen)
}

/// Take-off, rounds of way points, landing; the rounds end when `goes_on` says so.
fn one_flight(
    station: &mut GroundStation,
    seen: &mut Seen,
    watched: &Watched<'_>,
    goes_on: &dyn Fn() -> bool,
) -> Result<()> {
    arm(station)?;
    watched.taps.take();
    watched.processors.take();
    station.takeoff(ROUND[0][2]).context("take-off")?;
    let from_us = now_us();
    let mut asked = Asked::default();
    let mut airborne = || -> Result<()> {
        asked.parameters(station).context("the list of parameters")?;
        for [north_m, east_m, height_m] in std::iter::repeat_n(ROUND, ROUNDS).flatten() {
            station.goto(north_m, east_m, height_m).context("a way point")?;
            let leg = Instant::now();
            while leg.elapsed() < LEG {
                station.listen(Duration::from_millis(200))?;
                asked.command(station)?;
                seen.memory_B[2] = seen.memory_B[2].max(watched.companion.memory_B()?);
                if !goes_on() {
                    return Ok(());
                }
            }
        }
        Ok(())
    };
    let flown = airborne();
    // What was seen counts, however the flight ended.
    let to_us = now_us();
    let (passed, stalls) = (watched.taps.take(), watched.processors.take());
    seen.stood_ms = stalls.stood_us(from_us, to_us) as f64 * 1e-3;
    seen.asked.join(asked);
    seen.wire.join(Wire::of(&passed, &stalls, from_us, to_us));
    seen.stalls.join(stalls);
    seen.windows_us.push([from_us, to_us]);
    flown?;
    station.land().context("landing")?;
    station.wait_landed(LANDING).context("landing")?;
    seen.flights += 1;
    Ok(())
}

fn arm(station: &mut GroundStation) -> Result<()> {
    let deadline = Instant::now() + ALIGN_TIMEOUT;
    loop {
        match station.arm() {
            Ok(()) => return Ok(()),
            Err(error) if error.is_temporary() && Instant::now() < deadline => {
                station.listen(Duration::from_millis(500))?;
            }
            Err(error) => return Err(error).context("arming"),
        }
    }
}

/// The companion's own account of its control steps in flight, all flights together.
fn control_steps(log: &Path, windows_us: &[[u64; 2]]) -> Result<Phase> {
    phases(log, windows_us).map(|phases| phases.into_iter().reduce(Phase::join).unwrap_or_default())
}

/// Threads that keep processors busy.
struct Load(Arc<AtomicBool>, Vec<std::thread::JoinHandle<()>>);

impl Load {
    fn start(threads: usize) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let spin = |_| {
            let stop = stop.clone();
            std::thread::spawn(move || {
                let mut n = 1u64;
                while !stop.load(Relaxed) {
                    n = std::hint::black_box(n.wrapping_mul(6_364_136_223_846_793_005) + 1);
                }
            })
        };
        let threads = (0..threads).map(spin).collect();
        Self(stop, threads)
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.0.store(true, Relaxed);
        for thread in self.1.drain(..) {
            let _ = thread.join();
        }
    }
}
