//! Files: missions, parameters, plans, logs, configurations, anchor surveys.

use haltere::config::{Config, parse_anchors, stored};
use haltere::ctl::MissionFile;
use haltere::pilot::services::{decode_plan, encode_plan};
use haltere::pilot::{Input, Pilot};
use haltere::record::LogReader;
use haltere::time::HostTime;

/// A mission file as text, and a stored plan as bytes.
pub fn mission_file(data: &[u8]) {
    if let Ok(text) = std::str::from_utf8(data)
        && let Ok(file) = MissionFile::parse(text)
    {
        for (n, item) in file.items.iter().enumerate() {
            let _ = item.to_wire(n as u16, 1, 1);
        }
    }
    if let Ok(items) = decode_plan(data) {
        let bytes = encode_plan(&items);
        let again = decode_plan(&bytes).expect("what we encode decodes");
        assert_eq!(bytes, encode_plan(&again));
    }
}

/// A flight log: every entry is read, and a replay of what is in it is tried.
pub fn log(data: &[u8]) {
    let Ok(log) = LogReader::from_bytes("fuzz.mcap".into(), data.to_vec()) else { return };
    let mut entries = log.entries();
    let count = entries.by_ref().count();
    assert!(count <= data.len().max(1) * 64, "{count} entries in {} bytes", data.len());
    let _ = entries.end();
    let _ = haltere::replay::replay_log(&log);
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
    let mut problems = haltere::checks::Problems::new();
    config.check(&mut problems);
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
