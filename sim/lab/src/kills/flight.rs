//! One flight: take-off, what befalls the companion in it, and the way down.

use std::path::Path;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use haltere::ctl::{GroundStation, Mode};
use haltere::report::truth;
use haltere::rig::firmware::{Firmware, Which};
use haltere::rig::newest_log;
use haltere::rig::{Companion, Endpoint, Output, Wiring, free_port, now_us};
use haltere::simulated::scenario::Scenario;
use haltere_dialect::mav::haltere::{
    COMMAND_INT_DATA, COMMAND_LONG_DATA, MavCmd, MavFrame, MavMessage,
};
use haltere_dialect::mav_stream::MavSplitter;
use haltere_log::record::{Entry, LogReader};
use haltere_pilot::LinkId;
use rustix::process::Signal;

use super::judge::{self, Outcome, Seen};
use super::kind::{Kind, Phase, Trial};

/// The flight that may be struck anywhere, s after its spool began: two points, then landing.
const POINTS: [(f64, [f64; 3]); 2] = [(4.0, [6.0, 5.5, 1.5]), (8.0, [5.0, 5.0, 1.0])];
const LAND_S: f64 = 11.0;
const ALIGN_TIMEOUT: Duration = Duration::from_secs(60);
/// A phase has to begin within this after its order.
const PHASE_TIMEOUT: Duration = Duration::from_secs(20);
/// Time for the board to come down and disarm, after the kill or the restart.
const DOWN: Duration = Duration::from_secs(10);
/// A real firmware notices after 2 s, sinks at half a metre a second and makes sure that it stands.
const DOWN_BY_FIRMWARE: Duration = Duration::from_secs(20);
/// Time to land and end after a signal, from the heights of these flights.
const END_TIMEOUT: Duration = Duration::from_secs(30);
/// What is asked twice ends within this.
const AT_ONCE: Duration = Duration::from_millis(1200);
/// A signal is heard within this.
const HEARD: Duration = Duration::from_millis(300);
/// After a fault that leaves it flying it is left alone for so long, then given orders that make it say
/// something, and then told to land.
const ALONE: Duration = Duration::from_millis(1500);
const REFUSED_POINTS: usize = 30;

/// Held while a flight takes its ports.
static PORTS: Mutex<()> = Mutex::new(());

/// Programs of a flight, and the station that looks on.
struct Rig {
    companion: Companion,
    output: Option<Output>,
    firmware: Option<Firmware>,
    ground: String,
}

/// Flies it.
pub fn fly(trial: &Trial, folder: &Path, which: &Which) -> Result<Outcome> {
    if folder.exists() {
        std::fs::remove_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let truth = folder.join("truth.csv");
    let logs = folder.join("log");
    let between = which.between()?;
    let [how, what] = between.arguments();
    // A port that is free now need not be when a program opens it: one flight at a time takes its own.
    let ports = PORTS.lock().unwrap_or_else(PoisonError::into_inner);
    let mut endpoint = Endpoint::start([
        "--seed".into(),
        (trial.n as u64 + 1).to_string().into(),
        how,
        what,
        "--truth".into(),
        truth.clone().into_os_string(),
    ])?;
    let board = between.address(&endpoint)?;
    let port = free_port()?;
    let wiring = Wiring {
        tag: endpoint.told("tag")?,
        tag_protocol: endpoint.told("tag_protocol")?,
        board: &board,
        endpoints: &[format!("udpout:127.0.0.1:{port}")],
        logs: &logs,
    };
    let config = wiring.write(folder, &Scenario::load(None)?, "haltere-lab kills")?;
    let (companion, output) = start(trial.kind, &config, folder)?;
    let firmware = between.start(&folder.join("firmware"))?;
    let ground = format!("udpin:127.0.0.1:{port}");
    let mut station = GroundStation::connect(&ground).with_context(|| companion.last_words())?;
    drop(ports);
    let mut rig = Rig { companion, output, firmware, ground };

    let mut seen = Seen::default();
    let struck = strike(trial, &mut rig, &mut station, &mut seen);
    struck.with_context(|| rig.companion.last_words())?;
    // Its port is wanted again.
    drop(station);
    if trial.kind == Kind::Killed {
        std::thread::sleep(Duration::from_secs_f64(trial.lasts_s));
        rig.companion = Companion::start(&config, &[], folder.join("second.txt"))?;
        std::thread::sleep(if which.is_real() { DOWN_BY_FIRMWARE } else { DOWN });
    }
    let asked_us = now_us();
    let arms_again = trial.kind == Kind::Killed && rig.companion.runs() && {
        let mut station = GroundStation::connect(&rig.ground)?;
        arm(&mut station).and_then(|()| Ok(station.disarm()?)).is_ok()
    };
    if !trial.kind.ends() {
        seen.ends_when_asked = rig.companion.stop().is_ok();
    } else if trial.kind.leaves_board_alone() {
        std::thread::sleep(if which.is_real() { DOWN_BY_FIRMWARE } else { DOWN });
    }
    if let Some(firmware) = &mut rig.firmware {
        firmware.stop()?;
    }
    endpoint.stop()?;

    let file = std::fs::File::open(&truth).with_context(|| truth.display().to_string())?;
    let rows = truth::read(std::io::BufReader::new(file))?;
    if trial.kind == Kind::Killed {
        seen.arms_again = arms_again;
        seen.recaptured = setpoints(&newest_log(&logs)?, asked_us)?;
        seen.until_us = Some(asked_us);
    }
    judge::judge(trial, &rows, &seen)
}

/// The companion, with a pipe of ours for its output where that is what breaks.
fn start(kind: Kind, config: &Path, folder: &Path) -> Result<(Companion, Option<Output>)> {
    let said = folder.join("first.txt");
    if !matches!(kind, Kind::OutputBlocked | Kind::OutputClosed) {
        return Ok((Companion::start(config, &[], said)?, None));
    }
    let mut output = Output::new(&said)?;
    let streams = [output.stream()?, output.stream()?];
    let companion = Companion::start_into(config, &[], said, streams)?;
    output.handed_over();
    Ok((companion, Some(output)))
}

/// Flies to the moment, does it, and follows the companion to its landing where it still flies.
fn strike(
    trial: &Trial,
    rig: &mut Rig,
    station: &mut GroundStation,
    seen: &mut Seen,
) -> Result<()> {
    arm(station)?;
    // Nobody waits for the height: the order stands as soon as it is answered.
    let ordered = Instant::now();
    take_off(station, trial.height_m)?;
    await_words(rig, station, Phase::Spool.begins_with())?;
    if trial.phase == Phase::Landing {
        await_words(rig, station, Phase::Hover.begins_with())?;
        listen(rig, station, Duration::from_secs(1))?;
        station.set_mode(Mode::Land)?;
    }
    if !matches!(trial.phase, Phase::Spool | Phase::Any) {
        await_words(rig, station, trial.phase.begins_with())?;
    }
    if trial.phase == Phase::Any {
        tour(trial, rig, station, ordered)?;
    } else {
        listen(rig, station, Duration::from_secs_f64(trial.at_s))?;
    }
    seen.struck_us = now_us();
    befall(trial, rig, station, seen)
}

fn befall(
    trial: &Trial,
    rig: &mut Rig,
    station: &mut GroundStation,
    seen: &mut Seen,
) -> Result<()> {
    let lasts = Duration::from_secs_f64(trial.lasts_s);
    match trial.kind {
        Kind::Killed => return rig.companion.kill(),
        Kind::Paused => {
            rig.companion.signal(Signal::STOP)?;
            std::thread::sleep(lasts);
            rig.companion.signal(Signal::CONT)?;
        }
        Kind::HangUp => rig.companion.signal(Signal::HUP)?,
        Kind::Interrupt => rig.companion.signal(Signal::INT)?,
        Kind::Terminate => rig.companion.signal(Signal::TERM)?,
        Kind::InterruptTwice => {
            rig.companion.signal(Signal::INT)?;
            std::thread::sleep(lasts);
            // From the spool it may have ended by itself.
            if rig.companion.runs() {
                rig.companion.signal(Signal::INT)?;
            }
        }
        Kind::OutputBlocked => rig.output.as_mut().context("no pipe")?.block()?,
        Kind::OutputClosed => rig.output.as_mut().context("no pipe")?.close(),
    }
    if trial.kind.ends() {
        return follow_to_end(trial.kind, rig, station, seen);
    }
    station.listen(ALONE)?;
    for n in 0..REFUSED_POINTS {
        // Outside of any volume: refused, in words for people.
        go_to(station, [60.0 + n as f64, 50.0, 1.0])?;
        station.listen(Duration::from_millis(30))?;
    }
    seen.flies_on = rig.companion.runs();
    if station.vehicle().armed {
        // Refused where it disarms already.
        let _ = station.set_mode(Mode::Land);
        seen.lands_when_asked = station.wait_landed(END_TIMEOUT).is_ok();
    }
    Ok(())
}

/// It lands and ends by itself, and nobody can hold it back.
fn follow_to_end(
    kind: Kind,
    rig: &mut Rig,
    station: &mut GroundStation,
    seen: &mut Seen,
) -> Result<()> {
    seen.flies_on = true;
    if kind == Kind::InterruptTwice {
        seen.ends_when_asked = rig.companion.ends_within(AT_ONCE)?.is_some();
        return Ok(());
    }
    // An order that comes before the signal is heard is granted.
    station.take_texts();
    station.listen(HEARD)?;
    seen.told = station.take_texts().iter().any(|text| text.contains("asked to end"));
    let until = Instant::now() + END_TIMEOUT;
    while Instant::now() < until && rig.companion.runs() {
        set_mode(station, Mode::Hold)?;
        station.listen(Duration::from_millis(200))?;
        seen.held_back |= station.take_texts().iter().any(|text| text.starts_with("hold: "));
    }
    let status = rig.companion.ends_within(Duration::ZERO)?;
    seen.ends_when_asked = status.is_some_and(|status| status.success());
    seen.ended_us = Some(now_us());
    Ok(())
}

fn listen(rig: &mut Rig, station: &mut GroundStation, time: Duration) -> Result<()> {
    if let Some(output) = &mut rig.output {
        output.drain()?;
    }
    Ok(station.listen(time)?)
}

/// Listens until the vehicle says this.
fn await_words(rig: &mut Rig, station: &mut GroundStation, words: &str) -> Result<()> {
    let until = Instant::now() + PHASE_TIMEOUT;
    while Instant::now() < until {
        if station.take_texts().iter().any(|text| text.starts_with(words)) {
            return Ok(());
        }
        listen(rig, station, Duration::from_millis(20))?;
    }
    bail!("the vehicle did not say `{words}`")
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

fn take_off(station: &mut GroundStation, height_m: f64) -> Result<()> {
    let nan = f32::NAN;
    let params = [nan, nan, nan, nan, nan, nan, height_m as f32];
    Ok(station.command(MavCmd::MAV_CMD_NAV_TAKEOFF, params)?)
}

/// Asks for a point, and does not wait for an answer.
fn go_to(station: &mut GroundStation, [north_m, east_m, height_m]: [f64; 3]) -> Result<()> {
    let (target_system, target_component) = station.target();
    // `COMMAND_INT` counts local x and y in 0.1 mm.
    let wire = |m: f64| (m * 1e4).round() as i32;
    Ok(station.send(&MavMessage::COMMAND_INT(COMMAND_INT_DATA {
        command: MavCmd::MAV_CMD_DO_REPOSITION as u16,
        target_system,
        target_component,
        frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        param1: -1.0,
        param2: 1.0,
        param4: f32::NAN,
        x: wire(north_m),
        y: wire(east_m),
        z: -height_m as f32,
        ..Default::default()
    }))?)
}

/// The same for a mode.
fn set_mode(station: &mut GroundStation, mode: Mode) -> Result<()> {
    let (target_system, target_component) = station.target();
    let custom = mode.custom_mode();
    Ok(station.send(&MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_DO_SET_MODE as u16,
        target_system,
        target_component,
        param1: 1.0,
        param2: (custom >> 16 & 0xFF) as f32,
        param3: (custom >> 24) as f32,
        ..Default::default()
    }))?)
}

/// Two points and the landing, as far as the moment lets it come.
fn tour(trial: &Trial, rig: &mut Rig, station: &mut GroundStation, began: Instant) -> Result<()> {
    let orders =
        POINTS.into_iter().map(|(at_s, point)| (at_s, Some(point))).chain([(LAND_S, None)]);
    let until = |rig: &mut Rig, station: &mut GroundStation, s: f64| -> Result<()> {
        let left_s = s - began.elapsed().as_secs_f64();
        if left_s > 0.0 { listen(rig, station, Duration::from_secs_f64(left_s)) } else { Ok(()) }
    };
    for (at_s, point) in orders {
        if at_s > trial.at_s {
            break;
        }
        until(rig, station, at_s)?;
        match point {
            Some(point) => go_to(station, point)?,
            None => station.set_mode(Mode::Land)?,
        }
    }
    until(rig, station, trial.at_s)
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
