//! What users and logs are told of keys that are no more. The table here is made up: it must hold for any key that
//! leaves, and the real one may be empty.

use super::*;
use haltere_pilot::settings::{Author, Fate, Read, read_config};

const TABLE: &[Retired] = &[
    Retired { key: "uwb.longest_echo_s", fate: Fate::Gone { default: "3", heir: "" } },
    Retired {
        key: "flight.hop_m",
        fate: Fate::Gone { default: "0.5", heir: "flight.takeoff_height_m" },
    },
    Retired {
        key: "limits.hold_below_m",
        fate: Fate::Gone { default: "", heir: "the flight volume (limits.height_m)" },
    },
    Retired { key: "flight.climb_to_m", fate: Fate::MovedTo("flight.takeoff_height_m") },
    Retired { key: "log.folder", fate: Fate::MovedTo("record.directory") },
    Retired { key: "control.tilt_deg", fate: Fate::MovedTo("control.limits.tilt_deg") },
];

const ANCHORS: &str = include_str!("../../config/anchors.toml");

/// Through the way that `haltere check` and `haltere fly` read.
fn load(text: &str, environment: &[(&str, &str)], sets: &[&str]) -> Result<Loaded, Problems> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.toml"), text).unwrap();
    std::fs::write(folder.path().join("anchors.toml"), ANCHORS).unwrap();
    let sources = Sources {
        files: vec![folder.path().join("a.toml")],
        environment: environment.iter().map(|(n, v)| ((*n).into(), (*v).into())).collect(),
        overrides: sets.iter().map(|s| (*s).into()).collect(),
        ..Sources::default()
    };
    Loaded::load_by(&sources, TABLE, None)
}

/// Through the way that the head of a log is read.
fn recorded(text: &str) -> Result<Read, Problems> {
    read_config("recorded configuration", text, TABLE, Author::Recorder)
}

fn texts(notes: &[Note]) -> Vec<&str> {
    notes.iter().map(|note| note.text.as_str()).collect()
}

#[test]
fn prop_a_log_is_read_with_the_keys_of_its_time() {
    let text = "[uwb]\nlongest_echo_s = 7.5\n[flight]\nhop_m = 2.0\nclimb_to_m = 1.3\nspool_s = 1.5\n\
                [limits]\nhold_below_m = 2.0\n[log]\nfolder = \"old\"\n[control]\ntilt_deg = 22.0\n";
    let read = recorded(text).unwrap();
    assert_eq!(read.config.flight.takeoff_height_m, 1.3);
    assert_eq!(read.config.flight.spool_s, 1.5);
    assert_eq!(read.config.control.limits.tilt_deg, 22.0);
    assert_eq!(read.config.record.directory, std::path::Path::new("old"));
    assert_eq!(read.notes, [], "in silence");
    // A log of the time between holds both: what it says under today's name was in force.
    let both = recorded("[flight]\nclimb_to_m = 1.3\ntakeoff_height_m = 1.1\n").unwrap();
    assert_eq!(both.config.flight.takeoff_height_m, 1.1);
    let unknown = recorded("[flight]\nhopp_m = 2.0\n").unwrap_err().to_string();
    assert!(unknown.contains("unknown key `hopp_m`"), "{unknown}");
}

#[test]
fn prop_a_moved_key_gives_its_value_to_its_heir_and_that_is_told() {
    let text = "# mine\n[flight]\nclimb_to_m = 1.3\n[log]\nfolder = \"old\"\n";
    let loaded = load(text, &[], &[]).unwrap();
    assert_eq!(loaded.config.flight.takeoff_height_m, 1.3);
    assert_eq!(loaded.config.record.directory, std::path::Path::new("old"));
    let told = texts(&loaded.notes);
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(
        told[0].ends_with(
            "a.toml: line 3: flight.climb_to_m = 1.3: the key is called flight.takeoff_height_m now and was \
             read as such"
        ),
        "{told:?}"
    );
    assert!(loaded.notes.iter().all(|note| !note.way_out.is_empty()), "a look of `check`");
    // Range and type are those of the heir, and later layers win under either name.
    let error = load("[flight]\nclimb_to_m = 90.0\n", &[], &[]).unwrap_err().to_string();
    assert!(error.contains("flight.takeoff_height_m = 90, allowed"), "{error}");
    let error = load("[log]\nfolder = 3\n", &[], &[]).unwrap_err().to_string();
    assert!(error.contains("line 2: record.directory: found integer `3`"), "{error}");
    let by_hand = load(
        "[flight]\nclimb_to_m = 1.3\n",
        &[("HALTERE_LOG__FOLDER", "2026")],
        &["flight.takeoff_height_m=1.2"],
    );
    let by_hand = by_hand.unwrap();
    assert_eq!(by_hand.config.flight.takeoff_height_m, 1.2);
    assert_eq!(by_hand.config.record.directory, std::path::Path::new("2026"));
    assert!(
        texts(&by_hand.notes).iter().any(|t| t.starts_with("environment variable HALTERE_LOG"))
    );
    let set = load("", &[], &["flight.climb_to_m=1.4"]).unwrap();
    assert_eq!(set.config.flight.takeoff_height_m, 1.4);
    // Both at once contradict one another: nobody guesses which was meant.
    let error = load("[flight]\nclimb_to_m = 1.3\ntakeoff_height_m = 1.1\n", &[], &[]);
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("line 2: flight.climb_to_m = 1.3: ") && error.contains("set too"),
        "{error}"
    );
}

#[test]
fn prop_a_key_without_effect_is_told_unless_it_was_at_its_default() {
    for text in ["longest_echo_s = 3", "longest_echo_s = 3.0"] {
        assert_eq!(load(&format!("[uwb]\n{text}\n"), &[], &[]).unwrap().notes, [], "{text}");
    }
    let loaded = load("[uwb]\nlongest_echo_s = 4\n", &[], &[]).unwrap();
    assert_eq!(loaded.config, load("", &[], &[]).unwrap().config);
    let told = texts(&loaded.notes);
    assert!(
        told[0].ends_with("line 2: uwb.longest_echo_s = 4: the key has no effect any more"),
        "{told:?}"
    );
    let set = load("", &[], &["uwb.longest_echo_s=4"]).unwrap();
    assert!(set.notes[0].text.starts_with("--set uwb.longest_echo_s=4: "), "{:?}", set.notes);
}

#[test]
fn prop_what_kept_a_flight_safe_is_refused_with_its_heir_and_never_ignored() {
    let refused = |text: &str, says: &[&str]| {
        let error = load(text, &[], &[]).unwrap_err().to_string();
        for says in says {
            assert!(error.contains(says), "{error}\n  should say: {says}");
        }
    };
    refused(
        "[flight]\nspool_s = 1.0\nhop_m = 0.6\n",
        &["a.toml: line 3: flight.hop_m = 0.6: ", "flight.takeoff_height_m serves its purpose now"],
    );
    // It was absent by default: any value was meant.
    refused(
        "[limits]\nhold_below_m = 2.0\n",
        &["limits.hold_below_m = 2.0: ", "the flight volume (limits.height_m)"],
    );
    let error = load("", &[], &["flight.hop_m=0.6"]).unwrap_err().to_string();
    assert!(error.starts_with("--set flight.hop_m=0.6: flight.hop_m = 0.6: "), "{error}");
    // At its default it says nothing about this vehicle, and is told.
    let loaded = load("[flight]\nhop_m = 0.5\n", &[], &[]).unwrap();
    assert!(texts(&loaded.notes)[0].contains("flight.hop_m = 0.5: the key has no effect any more"));
}

#[test]
fn prop_a_newer_file_is_refused_before_its_keys_are() {
    assert_eq!(load("schema_version = 1\n", &[], &[]).unwrap().notes, []);
    let error = load("schema_version = 9\n[flight]\nspool_sec = 1.0\n", &[], &[]).unwrap_err();
    let error = error.to_string();
    assert!(error.contains("a.toml: schema version 9 of the configuration"), "{error}");
    assert!(error.contains("install that one") && !error.contains("spool_sec"), "{error}");
    assert!(load("schema_version = \"1\"\n", &[], &[]).is_err());
    // As written by `haltere init`, in the file alone.
    let resolved = load("schema_version = 1\n", &[], &[]).unwrap().config;
    assert!(!resolved.to_toml().contains("schema_version"));
    assert!(load("", &[], &["schema_version=1"]).is_err());
}
