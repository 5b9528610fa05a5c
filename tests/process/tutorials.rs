//! The tutorials as they stand: every block of commands, in order, in an empty folder.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use super::packages::companion;
use super::support::{finish, root};

const LIMIT: Duration = Duration::from_secs(1800);

/// The blocks of commands of a page.
fn blocks(page: &str) -> Vec<String> {
    let text = fs::read_to_string(root().join("docs").join(page)).unwrap();
    let mut blocks = Vec::new();
    let mut block: Option<String> = None;
    for line in text.lines() {
        match (&mut block, line) {
            (None, "```sh") => block = Some(String::new()),
            (Some(_), "```") => blocks.extend(block.take()),
            (Some(block), line) => *block += &format!("{line}\n"),
            (None, _) => {}
        }
    }
    blocks
}

/// What `haltere gap diagnose` exits with when it names an effect.
const NAMED: i32 = 10;

/// Runs a block as a shell would, and says what came out.
fn run(block: &str, folder: &Path, code: i32) -> String {
    let mut command = Command::new("bash");
    let programs = std::env::var_os("HALTERE_PROGRAMS").map_or_else(
        || companion().parent().expect("a program lies in a folder").to_owned(),
        |folder| root().join(folder),
    );
    let path = format!("{}:{}", programs.display(), std::env::var("PATH").unwrap());
    command.args(["-euc", block]).current_dir(folder).env("PATH", path);
    command.env("XDG_CACHE_HOME", folder.join("cache"));
    let ended = finish(command, folder, LIMIT);
    assert_eq!(ended.code, Some(code), "{block}{}", ended.text);
    ended.text
}

#[test]
#[ignore = "4 minutes of processor time by a release, by which .ci/nightly runs it; more than 7 by programs that are not optimised"]
fn val_the_story_of_a_gap_takes_six_commands() {
    let dir = tempfile::tempdir().unwrap();
    let blocks = blocks("TUTORIAL_GAP.md");
    assert!(blocks.iter().all(|block| block.lines().count() == 1), "{blocks:?}");
    let [good, bad, diagnosis, accepted, mended, check] = &blocks[..] else {
        panic!("{} commands", blocks.len())
    };
    let run = |block: &str| run(block, dir.path(), if block == diagnosis { NAMED } else { 0 });
    assert_eq!(run(good).matches("landed").count(), 16);
    assert_eq!(run(bad).matches("landed").count(), 6);
    let said = run(diagnosis);
    assert!(said.contains("VERDICT     named") && said.contains("EFFECT      P1"), "{said}");
    assert!(dir.path().join("gap.html").metadata().unwrap().len() > 100_000);
    assert!(run(accepted).contains("[effects.on.P1]"));
    assert!(run(mended).contains("landed"));
    let said = run(check);
    assert!(said.contains("VERDICT     no material gap"), "{said}");
}

#[test]
fn val_the_square_is_flown_before_a_vehicle_flies_it() {
    let dir = tempfile::tempdir().unwrap();
    let blocks = blocks("TUTORIAL_SQUARE.md");
    assert!(run(&blocks[0], dir.path(), 0).contains("flights/square-1.mcap  seed 1  landed"));
    assert!(dir.path().join("square.html").metadata().unwrap().len() > 100_000);
    // What needs no second terminal: the survey, and a configuration of it.
    let room = blocks.iter().position(|block| block.contains("haltere init")).unwrap();
    for block in &blocks[room..room + 2] {
        run(block, dir.path(), 0);
    }
    assert!(fs::read_to_string(dir.path().join("haltere.toml")).unwrap().contains("gear_height_m"));
}
