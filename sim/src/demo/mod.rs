//! `haltere-sim demo`: endpoint, companion and ground station together, over the real wires.
//!
//! The endpoint and the companion are separate processes of this same program; between them lie
//! a pseudo-terminal and UDP sockets, as between a computer and its tag and board. The mission goes
//! up as a ground station would send it. Afterwards the flight log is read, laid over the truth file
//! and judged.

mod plan;
mod result;

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use haltere::ctl::{GroundStation, Mode};

use haltere::cli::{print, print_json};
use haltere::rig::firmware::Which;
use haltere::rig::{Pair, Setup, newest_log};
use haltere_log::written;

use self::plan::Plan;

/// `haltere-sim demo`
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Folder for configuration, log, truth and report; made if it is missing.
    #[arg(long, value_name = "DIR", default_value = "demo")]
    pub output: PathBuf,
    /// Scenario file of the endpoint, or the name of a built-in one (`haltere-sim print scenario`).
    #[arg(long, value_name = "FILE")]
    pub scenario: Option<PathBuf>,
    /// Seed of the endpoint's random numbers.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Fly the four shapes only, without the steps.
    #[arg(long)]
    pub short: bool,
    /// Set a configuration value of the companion, as `haltere fly --set`.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    #[command(flatten)]
    pub firmware: Which,
    /// Print the result as JSON on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Time to find the anchors' clocks and the start values.
const ALIGN_TIMEOUT: Duration = Duration::from_secs(30);
/// Flight time beyond the plan after which something is wrong.
const EXTRA_TIME: Duration = Duration::from_secs(60);
/// Between two lines of progress when standard error is no terminal.
const PROGRESS_PERIOD: Duration = Duration::from_secs(10);

/// What is written into the folder beside the log.
const WRITTEN: [&str; 5] =
    ["haltere.toml", "anchors.toml", "truth.csv", "companion.txt", "report.html"];

/// What a demo came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Judged {
    /// Every bound held.
    Well,
    /// One is broken.
    Badly,
    /// The simulator did not keep its time, and a bound is broken.
    Not,
}

/// Runs the demo.
pub fn run(options: &Options) -> Result<Judged> {
    let inputs: Vec<&PathBuf> = options.scenario.iter().collect();
    written::look_all(&options.output, &WRITTEN, &inputs).context("--output")?;
    std::fs::create_dir_all(&options.output)
        .with_context(|| format!("--output {}", options.output.display()))?;
    let plan = Plan::new(!options.short);
    eprintln!(
        "demo: about {:.0} s of flight in real time; log and report go to {}",
        plan.duration_s(),
        options.output.display()
    );
    let mut processes = Pair::start(&Setup {
        output: options.output.clone(),
        scenario: options.scenario.clone(),
        seed: options.seed,
        overrides: options.overrides.clone(),
        firmware: options.firmware.clone(),
        by: "haltere-sim demo",
    })?;
    eprintln!("demo: watch it live: {}", processes.page);
    let flown = fly(&processes, &plan);
    // The companion closes its log, the endpoint its truth file.
    let stopped = processes.stop();
    let landed = match flown {
        Ok(()) => Ok(()),
        Err(error) => {
            eprintln!("demo: {error:#}");
            Err(format!("{error:#}"))
        }
    };
    let late = stopped?;
    let log = newest_log(&processes.log_directory)?;
    let outcome = result::judge(&plan, &log, &processes.truth, landed, late)?;
    let report = options.output.join("report.html");
    written::write(&report, outcome.html(&log), &[&log])?;
    if options.json {
        eprint!("{}", outcome.table());
        print_json(&outcome.json(&log, &report))?;
    } else {
        print(&outcome.table().to_string())?;
        print(&format!("log:    {}\nreport: {}\n", log.display(), report.display()))?;
    }
    Ok(outcome.judged())
}

/// What a ground station does.
fn fly(processes: &Pair, plan: &Plan) -> Result<()> {
    let mut station = GroundStation::connect(&processes.ground)?;
    station.upload(&plan.items)?;
    eprintln!("demo: mission of {} items accepted, aligning", plan.items.len());
    let deadline = Instant::now() + ALIGN_TIMEOUT;
    loop {
        match station.arm() {
            Ok(()) => break,
            // Not ready yet: the estimator finds its start values.
            Err(error) if error.is_temporary() && Instant::now() < deadline => {
                station.listen(Duration::from_millis(500))?;
            }
            Err(error) => return Err(error).context("arming"),
        }
    }
    station.set_mode(Mode::Mission).context("starting the mission")?;
    let started = Instant::now();
    let timeout = Duration::from_secs_f64(plan.duration_s()) + EXTRA_TIME;
    let mut progress = Progress::new(plan, started);
    let mut airborne = false;
    loop {
        if processes.stop_asked() {
            bail!("stopped by a signal");
        }
        station.listen(Duration::from_millis(200))?;
        for text in station.take_texts() {
            progress.text(&text);
        }
        let vehicle = station.vehicle();
        progress.show(vehicle);
        airborne |= vehicle.armed && vehicle.height_m().is_some_and(|h| h > 0.5);
        if airborne && !vehicle.armed {
            progress.end(&format!("100 %, landed after {:.0} s", started.elapsed().as_secs_f64()));
            break;
        }
        if started.elapsed() > timeout {
            progress.end("not landed");
            bail!("the flight takes longer than {:.0} s", timeout.as_secs_f64());
        }
    }
    let last = plan.items.len().saturating_sub(1) as u16;
    let reached = station.vehicle().reached;
    if reached.is_none_or(|seq| seq + 1 < last) {
        bail!(
            "the vehicle landed after {} of {} items",
            reached.map_or(0, |seq| seq.saturating_add(1)),
            plan.items.len()
        );
    }
    Ok(())
}

/// One line that is rewritten on a terminal, now and then a line elsewhere.
struct Progress<'a> {
    plan: &'a Plan,
    started: Instant,
    next: Instant,
    terminal: bool,
}

impl<'a> Progress<'a> {
    fn new(plan: &'a Plan, started: Instant) -> Self {
        let terminal = std::io::stderr().is_terminal();
        Self { plan, started, next: started, terminal }
    }

    fn show(&mut self, vehicle: &haltere::ctl::Vehicle) {
        let now = Instant::now();
        if now < self.next {
            return;
        }
        self.next = now + if self.terminal { Duration::ZERO } else { PROGRESS_PERIOD };
        let current = vehicle.current.map_or(0, usize::from);
        let doing = match self.plan.items.get(current) {
            Some(item) => match (&item.path, item.command) {
                (Some(path), _) => path.clone(),
                (None, haltere_pilot::mission_file::Command::Takeoff) => "take-off".into(),
                (None, haltere_pilot::mission_file::Command::Land) => "landing".into(),
                _ => "on the way".into(),
            },
            None => "landing".into(),
        };
        let flown_s = self.started.elapsed().as_secs_f64();
        // The plan does not know how long take-off and landing take: the rest is 100 % when the vehicle is down.
        let percent = (100.0 * flown_s / self.plan.duration_s()).min(99.0);
        let [north_m, east_m, down_m] = vehicle.position_m.unwrap_or([f64::NAN; 3]);
        let line = format!(
            "demo: {percent:2.0} %, {:.0} s left  item {:2}/{}  {doing:12}  N {north_m:5.2}  E {east_m:5.2}  \
             height {:5.2} m  {:4.2} V",
            (self.plan.duration_s() - flown_s).max(0.0),
            (current + 1).min(self.plan.items.len()),
            self.plan.items.len(),
            -down_m,
            vehicle.supply_v.unwrap_or(f64::NAN),
        );
        if self.terminal {
            eprint!("\r{line}\u{1b}[K");
        } else {
            eprintln!("{line}");
        }
    }

    fn text(&self, text: &str) {
        if self.terminal {
            eprintln!("\r\u{1b}[Kdemo: vehicle: {text}");
        } else {
            eprintln!("demo: vehicle: {text}");
        }
    }

    fn end(&self, how: &str) {
        let back = if self.terminal { "\r\u{1b}[K" } else { "" };
        eprintln!("{back}demo: {how}");
    }
}
