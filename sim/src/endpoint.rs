//! `haltere-sim serve`: the plant in real time, on a pseudo-terminal and a UDP socket.
//!
//! One loop on absolute deadlines: bytes in, plant up to now, bytes out. It never waits for the
//! companion, which may come, go and come back.

use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use haltere::live::realtime::insist_on_deadlines;
use haltere::report::truth::TruthRow;
use haltere::rig::firmware::Interface;
use haltere::rig::pty::{Dtr, TagPty};
use haltere::rig::stop::Stop;
use haltere::simulated::faults::happen;
use haltere::simulated::scenario::Scenario;
use haltere::vehicles;
use haltere_core::time::HostTime;
use haltere_model::board::Firmware;
use haltere_model::tag::TagProtocol;
use haltere_model::{Fault, Plant, Vehicle};
use haltere_pilot::settings::Address;
use rustix::io::Errno;
use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};
use serde_json::json;

use crate::board_wire::BoardWire;
use crate::firmware::{Crazyflie, FIRMWARE_YAW_DEG, InnerLoop};
use crate::lateness::Lateness;
use crate::orders::{self, Next, Order, Orders};
use crate::packet_wire::PacketWire;
use crate::truth_file::TruthFile;

/// `haltere-sim serve`
#[derive(Debug, Clone, clap::Args)]
pub struct Options {
    /// Scenario file, or the name of a built-in one (`haltere-sim print scenario`); without it the vehicle stands in the middle of a 10 × 10 × 7 m hall.
    #[arg(long, value_name = "FILE")]
    pub scenario: Option<PathBuf>,
    /// Seed of the random numbers; wins over the scenario.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Ends after this simulated time, s; else a signal ends it.
    #[arg(long, value_name = "S")]
    pub duration: Option<f64>,
    /// Simulated seconds a second.
    #[arg(long, value_name = "X", default_value_t = 1.0)]
    pub speed: f64,
    /// Vehicle file, or the name of a built-in one (`haltere-sim print vehicle`).
    #[arg(long, value_name = "FILE")]
    pub vehicle: Option<PathBuf>,
    /// Symbolic link to the tag's pseudo-terminal.
    #[arg(long, value_name = "PATH")]
    pub tag_link: Option<PathBuf>,
    /// What the tag speaks: lps-sniffer (TDoA2 on the air), tdoa3, mavlink; wins over the scenario.
    #[arg(long, value_name = "P", value_parser = tag_protocol)]
    pub tag_protocol: Option<TagProtocol>,
    /// The board's own end of its line, `udpin:HOST:PORT` or `udpout:HOST:PORT`. Default:
    /// udpout:127.0.0.1:14600; where another simulator speaks there, the next port that is free. With `crazyflie`
    /// the board is one whatever the scenario says, at the first free port from 19850 on, one packet a datagram.
    #[arg(long, value_name = "ADDR", value_parser = board_at)]
    pub board: Option<BoardAt>,
    /// Instead of the simulated board a real firmware flies the vehicle: its physics are served on this UDP
    /// port of the loopback, by ArduPilot's JSON interface; it speaks to the companion by itself.
    #[arg(long, value_name = "PORT", conflicts_with = "board")]
    pub json_physics: Option<u16>,
    /// The same for PX4: it takes its sensors from this TCP port of the loopback.
    #[arg(long, value_name = "PORT", conflicts_with_all = ["board", "json_physics"])]
    pub hil_physics: Option<u16>,
    /// A Crazyflie's firmware that you have built for the host, with a clock that is driven, as the board: as with `--board
    /// crazyflie` (docs/CRAZYFLIE.md).
    #[arg(long, value_name = "PROGRAM", conflicts_with_all = ["board", "json_physics", "hil_physics"])]
    pub crazyflie: Option<PathBuf>,
    /// File for truth, 100 lines a second.
    #[arg(long, value_name = "FILE")]
    pub truth: Option<PathBuf>,
    /// Takes orders of a script on standard input, one JSON object a line, and answers on standard output:
    /// {"fault": {"part": "anchor", "anchor": 3}}, {"truth": true}, {"late": true}. Ends when standard input ends.
    #[arg(long)]
    pub orders: bool,
}

/// Period of the loop, µs of host time.
const TICK_US: u64 = 1_000;
/// Priority under SCHED_FIFO: below the companion's, which must win on one core.
const PRIORITY: u8 = 40;
/// Highest speed at which the loop runs under it.
const REALTIME_SPEED: f64 = 2.0;
/// Period of truth rows, µs of simulated time.
const TRUTH_US: u64 = 10_000;
/// A loop that is later than this gives the lost time up, µs: the computer slept. With a firmware it does so
/// soon, since every step to be made up for takes the firmware's time too.
const GIVE_UP_US: u64 = 1_000_000;
const GIVE_UP_WITH_FIRMWARE_US: u64 = 20_000;
/// Speeds that make sense: the links and the companion live in real time.
const SPEEDS: std::ops::RangeInclusive<f64> = 0.01..=100.0;

/// Where the board speaks, or which one it is.
#[derive(Debug, Clone, PartialEq)]
pub enum BoardAt {
    Address(Address),
    Crazyflie,
}

fn board_at(text: &str) -> Result<BoardAt, String> {
    match text {
        "crazyflie" => Ok(BoardAt::Crazyflie),
        _ => text.parse().map(BoardAt::Address).map_err(|why| format!("{why}")),
    }
}

fn tag_protocol(text: &str) -> Result<TagProtocol, String> {
    match text {
        "lps-sniffer" | "tdoa2" => Ok(TagProtocol::Tdoa2),
        "tdoa3" => Ok(TagProtocol::Tdoa3),
        "mavlink" => Ok(TagProtocol::Mavlink),
        _ => Err("allowed lps-sniffer (the same as tdoa2), tdoa3, mavlink".into()),
    }
}

/// Runs until a signal or the end of `--duration`. `false`: it was too late to stand in for anything.
pub fn serve(options: &Options) -> Result<bool> {
    if !SPEEDS.contains(&options.speed) {
        bail!("--speed {}: allowed {} to {}", options.speed, SPEEDS.start(), SPEEDS.end());
    }
    let stop = Stop::on_signals()?;
    let mut scenario = Scenario::load(options.scenario.as_deref())?;
    scenario.seed = options.seed.unwrap_or(scenario.seed);
    scenario.tag.protocol = options.tag_protocol.unwrap_or(scenario.tag.protocol);
    if options.crazyflie.is_some() {
        scenario.start.yaw_deg = FIRMWARE_YAW_DEG;
    }
    if options.crazyflie.is_some() || options.board == Some(BoardAt::Crazyflie) {
        scenario.board.firmware = Firmware::Crazyflie;
    }
    let faults = scenario.fixed_faults()?;
    let mut plant = plant(options.vehicle.as_deref(), &scenario)?;
    if let Some(program) = &options.crazyflie {
        plant.fly_by(Box::new(Crazyflie::start(program, true)?), None)?;
    }
    let mut tag = TagPty::new(options.tag_link.as_deref())?;
    let interface =
        (options.json_physics.map(Interface::Json)).or(options.hil_physics.map(Interface::Hil));
    let mut board = match interface {
        Some(interface) => {
            let start_E_m = plant.truth().pos_E_m;
            let inner = InnerLoop::listen(interface, plant.vehicle(), start_E_m)?;
            BoardSide::Firmware(Box::new(inner))
        }
        None if scenario.board.firmware == Firmware::Crazyflie => {
            if let Some(BoardAt::Address(address)) = &options.board {
                bail!("--board {address}: a Crazyflie takes the first free port from 19850 on");
            }
            BoardSide::Crazyflie(PacketWire::open_free()?)
        }
        None => BoardSide::Simulated(match &options.board {
            Some(BoardAt::Address(address)) => BoardWire::open(address)?,
            _ => BoardWire::open_free()?,
        }),
    };
    let inputs: Vec<&Path> = [&options.scenario, &options.vehicle]
        .into_iter()
        .filter_map(|file| file.as_deref())
        .collect();
    let mut truth =
        options.truth.as_deref().map(|path| TruthFile::create(path, &inputs)).transpose()?;
    let greeting = json!({
        "tag": tag.device(),
        "tag_protocol": scenario.companion_protocol(),
        "board": board.companion_address(),
        "board_own": board.own_address(),
        "json_physics": options.json_physics,
        "hil_physics": options.hil_physics,
        "truth": options.truth,
        "seed": scenario.seed,
        "start_us": now_us(),
    });
    let mut out = haltere::cli::Out::lock();
    writeln!(out, "{greeting}").and_then(|()| out.flush()).context("standard output")?;
    drop(out);
    if options.orders {
        orders::answer_without_waiting()?;
    }
    let orders = options.orders.then(Orders::listen).transpose()?;
    // Late bytes of tag and board would look like jitter of the real devices. Not with a firmware, which has to run as well.
    if interface.is_none() {
        keep_time(options.speed);
    }
    let wires = Wires { tag: &mut tag, board: &mut board, orders };
    let ticks = run(options, &stop, faults, &mut plant, wires, truth.as_mut());
    let lost_rows = truth.map_or(Ok(0), TruthFile::finish)?;
    tracing::info!(
        ticks.late,
        tag_dropped_bytes = tag.dropped(),
        board_dropped_bytes = board.dropped(),
        board_refused_datagrams = board.wire().map_or(0, BoardWire::refused),
        firmware_restarts_and_strange = ?board.restarts_and_strange(),
        waited = ticks.waited,
        truth_lost_rows = lost_rows,
        "ended"
    );
    // Who started it may have gone.
    orders::answer(&ticks.lateness.json());
    let not_judged = ticks.lateness.not_judged();
    if let Some(words) = &not_judged {
        tracing::error!("{words}");
    }
    Ok(not_judged.is_none())
}

/// Puts the loop of a world before all that does not keep time itself, where that is permitted. Not at many times real time,
/// where the loop may never sleep.
pub fn keep_time(speed: f64) {
    if speed <= REALTIME_SPEED
        && let Err(why) = insist_on_deadlines(PRIORITY)
    {
        tracing::debug!("{why}");
    }
}

/// The world of a scenario.
pub fn plant(vehicle: Option<&Path>, scenario: &Scenario) -> Result<Plant> {
    let vehicle = match vehicle {
        Some(path) => {
            let name = path.display();
            Vehicle::from_toml(&vehicles::read(path)?).with_context(|| format!("{name}"))?
        }
        None => Vehicle::default(),
    };
    Ok(Plant::new(scenario.plant(vehicle)?)?)
}

/// How the loop kept its deadlines.
#[derive(Debug, Default)]
struct Ticks {
    late: u64,
    lateness: Lateness,
    /// Turns in which the world stood, because the firmware had not said what its motors do.
    waited: u64,
}

/// Whose inner loop it is.
enum BoardSide {
    Simulated(BoardWire),
    Crazyflie(PacketWire),
    Firmware(Box<InnerLoop>),
}

impl BoardSide {
    fn wire(&self) -> Option<&BoardWire> {
        match self {
            Self::Simulated(wire) => Some(wire),
            Self::Crazyflie(_) | Self::Firmware(_) => None,
        }
    }

    /// What the companion has to be told.
    fn companion_address(&self) -> Option<String> {
        match self {
            Self::Simulated(wire) => Some(wire.companion_address().to_string()),
            Self::Crazyflie(wire) => Some(wire.companion_address()),
            Self::Firmware(_) => None,
        }
    }

    /// Its own end; of a Crazyflie as cflib is told.
    fn own_address(&self) -> Option<String> {
        match self {
            Self::Simulated(wire) => Some(wire.own_address().to_string()),
            Self::Crazyflie(wire) => Some(wire.uri()),
            Self::Firmware(_) => None,
        }
    }

    fn dropped(&self) -> u64 {
        match self {
            Self::Simulated(wire) => wire.dropped(),
            Self::Crazyflie(wire) => wire.dropped,
            Self::Firmware(_) => 0,
        }
    }

    fn read(&mut self, into: &mut Vec<u8>) {
        into.clear();
        match self {
            Self::Simulated(wire) => wire.read(now_us(), into),
            Self::Crazyflie(wire) => wire.read(into),
            Self::Firmware(_) => {}
        }
    }

    fn restarts_and_strange(&self) -> (u64, u64) {
        match self {
            Self::Simulated(_) | Self::Crazyflie(_) => (0, 0),
            Self::Firmware(inner) => inner.restarts_and_strange(),
        }
    }
}

/// What leads out of the simulated world.
struct Wires<'a> {
    tag: &'a mut TagPty,
    board: &'a mut BoardSide,
    orders: Option<Orders>,
}

fn run(
    options: &Options,
    stop: &Stop,
    faults: Vec<(f64, Fault)>,
    plant: &mut Plant,
    wires: Wires<'_>,
    mut truth: Option<&mut TruthFile>,
) -> Ticks {
    let Wires { tag, board, orders } = wires;
    let mut ticks = Ticks::default();
    let mut from_tag = Vec::new();
    let mut from_board = Vec::new();
    // Host time at which simulated time was zero; moved when the computer slept.
    let mut start_us = now_us();
    let mut deadline_us = start_us;
    let mut truth_due_us = 0;
    let mut faults = faults.into_iter().peekable();
    let give_up_us = match board {
        BoardSide::Firmware(_) => GIVE_UP_WITH_FIRMWARE_US,
        _ => GIVE_UP_US,
    };
    while !stop.asked() {
        deadline_us += TICK_US;
        sleep_until(deadline_us);
        let late_us = now_us().saturating_sub(deadline_us);
        if late_us > TICK_US {
            ticks.late += 1;
        }
        if !matches!(board, BoardSide::Firmware(_)) {
            ticks.lateness.note(late_us);
        }
        if late_us > give_up_us {
            start_us += late_us;
            deadline_us += late_us;
        }
        if let BoardSide::Firmware(inner) = &mut *board
            && !inner.steer(plant, TICK_US as f64 * 1e-6 * options.speed)
        {
            start_us += TICK_US;
            ticks.waited += 1;
            continue;
        }
        let simulated_us = ((deadline_us - start_us) as f64 * options.speed) as u64;
        if options.duration.is_some_and(|s| simulated_us as f64 * 1e-6 >= s) {
            break;
        }
        while let Some((_, fault)) = faults.next_if(|(at_s, _)| at_s * 1e6 <= simulated_us as f64) {
            happen(fault, plant);
        }
        if let Some(orders) = &orders
            && !obey(orders, plant, start_us, options.speed, &ticks.lateness)
        {
            break;
        }
        from_tag.clear();
        let dtr = tag.read(&mut from_tag);
        if dtr == Dtr::Rising {
            plant.tag_opened();
        }
        if !from_tag.is_empty() {
            plant.tag_input(&from_tag);
        }
        board.read(&mut from_board);
        if !from_board.is_empty() {
            plant.board_input(&from_board);
        }
        plant.advance_to(simulated_us);
        let output = plant.tag_output();
        // Silent while nobody has the device open.
        if dtr != Dtr::Low {
            tag.write(output);
        }
        output.clear();
        match &mut *board {
            BoardSide::Simulated(wire) => wire.write(now_us(), plant.board_output()),
            BoardSide::Crazyflie(wire) => wire.write(plant.board_output()),
            BoardSide::Firmware(inner) => inner.answer(plant, simulated_us),
        }
        plant.board_output().clear();
        if let Some(truth) = truth.as_deref_mut()
            && simulated_us >= truth_due_us
        {
            truth_due_us = simulated_us - simulated_us % TRUTH_US + TRUTH_US;
            truth.push(row(plant, start_us, options.speed));
        }
    }
    ticks
}

/// `false`: the script is gone.
fn obey(
    orders: &Orders,
    plant: &mut Plant,
    start_us: u64,
    speed: f64,
    lateness: &Lateness,
) -> bool {
    loop {
        match orders.next() {
            Next::Order(Order::Fault(fault)) => orders::inject(plant, fault),
            Next::Order(Order::Truth) => orders::tell_truth(&row(plant, start_us, speed)),
            Next::Order(Order::Late) => orders::answer(&lateness.json()),
            Next::Order(Order::Run(_)) => orders::refuse(&anyhow::anyhow!(
                "run_s: time passes by itself here; `haltere-sim lockstep --speed 0` leaves it to the script"
            )),
            Next::None => return true,
            Next::Ended => return false,
        }
    }
}

fn row(plant: &Plant, start_us: u64, speed: f64) -> TruthRow {
    let truth = plant.truth();
    TruthRow::of(&truth, HostTime::from_us(start_us + (truth.t_us as f64 / speed) as u64))
}

fn now_us() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec.unsigned_abs() * 1_000_000 + now.tv_nsec.unsigned_abs() / 1000
}

fn sleep_until(deadline_us: u64) {
    let request = Timespec {
        tv_sec: (deadline_us / 1_000_000).cast_signed(),
        tv_nsec: (deadline_us % 1_000_000 * 1000).cast_signed(),
    };
    while let Err(Errno::INTR) = clock_nanosleep_absolute(ClockId::Monotonic, &request) {}
}
