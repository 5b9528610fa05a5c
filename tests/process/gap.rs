//! The gap diagnosis as a user runs it: outcomes, exit codes, files; faults end in words.

use std::fs;
use std::path::Path;
use std::time::Duration;

use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;
use haltere_gap::scene::Scene;
use haltere_model::EffectSet;

use super::flights::{box_mission, record};
use super::support::{Ended, companion, sim};

const LIMIT: Duration = Duration::from_secs(900);
/// The smallest bank that can be learned, of three effects: it tests the program, not the verdict.
const SMALL: [&str; 12] = [
    "--banks",
    "banks",
    "--size",
    "smallest",
    "--room",
    "0,6,0,6,3",
    "--only",
    "P1",
    "--only",
    "U2",
    "--only",
    "M1",
];

fn run(folder: &Path, args: &[&str]) -> Ended {
    companion(args, folder, LIMIT)
}

fn diagnose(folder: &Path, args: &[&str]) -> Ended {
    let mut all = vec!["gap", "diagnose"];
    all.extend(args);
    all.extend(SMALL);
    run(folder, &all)
}

fn with(id: &str, values: &[(&str, f64)]) -> EffectSet {
    EffectSet::nominal().with(id, values).unwrap()
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// One test, since every part stands on the bank and the report before it.
#[test]
fn val_a_gap_is_diagnosed_advised_shrunk_accepted_and_undone() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let scene = Scene::lab().unwrap();
    let mission = box_mission();
    record(&scene, &mission, with("P1", &[("loss", 0.15)]), 5, &dir.join("worn.mcap"));
    record(&scene, &mission, with("P1", &[("loss", 0.15)]), 6, &dir.join("again.mcap"));

    let ended = diagnose(dir, &["worn.mcap", "again.mcap", "--report", "r.html"]);
    assert!(matches!(ended.code, Some(10..=14)), "{ended:?}");
    assert!(ended.text.contains("VERDICT") && !ended.text.contains("panicked"), "{}", ended.text);
    let report = json(&dir.join("r.json"));
    let codes = [
        ("named", 10),
        ("ambiguous", 11),
        ("several", 12),
        ("not_in_library", 13),
        ("named_with_remainder", 14),
        ("budget", 15),
        ("not_testable", 20),
    ];
    let outcome = report["outcome"].as_str().unwrap();
    assert!(codes.contains(&(outcome, ended.code.unwrap())), "{outcome}: {:?}", ended.code);
    for key in ["verdict", "where", "effects", "set", "not_testable", "shrink", "replay", "bank"] {
        assert!(report.get(key).is_some(), "{key} is missing");
    }
    assert!(report["picture"]["matrix"]["squares"].as_array().unwrap().len() > 300);
    assert_eq!(report["made_with"]["log_sha256"].as_str().unwrap().len(), 64);
    assert_eq!(report["made_with"]["library"].as_array().unwrap().len(), 3);
    assert!(
        report["attribution"]["candidates"].as_array().unwrap().iter().any(|c| c["id"] == "P1")
    );
    let page = fs::read_to_string(dir.join("r.html")).unwrap();
    assert!(page.ends_with("</html>") && !page.contains("http") && !page.contains("NaN"));

    // Beside its truth: the same verdict, and how far the estimate was off.
    let beside = diagnose(dir, &["worn.mcap", "--truth", "worn.csv", "--report", "t.html"]);
    assert_eq!(beside.code, ended.code, "{beside:?}");
    assert!(
        beside.text.contains("TRUTH       beside worn.csv: estimate off by"),
        "{}",
        beside.text
    );
    let errors = json(&dir.join("t.json"))["truth"]["errors"].clone();
    let rms_m = errors[0]["rms_m"].as_f64().unwrap();
    assert!((0.01..0.3).contains(&rms_m) && errors.as_array().unwrap().len() >= 3, "{errors}");
    assert!(fs::read_to_string(dir.join("t.html")).unwrap().contains("estimate off by"));
    diagnose(dir, &["worn.mcap", "--truth"]).refused(&["worn.mcap", "holds no truth"]);
    diagnose(dir, &["worn.mcap", "--truth", "r.json"]).refused(&["r.json", "line 1"]);

    // Another nominal vehicle is another simulator. Its mass and the loss of thrust are two causes: one constant closes most of the gap or
    // none does, and the code says which.
    fs::write(dir.join("heavy.toml"), "[body]\nmass_kg = 0.108\n").unwrap();
    let heavy = diagnose(dir, &["worn.mcap", "--vehicle", "heavy.toml", "--report", "h.html"]);
    let other = json(&dir.join("h.json"));
    let outcome = other["outcome"].as_str().unwrap();
    assert!(codes.contains(&(outcome, heavy.code.unwrap())), "{outcome}: {heavy:?}");
    assert_ne!(other["bank"], report["bank"]);
    fs::write(dir.join("lead.toml"), "[body]\nmass_kg = 102.0\n").unwrap();
    diagnose(dir, &["worn.mcap", "--vehicle", "lead.toml"]).refused(&[
        "lead.toml",
        "body.mass_kg",
        "102",
    ]);

    // The effect with given values closes the gap on the other flight; its opposite does not.
    let args =
        ["gap", "shrink", "--effect", "P1=0.15", "again.mcap", "--room", "0,6,0,6,3", "--json"];
    let shrunk = run(dir, &args);
    assert_eq!(shrunk.code, Some(0), "{shrunk:?}");
    let start = shrunk.text.find('{').unwrap();
    let text = &shrunk.text[start..=shrunk.text.rfind('}').unwrap()];
    // Progress and answer share the file; the answer is printed last and at once.
    let value: serde_json::Value = serde_json::from_str(text).unwrap();
    let shrink = &value["shrink"];
    // Where the effect lives it must close. Over all statistics one flight beside eight simulated ones
    // is a noisy number even for the true effect at its true size (0.62 and 0.77 measured): there it
    // must stand out from the effects that are not the cause.
    let channels = shrink["channels"].as_array().unwrap();
    let force = channels.iter().find(|c| c[0] == "ForceZ").unwrap();
    assert!(force[1]["value"].as_f64().is_some_and(|value| value > 0.85), "{force}");
    let number = |v: &serde_json::Value| v.as_f64().unwrap_or_else(|| panic!("{v} in {shrink:#}"));
    let (closed, wrong) = (number(&shrink["whole"]["value"]), number(&shrink["wrong_median"]));
    assert!(closed > wrong + 0.3, "closed {closed}, by wrong effects {wrong}");

    // Advice from the report alone.
    let asked = run(dir, &["gap", "advise", "r.json", "--room", "0,6,0,6,3", "--out", "next"]);
    assert_eq!(asked.code, Some(0), "{asked:?}");

    // Into a scenario, as the simulator reads it, and back.
    let before = "# mine\nseed = 4 # four\n";
    fs::write(dir.join("s.toml"), before).unwrap();
    let accept = ["gap", "accept", "r.json", "--effect", "P1", "--scenario", "s.toml"];
    let dry = run(dir, &[&accept[..], &["--dry-run"]].concat());
    assert_eq!(dry.code, Some(0), "{dry:?}");
    assert!(dry.text.contains("+ [effects.on.P1]") && dry.text.contains("nothing written"));
    assert_eq!(fs::read_to_string(dir.join("s.toml")).unwrap(), before);
    assert_eq!(run(dir, &accept).code, Some(0));
    let after = fs::read_to_string(dir.join("s.toml")).unwrap();
    assert!(after.starts_with(before.trim_end()) && after.contains("[effects.on.P1]"), "{after}");
    let served = sim(&["serve", "--scenario", "s.toml", "--duration", "1"], dir, LIMIT);
    // 75: it was not given the time, which is not the question here.
    assert!(matches!(served.code, Some(0 | 75)), "{served:?}");
    fs::write(dir.join("s.toml"), format!("{after}# edited\n")).unwrap();
    run(dir, &["gap", "undo", "s.toml"]).refused(&["s.toml", "was edited since"]);
    fs::write(dir.join("s.toml"), after).unwrap();
    assert_eq!(run(dir, &["gap", "undo", "s.toml"]).code, Some(0));
    assert_eq!(fs::read_to_string(dir.join("s.toml")).unwrap(), before);
    run(dir, &["gap", "undo", "s.toml"]).refused(&["nothing to take back"]);
    // Thrust loss is no number of the vehicle, and no anchor has moved.
    let vehicle = ["gap", "accept", "r.json", "--effect", "P1", "--vehicle", "v.toml"];
    run(dir, &vehicle).refused(&["v.toml", "use --scenario"]);
    let anchors = ["gap", "accept", "r.json", "--effect", "P1", "--anchors", "a.toml"];
    run(dir, &anchors).refused(&["a.toml", "replace the wings"]);

    // A log that was cut while landing is judged by what it holds, and says so.
    let whole = fs::read(dir.join("worn.mcap")).unwrap();
    fs::write(dir.join("landing.mcap"), &whole[..whole.len() * 8 / 10]).unwrap();
    let ended = diagnose(dir, &["landing.mcap"]);
    assert!(matches!(ended.code, Some(10..=14)), "{ended:?}");
    assert!(ended.text.contains("log cut at byte"), "{}", ended.text);
    // Hardly anything, or nothing, is what a power loss leaves: a fault of the log.
    fs::write(dir.join("cut.mcap"), &whole[..whole.len() / 10]).unwrap();
    fs::write(dir.join("empty.mcap"), []).unwrap();
    for name in ["cut.mcap", "empty.mcap"] {
        let ended = diagnose(dir, &[name, "--report", "f.html"]);
        assert_eq!(ended.code, Some(30), "{name}: {ended:?}");
        let report = json(&dir.join("f.json"));
        assert_eq!(report["outcome"], "log_fault");
        assert!(!report["faults"].as_array().unwrap().is_empty(), "{name}");
    }
    // What is no log at all is a wrong name, and no verdict.
    fs::write(dir.join("garbage.mcap"), [0xA5u8; 5000]).unwrap();
    for name in ["garbage.mcap", "gone.mcap"] {
        let ended = diagnose(dir, &[name]);
        assert_eq!(ended.code, Some(1), "{name}: {ended:?}");
        ended.refused(&[name]);
    }
    // Every tenth of a log spoilt by one bit: an outcome, never a panic.
    for k in 1..10 {
        let mut bad = whole.clone();
        bad[whole.len() * k / 10] ^= 0x20;
        fs::write(dir.join("bit.mcap"), bad).unwrap();
        let ended = diagnose(dir, &["bit.mcap"]);
        assert!(matches!(ended.code, Some(10..=14 | 20 | 30)), "bit {k}: {ended:?}");
        assert!(!ended.text.contains("panicked"), "{}", ended.text);
    }

    // References of another mission, or among other anchors, are refused in words.
    let mut longer = mission.clone();
    longer.items.remove(3);
    record(&scene, &longer, EffectSet::nominal(), 7, &dir.join("other.mcap"));
    let mut moved = scene.clone();
    let anchors: Vec<_> = moved
        .room
        .corner_anchors()
        .into_iter()
        .map(|(id, p)| (id, if id == AnchorId(3) { p * 0.97 } else { p }))
        .collect();
    moved.survey = Survey::new(&anchors).unwrap();
    record(&moved, &mission, EffectSet::nominal(), 8, &dir.join("surveyed.mcap"));
    let says = |reference: &str, says: &[&str]| {
        diagnose(dir, &["worn.mcap", "--reference", reference]).refused(says);
    };
    says("other.mcap", &["other.mcap", "another mission"]);
    says("surveyed.mcap", &["surveyed.mcap", "another anchor survey"]);
    says("again.mcap", &["1 reference flights", "at least 8"]);
    // A flight is known by what it holds: eight copies of the judged one were eight references, and eight of another one too.
    let copies = |of: &str| -> Vec<String> {
        let name = |k| format!("copy {k}.mcap");
        let copied = (0..8).map(|k| fs::copy(dir.join(of), dir.join(name(k))).map(|_| name(k)));
        copied.map(Result::unwrap).collect()
    };
    for (of, left, said) in [
        ("worn.mcap", 0, "not counted: copy 7.mcap: is the flight of worn.mcap, which is judged"),
        (
            "again.mcap",
            1,
            "not counted: copy 7.mcap: is the flight of copy 0.mcap, which was given already",
        ),
    ] {
        let copies = copies(of);
        let mut args = vec!["worn.mcap", "--reference"];
        args.extend(copies.iter().map(String::as_str));
        let beside = format!(
            "{left} reference flights on the mission of worn.mcap, beside {} logs",
            8 - left
        );
        diagnose(dir, &args).refused(&[said, &beside]);
    }
    diagnose(dir, &["worn.mcap", "copy 0.mcap", "copy 1.mcap"])
        .refused(&["copy 1.mcap: is the flight of copy 0.mcap"]);
    // Of a folder what does not fit is left out, and said.
    fs::create_dir(dir.join("refs")).unwrap();
    for (from, to) in [("again.mcap", "a.mcap"), ("other.mcap", "b.mcap"), ("cut.mcap", "c.mcap")] {
        fs::copy(dir.join(from), dir.join("refs").join(to)).unwrap();
    }
    fs::write(dir.join("refs/notes.txt"), "ok").unwrap();
    let told = [
        "reference: refs/a.mcap",
        "left out: refs/b.mcap: flew another mission",
        "left out: refs/c.mcap",
    ];
    says("refs", &[&told[..], &["1 reference flights"]].concat());
    fs::create_dir(dir.join("none")).unwrap();
    says("none", &["none: no log"]);
    diagnose(dir, &["worn.mcap", "surveyed.mcap"]).refused(&["another anchor survey"]);
}

#[test]
fn prop_wrong_use_is_refused_in_words() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let check = |args: &[&str], says: &[&str]| run(dir, args).refused(says);
    check(&["gap", "advise", "gone.json"], &["gone.json"]);
    fs::write(dir.join("x.json"), "{\"a\": 1}").unwrap();
    check(&["gap", "advise", "x.json"], &["x.json", "gap diagnose"]);
    check(&["gap", "accept", "x.json"], &["x.json"]);
    check(&["gap", "undo", "x.json"], &["nothing to take back"]);
    let none = "{\"log\": \"l.mcap\", \"outcome\": \"no_gap\", \"attribution\": null}";
    fs::write(dir.join("n.json"), none).unwrap();
    check(&["gap", "accept", "n.json"], &["names no effect", "no_gap"]);
    check(&["gap", "advise", "n.json"], &["l.mcap", "--log"]);
    check(&["gap", "shrink", "--effect", "Z9", "a.mcap"], &["Z9", "no such effect"]);
    check(&["gap", "shrink", "--effect", "P1=0.1", "gone.mcap"], &["gone.mcap"]);
    check(&["gap", "diagnose", "a.mcap", "--only", "Z9"], &["Z9"]);
    let listed = run(dir, &["gap", "advise", "--list"]);
    assert!(listed.code == Some(0) && listed.text.contains("kitchen scale"), "{listed:?}");
}
