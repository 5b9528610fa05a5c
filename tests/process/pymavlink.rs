//! Runs `tests/pymavlink`, `tests/stations`, `tests/mavsdk3`, `tests/cflib` and `tests/haltere_gap` with pytest, in virtual environments of
//! their own under `target/`.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

use super::support::{finish, in_real_time, program, root, tell};

const NO_PYTHON: &str = "the pymavlink tests need Python 3.9 or later with venv and pip: on Debian \
                         or Ubuntu `apt install python3 python3-venv python3-pip`";

/// Runs a command; its output is shown when it fails.
fn run(command: &mut Command, otherwise: &str) -> Output {
    let output = command.output().unwrap_or_else(|e| panic!("{command:?}: {e}; {otherwise}"));
    assert!(
        output.status.success(),
        "{command:?}: {}\n{}{}\n{otherwise}",
        output.status,
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    output
}

/// FNV-1a: another list of packages gets another environment.
fn fingerprint(text: &str) -> u32 {
    text.bytes().fold(0x811c_9dc5, |hash, b| (hash ^ u32::from(b)).wrapping_mul(0x0100_0193))
}

/// Python of an environment with the pinned packages; made once, then kept. An error: pip could not install them.
fn installed(requirements: &Path) -> Result<PathBuf, String> {
    let list = std::fs::read_to_string(requirements).expect("the list of packages");
    let version = run(Command::new("python3").arg("--version"), NO_PYTHON).stdout;
    let key = fingerprint(&(list + &String::from_utf8_lossy(&version)));
    let parent = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pymavlink");
    std::fs::create_dir_all(&parent).expect("a folder under target/");
    // Two test runs at once: the second waits for the first to finish the environment.
    let lock = File::create(parent.join("lock")).expect("a lock file");
    lock.lock().expect("a lock");
    let folder = parent.join(format!("venv-{key:08x}"));
    let python = folder.join("bin/python");
    let ready = folder.join("ready");
    if !ready.exists() {
        let _ = std::fs::remove_dir_all(&folder);
        run(Command::new("python3").args(["-m", "venv"]).arg(&folder), NO_PYTHON);
        let output = Command::new(&python)
            // The lists are complete. What MAVProxy asks for besides are its windows.
            .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-deps"])
            .arg("--requirement")
            .arg(requirements)
            .output()
            .map_err(|e| format!("pip: {e}"))?;
        if !output.status.success() {
            return Err(format!(
                "pip could not install the pinned packages; is a package index reachable?\n{}{}",
                String::from_utf8_lossy(&output.stdout),
                String::from_utf8_lossy(&output.stderr)
            ));
        }
        std::fs::write(&ready, "").expect("a mark that the environment is complete");
    }
    Ok(python)
}

/// The dialect as a Python module, from the same XML that the Rust code is made of.
fn dialect(python: &Path, folder: &Path) -> PathBuf {
    let module = folder.join("haltere_dialect.py");
    run(
        Command::new(python)
            .args(["-m", "pymavlink.tools.mavgen", "--lang=Python3", "--wire-protocol=2.0"])
            .arg(format!("--output={}", module.display()))
            .arg(Path::new(haltere_dialect::XML_FOLDER).join("haltere.xml")),
        "pymavlink's generator refuses dialect/xml/haltere.xml",
    );
    module
}

/// Runs pytest on a file or folder below `tests/`, with the packages listed in that folder.
fn pytest(folder: &str, what: &str) {
    in_real_time(&format!("{folder}/{what}"), || {
        if let Err(told) = attempt(folder, what) {
            panic!("{told}");
        }
    });
}

/// The same for files in which a program of somebody else takes part, with threads and time limits of its own
/// that count the computer's time: it may try once more in any case, and what went wrong is told.
fn pytest_of_others(folder: &str, what: &str) {
    let Err(told) = attempt(folder, what) else { return };
    tell(&format!("{folder}/{what}: SECOND ATTEMPT after\n{told}"));
    pytest(folder, what);
}

/// Longest run of a file or folder: several times what the slowest takes.
const LIMIT: Duration = Duration::from_secs(720);

fn attempt(folder: &str, what: &str) -> Result<(), String> {
    let tests = root().join("tests").join(folder);
    let python = installed(&tests.join("requirements.txt"))?;
    let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).expect("a folder");
    let mut command = Command::new(&python);
    command
        .args(["-m", "pytest", "-q", "--color=no", "-p", "no:cacheprovider", "--durations=5"])
        .args(["-rs", "-p", "haltere_testing.plugin"])
        .arg(tests.join(what))
        .current_dir(folder.path())
        .env("HALTERE_TEST_SIM", program())
        // The helper that users have, not installed.
        .env(
            "PYTHONPATH",
            std::env::join_paths(["examples", "python"].map(|of| root().join(of))).expect("paths"),
        )
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env("MAVLINK20", "1");
    if has_pymavlink(&tests) {
        command.env("HALTERE_TEST_DIALECT", dialect(&python, folder.path()));
    }
    let ended = finish(command, folder.path(), LIMIT);
    match ended.code {
        Some(0) => {
            println!("{}", ended.text);
            Ok(())
        }
        Some(code) => Err(format!("pytest: exit code {code}\n{}", ended.text)),
        None => Err(format!("pytest: not at its end after {LIMIT:?}\n{}", ended.text)),
    }
}

/// Whether the tests of a folder speak MAVLink themselves.
fn has_pymavlink(tests: &Path) -> bool {
    let list = std::fs::read_to_string(tests.join("requirements.txt")).unwrap_or_default();
    list.lines().any(|line| line.starts_with("pymavlink=="))
}

#[test]
fn prop_pymavlink_connects() {
    pytest("pymavlink", "test_a_connect.py");
}

#[test]
fn prop_pymavlink_flies_a_mission() {
    pytest("pymavlink", "test_b_mission.py");
}

#[test]
fn prop_pymavlink_flies_it() {
    pytest("pymavlink", "test_c_flight.py");
}

#[test]
fn prop_pymavlink_flies_steps() {
    pytest("pymavlink", "test_d_steps.py");
}

#[test]
fn prop_pymavlink_signs() {
    pytest("pymavlink", "test_k_signing.py");
}

#[test]
fn prop_pymavlink_sets_signing_up() {
    pytest("pymavlink", "test_l_setup_signing.py");
}

#[test]
fn prop_pymavlink_reads_and_writes_files() {
    pytest("pymavlink", "test_s_files.py");
}

#[test]
fn prop_pymavlink_reads_and_sets_parameters() {
    pytest("pymavlink", "test_s_parameters.py");
}

#[test]
fn prop_pymavlink_loads_plans() {
    pytest("pymavlink", "test_s_plans.py");
}

/// Each file is run by itself: what has to be repeated on a machine that stood still is short then.
#[test]
fn prop_no_file_is_forgotten() {
    let here = include_str!("pymavlink.rs");
    for folder in ["pymavlink", "stations", "cflib", "haltere_gap"] {
        for file in std::fs::read_dir(root().join("tests").join(folder)).expect("a folder of tests")
        {
            let name = file.expect("a file").file_name().to_string_lossy().into_owned();
            if name.starts_with("test_") {
                assert!(here.contains(&format!("\"{folder}\", \"{name}\"")), "{folder}/{name}");
            }
        }
    }
}

#[test]
fn prop_the_diagnosis_is_called_from_python() {
    pytest("haltere_gap", "test_diagnose.py");
}

#[test]
fn prop_every_station_has_a_link_of_its_own() {
    pytest("stations", "test_links.py");
}

#[test]
fn prop_answers_and_streams_keep_their_time() {
    pytest("stations", "test_timing.py");
}

#[test]
fn prop_setpoints_and_joystick_fly_it() {
    pytest("stations", "test_flight.py");
}

#[test]
fn prop_qgroundcontrol_s_sequence_flies_it() {
    pytest("stations", "test_qgc.py");
}

#[test]
fn prop_mavsdk_flies_it() {
    pytest_of_others("stations", "test_mavsdk.py");
}

#[test]
fn prop_mavsdk_reads_events_and_flies_by_joystick() {
    pytest_of_others("stations", "test_mavsdk_events.py");
}

#[test]
fn prop_the_older_mavsdk_flies_it() {
    pytest_of_others("mavsdk3", "");
}

#[test]
fn prop_a_bad_wire_is_survived_in_flight() {
    pytest("stations", "test_wire.py");
}

#[test]
fn prop_mavsdk_fetches_and_stores() {
    pytest_of_others("stations", "test_services.py");
}

#[test]
fn prop_logs_come_down_byte_for_byte() {
    pytest_of_others("stations", "test_downloads.py");
}

#[test]
fn prop_two_vehicles_and_one_station_fly_side_by_side() {
    pytest("stations", "test_two_vehicles.py");
}

#[test]
fn prop_a_mission_is_flown_over_a_slow_radio() {
    pytest("stations", "test_radio.py");
}

#[test]
fn prop_mavproxy_flies_it() {
    pytest_of_others("stations", "test_mavproxy.py");
}

#[test]
fn prop_dronekit_flies_it() {
    pytest_of_others("stations", "test_dronekit.py");
}

#[test]
fn prop_four_clients_fly_it_together_twice() {
    pytest("stations", "test_zz_four.py");
}

#[test]
fn prop_the_first_script_runs_unchanged_against_each() {
    pytest_of_others("stations", "test_first_script.py");
}

#[test]
fn prop_the_examples_fly_as_they_stand() {
    pytest_of_others("stations", "test_examples.py");
}

#[test]
fn prop_a_mission_test_of_a_user_is_eight_lines() {
    pytest_of_others("stations", "../../examples");
}

#[test]
fn prop_the_helper_breaks_judges_and_tells() {
    pytest("stations", "test_helper.py");
}

#[test]
fn prop_the_watch_page_shows_the_flight_and_keeps_others_out() {
    pytest_of_others("watch", "");
}

/// Where its packages cannot be had it is told, and nothing is judged; CI has them.
#[test]
fn prop_cflib_reads_the_simulated_crazyflie() {
    let list = root().join("tests/cflib/requirements.txt");
    match installed(&list) {
        Err(why) if std::env::var_os("CI").is_none() => {
            tell(&format!("cflib: NOT JUDGED: {why}"));
        }
        _ => pytest_of_others("cflib", "test_board.py"),
    }
}
