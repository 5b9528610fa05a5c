//! What programs write: never over a flight log or over what they read, and a result that does not arrive is told.

use std::fs::{self, File};
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use haltere_log::written::LOG_MAGIC;

use super::support::{companion, program, sim, wait};

const LIMIT: Duration = Duration::from_secs(120);

/// A flight of half a minute.
fn flown(folder: &Path) -> Vec<u8> {
    let ended = sim(&["fly", "straight", "--out", "."], folder, LIMIT);
    assert_eq!(ended.code, Some(0), "{}", ended.text);
    let log = fs::read(folder.join("straight-1.mcap")).expect("a log");
    assert!(log.starts_with(&LOG_MAGIC));
    fs::rename(folder.join("straight-1.mcap"), folder.join("a.mcap")).expect("renamed");
    log
}

#[test]
fn regress_nothing_is_written_over_a_flight_log_or_over_what_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let here = |name: &str| folder.path().join(name);
    let log = flown(folder.path());
    fs::copy(here("a.mcap"), here("b.mcap")).unwrap();
    symlink("b.mcap", here("soft.html")).unwrap();
    fs::hard_link(here("b.mcap"), here("hard.html")).unwrap();
    let truth = fs::read(here("straight-1.truth.csv")).unwrap();
    symlink("straight-1.truth.csv", here("truth.html")).unwrap();
    for (args, says) in [
        (&["report", "-o", "a.mcap", "b.mcap"][..], "a.mcap: is a flight log"),
        (&["report", "a.mcap", "-o", "a.mcap"], "which this command reads"),
        (&["report", "a.mcap", "-o", "soft.html"], "is a flight log"),
        (&["report", "a.mcap", "-o", "hard.html"], "is a flight log"),
        (
            &["report", "a.mcap", "--truth", "straight-1.truth.csv", "-o", "truth.html"],
            "the same file as straight-1.truth.csv",
        ),
        (&["fit", "imu", "a.mcap", "--report", "a.mcap"], "which this command reads"),
        (&["fit", "imu", "a.mcap", "--report", "b.mcap"], "is a flight log"),
        (&["log", "tlog", "a.mcap", "a.mcap", "--overwrite"], "which this command reads"),
        (&["log", "tlog", "a.mcap", "b.mcap", "--overwrite"], "is a flight log"),
        (&["gap", "diagnose", "a.mcap", "--report", "b.mcap"], "is a flight log"),
        (&["gap", "bank", "a.mcap", "--export", "b.mcap"], "is a flight log"),
    ] {
        let ended = companion(args, folder.path(), LIMIT);
        ended.refused(&[says]);
        assert_eq!(ended.code, Some(1), "{args:?}: {}", ended.text);
        assert!(fs::read(here("a.mcap")).unwrap() == log, "{args:?}: a.mcap has changed");
        assert!(fs::read(here("b.mcap")).unwrap() == log, "{args:?}: b.mcap has changed");
        assert!(fs::read(here("straight-1.truth.csv")).unwrap() == truth, "{args:?}");
    }
    // The simulator's folders and files, and a table that a link leads to a log.
    fs::create_dir(here("demo")).unwrap();
    fs::write(here("demo/haltere.toml"), "seed = 3\n").unwrap();
    fs::create_dir(here("tables")).unwrap();
    symlink("../a.mcap", here("tables/status.csv")).unwrap();
    sim(&["demo", "--scenario", "demo/haltere.toml", "--output", "demo"], folder.path(), LIMIT)
        .refused(&["demo/haltere.toml", "which this command reads"]);
    sim(&["lockstep", "--truth", "a.mcap", "--duration", "1"], folder.path(), LIMIT)
        .refused(&["a.mcap: is a flight log"]);
    assert_eq!(fs::read(here("demo/haltere.toml")).unwrap(), b"seed = 3\n");
    assert!(fs::read(here("a.mcap")).unwrap() == log, "the simulator has changed a.mcap");
    let good = companion(&["report", "a.mcap"], folder.path(), LIMIT);
    assert_eq!(good.code, Some(0), "{}", good.text);
    assert!(here("a.html").metadata().unwrap().len() > 10_000);
}

#[test]
fn regress_a_result_that_cannot_be_written_is_no_success_and_told_unless_the_reader_left() {
    let folder = tempfile::tempdir().unwrap();
    flown(folder.path());
    let ours: [&[&str]; 12] = [
        &["companion", "--help"],
        &["companion", "--version"],
        &["companion", "completions", "bash"],
        &["companion", "gap", "mission", "diagnostic"],
        &["companion", "vehicle", "print"],
        &["companion", "log", "info", "a.mcap"],
        &["companion", "log", "info", "--json", "a.mcap"],
        &["companion", "log", "list", "."],
        &["companion", "report", "a.mcap"],
        &["companion", "replay", "--json", "a.mcap"],
        &["fly", "--list"],
        &["effects"],
    ];
    let run = |args: &[&str], stdout: Stdio| {
        let said = folder.path().join("said.txt");
        let mut child = Command::new(program())
            .args(args)
            .current_dir(folder.path())
            .stdin(Stdio::null())
            .stdout(stdout)
            .stderr(File::create(&said).unwrap())
            .spawn()
            .unwrap();
        let code = wait(&mut child, LIMIT);
        let said = fs::read_to_string(said).unwrap();
        assert_eq!(code, Some(1), "{args:?}: {said}");
        said
    };
    for args in ours {
        if Path::new("/dev/full").exists() {
            let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
            let said = run(args, full.into());
            assert!(said.contains("cannot be written to standard output"), "{args:?}: {said}");
            assert!(!said.contains("panicked"), "{args:?}: {said}");
        }
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        // As `| head` does when it has enough: "Broken pipe" was said.
        let said = run(args, writer.into());
        let of_that = ["ipe", "standard output", "panicked"];
        assert!(!of_that.iter().any(|word| said.contains(word)), "{args:?}: {said}");
    }
}
