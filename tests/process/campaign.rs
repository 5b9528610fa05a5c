//! Campaigns as a user runs them: processes side by side, a kill in the middle, a merge.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use super::support::{program, sim};

const LIMIT: Duration = Duration::from_secs(300);

/// A short flight, many times.
fn campaign(folder: &Path, flights: u64) {
    let text = format!(
        "name = 'short'\nflights = {flights}\nlimit_s = 30.0\n\
         [[item]]\ncommand = 'takeoff'\nheight_m = 0.8\n[[item]]\ncommand = 'land'\n\
         [vary]\n'start.yaw_deg' = {{ uniform = [-90.0, 90.0] }}\n"
    );
    fs::write(folder.join("short.toml"), text).unwrap();
}

fn rows(folder: &Path, name: &str) -> Vec<u8> {
    fs::read(folder.join(name).join("rows.jsonl")).unwrap()
}

fn fine(folder: &Path, args: &[&str]) -> String {
    let ended = sim(args, folder, LIMIT);
    assert_eq!(ended.code, Some(0), "{args:?}: {}", ended.text);
    ended.text
}

#[test]
fn prop_processes_side_by_side_fly_what_one_flies() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    campaign(folder, 6);
    // As docs/CAMPAIGNS.md says, and without a scheduler of ours.
    let script = format!(
        "seq 1 3 | xargs -P 3 -I{{}} '{}' campaign short.toml --shard {{}}/3 --jobs 1 --out shards/{{}}",
        program().display()
    );
    let done = Command::new("sh").args(["-c", &script]).current_dir(folder).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    fine(folder, &["campaign", "merge", "shards/2", "shards/3", "shards/1", "--out", "merged"]);
    let said = fine(folder, &["campaign", "short.toml", "--out", "whole"]);
    assert!(said.contains("6 flights") && said.contains("6 landed"), "{said}");
    assert_eq!(rows(folder, "merged"), rows(folder, "whole"));
    for file in ["results.parquet", "summary.html", "campaign.json"] {
        assert!(folder.join("merged").join(file).metadata().unwrap().len() > 100, "{file}");
    }
    let merge = |shards: &[&str]| {
        let args: Vec<&str> = ["campaign", "merge"].iter().chain(shards).copied().collect();
        sim(&[&args[..], &["--out", "none"]].concat(), folder, LIMIT)
    };
    merge(&["shards/1", "shards/3"]).refused(&["shards 2 of 3 are missing"]);
    merge(&["shards/1", "shards/2", "shards/2"]).refused(&["shard 2 is there twice"]);
    merge(&["shards/1", "nowhere"]).refused(&["nowhere", "no campaign"]);
    assert!(!folder.join("none").exists());
}

#[test]
fn prop_a_killed_campaign_goes_on_and_a_changed_one_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path();
    campaign(folder, 40);
    let args = ["campaign", "short.toml", "--out", "out", "--jobs", "1"];
    let mut child = Command::new(program())
        .args(args)
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let begun = Instant::now();
    let lines = || fs::read(folder.join("out/rows.jsonl")).unwrap_or_default();
    while lines().iter().filter(|b| **b == b'\n').count() < 2 {
        assert!(begun.elapsed() < LIMIT, "nothing is flown");
        assert!(child.try_wait().unwrap().is_none(), "over before it could be killed");
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let mut before = lines();
    // A kill in the middle of a write: the last row is torn.
    before.truncate(before.len() - 7);
    fs::write(folder.join("out/rows.jsonl"), &before).unwrap();
    let said = fine(folder, &args);
    assert!(said.contains("1 torn rows") && said.contains("40 landed"), "{said}");
    fine(folder, &["campaign", "short.toml", "--out", "whole"]);
    assert_eq!(rows(folder, "out"), rows(folder, "whole"));

    let refused = |args: &[&str], says: &[&str]| sim(args, folder, LIMIT).refused(says);
    refused(&[&args[..], &["--seed", "9"]].concat(), &["out", "another campaign"]);
    refused(&[&args[..], &["--shard", "1/2"]].concat(), &["shard 1/1 and not 1/2"]);
    refused(&[&args[..], &["--shard", "3/2"]].concat(), &["I from 1 to N"]);
    refused(&["campaign", "nowhere.toml"], &["nowhere.toml"]);
    refused(&["campaign", "short.toml", "--fly", "40", "--log", "x"], &["flights 0 to 39"]);
    fs::write(folder.join("bad.toml"), "name = 'x'\n[[item]]\ncommand = 'land'\n").unwrap();
    refused(&["campaign", "bad.toml"], &["bad.toml", "flights is missing"]);
    // A folder that cannot be written.
    fs::write(folder.join("file"), "").unwrap();
    refused(&["campaign", "short.toml", "--out", "file"], &["file"]);
}
