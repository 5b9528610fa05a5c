//! The Debian package and the wheel, made of the programs under test and tried where nothing else of ours is: folders that
//! are empty, an environment that names neither the sources nor what was built from them.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use super::support::{finish, program, root};

/// Longest step: pip fetches what a wheel asks for.
const LIMIT: Duration = Duration::from_secs(600);
/// Where the system's own programs lie.
const SYSTEM: &str = "/usr/local/bin:/usr/bin:/bin";

/// `haltere` beside the program under test; `cargo test --workspace` builds it, a test of this package alone does not.
pub fn companion() -> PathBuf {
    let folder = program().parent().expect("a program lies in a folder");
    let companion = folder.join("haltere");
    if !companion.exists() {
        let release = folder.ends_with("release").then_some("--release");
        let mut build = Command::new(env!("CARGO"));
        build.args(["build", "--locked", "--package", "haltere", "--bin", "haltere"]).args(release);
        let built = build.current_dir(root()).output().expect("cargo runs");
        assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    }
    companion
}

/// A script of `packaging/`, given the programs; they go to `out`.
fn build(script: &str, out: &Path) -> Command {
    let mut command = Command::new(root().join("packaging").join(script));
    command.env("PROGRAM", companion()).env("SIM_PROGRAM", program()).env("OUT", out);
    command
}

/// A command that knows of the system and of `path`, and of nothing else.
fn bare(what: impl AsRef<std::ffi::OsStr>, path: &Path, folder: &Path) -> Command {
    let mut command = Command::new(what);
    command.env_clear().env("PATH", format!("{}:{SYSTEM}", path.display()));
    command.env("HOME", folder).current_dir(folder);
    command
}

fn good(command: Command, folder: &Path) -> String {
    let told = format!("{command:?}");
    let ended = finish(command, folder, LIMIT);
    assert_eq!(ended.code, Some(0), "{told}: {}", ended.text);
    ended.text
}

/// The one file of a folder that ends so.
fn only(folder: &Path, ending: &str) -> PathBuf {
    let all: Vec<PathBuf> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    let mut found = all.iter().filter(|path| path.to_string_lossy().ends_with(ending));
    let one = found.next().unwrap_or_else(|| panic!("no {ending} among {all:?}"));
    assert!(found.next().is_none(), "several {ending}: {all:?}");
    one.clone()
}

/// Every file below a folder, as a path from there.
fn below(folder: &Path) -> Vec<String> {
    let mut all = Vec::new();
    let mut waiting = vec![folder.to_owned()];
    while let Some(next) = waiting.pop() {
        for entry in std::fs::read_dir(&next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                waiting.push(path);
            } else {
                all.push(path.strip_prefix(folder).unwrap().to_string_lossy().into_owned());
            }
        }
    }
    all.sort();
    all
}

/// What the tutorials fly is flown by the programs of the package, on the files of the package.
#[test]
fn prop_the_package_holds_what_the_tutorials_need() {
    let out = tempfile::tempdir().unwrap();
    let room = tempfile::tempdir().unwrap();
    let (out, room) = (out.path(), room.path());
    good(build("build-deb", out), out);
    let package = out.join("package");
    let mut unpack = Command::new("dpkg-deb");
    unpack.arg("--extract").arg(only(out, ".deb")).arg(&package);
    good(unpack, out);

    let files = below(&package);
    for needed in [
        "usr/bin/haltere",
        "usr/bin/haltere-sim",
        "usr/share/doc/haltere/LICENCES.md",
        "usr/share/doc/haltere/LICENSE-APACHE",
        "usr/share/doc/haltere/LICENSE-MIT",
        "usr/share/doc/haltere/CITATION.cff",
        "usr/share/doc/haltere/TUTORIAL_GAP.md",
        "usr/share/doc/haltere/TUTORIAL_SQUARE.md",
        "usr/share/haltere/examples/ci.yml",
        "usr/share/haltere/missions/diagnostic.toml",
        "usr/share/haltere/scenarios/sample.toml",
        "usr/share/haltere/vehicles/delfly-nimble.toml",
        "usr/share/man/man1/haltere-gap-diagnose.1.gz",
        "usr/share/man/man1/haltere-sim-lockstep.1.gz",
        "usr/share/man/man1/haltere-sim.1.gz",
        "usr/share/bash-completion/completions/haltere-sim",
        "usr/share/fish/vendor_completions.d/haltere-sim.fish",
        "usr/share/zsh/vendor-completions/_haltere-sim",
    ] {
        assert!(files.iter().any(|file| file == needed), "{needed} is not among {files:#?}");
    }
    let documents = package.join("usr/share/doc/haltere");
    let readme = std::fs::read_to_string(documents.join("README.md")).unwrap();
    let links = readme.split("](").skip(1).filter_map(|rest| rest.split([')', '#']).next());
    let lost: Vec<_> = links.filter(|link| !documents.join(link).exists()).collect();
    assert_eq!(lost, ["ARCHITECTURE.md", "CONTRIBUTING.md"], "these come with the sources alone");
    let strange = |file: &&String| {
        file.contains("haltere-lab") || file.contains("/lab/") || file.contains("__pycache__")
    };
    assert_eq!(files.iter().find(strange), None, "the laboratory is none of the package");

    let bin = package.join("usr/bin");
    let share = package.join("usr/share");
    let data = share.join("haltere");
    let run = |what: &str, args: &[&str]| -> String {
        let mut command = bare(bin.join(what), &bin, room);
        command.args(args);
        good(command, room)
    };
    assert!(run("haltere", &["--version"]).starts_with("haltere 0."));
    assert!(run("haltere-sim", &["--version"]).starts_with("haltere-sim 0."));
    let completion = share.join("bash-completion/completions/haltere-sim");
    let completion = std::fs::read_to_string(completion).unwrap();
    assert!(completion.lines().any(|line| line.ends_with("-o default haltere-sim")));
    let page = share.join("man/man1/haltere-sim-lockstep.1.gz");
    let mut unzip = Command::new("gzip");
    unzip.arg("-dc").arg(page);
    assert!(good(unzip, out).contains("Scenario file, or the name of a built\\-in one"));

    // The survey of the one tutorial is accepted, its square is flown; the other one's flights are missions by name.
    let at = |file: &str| data.join(file).display().to_string();
    let anchors = at("tutorials/anchors.txt");
    run("haltere", &["init", "--yes", "--no-probe", "--tag", "tag", "--anchors", &anchors]);
    let square = at("tutorials/square.toml");
    for (mission, name) in [(square.as_str(), "square"), ("diagnostic", "diagnostic")] {
        let said = run("haltere-sim", &["fly", mission, "--scenario", "sample", "--out", name]);
        assert!(said.contains("landed"), "{said}");
        let log = format!("{name}/{name}-1.mcap");
        assert!(run("haltere", &["replay", &log]).contains("reproduced bit for bit"));
    }
    // A scenario that is not there is refused in the words of those that are.
    let mut command = bare(bin.join("haltere-sim"), &bin, room);
    command.args(["fly", "plain", "--scenario", "corridors"]);
    finish(command, room, LIMIT).refused(&["scenario corridors: allowed are a file", "corridor, "]);
}

/// `run:` lines of the job in `examples/ci.yml`.
fn steps_of_the_job() -> Vec<String> {
    let job = std::fs::read_to_string(root().join("examples/ci.yml")).expect("the job");
    let steps = job.lines().filter_map(|line| line.trim_start().strip_prefix("- run: "));
    steps.map(str::to_owned).collect()
}

/// Newest version of the C library that a program asks for.
fn glibc_of(program: &Path) -> (u32, u32) {
    let told = Command::new("objdump").arg("-T").arg(program).output().expect("objdump runs");
    let told = String::from_utf8_lossy(&told.stdout).into_owned();
    let versions = told.split("GLIBC_").skip(1).filter_map(|rest| {
        let end = rest.find(|c: char| c != '.' && !c.is_ascii_digit()).unwrap_or(rest.len());
        let mut numbers = rest[..end].split('.').map(|number| number.parse().ok());
        Some((numbers.next()??, numbers.next()??))
    });
    versions.max().expect("a program asks for a C library")
}

/// In a virtual environment with nothing in it the steps of `examples/ci.yml` are the whole set-up.
#[test]
fn prop_the_wheel_is_all_that_a_test_of_a_mission_needs() {
    let out = tempfile::tempdir().unwrap();
    let room = tempfile::tempdir().unwrap();
    let (out, room) = (out.path(), room.path().canonicalize().unwrap());
    let venv = room.join("venv");
    let mut make = Command::new("python3");
    make.args(["-m", "venv"]).arg(&venv);
    good(make, out);
    let bin = venv.join("bin");

    let wheels = room.join("wheels");
    let mut wheel = build("build-wheel", &wheels);
    wheel.env("PYTHON", bin.join("python"));
    good(wheel, out);
    let wheel = only(&wheels, ".whl");

    // A repository with missions of its own.
    for test in ["test_square.py", "test_more.py"] {
        std::fs::copy(root().join("examples").join(test), room.join(test)).unwrap();
    }
    let steps = steps_of_the_job();
    assert_eq!(steps.len(), 2, "{steps:?}");
    let mut said = String::new();
    for step in &steps {
        let mut command = bare("bash", &bin, &room);
        command.args(["-c", step]);
        // The versions that the other tests of missions have.
        command.env("PIP_CONSTRAINT", root().join("tests/pymavlink/requirements.txt"));
        said = good(command, out);
    }
    assert!(said.contains("5 passed"), "{said}");

    // Where no path names them, the helper takes those of the wheel.
    let mut command = bare(bin.join("python"), Path::new("/nowhere"), &room);
    command.args(["-c", "import haltere_testing; print(haltere_testing.program())"]);
    assert_eq!(Path::new(good(command, out).trim()), bin.join("haltere-sim"));
    let name = wheel.file_name().unwrap().to_str().unwrap();
    let told = name.split("manylinux_").nth(1).and_then(|rest| rest.strip_suffix("_x86_64.whl"));
    let (major, minor) = told.and_then(|told| told.split_once('_')).expect(name);
    let told: (u32, u32) = (major.parse().expect(name), minor.parse().expect(name));
    let newest = ["haltere", "haltere-sim"].map(|program| {
        let program = bin.join(program);
        let mut command = bare(&program, &bin, &room);
        command.arg("--version");
        assert!(good(command, out).contains(" 0."));
        glibc_of(&program)
    });
    assert_eq!(newest.into_iter().max(), Some(told), "{name}");
    let licences =
        below(&venv).into_iter().filter(|file| file.contains("dist-info/licenses/LICEN"));
    // lib64 is lib.
    let ours = licences.filter(|file| file.contains("lib/") && file.contains("haltere_testing"));
    let ours: Vec<String> = ours.collect();
    assert_eq!(ours.len(), 3, "{ours:?}");
}

/// A folder `build/` and an egg-info were left behind, after which pytest found the plugin twice.
#[test]
fn regress_an_install_from_the_sources_leaves_nothing_in_them() {
    let room = tempfile::tempdir().unwrap();
    let room = room.path();
    let mut copy = Command::new("git");
    let prefix = format!("--prefix={}/", room.join("sources").display());
    copy.args(["checkout-index", "--all", &prefix]).current_dir(root());
    good(copy, room);
    let examples = room.join("sources/examples");
    let sources = below(&examples);
    let venv = room.join("venv");
    let mut make = Command::new("python3");
    make.args(["-m", "venv"]).arg(&venv);
    good(make, room);
    let bin = venv.join("bin");
    let mut install = bare(bin.join("pip"), &bin, room);
    install.args(["install", "--quiet", "--no-deps"]).arg(&examples);
    good(install, room);
    assert_eq!(below(&examples), sources);
    let installed = below(&venv);
    for file in ["station.py", "py.typed", "custom_mode_map.json"] {
        let file = format!("haltere_testing/{file}");
        assert!(installed.iter().any(|path| path.ends_with(&file)), "{file}");
    }
}

/// Half of what is needed is refused, not packed.
#[test]
fn prop_a_program_that_is_not_there_is_named() {
    let out = tempfile::tempdir().unwrap();
    for script in ["build-deb", "build-wheel"] {
        let mut command = build(script, out.path());
        command.env("SIM_PROGRAM", "/nowhere/haltere-sim");
        finish(command, out.path(), LIMIT)
            .refused(&[script, "SIM_PROGRAM=/nowhere/haltere-sim: no such program; give both"]);
        let mut command = build(script, out.path());
        command.env_remove("PROGRAM");
        finish(command, out.path(), LIMIT).refused(&["PROGRAM=: no such program; give both"]);
    }
    assert_eq!(std::fs::read_dir(out.path()).unwrap().count(), 1, "more than the output");
}
