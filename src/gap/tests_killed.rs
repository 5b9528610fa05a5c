//! What is killed at any moment while it writes a bank, or accepts and takes back, leaves files that are whole, and a
//! way back that is taken. `HALTERE_KILLS` says how often it is tried (`.ci/nightly`: 200).

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::accept::accepted;
use crate::bank::Bank;
use crate::bank::bank_file;

const PLACE: &str = "HALTERE_KILLED_IN";

/// The bank of this number, some 100 kB.
fn bank(n: u64) -> Bank {
    let row = |k: u64| vec![n as f64, k as f64];
    Bank {
        names: vec!["n".into(), "k".into()],
        seeds: (0..3000).map(row).collect(),
        jitter: (0..12).map(row).collect(),
        effects: Vec::new(),
    }
}

/// The text of this number, of another length each.
fn text(n: usize) -> String {
    format!("n = {n}\n").repeat(1 + n % 3000)
}

/// The number of a text, which must be whole.
fn number(found: &str) -> usize {
    let n = found.lines().next().and_then(|line| line.strip_prefix("n = ")).unwrap().parse();
    let n = n.unwrap();
    assert!(found == text(n), "torn: {n}");
    n
}

/// The writers: this program again.
#[test]
fn keeps_banks_until_it_is_killed() {
    let Some(file) = std::env::var_os(PLACE) else { return };
    for n in 0..u64::MAX {
        bank_file::write(Path::new(&file), &bank(n)).unwrap();
    }
}

#[test]
fn accepts_until_it_is_killed() {
    let Some(file) = std::env::var_os(PLACE) else { return };
    let file = Path::new(&file);
    let mut now = accepted::read(file).unwrap();
    loop {
        let next = now.as_deref().map_or(0, number) + 1;
        accepted::write(file, now.as_deref(), &text(next), "a change").unwrap();
        // Two forward, one back.
        if next.is_multiple_of(3) {
            accepted::undo(file, false).unwrap();
        }
        now = accepted::read(file).unwrap();
        if next > 20 {
            while accepted::undo(file, false).is_ok() {}
            now = None;
        }
    }
}

/// Kills the writer of this name again and again at different moments, and looks each time at what it left.
fn kill(writer: &str, mut look: impl FnMut(u64, &Path)) -> u64 {
    let kills = std::env::var("HALTERE_KILLS").ok().and_then(|n| n.parse().ok()).unwrap_or(5);
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    for kill in 0..kills {
        let mut writer = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", &format!("tests_killed::{writer}")])
            .env(PLACE, &file)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // A stride that is prime to the range.
        std::thread::sleep(Duration::from_micros(kill * 7919 % 150_000));
        writer.kill().unwrap();
        let status = writer.wait().unwrap();
        assert_eq!(status.code(), None, "kill {kill}: it ended by itself");
        look(kill, &file);
    }
    kills
}

#[test]
fn prop_a_bank_whose_writer_is_killed_is_the_old_or_the_new() {
    let (mut none, mut whole) = (0, 0);
    let kills = kill("keeps_banks_until_it_is_killed", |kill, file| {
        if !file.exists() {
            none += 1;
            return;
        }
        let (found, _) =
            bank_file::read(file).unwrap_or_else(|error| panic!("kill {kill}: {error}"));
        let n = found.seeds[0][0] as u64;
        assert_eq!(found, bank(n), "kill {kill}");
        whole += 1;
    });
    println!(
        "bank: killed {kills} times: {whole} times whole, {none} times before there was one, 0 torn"
    );
    assert_eq!(none + whole, kills);
}

#[test]
fn prop_what_was_accepted_is_taken_back_whenever_the_power_went() {
    let (mut none, mut whole) = (0, 0);
    let kills = kill("accepts_until_it_is_killed", |kill, file| {
        let found = accepted::read(file).unwrap();
        if kill % 4 != 3 {
            // The next one goes on from here.
            found.as_deref().map(number);
        } else {
            // All the way back, to where there was no file.
            loop {
                match accepted::undo(file, false) {
                    Ok(_) => {}
                    Err(accepted::FileError::Nothing { .. }) => break,
                    Err(error) => panic!("kill {kill}: {error}"),
                }
            }
            assert_eq!(accepted::read(file).unwrap(), None, "kill {kill}");
        }
        match found {
            None => none += 1,
            Some(_) => whole += 1,
        }
    });
    println!(
        "accept: killed {kills} times: {whole} times whole, {none} times without a file, 0 torn, all taken back"
    );
    assert_eq!(none + whole, kills);
}
