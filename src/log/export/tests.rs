//! Exports of a small flight, read back.

use std::fs::File;

use ::parquet::file::reader::{FileReader as _, SerializedFileReader};
use ::parquet::record::RowAccessor as _;

use super::*;
use crate::record::{Recorder, Session};
use haltere_core::frames::Vec3;
use haltere_core::measure::{AnchorId, BatterySample};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_core::topics::{ModeRecord, Topic};
use haltere_pilot::{Input, LinkId};

const START_US: u64 = 5_000_000;
const UNIX_US: i64 = 1_700_000_000_000_000;

fn heartbeat(sequence: u8) -> Vec<u8> {
    let mut out = Vec::new();
    let payload = [0, 0, 0, 0, 2, 3, 81, 3, 3];
    haltere_dialect::mav_stream::encode_payload(&mut out, 1, 1, sequence, 0, &payload);
    out
}

/// Two battery samples, one without current; a mode with what CSV must quote; three heartbeats on the
/// first ground link, the second in two pieces behind garbage.
fn log(folder: &Path) -> LogReader {
    let corner = |i: u8, bit: u8| if i & bit != 0 { 5.0 } else { 0.0 };
    let anchors: Vec<_> = (0..8u8)
        .map(|i| (AnchorId(i), Vec3::new(corner(i, 1), corner(i, 2), -corner(i, 4))))
        .collect();
    let session = Session {
        build: crate::record::BuildIdentity::default(),
        started_unix_us: UNIX_US,
        pilot_started_at: HostTime::from_us(START_US),
        config_toml: String::new(),
        survey: Survey::new(&anchors).unwrap(),
    };
    let mut recorder = Recorder::start(folder, &session).unwrap();
    let at = |us: u64| HostTime::from_us(START_US + us);
    let link = LinkId::Ground(0);
    for (us, current_a) in [(1_000_000, Some(2.5)), (1_100_000, None)] {
        recorder.input(at(us), Input::Wake);
        let sample =
            BatterySample { received_at: at(us), supply_v: 7.4, current_a, remaining_frac: None };
        recorder.topic(at(us), Topic::Battery(sample));
    }
    let cause = "asked, by \"a\" client".to_owned();
    recorder.topic(at(0), Topic::Mode(ModeRecord { at: at(0), mode: "hold", armed: true, cause }));
    recorder.output(at(1_200_000), link, &heartbeat(0));
    let mut torn = vec![1, 2, 3];
    torn.extend(heartbeat(1));
    recorder.input(at(1_300_000), Input::Bytes { link, bytes: &torn[..9] });
    recorder.input(at(1_400_000), Input::Bytes { link, bytes: &torn[9..] });
    recorder.input(at(2_000_000), Input::Wake);
    recorder.output(at(2_000_000), link, &heartbeat(2));
    let path = recorder.finish().path.unwrap();
    LogReader::open(path).unwrap()
}

#[test]
fn prop_csv_has_units_empty_cells_and_quotes() {
    let folder = tempfile::tempdir().unwrap();
    let log = log(folder.path());
    let (tables, end) = write_tables(&log, Form::Csv, folder.path(), &[], false).unwrap();
    assert_eq!(end, crate::record::LogEnd::Complete);
    let text = |name: &str| {
        let table = tables.iter().find(|t| t.topic == name).unwrap();
        std::fs::read_to_string(&table.to).unwrap()
    };
    assert_eq!(
        text("battery"),
        "t_s,received_at_us,supply_v,current_a,remaining_frac\n1,6000000,7.4,2.5,\n\
         1.1,6100000,7.4,,\n"
    );
    assert_eq!(
        text("mode"),
        "t_s,at_us,mode,armed,cause\n0,5000000,hold,true,\"asked, by \"\"a\"\" client\"\n"
    );
    let mode = ["mode".to_owned()];
    let error = write_tables(&log, Form::Csv, folder.path(), &mode, false).unwrap_err();
    assert!(error.to_string().contains("exists already"), "{error}");
    let (again, _) = write_tables(&log, Form::Csv, folder.path(), &mode, true).unwrap();
    assert_eq!(again.len(), 1);
    let none = ["mode".to_owned(), "none".to_owned()];
    let other = tempfile::tempdir().unwrap();
    let error = write_tables(&log, Form::Csv, other.path(), &none, false).unwrap_err();
    assert!(error.to_string().contains("--topic none: not in this log; it holds battery, mode"));
    assert_eq!(std::fs::read_dir(other.path()).unwrap().count(), 0, "all files, or none");
}

#[test]
fn prop_parquet_reads_back_with_nulls_and_its_log() {
    let folder = tempfile::tempdir().unwrap();
    let log = log(folder.path());
    let battery = ["battery".to_owned()];
    let (tables, _) = write_tables(&log, Form::Parquet, folder.path(), &battery, false).unwrap();
    let path = &tables[0].to;
    let reader = SerializedFileReader::new(File::open(path).unwrap()).unwrap();
    let about = reader.metadata().file_metadata().key_value_metadata().unwrap();
    assert!(about.iter().any(|kv| kv.key == "haltere.started_unix_us"));
    let rows: Vec<_> = reader.get_row_iter(None).unwrap().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 2);
    assert_eq!(rows[0].get_long(1).unwrap(), 6_000_000);
    assert_eq!(rows[0].get_double(3).unwrap(), 2.5);
    assert!(rows[1].get_double(3).is_err(), "a null is no number");
}

#[test]
fn prop_tlog_holds_whole_frames_with_wall_clock_times() {
    let folder = tempfile::tempdir().unwrap();
    let log = log(folder.path());
    let traffic = links(&log)[&LinkId::Ground(0)];
    assert_eq!((traffic.bytes_in, traffic.bytes_out), (24, 42));
    let mut out = Vec::new();
    let count = write_tlog(&log, LinkId::Ground(0), &mut out).unwrap();
    assert_eq!(count, TlogCount { frames_in: 1, frames_out: 2, garbage_bytes: 3 });
    let expected: Vec<u8> = [(1_200_000, 0), (1_400_000, 1), (2_000_000, 2)]
        .into_iter()
        .flat_map(|(us, sequence)| {
            let stamp = (UNIX_US as u64 + us).to_be_bytes();
            stamp.into_iter().chain(heartbeat(sequence))
        })
        .collect();
    assert_eq!(out, expected);
}

#[test]
fn prop_a_part_has_its_span_and_the_mode_it_began_in() {
    let folder = tempfile::tempdir().unwrap();
    let log = log(folder.path());
    let to = folder.path().join("part.mcap");
    let part = crate::record::trim(&log, &to, 1.05, 1.5).unwrap();
    assert_eq!(part.span_s, [1.1, 1.4]);
    let cut = LogReader::open(&to).unwrap();
    let sink = |_: &str| Ok(std::io::sink());
    let (tables, end) = stream_tables(&cut, Form::Csv, &[], sink).unwrap();
    assert_eq!(end, crate::record::LogEnd::Complete);
    let names: Vec<_> = tables.iter().map(|t| (t.topic.as_str(), t.rows)).collect();
    assert_eq!(names, [("battery", 1), ("mode", 1)]);
    let nothing = crate::record::trim(&log, &folder.path().join("x.mcap"), 3.0, 4.0).unwrap_err();
    assert!(nothing.to_string().contains("the log runs from 0 to 2.0 s"), "{nothing}");
}
