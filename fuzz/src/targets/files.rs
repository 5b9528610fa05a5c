//! Files: missions, parameters, plans, logs, configurations, anchor surveys.

use haltere::ctl::PlanFile;
use haltere::fit::source::Source;
use haltere::fit::tell;
use haltere::report::flight::Flight;
use haltere::report::{Page, from_log};
use haltere::sources::stored;
use haltere_core::geo::LocalOrigin;
use haltere_core::time::HostTime;
use haltere_log::export::{self, Form};
use haltere_log::import::{columns, flapper, stand};
use haltere_log::record::{self, Flights, LogEnd, LogReader, recovered_name};
use haltere_pilot::mission_file::MissionFile;
use haltere_pilot::services::{decode_plan, encode_plan};
use haltere_pilot::settings::{Config, parse_anchors};
use haltere_pilot::{Input, Pilot};

/// A mission file as text, ours or a station's, and a stored plan as bytes.
pub fn mission_file(data: &[u8]) {
    if let Ok(text) = std::str::from_utf8(data)
        && let Ok(file) = MissionFile::parse(text)
    {
        for (n, item) in file.items.iter().enumerate() {
            let _ = item.to_wire(n as u16, 1, 1);
        }
    }
    if let Ok(text) = std::str::from_utf8(data)
        && PlanFile::is_one(std::path::Path::new(""), text)
        && let Ok(file) = PlanFile::parse(text)
    {
        let _ = file.to_mission(&LocalOrigin::zero());
    }
    if let Ok(items) = decode_plan(data) {
        let bytes = encode_plan(&items);
        let again = decode_plan(&bytes).expect("what we encode decodes");
        assert_eq!(bytes, encode_plan(&again));
    }
}

/// A flight log: every entry is read, a replay of what is in it is tried, and everything is made of it that
/// `haltere log`, `report`, `fit` and the first step of `gap` make.
pub fn log(data: &[u8]) {
    let Ok(log) = LogReader::from_bytes("fuzz.mcap".into(), data.to_vec()) else { return };
    let mut entries = log.entries();
    let count = entries.by_ref().count();
    assert!(count <= data.len().max(1) * 64, "{count} entries in {} bytes", data.len());
    let _ = entries.end();
    exported(&log);
    let flight = shown(&log);
    if let Ok(flown) = haltere_gap::flight::logs::read_log(&log, None) {
        let _ = flown.scene(&haltere_gap::scene::Told::default());
        let _ = haltere_gap::flight::timeline::Timeline::new(&flown.trace, None);
        // A flight that was truly flown does not fit into an input; the fits refuse most of the rest.
        let config = Box::new(flown.config);
        let name = "fuzz".to_owned();
        fitted(&[Source::Log { name, flight: Box::new(flight), config }]);
    }
}

/// Head and tail of a log, as `haltere log list` and `log info` read them, and the flights that they tell: whatever the
/// tail claims, no more is found than there is.
pub fn outline(data: &[u8]) {
    let mut bytes = data.to_vec();
    put_checksum_right(&mut bytes);
    let Ok(log) = LogReader::from_bytes("fuzz.mcap".into(), bytes) else { return };
    if let Some(outline) = log.outline() {
        let channels: Vec<_> = outline.counts().into_keys().map(str::to_owned).collect();
        for channel in channels {
            let found = outline.entries(&channel).map_or(0, |entries| entries.len());
            assert!(found <= data.len(), "{found} entries of {channel} in {} bytes", data.len());
        }
    }
    let flights = Flights::recorded(&log);
    for asked in [None, Some(1), Some(2), Some(usize::MAX)] {
        let Ok(mut part) = flights.part(&log, asked) else { continue };
        let _ = part.flight().map(|flight| flight.to_string());
        log.entries().filter(|entry| part.holds(entry)).for_each(drop);
    }
}

/// Checksum of the tail (CRC-32 of IEEE 802.3): a fuzzer that has changed a byte of it would come no further.
fn put_checksum_right(bytes: &mut [u8]) {
    // Footer: two offsets and the checksum; the closing magic.
    let Some(checksum_at) = bytes.len().checked_sub(4 + 8) else { return };
    let Some(start) = checksum_at.checked_sub(16).and_then(|at| bytes[at..].first_chunk::<8>())
    else {
        return;
    };
    let start = usize::try_from(u64::from_le_bytes(*start)).unwrap_or(usize::MAX);
    let Some(tail) = bytes.get(start..checksum_at) else { return };
    let crc = tail.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
            (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg())
        })
    });
    bytes[checksum_at..checksum_at + 4].copy_from_slice(&(!crc).to_le_bytes());
}

fn exported(log: &LogReader) {
    for form in [Form::Csv, Form::Parquet] {
        // A log without topics has no tables.
        let _ = export::stream_tables(log, form, &[], |_| Ok(std::io::sink()));
    }
    for link in export::links(log).into_keys() {
        export::write_tlog(log, link, std::io::sink()).expect("a sink takes everything");
    }
}

fn shown(log: &LogReader) -> Flight {
    let (mut flight, _) = from_log::read(log);
    flight.facts = from_log::facts(log, &flight);
    let _ = haltere_log::replay::changed_parameters(log);
    let page =
        Page { title: "", subtitle: "", checks: &[], errors: &[], paths: &[], flight: &flight };
    let _ = page.render();
    flight
}

fn fitted(sources: &[Source]) {
    let _ = tell::drag::fit(sources, false);
    let _ = tell::thrust::fit(sources);
    let _ = tell::ground::fit(sources, -1.0, false);
    let _ = tell::lag::fit(sources);
    let _ = tell::imu::fit(sources);
    let _ = tell::anchors::fit(sources, false);
}

/// What `haltere log recover` makes of a log is one that is read to its end.
pub fn recover(data: &[u8]) {
    let folder = tempfile::tempdir().expect("a folder for what is written");
    let path = folder.path().join("fuzz.mcap");
    std::fs::write(&path, data).expect("a file in it");
    let to = recovered_name(&path);
    if record::recover(&path, &to).is_err() {
        return;
    }
    let log = LogReader::open(&to).expect("what we write reads");
    let mut entries = log.entries();
    entries.by_ref().for_each(drop);
    assert_eq!(entries.end(), LogEnd::Complete);
}

/// A recording of somebody else as text, in each of the layouts, and what is fitted on it.
pub fn csv(data: &[u8]) {
    let path = std::path::Path::new("fuzz.csv");
    let recordings = [columns::parse(data, path), flapper::parse(data, path)];
    for recording in recordings.into_iter().flatten() {
        fitted(&[Source::Recording(recording)]);
    }
    if let Ok(stand) = stand::parse(data, path) {
        let _ = tell::thrust::fit(&[Source::Stand(stand)]);
    }
}

/// A configuration that is not refused flies: nothing that the checks allow may panic the core. And
/// parameters and anchors.
pub fn config(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    if let Ok(values) = stored::from_text(text) {
        let again = stored::from_text(&stored::to_text(&values)).expect("what we write reads");
        assert_eq!(format!("{values:?}"), format!("{again:?}"));
    }
    let survey = parse_anchors("anchors.toml", text);
    let Ok(config) = Config::from_toml("fuzz.toml", text) else {
        if let Ok(survey) = survey {
            let mut pilot = Pilot::new(Config::default().pilot(), survey, HostTime::from_us(0));
            pilot.handle(HostTime::from_us(20_000), Input::Wake);
        }
        return;
    };
    let mut problems = haltere_core::checks::Problems::new();
    config.check("", &mut problems);
    if !problems.is_empty() {
        return;
    }
    let again = Config::from_toml("again.toml", &config.to_toml()).expect("what we write reads");
    assert_eq!(config.to_toml(), again.to_toml());
    let _ = config.doors();
    let mut pilot = Pilot::new(config.pilot(), super::core::hall(), HostTime::from_us(1_000_000));
    for n in 1..20 {
        pilot.handle(HostTime::from_us(1_000_000 + n * 10_000), Input::Wake);
        pilot.drain_output(|_, _| {});
        pilot.drain_topics(|_| {});
    }
}
