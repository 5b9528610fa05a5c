//! `haltere-lab flood`: the companion hovers, and others shout at its ground endpoints.
//!
//! Endpoint and companion are processes. While the vehicle hovers, attackers send what is
//! well formed and what is not, over UDP from one address and from many, over TCP, with connections
//! that come and go and one that never reads. Measured is what the companion itself wrote down: how late
//! its control steps were, before and during the flood, what it threw away, and its memory.

mod attack;
pub mod measure;

use std::io::Write as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use haltere::ctl::{GroundStation, Mode};
use haltere::rig::firmware::Which;
use haltere::rig::{Pair, Setup, free_port, newest_log, now_us};
use serde_json::json;

use self::attack::Attack;
use self::measure::{Phase, phases};

/// `haltere-lab flood`
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Folder for configuration and log; made if it is missing.
    #[arg(long, value_name = "DIR", default_value = "flood")]
    pub output: PathBuf,
    /// Seconds of hover before, and seconds of flood.
    #[arg(long, value_name = "S", default_value_t = 15.0)]
    pub seconds: f64,
    /// Frames that all attackers together try to send in a second.
    #[arg(long, value_name = "N", default_value_t = 20_000)]
    pub frames_per_s: u32,
    /// Set a configuration value of the companion, as `haltere fly --set`.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Print the result as JSON on standard output.
    #[arg(long)]
    pub json: bool,
}

/// Time to find the anchors' clocks and the start values.
const ALIGN_TIMEOUT: Duration = Duration::from_secs(30);
/// Hovering height, m.
const HEIGHT_M: f64 = 1.2;
/// Settling before anything is measured.
const SETTLE: Duration = Duration::from_secs(3);

/// Late control steps during the flood, as a share, that are too many beyond twice those before it:
/// attackers and simulator here share the processor with the companion, and with whatever else runs.
const MOST_LATE_SHARE: f64 = 0.05;
/// What the companion's memory may grow by, bytes: every queue and buffer at its bound.
const MOST_GROWTH_B: u64 = 64 << 20;

/// Runs the flood. `false`: a bound is broken.
pub fn run(options: &Options) -> Result<bool> {
    std::fs::create_dir_all(&options.output)
        .with_context(|| format!("--output {}", options.output.display()))?;
    let (udp, tcp) = (free_port()?, free_port()?);
    let more = [format!("udpin:127.0.0.1:{udp}"), format!("tcpin:127.0.0.1:{tcp}")];
    let setup = Setup {
        output: options.output.clone(),
        scenario: None,
        seed: 1,
        overrides: options.overrides.clone(),
        firmware: Which::default(),
        by: "haltere-lab flood",
    };
    let mut processes = Pair::start_with(&setup, &more)?;
    let flown = hover(options, &processes, udp, tcp);
    let stopped = processes.stop();
    let flown = flown?;
    stopped?;
    let log = newest_log(&processes.log_directory)?;
    let [a, b, c, d] = flown.marks;
    let mut both = phases(&log, &[[a, b], [c, d]])?.into_iter();
    let (quiet, flood) = (both.next().unwrap_or_default(), both.next().unwrap_or_default());
    let growth_B = flown.memory_B[1].saturating_sub(flown.memory_B[0]);
    let ok = flown.landed
        && flood.late_share() <= 2.0 * quiet.late_share() + MOST_LATE_SHARE
        && flood.dropped > 0
        && growth_B <= MOST_GROWTH_B;
    let mut out = haltere::cli::Out::lock();
    if options.json {
        let phase = |p: &Phase, drift_m: f64| {
            json!({
                "control_steps": p.steps, "late": p.late, "late_share": p.late_share(),
                "median_ms": p.lateness_ms(0.5), "p99_ms": p.lateness_ms(0.99),
                "worst_ms": p.lateness_ms(1.0), "longest_pause_ms": p.longest_pause_ms,
                "dropped": p.dropped, "input_kB": p.input_B / 1000, "drift_m": drift_m,
            })
        };
        let result = json!({
            "ok": ok, "landed": flown.landed, "frames_sent": flown.sent,
            "quiet": phase(&quiet, flown.drift_m[0]), "flood": phase(&flood, flown.drift_m[1]),
            "memory_growth_kB": growth_B / 1000, "drops": flood.drops, "log": log,
        });
        writeln!(out, "{}", serde_json::to_string_pretty(&result)?)?;
    } else {
        writeln!(out, "                      quiet      flood")?;
        let mut row = |name: &str, of: &dyn Fn(&Phase) -> f64| {
            writeln!(out, "{name:18} {:9.3}  {:9.3}", of(&quiet), of(&flood))
        };
        row("control steps", &|p| p.steps as f64)?;
        row("late, over 5 ms", &|p| p.late as f64)?;
        row("median late, ms", &|p| p.lateness_ms(0.5))?;
        row("99 % late, ms", &|p| p.lateness_ms(0.99))?;
        row("worst late, ms", &|p| p.lateness_ms(1.0))?;
        row("longest pause, ms", &|p| p.longest_pause_ms)?;
        row("thrown away", &|p| p.dropped as f64)?;
        row("let in, kB", &|p| p.input_B as f64 / 1000.0)?;
        writeln!(
            out,
            "drift in hover, m  {:9.3}  {:9.3}\nsent {} frames; memory grew by {} kB; {}",
            flown.drift_m[0],
            flown.drift_m[1],
            flown.sent,
            growth_B / 1000,
            if ok { "within bounds" } else { "A BOUND IS BROKEN" }
        )?;
        for (reason, count) in &flood.drops {
            writeln!(out, "  {reason}: {count}")?;
        }
    }
    Ok(ok)
}

/// What a flight came to, seen from its ground station.
struct Flown {
    /// Ends of the quiet part and of the flood, µs of the monotonic clock, which the log counts in too.
    marks: [u64; 4],
    landed: bool,
    sent: u64,
    /// Farthest from where it hovered, m.
    drift_m: [f64; 2],
    memory_B: [u64; 2],
}

fn hover(options: &Options, processes: &Pair, udp: u16, tcp: u16) -> Result<Flown> {
    let mut station = GroundStation::connect(&processes.ground)?;
    let deadline = Instant::now() + ALIGN_TIMEOUT;
    loop {
        match station.arm() {
            Ok(()) => break,
            Err(error) if error.is_temporary() && Instant::now() < deadline => {
                station.listen(Duration::from_millis(500))?;
            }
            Err(error) => return Err(error).context("arming"),
        }
    }
    station.takeoff(HEIGHT_M).context("taking off")?;
    station.set_mode(Mode::Hold).context("holding")?;
    station.listen(SETTLE)?;
    let part = Duration::from_secs_f64(options.seconds);
    let before = (now_us(), processes.companion_memory_B()?);
    let quiet_m = drift(&mut station, part)?;
    let quiet_end = now_us();
    let attack = Attack::start(udp, tcp, options.frames_per_s)?;
    // The first second is that of the bursts that are allowed.
    station.listen(Duration::from_secs(1))?;
    let flood_begin = now_us();
    let flood_m = drift(&mut station, part)?;
    let after = (now_us(), processes.companion_memory_B()?);
    let sent = attack.stop();
    let landed = station.land().is_ok();
    Ok(Flown {
        marks: [before.0, quiet_end, flood_begin, after.0],
        landed,
        sent,
        drift_m: [quiet_m, flood_m],
        memory_B: [before.1, after.1],
    })
}

/// Farthest from the first place within this time, m.
fn drift(station: &mut GroundStation, time: Duration) -> Result<f64> {
    let end = Instant::now() + time;
    let (mut first, mut far_m) = (None, 0.0_f64);
    while Instant::now() < end {
        station.listen(Duration::from_millis(50))?;
        if let Some(p) = station.vehicle().position_m {
            let [n, e, d] = *first.get_or_insert(p);
            far_m = far_m.max((p[0] - n).hypot(p[1] - e).hypot(p[2] - d));
        }
    }
    Ok(far_m)
}
