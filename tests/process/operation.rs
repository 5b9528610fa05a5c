//! Setting up, looking and handling logs, with the real program.

use std::path::Path;
use std::time::Duration;

use haltere::gap::scene::Scene;
use haltere::model::EffectSet;

use super::flights::{box_mission, record};
use super::support::{Ended, companion, root};

const LIMIT: Duration = Duration::from_secs(180);

fn run(folder: &Path, args: &[&str]) -> Ended {
    companion(args, folder, LIMIT)
}

#[test]
fn prop_what_init_writes_is_what_check_reads() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    run(dir, &["init", "--yes"]).refused(&["--anchors FILE", "--anchor ID=X,Y,Z"]);
    run(dir, &["check"]).refused(&["anchors.toml", "haltere init"]);
    let anchors = root().join("config/anchors.toml").display().to_string();
    let init =
        ["init", "--yes", "--no-probe", "--board", "udpin:127.0.0.1:14699", "--anchors", &anchors];
    let made = run(dir, &init);
    assert_eq!(made.code, Some(0), "{made:?}");
    run(dir, &init).refused(&["haltere.toml", "exists already", "--force"]);

    // No tag is plugged in here: that alone must be put right.
    let set = ["check", "--json", "--set", "tag.port=/dev/null"];
    let checked = run(dir, &set);
    assert_eq!(checked.code, Some(1), "{checked:?}");
    let report: serde_json::Value =
        serde_json::from_str(&checked.text[checked.text.find('{').unwrap()..]).unwrap();
    let findings = report["findings"].as_array().unwrap();
    let problems: Vec<_> =
        findings.iter().filter(|f| f["status"] == "problem").map(|f| f["what"].clone()).collect();
    assert_eq!(problems, ["tag.port"], "{report:#}");
    run(dir, &["check", "--set", "flight.spool_s=99"])
        .refused(&["flight.spool_s = 99, allowed 0.2 to 5 s"]);
}

#[test]
fn prop_logs_are_listed_cut_converted_and_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let scene = Scene::lab().unwrap();
    record(&scene, &box_mission(), EffectSet::nominal(), 1, &dir.join("a.mcap"));
    let bytes = std::fs::read(dir.join("a.mcap")).unwrap();
    std::fs::write(dir.join("cut.mcap"), &bytes[..bytes.len() / 2]).unwrap();
    std::fs::write(dir.join("none.mcap"), b"nothing").unwrap();
    let good = |args: &[&str]| {
        let ended = run(dir, args);
        assert_eq!(ended.code, Some(0), "{args:?}: {}", ended.text);
        ended.text
    };
    let list = good(&["log", "list", "."]);
    for needed in ["a.mcap", "cut at byte", "not an MCAP file"] {
        assert!(list.contains(needed), "{list}");
    }
    good(&["log", "trim", "a.mcap", "--to", "8", "-o", "part.mcap"]);
    assert!(good(&["replay", "part.mcap"]).contains("reproduced bit for bit"));
    run(dir, &["log", "trim", "a.mcap", "--from", "900"]).refused(&["the log runs from 0 to"]);
    run(dir, &["log", "trim", "a.mcap", "--from", "3", "--to", "2"]).refused(&["before the end"]);
    good(&["log", "recover", "cut.mcap"]);
    assert!(good(&["replay", "cut.recovered.mcap"]).contains("reproduced bit for bit"));
    assert!(good(&["log", "tlog", "a.mcap", "--link", "board"]).contains("a.tlog: board"));
    run(dir, &["log", "tlog", "a.mcap", "--link", "ground/9"]).refused(&["carried nothing"]);
    run(dir, &["log", "export", "none.mcap"]).refused(&["not an MCAP file"]);
    // Flown in memory, without decoded topics: the page is that of a replay.
    good(&["report", "a.mcap"]);
    let page = std::fs::read_to_string(dir.join("a.html")).unwrap();
    for needed in ["What was in force", "Corrections", "wings beat", "takeoff"] {
        assert!(page.contains(needed), "{needed}");
    }
    good(&["report", "cut.mcap"]);
    run(dir, &["report", "none.mcap"]).refused(&["none.mcap", "not an MCAP file"]);
}
