//! The layers, and what bad files are told.

use std::path::Path;

use super::*;

const SAMPLE_ANCHORS: &str = include_str!("../../config/anchors.toml");

fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// Loads `a.toml` with `text`, and the sample's anchors beside it.
fn load(text: &str, environment: &[(&str, &str)], sets: &[&str]) -> Result<Loaded, Problems> {
    let folder = folder(&[("a.toml", text), ("anchors.toml", SAMPLE_ANCHORS)]);
    Loaded::load(&Sources {
        files: vec![folder.path().join("a.toml")],
        environment: environment.iter().map(|(n, v)| ((*n).into(), (*v).into())).collect(),
        overrides: sets.iter().map(|s| (*s).into()).collect(),
        ..Sources::default()
    })
}

#[test]
fn prop_later_layers_win() {
    let text = "[flight]\ntakeoff_height_m = 1.1\nspool_s = 2\n[record]\ndirectory = \"a\"\n";
    let environment = [
        ("HALTERE_FLIGHT__TAKEOFF_HEIGHT_M", "1.2"),
        ("HALTERE_RECORD__DIRECTORY", "2026"),
        ("HALTERE_GROUND__ENDPOINTS", "udpin:0.0.0.0:14551, tcpin:0.0.0.0:5760"),
        ("HALTERE_BLESS", "1"),
        ("PATH", "/bin"),
    ];
    let deep = [
        ("HALTERE_CONTROL__LIMITS__TILT_DEG", "25"),
        ("HALTERE_ESTIMATOR__P_BT_B_M", "0.01, 0.0, -0.02"),
        ("HALTERE_CONTROL__VERSION", "raw"),
    ];
    let deep = load("", &deep, &["control.ground_correction=true"]).unwrap().config;
    assert_eq!(deep.control.limits.tilt_deg, 25.0);
    assert_eq!(deep.control.ground_correction, Some(true));
    assert_eq!(deep.control.version, haltere_core::control::Version::Raw);
    assert_eq!(deep.estimator.p_BT_B_m, [0.01, 0.0, -0.02]);
    let sets = [
        "flight.takeoff_height_m=1.3",
        "limits.north_m=[-1.0, 4.5]",
        "board.address=udpin:0.0.0.0:1",
    ];
    let config = load(text, &environment, &sets).unwrap().config;
    assert_eq!(config.flight.takeoff_height_m, 1.3);
    assert_eq!(config.flight.spool_s, 2.0);
    assert_eq!(config.record.directory, Path::new("2026"));
    assert_eq!(config.limits.north_m, Some([-1.0, 4.5]));
    assert_eq!(
        config.ground.endpoints.iter().map(|e| e.address.to_string()).collect::<Vec<_>>(),
        ["udpin:0.0.0.0:14551", "tcpin:0.0.0.0:5760"]
    );
    // What is resolved is what a log will hold, and a replay reads back.
    assert_eq!(Config::from_toml("log", &config.to_toml()).unwrap(), config);
    let none = load("[ground]\nendpoints = []", &[], &[]).unwrap().config;
    assert!(none.ground.endpoints.is_empty());
}

#[test]
fn prop_later_files_win_and_anchors_lie_beside_the_file_that_names_them() {
    let one =
        folder(&[("a.toml", "[anchors]\nfile = \"room.toml\"\n"), ("room.toml", SAMPLE_ANCHORS)]);
    let two = folder(&[("b.toml", "[flight]\nspool_s = 1.5\n")]);
    let files = vec![one.path().join("a.toml"), two.path().join("b.toml")];
    let loaded = Loaded::load(&Sources { files, ..Sources::default() }).unwrap();
    assert_eq!(loaded.config.flight.spool_s, 1.5);
    assert_eq!(loaded.files.last().unwrap(), &one.path().join("room.toml"));
}

#[test]
fn prop_bad_values_are_named_with_place_and_way_out() {
    let check = |text: &str, says: &str| {
        let error = load(text, &[], &[]).unwrap_err().to_string();
        assert!(error.contains(says), "{error}\n  should say: {says}");
        assert!(error.contains("a.toml: "), "{error}");
    };
    check("[flight]\n\nspool_s = 9.0\n", "a.toml: flight.spool_s = 9, allowed 0.2 to 5 s");
    check(
        "[flight]\nspool_s = \"2\"\n",
        "line 2: flight.spool_s: found string \"2\", expected a number",
    );
    check("[flight]\nspool_s = nan\n", "flight.spool_s = NaN, allowed 0.2 to 5 s");
    check(
        "[estimator]\nfuse_reference = 1\n",
        "estimator.fuse_reference: found integer `1`, expected true or false",
    );
    check("[tag]\nbaud = 921600.5\n", "tag.baud: found number `921600.5`, expected a whole number");
    check("[tag]\nbaud = -1\n", "tag.baud: found integer `-1`, expected a whole number from 0");
    check(
        "[tag]\nprotocol = \"uwb\"\n",
        "tag.protocol: unknown choice `uwb`, expected one of `lps-sniffer`, `mavlink`, `crazyflie`",
    );
    check(
        "[tag]\nprotocol = \"mavlink\"\n",
        "tag.protocol = \"mavlink\": such a tag is not found by itself; name its device in tag.port",
    );
    check(
        "[tag]\nprot = 1\n",
        "line 2: tag.prot: unknown key `prot`, expected one of `port`, `protocol`, `baud`",
    );
    check("[tagg]\nport = 1\n", "line 1: tagg: unknown key `tagg`, expected one of `tag`, `board`");
    check(
        "[board]\naddress = \"/dev/ttyS0\"\n",
        "board.address: \"/dev/ttyS0\" is no address: allowed udpin:HOST:PORT",
    );
    check("[ground]\nendpoints = \"udpin:0.0.0.0:1\"\n", "ground.endpoints: found string");
    check(
        "[ground]\nendpoints = [\"udpin:0.0.0.0:x\"]\n",
        "ground.endpoints[0]: \"udpin:0.0.0.0:x\": port \"x\"",
    );
    check(
        "[ground]\nendpoints = [\"tcpin:0.0.0.0:5760\", \"tcpin:127.0.0.1:5760\"]\n",
        "ground.endpoints[1]: TCP port 5760 is taken by ground.endpoints[0]",
    );
    check("[timing]\npriority = 99\n", "timing.priority = 99, allowed 1 to 98");
    check(
        "[timing]\npriority = 300\n",
        "timing.priority: found integer `300`, expected a whole number from 0 to 255",
    );
    check(
        "[limits]\nnorth_m = [3.0, 1.0]\n",
        "limits.north_m = [3, 1]: the first must be the smaller",
    );
    check("[limits]\nnorth_m = [3.0]\n", "limits.north_m: ");
    check("[flight]\nspool_s = 1\nspool_s = 2\n", "line 3: ");
    check("[flight\n", "line 1: ");
    check("\u{0}\u{1}", "line 1: ");
    let none = load("[anchors]\nfile = \"none.toml\"\n", &[], &[]).unwrap_err().to_string();
    assert!(none.contains("/none.toml: the anchor survey cannot be read: "), "{none}");
    assert!(none.contains("write one as in config/anchors.toml"), "{none}");

    let both = load("[flight]\nspool_s = 9\n[limits]\nboard_loss_s = 0\n", &[], &[]).unwrap_err();
    assert_eq!(both.lines().len(), 2, "everything that is wrong at once");
}

#[test]
fn regress_a_variable_with_one_underscore_for_two_is_told_and_others_are_nobodys_business() {
    let environment = [
        ("HALTERE_FLIGHT_TAKEOFF_HEIGHT_M", "2"),
        ("HALTERE_CONTROL_LIMITS_TILT_DEG", "20"),
        ("HALTERE_BIN", "target"),
        ("HALTERE_FLIGHT", "1"),
    ];
    let notes = load("", &environment, &[]).unwrap().notes;
    let told: Vec<String> = notes.iter().map(ToString::to_string).collect();
    assert_eq!(told.len(), 2, "{told:?}");
    assert!(told[0].contains("HALTERE_FLIGHT__TAKEOFF_HEIGHT_M sets flight.takeoff_height_m"));
    assert!(told[1].contains("HALTERE_CONTROL__LIMITS__TILT_DEG"), "{told:?}");
}

#[test]
fn regress_lists_of_numbers_that_are_too_long_are_refused() {
    let refused = |text: &str, says: &str| {
        let why = load(text, &[], &[]).unwrap_err().to_string();
        assert!(why.contains(says), "{why}");
    };
    refused("[limits]\nnorth_m = [1.0, 2.0, 3.0]\n", "3 numbers, allowed 2");
    refused("[estimator]\np_BT_B_m = [0, 0, 0, 1]\n", "estimator.p_BT_B_m = [0, 0, 0, 1]");
    let why = haltere_pilot::settings::parse_anchors(
        "anchors.toml",
        "[[anchor]]\nid = 0\nposition_m = [0, 0, 0, 0]\n",
    );
    assert!(why.unwrap_err().to_string().contains("found 4 numbers, allowed 3"));
}

#[test]
fn prop_environment_and_overrides_are_as_strict_as_files() {
    let environment = |name: &str, value: &str, says: &str| {
        let error = load("", &[(name, value)], &[]).unwrap_err().to_string();
        assert!(error.contains(says) && error.contains(name), "{error}");
    };
    environment("HALTERE_TAG__PROT", "x", "unknown key `prot`");
    environment("HALTERE_FLIGHT__SPOOL_S", "fast", "flight.spool_s: found string \"fast\"");
    environment("HALTERE_FLIGHT__SPOOL_S", "7", "flight.spool_s = 7, allowed 0.2 to 5 s");
    let set = |text: &str, says: &str| {
        let error = load("", &[], &[text]).unwrap_err().to_string();
        assert!(error.contains(says) && error.contains(&format!("--set {text}")), "{error}");
    };
    set("tag.baud=9.7", "tag.baud: found number `9.7`");
    set("tag.baud", "write it as section.key=value");
    set("baud=9600", "write it as section.key=value");
    set("flight.spool_s=6", "flight.spool_s = 6, allowed 0.2 to 5 s");
    set("control..x=6", "write it as section.key=value");
}

#[test]
fn regress_quotes_on_the_command_line_are_those_of_a_file() {
    // `haltere-sim lockstep` sets store.directory="" and kept missions in a folder called `""`.
    let directory = |text: &str| {
        let config = load("", &[], &[text]).unwrap();
        config.config.store.directory.to_str().unwrap().to_owned()
    };
    assert_eq!(directory("store.directory=\"\""), "");
    assert_eq!(directory("store.directory="), "");
    assert_eq!(directory("store.directory=\"a b\""), "a b");
    assert_eq!(directory("store.directory='a'"), "a");
    for plain in ["a", "12", "2026-11-25", "a \"b\"", "true", "[x]", "a\"b"] {
        assert_eq!(directory(&format!("store.directory={plain}")), plain);
    }
}

#[test]
fn prop_a_missing_file_says_where_a_sample_is() {
    let sources = Sources { files: vec!["/nowhere/x.toml".into()], ..Sources::default() };
    let error = Loaded::load(&sources).unwrap_err().to_string();
    assert!(error.starts_with("/nowhere/x.toml: cannot be read: "), "{error}");
    assert!(error.contains("config/haltere.toml is a sample"), "{error}");
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
