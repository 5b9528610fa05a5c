//! The tutorial of the square as a reader goes through it, in three terminals and real time: the page shows what comes out.
//! `HALTERE_REWRITE_GOLDENS=1` writes what it shows anew.

use std::fs::{self, File};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use super::packages::companion;
use super::support::{in_real_time, root, wait};

/// Longest block: the flight of the square.
const LIMIT: Duration = Duration::from_secs(180);

/// Commands of the page, and the lines of the page that show their output.
struct Block {
    commands: String,
    shown: Option<Range<usize>>,
}

fn blocks(page: &[&str]) -> Vec<Block> {
    let mut found: Vec<Block> = Vec::new();
    let mut open: Option<usize> = None;
    for (at, line) in page.iter().enumerate() {
        match open {
            None if line.starts_with("```") => open = Some(at),
            Some(begin) if *line == "```" => {
                let inside = begin + 1..at;
                match page[begin] {
                    "```sh" => {
                        found.push(Block { commands: page[inside].join("\n"), shown: None });
                    }
                    _ => {
                        found.last_mut().expect("output follows its commands").shown = Some(inside)
                    }
                }
                open = None;
            }
            _ => {}
        }
    }
    found
}

/// A terminal in the folder of the reader.
struct Terminal<'a> {
    folder: &'a Path,
    path: String,
}

impl Terminal<'_> {
    /// Begins a block, with what a reader sees of it in a file.
    fn begin(&self, commands: &str, output: &str) -> (Child, PathBuf) {
        let output = self.folder.join(output);
        let mut command = Command::new("bash");
        command.args(["-euc", commands]).current_dir(self.folder).env("PATH", &self.path);
        let file = File::create(&output).expect("a file for output");
        let twice = file.try_clone().expect("a second handle");
        command.stdin(Stdio::null()).stdout(file).stderr(twice);
        (command.spawn().expect("bash"), output)
    }

    /// Exit code and output of a block.
    fn run(&self, commands: &str) -> (Option<i32>, String) {
        let (mut child, output) = self.begin(commands, "output.txt");
        (wait(&mut child, LIMIT), fs::read_to_string(output).expect("its output"))
    }

    /// Waits for what a program that goes on has said.
    fn until(&self, mut there: impl FnMut(&Self) -> bool) {
        let end = Instant::now() + LIMIT;
        while !there(self) {
            assert!(Instant::now() < end, "a program of the page does not begin");
            std::thread::sleep(Duration::from_millis(200));
        }
    }
}

/// Ends a program as Ctrl-C does.
fn interrupt(mut child: Child) {
    let asked = Command::new("kill").args(["-INT", &child.id().to_string()]).status();
    assert!(asked.expect("kill").success());
    assert_eq!(wait(&mut child, LIMIT), Some(0));
}

/// What the page shows of an output: neither the log nor how far a task is.
fn to_show(output: &str) -> impl Iterator<Item = &str> {
    let noise = |line: &str| {
        line.contains("Z  INFO ") || line.contains("Z  WARN ") || line.starts_with("flights: ")
    };
    output.lines().filter(move |line| !noise(line))
}

/// A line without what differs between computers and runs: numbers, their columns, the user; of a line of `haltere check`
/// its subject. `None`: it need not come at all.
fn shape(line: &str) -> Option<String> {
    let optional = ["   ", "lost on ", "unused on ", "everything is in order"];
    if optional.iter().any(|begin| line.starts_with(begin)) || line.contains("worth a look") {
        return None;
    }
    if ["ok    ", "look  ", "--    ", "FIX   "].iter().any(|mark| line.starts_with(mark)) {
        return Some(line[6..].split("  ").next().unwrap_or_default().to_owned());
    }
    let line = match line.split_once(", user ") {
        Some((before, _)) => before,
        None => line,
    };
    let part = |word: &str| -> String {
        let mut masked = String::new();
        for c in word.trim_start_matches('-').chars() {
            let c = if c.is_ascii_digit() { '#' } else { c };
            if !(c == '#' && masked.ends_with('#') || c == '.' && masked.ends_with('#')) {
                masked.push(c);
            }
        }
        masked
    };
    Some(line.split_whitespace().map(part).collect::<Vec<_>>().join(" "))
}

fn shapes<'a>(lines: impl Iterator<Item = &'a str>) -> Vec<String> {
    lines.filter_map(shape).collect()
}

#[test]
#[ignore = "two minutes of real time with ports that the page names, by .ci/nightly"]
fn golden_the_page_of_the_square_shows_what_comes_out() {
    in_real_time("the page of the square", || {
        if let Err(differs) = go_through() {
            panic!("{differs}");
        }
    });
}

/// Every block in its terminal; what the page shows otherwise than it came out.
fn go_through() -> Result<(), String> {
    let path = root().join("docs/TUTORIAL_SQUARE.md");
    let text = fs::read_to_string(&path).unwrap();
    let page: Vec<&str> = text.lines().collect();
    let dir = tempfile::tempdir().unwrap();
    let programs = std::env::var_os("HALTERE_PROGRAMS").map_or_else(
        || companion().parent().expect("a program lies in a folder").to_owned(),
        |folder| root().join(folder),
    );
    let path_of = format!("{}:{}", programs.display(), std::env::var("PATH").unwrap());
    let terminal = Terminal { folder: dir.path(), path: path_of };

    let (mut going, mut outputs) = (Vec::new(), Vec::new());
    for block in blocks(&page) {
        let commands = &block.commands;
        let output = if commands.contains("haltere-sim serve") {
            let (child, output) = terminal.begin(&format!("exec {commands}"), "serve.txt");
            going.push(child);
            let said = || fs::read_to_string(&output).unwrap_or_default();
            terminal.until(|_| said().ends_with('\n'));
            said()
        } else if commands.starts_with("haltere fly") {
            going.push(terminal.begin(&format!("exec {commands}"), "fly.txt").0);
            terminal.until(|it| it.run("haltere ctl status").1.contains("on the ground"));
            continue;
        } else {
            if commands.contains("haltere log list") {
                going.drain(..).rev().for_each(interrupt);
            }
            let (code, output) = terminal.run(commands);
            // A computer that is busy has a line worth a look.
            let busy = commands.contains("haltere check") && code == Some(3);
            assert!(code == Some(0) || busy, "{commands}: {code:?}\n{output}");
            output
        };
        outputs.push((block, output));
    }
    assert!(going.is_empty() && outputs.len() > 8, "{} blocks", outputs.len());

    if std::env::var_os("HALTERE_REWRITE_GOLDENS").is_some() {
        let mut lines: Vec<String> = page.iter().map(|line| (*line).to_owned()).collect();
        for (block, output) in outputs.iter().rev() {
            if let Some(shown) = block.shown.clone() {
                let folder = dir.path().display().to_string();
                let clean = output.replace(&folder, ".../square");
                lines.splice(shown, to_show(&clean).map(str::to_owned));
            }
        }
        fs::write(&path, lines.join("\n") + "\n").unwrap();
        return Ok(());
    }
    for (block, output) in &outputs {
        let Some(shown) = block.shown.clone() else { continue };
        let (came, shown) = (shapes(to_show(output)), shapes(page[shown].iter().copied()));
        if came != shown {
            let commands = &block.commands;
            return Err(format!("{commands}\n{output}\ncame: {came:#?}\nshown: {shown:#?}"));
        }
    }
    Ok(())
}

#[test]
fn prop_a_shape_keeps_words_and_drops_numbers() {
    let shapes = |text: &str| shape(text).unwrap_or_default();
    assert_eq!(shapes("position: north 5.00 m, east -0.05 m"), "position: north # m, east # m");
    assert_eq!(shapes("ok    anchor 3               59.1 packets/s"), "anchor 3");
    assert_eq!(shapes("look  control loop           2 of 697"), "control loop");
    assert_eq!(shape("lost on tag: uwb_no_pair 1"), None);
}
