//! A writer that is killed at any moment leaves a log that is read, or nothing. `HALTERE_KILLS` says how often it is
//! tried (`.ci/nightly`: 200).

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use super::tests::session;
use super::*;
use haltere_core::time::HostTime;
use haltere_pilot::{Input, LinkId};

const FOLDER: &str = "HALTERE_KILLED_WRITER";

/// The writer: this program again.
#[test]
fn writes_until_it_is_killed() {
    let Some(folder) = std::env::var_os(FOLDER) else { return };
    // One that waits for the disk leaves nothing out.
    let mut recorder = Recorder::start_waiting(Path::new(&folder), &session()).unwrap();
    for n in 0..u64::MAX {
        let at = HostTime::from_us(5_000_000 + n * 10_000);
        recorder.input(at, Input::Bytes { link: LinkId::Tag, bytes: &[n as u8; 3000] });
        recorder.commit(at);
        if n % 50 == 0 {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

#[test]
fn prop_a_writer_that_is_killed_leaves_a_log_or_nothing() {
    let kills = std::env::var("HALTERE_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(5);
    let (mut none, mut whole, mut recovered) = (0, 0, 0);
    for kill in 0..kills {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "record::tests_killed::writes_until_it_is_killed"])
            .env(FOLDER, folder.path())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        // A stride that is prime to the range: every moment from before the file to some chunks of it.
        std::thread::sleep(Duration::from_micros(kill * 7919 % 200_000));
        writer.kill().unwrap();
        writer.wait().unwrap();
        let log = std::fs::read_dir(folder.path()).unwrap().next();
        let Some(path) = log.map(|entry| entry.unwrap().path()) else {
            none += 1;
            continue;
        };
        let log = match LogReader::open(path.clone()) {
            Ok(log) => log,
            // Killed in its first write.
            Err(LogError::NoHead { .. }) => {
                none += 1;
                continue;
            }
            Err(error) => panic!("kill {kill}: {error}"),
        };
        let mut entries = log.entries();
        let sequences: Vec<u64> = entries
            .by_ref()
            .filter_map(|entry| match entry {
                Entry::Input { sequence, .. } => Some(sequence),
                _ => None,
            })
            .collect();
        assert!(sequences.iter().copied().eq(1..=sequences.len() as u64), "kill {kill}");
        assert!(!matches!(entries.end(), LogEnd::Damaged { .. }), "kill {kill}: {}", entries.end());
        whole += u64::from(entries.end() == LogEnd::Complete);
        let to = recovered_name(&path);
        recover(&path, &to).unwrap();
        let again = LogReader::open(to).unwrap();
        let mut entries = again.entries();
        let inputs = entries.by_ref().filter(|e| matches!(e, Entry::Input { .. })).count();
        assert_eq!((inputs, entries.end()), (sequences.len(), LogEnd::Complete), "kill {kill}");
        recovered += 1;
    }
    println!(
        "log: killed {kills} times: {recovered} logs recovered with all that was in them ({whole} ended between two \
         records), {none} times before there was one, 0 lost"
    );
    assert_eq!(none + recovered, kills);
}
