//! Bad input to the real programs: a clear sentence, an exit code, never a panic.

use std::fs;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use super::support::{companion, program, sim, wait};

const LIMIT: Duration = Duration::from_secs(120);

/// Survey file with these heights at the corners of a square.
fn anchors(folder: &Path, heights_m: [f64; 8]) {
    let mut text = String::from("frame = \"enu\"\n");
    for (id, height_m) in heights_m.into_iter().enumerate() {
        // No two in one place, even when all heights are equal.
        let x = if id & 1 != 0 { 10.0 } else { 0.0 } + if id & 4 != 0 { 0.5 } else { 0.0 };
        let y = if id & 2 != 0 { 10.0 } else { 0.0 };
        text += &format!("[[anchor]]\nid = {id}\nposition_m = [{x:?}, {y:?}, {height_m:?}]\n");
    }
    fs::write(folder.join("anchors.toml"), text).unwrap();
}

fn config(folder: &Path, text: &str) {
    let common = "[record]\nenabled = false\n[store]\ndirectory = \"\"\n[timing]\nrealtime = false\nlock_memory = false\n";
    fs::write(folder.join("haltere.toml"), format!("{text}\n{common}")).unwrap();
}

const HALL: [f64; 8] = [0.0, 0.0, 0.0, 0.0, 7.0, 7.0, 7.0, 7.0];

#[test]
fn prop_wrong_configuration_names_key_and_file() {
    let check = |text: &str, says: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        anchors(folder.path(), HALL);
        config(folder.path(), text);
        companion(&["fly", "--config", "haltere.toml"], folder.path(), LIMIT).refused(says);
    };
    check("[tagg]\nport = \"x\"", &["haltere.toml", "tagg"]);
    check("[board]\naddress = \"udp:1.2.3.4:5\"", &["board.address", "udpin:HOST:PORT"]);
    check("[limits]\nbattery_low_v = 400.0", &["limits.battery_low_v", "400"]);
    check("[tag\nport = 1", &["haltere.toml"]);
}

#[test]
fn prop_missing_files_are_named() {
    let folder = tempfile::tempdir().unwrap();
    companion(&["fly", "--config", "nowhere.toml"], folder.path(), LIMIT)
        .refused(&["nowhere.toml"]);
    config(folder.path(), "");
    companion(&["fly", "--config", "haltere.toml"], folder.path(), LIMIT)
        .refused(&["anchors.toml"]);
}

#[test]
fn prop_coplanar_anchors_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    anchors(folder.path(), [2.0; 8]);
    config(folder.path(), "");
    companion(&["fly", "--config", "haltere.toml"], folder.path(), LIMIT)
        .refused(&["anchors.toml", "coplanar"]);
}

#[test]
fn prop_simulator_refuses_bad_scenarios() {
    let folder = tempfile::tempdir().unwrap();
    let check = |text: &str, says: &[&str]| {
        fs::write(folder.path().join("s.toml"), text).unwrap();
        sim(&["serve", "--scenario", "s.toml", "--duration", "1"], folder.path(), LIMIT)
            .refused(says);
    };
    check("sead = 1", &["s.toml", "sead"]);
    check("[start]\nposition_m = [50.0, 0.0]", &["s.toml", "start.position_m[0] = 50"]);
    sim(&["serve", "--board", "serial:/dev/null:9600"], folder.path(), LIMIT).refused(&["udpin"]);
    sim(&["serve", "--scenario", "gone.toml"], folder.path(), LIMIT).refused(&["gone.toml"]);
}

/// The companion outlives a tag that is missing, and one that talks nonsense, and says so.
#[test]
fn prop_missing_and_noisy_tags_are_survived() {
    let folder = tempfile::tempdir().unwrap();
    anchors(folder.path(), HALL);
    let tag = folder.path().join("tag");
    config(
        folder.path(),
        &format!(
            "[tag]\nport = \"{}\"\n[board]\naddress = \"udpin:127.0.0.1:0\"\n[ground]\nendpoints = []",
            tag.display()
        )
        .replace(":0\"", &format!(":{}\"", free_port())),
    );
    let output = folder.path().join("output.txt");
    let file = fs::File::create(&output).unwrap();
    let mut child = Command::new(program())
        .args(["companion", "fly", "--config", "haltere.toml"])
        .current_dir(folder.path())
        .stdin(Stdio::null())
        .stdout(file.try_clone().unwrap())
        .stderr(file)
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(2));
    assert!(child.try_wait().unwrap().is_none(), "gave up without a tag");
    // Now a tag appears that speaks garbage: the other end of a line made by `serve` is ours to
    // spoil, so any pseudo-terminal does.
    let mut noise = Command::new("python3")
        .args(["-c", NOISE])
        .arg(&tag)
        .stdout(Stdio::piped())
        .spawn()
        .expect("python3");
    let mut line = String::new();
    BufReader::new(noise.stdout.take().unwrap()).read_line(&mut line).unwrap();
    std::thread::sleep(Duration::from_secs(4));
    assert!(child.try_wait().unwrap().is_none(), "garbage ended it");
    terminate(child.id());
    let code = wait(&mut child, LIMIT);
    let _ = noise.kill();
    let _ = noise.wait();
    let text = fs::read_to_string(&output).unwrap();
    assert_eq!(code, Some(0), "{text}");
    assert!(!text.contains("panicked"), "{text}");
    assert!(text.contains("tag"), "nothing was said about the tag: {text}");
}

/// A pseudo-terminal at the path given, full of noise.
const NOISE: &str = "
import os, pty, random, sys, time
master, slave = pty.openpty()
os.symlink(os.ttyname(slave), sys.argv[1])
os.set_blocking(master, False)
random.seed(1)
print('ready', flush=True)
while True:
    try:
        os.write(master, bytes(random.choice((0xBC, 0x00, 0xFF, random.randrange(256))) for _ in range(400)))
    except BlockingIOError:
        pass
    time.sleep(0.01)
";

fn free_port() -> u16 {
    std::net::UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

fn terminate(pid: u32) {
    let status = Command::new("kill").args(["-TERM", &pid.to_string()]).status().unwrap();
    assert!(status.success());
    let _ = std::io::stdout().flush();
}

#[test]
fn prop_a_program_that_comes_to_no_end_is_ended() {
    let mut child = std::process::Command::new("sleep").arg("600").spawn().expect("sleep starts");
    assert_eq!(wait(&mut child, Duration::from_millis(100)), None);
    assert!(child.try_wait().expect("a child of ours").is_some(), "it runs on");
}
