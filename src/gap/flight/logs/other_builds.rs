//! Gate 0 on logs of other builds: those of a build that sends one request less, that flies otherwise, or that this
//! one would not have let fly; and the logs of a stranger, where they are.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock};

use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream::{MavSplitter, encode};
use rayon::prelude::*;

use super::*;
use crate::bank::missions;
use haltere_core::frames::{B, E, Rot, wrap_pi_rad};
use haltere_core::time::HostTime;
use haltere_core::topics::ControlRecord;
use haltere_log::record::{BuildIdentity, Decoded, Entry, RawInput, Recorder, Session};
use haltere_model::Plant;
use haltere_model::lockstep::{HOST_START_US, Lockstep, fly_watched};
use haltere_pilot::{Input, LinkId};

/// A flight of a box, recorded by this build: once for all tests here.
fn flight() -> &'static LogReader {
    static FLIGHT: OnceLock<LogReader> = OnceLock::new();
    FLIGHT.get_or_init(|| recorded(1))
}

fn another() -> BuildIdentity {
    BuildIdentity { source_hash: "another".into(), ..BuildIdentity::current() }
}

/// Flights of a box, one after the other, in one log of this build.
fn recorded(flights: usize) -> LogReader {
    let scene = Scene::lab().unwrap();
    let mut config = Config { flight: scene.pilot.flight.clone(), ..Config::default() };
    // Nobody here answers for a disk.
    config.store.directory = PathBuf::new();
    let folder = tempfile::tempdir().unwrap();
    let session = Session {
        build: BuildIdentity::current(),
        started_unix_us: 0,
        pilot_started_at: HostTime::from_us(HOST_START_US),
        config_toml: config.to_toml(),
        survey: scene.survey.clone(),
    };
    let recorder = Recorder::start_waiting(folder.path(), &session).unwrap();
    let reel = Arc::new(Mutex::new((recorder, session.pilot_started_at)));
    let (heard, sent) = (reel.clone(), reel.clone());
    let mut world = Lockstep::in_world(
        Plant::new(scene.plant(5)).unwrap(),
        config.pilot(),
        &scene.survey,
        Some(Box::new(move |at, input| {
            let mut reel = heard.lock().unwrap();
            reel.1 = at;
            if input == Input::Wake {
                reel.0.commit(at);
            }
            reel.0.input(at, input);
        })),
    )
    .with_tap(Box::new(move |_, link, bytes| {
        let mut reel = sent.lock().unwrap();
        let at = reel.1;
        reel.0.output(at, link, bytes);
    }));
    for _ in 0..flights {
        let flown = fly_watched(&mut world, &missions::plain(&scene), 150.0, |world| {
            let at = world.host_now();
            let mut reel = reel.lock().unwrap();
            world.pilot_mut().drain_topics(|topic| reel.0.topic(at, topic));
        });
        assert!(flown.unwrap().landed);
    }
    drop(world);
    let (recorder, _) = Arc::into_inner(reel).unwrap().into_inner().unwrap();
    let path = recorder.finish().path.unwrap();
    let bytes = std::fs::read(&path).unwrap();
    LogReader::from_bytes("flight.mcap".into(), bytes).unwrap()
}

/// The flight as another log: by this build, with this configuration, and each entry made into others.
fn rewritten(
    build: BuildIdentity,
    config_toml: Option<String>,
    mut change: impl FnMut(Entry) -> Vec<Entry>,
) -> LogReader {
    let log = flight();
    let folder = tempfile::tempdir().unwrap();
    let mut session = Session { build, ..log.session().clone() };
    session.config_toml = config_toml.unwrap_or(session.config_toml);
    let mut recorder = Recorder::start_waiting(folder.path(), &session).unwrap();
    let mut written = Vec::new();
    for entry in log.entries().flat_map(&mut change) {
        match entry {
            Entry::Input { at, input, .. } => {
                recorder.input(at, input.as_input());
                recorder.commit(at);
            }
            Entry::Output { at, link, bytes, .. } => recorder.output(at, link, &bytes),
            Entry::Decoded(decoded) => written.push(decoded),
            Entry::Hole(_) | Entry::Closing(_) => {}
        }
        for decoded in written.drain(..) {
            recorder.decoded(decoded.at(), decoded);
        }
    }
    let path = recorder.finish().path.unwrap();
    LogReader::from_bytes("rewritten.mcap".into(), std::fs::read(path).unwrap()).unwrap()
}

/// The message of one frame, its number and its sender.
fn message(bytes: &[u8]) -> Option<(u8, [u8; 2], MavMessage)> {
    let mut frames = MavSplitter::new();
    frames.push(bytes);
    let frame = frames.next()?.ok()?;
    let header = frame.header;
    Some((header.sequence, [header.system_id, header.component_id], frame.decode().ok()?))
}

fn is_to_board(entry: &Entry) -> bool {
    matches!(entry, Entry::Output { link: LinkId::Board, .. })
}

/// As recorded by a build that did not make the last request to the board before arming: everything behind it has
/// another number.
fn one_request_less(build: BuildIdentity) -> LogReader {
    let is_request = |entry: &Entry| {
        let Entry::Output { bytes, .. } = entry else { return false };
        let message = message(bytes).map(|(_, _, message)| message);
        is_to_board(entry)
            && matches!(message, Some(MavMessage::COMMAND_LONG(m)) if m.command as u32 == 511)
    };
    let last = flight().entries().filter(is_request).count();
    assert!(last > 2, "{last} requests");
    let (mut requests, mut shift) = (0, 0_u8);
    rewritten(build, None, |entry| {
        requests += usize::from(is_request(&entry));
        if is_request(&entry) && requests == last - 1 {
            shift = 1;
            return Vec::new();
        }
        vec![renumbered(entry, shift)]
    })
}

/// A frame to the board with a number that is `shift` less.
fn renumbered(entry: Entry, shift: u8) -> Entry {
    if !is_to_board(&entry) || shift == 0 {
        return entry;
    }
    let Entry::Output { sequence, at, link, bytes } = entry else { return entry };
    let (number, [system, component], m) = message(&bytes).unwrap();
    let mut bytes = Vec::new();
    encode(&mut bytes, system, component, number.wrapping_sub(shift), &m);
    Entry::Output { sequence, at, link, bytes }
}

/// Every setpoint rolled by 2° and with 0.02 more thrust, from 20 s on.
fn flown_otherwise(entry: Entry) -> Entry {
    let Entry::Output { sequence, at, link, bytes } = entry else { return entry };
    let told = message(&bytes).filter(|_| at.as_us() > HOST_START_US + 20_000_000);
    let Some((number, [system, component], MavMessage::SET_ATTITUDE_TARGET(mut m))) = told else {
        return Entry::Output { sequence, at, link, bytes };
    };
    if m.thrust > 0.0 {
        let attitude = Rot::<E, B>::from_wxyz(m.q.map(f64::from)).unwrap();
        let roll = Rot::<B, B>::from_euler_rad(2.0_f64.to_radians(), 0.0, 0.0);
        m.q = (attitude * roll).to_wxyz().map(|c| c as f32);
        m.thrust += 0.02;
    }
    let mut bytes = Vec::new();
    encode(&mut bytes, system, component, number, &MavMessage::SET_ATTITUDE_TARGET(m));
    Entry::Output { sequence, at, link, bytes }
}

fn without(kind: fn(&Decoded) -> bool, entry: Entry) -> Vec<Entry> {
    if matches!(&entry, Entry::Decoded(decoded) if kind(decoded)) {
        Vec::new()
    } else {
        vec![entry]
    }
}

/// All but the first step of the spool, which sends no thrust yet: by its bytes it idles.
fn told_by_bytes(controls: &[ControlRecord]) -> &[ControlRecord] {
    assert_eq!(controls[0].thrust_frac, 0.0);
    &controls[1..]
}

fn read_rewritten(log: &LogReader) -> Flown {
    read_log(log, None).unwrap()
}

/// A log of two flights was judged as one: the first mission, and the motors of both.
#[test]
fn regress_one_flight_of_a_log_of_several_is_taken_and_said() {
    let log = recorded(2);
    let [first, last] = [Some(1), None].map(|asked| read_log(&log, asked).unwrap());
    assert_eq!(read_log(&log, Some(2)).unwrap().flight, last.flight);
    for (number, flown) in [(1, &first), (2, &last)] {
        assert_eq!(flown.faults, [] as [&str; 0], "flight {number}");
        let flight = flown.flight.unwrap();
        assert_eq!((flight.number, flight.of), (number, 2));
        let said = format!("flight {number} of 2 in this log, ");
        assert!(flown.remarks.iter().any(|r| r.starts_with(&said)), "{:?}", flown.remarks);
        assert!(flown.trace.mission_part().is_some_and(|part| part.whole), "flight {number}");
        let missions = flown.trace.modes.iter().filter(|m| m.mode == Mode::Mission.name());
        assert_eq!((missions.count(), flown.mission.len()), (1, last.mission.len()));
    }
    assert!(first.flight.unwrap().to_s <= last.flight.unwrap().from_s);
    let end = first.trace.controls.last().unwrap().at;
    assert!(last.trace.controls[0].at > end, "no step is in both");
    let error = read_log(&log, Some(3)).unwrap_err().to_string();
    assert!(error.contains("no flight 3; the log holds 1 from "), "{error}");
    // Without decoded topics the replay tells the flights.
    let is_raw = |entry: &Entry| !matches!(entry, Entry::Decoded(_));
    let bare = rewritten(BuildIdentity::current(), None, |entry| {
        Some(entry).filter(is_raw).into_iter().collect()
    });
    let [own, relived] = [flight(), &bare].map(|log| read_log(log, Some(1)).unwrap());
    assert_eq!(relived.flight, own.flight);
    assert_eq!(relived.trace.controls.len(), own.trace.controls.len());
}

#[test]
fn regress_a_log_outlives_one_request_more_to_the_board() {
    let own = read_rewritten(flight());
    assert_eq!((&own.faults[..], own.replay.verdict), (&[][..], Verdict::Identical));
    let older = read_rewritten(&one_request_less(another()));
    assert_eq!(older.faults, [] as [&str; 0], "{}", older.replay);
    assert_eq!(older.replay.differs, Some(Differs::OtherTraffic), "{}", older.replay);
    let [odd] = &older.replay.other_traffic[..] else { panic!("{}", older.replay) };
    assert_eq!((odd.link, odd.message.as_str(), odd.additional), (1, "COMMAND_LONG", 1), "{odd:?}");
    assert_eq!((odd.differ, odd.missing), (0, 0), "{odd:?}");
    let said = older.remarks.join("\n");
    assert!(
        said.contains("nothing here rests: 1 message: COMMAND_LONG on link 1 1 more"),
        "{said}"
    );
    assert_eq!(older.trace.controls, own.trace.controls, "and the trace is the same");
    assert!(older.replay.to_string().contains("setpoints agree, all "), "{}", older.replay);
    // The same source has no such excuse.
    let same = read_rewritten(&one_request_less(BuildIdentity::current()));
    assert!(
        same.faults[0].starts_with("the replay does not send what was flown"),
        "{:?}",
        same.faults
    );
    assert_eq!(same.replay.differs, Some(Differs::OtherTraffic), "{}", same.replay);
}

#[test]
fn regress_setpoints_of_another_build_are_judged_as_they_were_flown() {
    let own = read_rewritten(flight());
    let log = rewritten(another(), None, |entry| {
        without(|d| matches!(d, Decoded::Control(_)), flown_otherwise(entry))
    });
    let other = read_rewritten(&log);
    assert_eq!(other.faults, [] as [&str; 0], "{}", other.replay);
    let found = &other.replay.setpoints;
    assert!((found.worst_deg - 2.0).abs() < 0.01, "{found}");
    assert!((found.worst_thrust_frac - 0.02).abs() < 1e-6, "{found}");
    assert_eq!((found.missing, found.additional), (0, 0), "{found}");
    assert_eq!(found.first_s.map(f64::floor), Some(20.0), "{found}");
    let said = other.remarks.join("\n");
    assert!(said.contains("by up to 2.00 deg and 0.020 of thrust"), "{said}");
    assert!(said.contains("those recorded are judged, the estimate is what this build"), "{said}");
    // Setpoints are the recorded ones, the rest is the replay's.
    let own_controls = told_by_bytes(&own.trace.controls);
    assert_eq!(other.trace.controls.len(), own_controls.len());
    assert_eq!(other.trace.estimates, own.trace.estimates);
    assert_eq!(other.trace.modes, own.trace.modes);
    let late = HostTime::from_us(HOST_START_US + 20_000_000);
    for (flown, replayed) in other.trace.controls.iter().zip(own_controls) {
        assert_eq!((flown.at, flown.pos_setpoint_E_m), (replayed.at, replayed.pos_setpoint_E_m));
        let [roll_deg, thrust_frac] = if flown.at > late { [2.0, 0.02] } else { [0.0, 0.0] };
        let rolled_deg = (flown.roll_rad - replayed.roll_rad).to_degrees();
        assert!((rolled_deg - roll_deg).abs() < 0.1, "{flown:?} {replayed:?}");
        let more_frac = flown.thrust_frac - replayed.thrust_frac;
        assert!((more_frac - thrust_frac).abs() < 1e-6, "{flown:?} {replayed:?}");
        let turned_rad = wrap_pi_rad(flown.yaw_rad - replayed.yaw_rad);
        assert!(turned_rad.abs() < 0.01, "{flown:?} {replayed:?}");
    }
    // Where the log tells the steps themselves, those are taken as they are.
    let log = rewritten(another(), None, |entry| vec![flown_otherwise(entry)]);
    assert_eq!(read_rewritten(&log).trace.controls, own.trace.controls);
    // The same source would have sent the same.
    let log = rewritten(BuildIdentity::current(), None, |entry| vec![flown_otherwise(entry)]);
    let same = read_rewritten(&log);
    assert!(
        same.faults[0].starts_with("the replay does not send what was flown"),
        "{:?}",
        same.faults
    );
    assert_eq!(same.replay.differs, Some(Differs::Setpoints), "{}", same.replay);
}

#[test]
fn regress_a_flight_that_this_build_would_not_have_begun_is_judged_all_the_same() {
    let own = read_rewritten(flight());
    // A check before arming that the flown build did not have, as far as this one is concerned.
    let mut config = own.config.clone();
    config.limits.battery_low_v = 9.0;
    let toml = config.to_toml();
    let controls: fn(&Decoded) -> bool = |d| matches!(d, Decoded::Control(_));
    let refused = read_rewritten(&rewritten(another(), Some(toml), |e| without(controls, e)));
    assert_eq!(refused.faults, [] as [&str; 0], "{}", refused.replay);
    let found = &refused.replay.setpoints;
    assert!(found.compared == 0 && found.missing > 4000, "{found}");
    assert_eq!(refused.trace.modes, own.trace.modes);
    assert!(refused.trace.mission_part().is_some_and(|part| part.whole));
    let own_controls = told_by_bytes(&own.trace.controls);
    assert_eq!(refused.trace.controls.len(), own_controls.len());
    // The filter knew that it flew: it is where the flown one was, but for the first steps off the floor.
    let far_m = refused
        .trace
        .estimates
        .iter()
        .zip(&own.trace.estimates)
        .map(|(a, b)| (a.pos_E_m - b.pos_E_m).norm());
    let worst_m = far_m.fold(0.0, f64::max);
    assert!(worst_m < 0.1, "{worst_m} m");
    for (flown, own) in refused.trace.controls.iter().zip(own_controls) {
        assert!((flown.thrust_frac - own.thrust_frac).abs() < 1e-6);
        let apart_rad = wrap_pi_rad(flown.yaw_rad - own.yaw_rad).abs();
        assert!(apart_rad < 0.1, "{flown:?} {own:?}");
    }
}

#[test]
fn regress_inputs_that_do_not_fit_are_a_fault_whoever_wrote_them() {
    let fault = |change: &mut dyn FnMut(Entry) -> Vec<Entry>, says: &str| {
        let flown = read_rewritten(&rewritten(another(), None, change));
        let found = flown.faults.join("\n");
        assert!(found.contains(says), "{found}\n  should say: {says}");
    };
    let late = |at: HostTime| at.as_us() > HOST_START_US + 30_000_000;
    // A wake-up from ten seconds ago.
    let mut once = true;
    let mut back = |entry: Entry| match entry {
        Entry::Input { sequence, at, input: RawInput::Wake } if late(at) && once => {
            once = false;
            let at = at.offset_us(-10_000_000);
            vec![Entry::Input { sequence, at, input: RawInput::Wake }]
        }
        other => vec![other],
    };
    fault(&mut back, "the time of wake-ups runs back by 9.9");
    // A second of wake-ups is missing, and the entries were numbered anew.
    let mut gone = |entry: Entry| match &entry {
        Entry::Input { at, input: RawInput::Wake, .. } => {
            let lost = late(*at) && at.as_us() < HOST_START_US + 31_000_000;
            if lost { Vec::new() } else { vec![entry] }
        }
        _ => vec![entry],
    };
    fault(&mut gone, "control steps were counted, and ");
    // A setpoint is missing.
    let mut lost = 0;
    let mut quiet = |entry: Entry| {
        let is_lost = matches!(&entry, Entry::Output { at, .. } if late(*at))
            && is_to_board(&entry)
            && lost < 1;
        lost += u32::from(is_lost);
        if is_lost { Vec::new() } else { vec![entry] }
    };
    fault(&mut quiet, " to the board follows frame ");
}

/// Logs of another program's vehicle, flown by build 8d8505d: whatever lands must diagnose them.
#[test]
fn val_the_logs_of_a_stranger_pass_gate_0() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/stranger");
    let files: Vec<PathBuf> = std::fs::read_dir(&folder)
        .map(|entries| entries.flatten().map(|e| e.path()).collect())
        .unwrap_or_default();
    let files: Vec<_> =
        files.into_iter().filter(|path| path.extension().is_some_and(|e| e == "xz")).collect();
    if files.is_empty() {
        println!("not checked: no data in {}", folder.display());
        return;
    }
    files.par_iter().for_each(|path| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let unpacked = std::process::Command::new("xz").arg("-dkc").arg(path).output();
        let Ok(unpacked) = unpacked else {
            println!("{name}: not checked: no program xz");
            return;
        };
        let log = LogReader::from_bytes(name.clone().into(), unpacked.stdout).unwrap();
        let flown = read_log(&log, None).unwrap();
        println!("{}  remarks: {:?}", flown.replay, flown.remarks);
        assert_eq!(flown.faults, [] as [&str; 0], "{name}");
        assert!(flown.trace.mission_part().is_some_and(|part| part.whole), "{name}");
        assert_eq!(flown.mission.len(), 46, "{name}");
        assert_eq!(flown.replay.input_faults, [] as [&str; 0], "{name}");
        // All that the residuals are made of is there.
        let nominal = crate::nominal::Nominal::of_scene(&flown.scene(&Told::default()));
        let seen = crate::flight::statistics::observe(&flown.trace, &nominal);
        assert!(seen.is_ok(), "{name}: {:?}", seen.err());
    });
}
