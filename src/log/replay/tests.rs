//! Record a run of the core, replay it; break the log in every way and see it told.

use haltere_dialect::mav::haltere::{HEARTBEAT_DATA, MavMessage};

use super::*;
use crate::record::{Recorder, Session};
use haltere_core::frames::Vec3;
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;
use haltere_pilot::Input;

fn survey() -> Survey {
    let anchors: Vec<_> = (0..8u8)
        .map(|i| {
            let at = |bit: u8, far: f64| if i & bit != 0 { far } else { 0.1 };
            (AnchorId(i), Vec3::new(at(1, 7.7), at(2, 9.3), -at(4, 3.1)))
        })
        .collect();
    Survey::new(&anchors).unwrap()
}

/// Runs the core as the pilot's thread does, on made-up time, and records it.
fn record(folder: &Path, build: BuildIdentity, meddle: impl Fn(u64, &mut Vec<u8>)) -> PathBuf {
    let config = Config::default();
    let start = HostTime::from_us(7_000_123);
    let session = Session {
        build,
        started_unix_us: 0,
        pilot_started_at: start,
        config_toml: config.to_log(&survey()),
        survey: survey(),
    };
    let mut recorder = Recorder::start(folder, &session).unwrap();
    let mut pilot = Pilot::new(config.pilot(), session.survey.clone(), start);
    let mut sent = 0;
    let mut heartbeat = Vec::new();
    let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    haltere_dialect::mav_stream::encode(&mut heartbeat, 1, 1, 0, &message);
    for cycle in 0..500i64 {
        let at = start.offset_us(10_000 * (cycle + 1));
        let mut inputs = vec![];
        if cycle == 3 {
            inputs.push(Input::LinkUp { link: LinkId::Tag });
            inputs.push(Input::LinkUp { link: LinkId::Board });
            inputs.push(Input::LinkUp { link: LinkId::Ground(0) });
        }
        if cycle % 100 == 10 {
            inputs.push(Input::Bytes { link: LinkId::Board, bytes: &heartbeat });
        }
        inputs.push(Input::Bytes { link: LinkId::Tag, bytes: b"garbage" });
        for input in inputs {
            recorder.input(at.offset_us(-40), input);
            pilot.handle(at.offset_us(-40), input);
        }
        recorder.input(at, Input::Wake);
        pilot.handle(at, Input::Wake);
        pilot.drain_output(|link, bytes| {
            sent += 1;
            let mut bytes = bytes.to_vec();
            meddle(sent, &mut bytes);
            recorder.output(at, link, &bytes);
        });
        pilot.drain_topics(|topic| recorder.topic(at, topic));
        recorder.commit(at);
    }
    recorder.finish().path.unwrap()
}

fn other_build() -> BuildIdentity {
    BuildIdentity { source_hash: "other".into(), ..BuildIdentity::current() }
}

#[test]
fn prop_the_same_build_reproduces_every_byte() {
    let folder = tempfile::tempdir().unwrap();
    let path = record(folder.path(), BuildIdentity::current(), |_, _| ());
    let report = replay(&path).unwrap();
    assert_eq!(report.verdict, Verdict::Identical, "{report}");
    assert_eq!(report.demand, Demand::BitExact);
    assert_eq!(report.log_end, "complete");
    assert_eq!(report.inputs, 500 + 500 + 3 + 5);
    assert!(report.outputs > 5, "{report}");
    assert_eq!(report.outputs, report.outputs_identical);
    assert_eq!(report.exit_code(), 0);
    assert!((report.duration_s - 5.0).abs() < 1e-9);
}

#[test]
fn prop_one_bit_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = record(folder.path(), BuildIdentity::current(), |n, bytes| {
        if n == 4 {
            let middle = bytes.len() / 2;
            bytes[middle] ^= 1;
        }
    });
    let report = replay(&path).unwrap();
    assert_eq!(report.verdict, Verdict::Different);
    assert_eq!(report.outputs_identical + 1, report.outputs);
    assert_eq!(report.exit_code(), 3);
    let text = report.to_string();
    assert!(text.contains("NOT reproduced") && text.contains("first difference at "), "{text}");
}

#[test]
fn prop_another_build_is_named_and_held_to_the_tolerance() {
    let folder = tempfile::tempdir().unwrap();
    let report = replay(&record(folder.path(), other_build(), |_, _| ())).unwrap();
    assert_eq!(report.demand, Demand::Decoded);
    assert!(report.build_differences[0].starts_with("source: "), "{:?}", report.build_differences);
    assert_eq!(report.verdict, Verdict::Identical, "nothing differs, whatever is allowed");
    let damaged = record(folder.path(), other_build(), |n, bytes| {
        if n == 4 {
            bytes[0] ^= 0x40;
        }
    });
    assert_eq!(replay(&damaged).unwrap().verdict, Verdict::Different);
}

#[test]
fn prop_a_missing_or_an_additional_output_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = record(folder.path(), BuildIdentity::current(), |_, _| ());
    let mut outputs = 0;
    for entry in LogReader::open(&path).unwrap().entries() {
        outputs += u64::from(matches!(entry, Entry::Output { .. }));
    }
    // The last output never recorded: as if this core sent one more.
    let report = replay(&path).unwrap();
    assert_eq!(report.outputs, outputs);
    let bytes = std::fs::read(&path).unwrap();
    let log = LogReader::from_bytes(path, bytes).unwrap();
    let session = log.session().clone();
    let mut recorder = Recorder::start(folder.path(), &session).unwrap();
    let mut seen = 0;
    for entry in log.entries() {
        match entry {
            Entry::Input { at, input, .. } => {
                recorder.input(at, input.as_input());
                recorder.commit(at);
            }
            Entry::Output { at, link, bytes, .. } => {
                seen += 1;
                if seen < outputs {
                    recorder.output(at, link, &bytes);
                }
            }
            _ => {}
        }
    }
    let report = replay(&recorder.finish().path.unwrap()).unwrap();
    assert_eq!(report.verdict, Verdict::Different, "{report}");
    assert!(report.first_difference.unwrap().what.contains("more than were recorded"));
}

#[test]
fn prop_a_cut_log_is_replayed_to_its_last_record() {
    let folder = tempfile::tempdir().unwrap();
    let path = record(folder.path(), BuildIdentity::current(), |_, _| ());
    let bytes = std::fs::read(&path).unwrap();
    let mut reproduced = 0;
    for cut in (bytes.len() / 4..bytes.len()).step_by(bytes.len() / 40) {
        let Ok(log) = LogReader::from_bytes(path.clone(), bytes[..cut].to_vec()) else { continue };
        let report = replay_log(&log).unwrap();
        assert!(report.first_difference.is_none(), "{report}");
        assert!(report.log_end.starts_with("cut at byte "), "{}", report.log_end);
        reproduced += u64::from(report.verdict == Verdict::Identical);
    }
    assert!(reproduced > 0);
}

#[test]
fn regress_a_damaged_log_says_how_much_of_it_was_compared() {
    let folder = tempfile::tempdir().unwrap();
    let path = record(folder.path(), BuildIdentity::current(), |_, _| ());
    let bytes = std::fs::read(&path).unwrap();
    let mut partly = 0;
    for at in (200..bytes.len() - 16).step_by(bytes.len() / 60) {
        let mut hurt = bytes.clone();
        hurt[at..at + 16].iter_mut().for_each(|b| *b ^= 0xff);
        let report = replay_log(&LogReader::from_bytes(path.clone(), hurt).unwrap()).unwrap();
        let text = report.to_string();
        if report.outputs_identical == 500 || report.inputs == 500 + 500 + 3 + 5 {
            assert_eq!(report.exit_code(), 0, "byte {at}: {text}");
        } else {
            partly += 1;
            assert_eq!(report.exit_code(), 4, "byte {at}: {text}");
            let says =
                format!("{:.1} s flown, {:.1} s compared", report.duration_s, report.compared_s);
            assert!(text.contains(&says) && report.compared_s < 4.99, "byte {at}: {text}");
        }
    }
    assert!(partly > 10, "{partly}");
}

#[test]
fn prop_a_cut_log_of_another_build_differs_by_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = record(folder.path(), other_build(), |_, _| ());
    let bytes = std::fs::read(&path).unwrap();
    for cut in (bytes.len() / 4..bytes.len()).step_by(bytes.len() / 40) {
        let Ok(log) = LogReader::from_bytes(path.clone(), bytes[..cut].to_vec()) else { continue };
        let report = replay_log(&log).unwrap();
        assert!(report.first_difference.is_none() && report.differs.is_none(), "{report}");
        assert_eq!(report.input_faults, [] as [&str; 0], "{report}");
    }
}

#[test]
fn prop_a_message_of_another_build_is_looked_for_among_its_kind() {
    // The fourth output is damaged: it is missing, and a message that nobody knows is there instead.
    let folder = tempfile::tempdir().unwrap();
    let path = record(folder.path(), other_build(), |n, bytes| {
        if n == 4 {
            bytes[0] ^= 0x40;
        }
    });
    let report = replay(&path).unwrap();
    assert_eq!(report.differs, Some(Differs::OtherTraffic), "{report}");
    let odd: u64 = report.other_traffic.iter().map(OtherTraffic::count).sum();
    assert_eq!(report.outputs_identical + 1, report.outputs, "{report}");
    assert!((1..=2).contains(&odd), "{report}");
    assert!(report.setpoints.agree(), "{report}");
    let text = report.to_string();
    assert!(text.contains("no setpoints: the vehicle was never armed"), "{text}");
    assert!(text.contains("other traffic differs: "), "{text}");
    let json = serde_json::to_value(&report).unwrap();
    // Keys that scripts rely on, and what was added.
    for key in
        ["verdict", "demand", "outputs_identical", "first_difference", "differs", "setpoints"]
    {
        assert!(json.get(key).is_some(), "{key} is missing");
    }
}

#[test]
fn prop_a_configuration_that_is_refused_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = record(folder.path(), BuildIdentity::current(), |_, _| ());
    let session = LogReader::open(&path).unwrap().session().clone();
    let session = Session { config_toml: "[flight]\nspool_s = 99.0\n".into(), ..session };
    let recorder = Recorder::start(folder.path(), &session).unwrap();
    let error = replay(&recorder.finish().path.unwrap()).unwrap_err().to_string();
    assert!(error.contains("replay it with the build that wrote it"), "{error}");
    assert!(error.contains("flight.spool_s = 99, allowed 0.2 to 5 s"), "{error}");
}

/// Found by the fuzzer: a hole that ends at the largest number there is.
#[test]
fn regress_a_hole_up_to_the_largest_number_is_told() {
    let config = Config::default();
    let start = HostTime::from_us(1);
    let pilot = Pilot::new(config.pilot(), survey(), start);
    let report = Report::new(PathBuf::new(), Demand::BitExact, Vec::new(), true);
    let mut run = Run::new(pilot, start, report, Airborne::default());
    let hole = pb::Hole {
        from_us: u64::MAX,
        to_us: 0,
        first_sequence: u64::MAX,
        last_sequence: u64::MAX,
        lost_raw: u64::MAX,
        lost_topics: u64::MAX,
    };
    run.take(&Entry::Hole(hole));
    for sequence in [u64::MAX, 0, 1] {
        let bytes = vec![0];
        run.take(&Entry::Output { sequence, at: start, link: LinkId::Board, bytes });
    }
    let report = run.finish(&LogEnd::Complete);
    assert_eq!(report.verdict, Verdict::OnlyToHole, "{report}");
}

/// Logs of builds whose default volume was the box of the anchors say nothing of it.
#[test]
fn regress_a_log_without_a_volume_was_flown_in_the_box_of_the_anchors() {
    let folder = tempfile::tempdir().unwrap();
    let read = |name: &str, config_toml: String| {
        let session = Session {
            build: BuildIdentity::current(),
            started_unix_us: 0,
            pilot_started_at: HostTime::from_us(1),
            config_toml,
            survey: survey(),
        };
        let folder = folder.path().join(name);
        let recorder = Recorder::start(&folder, &session).unwrap();
        let path = recorder.finish().path.unwrap();
        recorded_config(&LogReader::open(&path).unwrap()).unwrap().limits
    };
    let old = read("old", Config::default().to_toml());
    assert_eq!((old.north_m, old.height_m), (Some([0.1, 7.7]), Some(3.1)));
    let new = read("new", Config::default().to_log(&survey()));
    assert!(new.north_m.unwrap()[0] > 0.5 && new.height_m.unwrap() < 2.8, "{new:?}");
}
