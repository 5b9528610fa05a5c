//! Setting up, looking, handling logs, and ending, with the real program.

use std::io::Write as _;
use std::net::{TcpListener, UdpSocket};
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use haltere_gap::scene::Scene;
use haltere_model::EffectSet;

use super::flights::{box_mission, record};
use super::support::{Ended, companion, program, root, wait};

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
    // A demo of another test may have the usual port of the page.
    let page = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let page = format!("watch.address=tcpin:127.0.0.1:{page}");
    let set = ["check", "--json", "--set", "tag.port=/dev/null", "--set", &page];
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

/// A companion that has neither tag nor board, in a folder of its own.
fn idle(dir: &Path) -> Command {
    let anchors = root().join("config/anchors.toml").display().to_string();
    let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let config = format!(
        "[tag]\nport = \"{0}/no-tag\"\n[board]\naddress = \"udpin:{free}\"\n[ground]\nendpoints = []\n\
         [anchors]\nfile = \"{anchors}\"\n[record]\ndirectory = \"{0}/log\"\n[store]\ndirectory = \"\"\n",
        dir.display()
    );
    std::fs::write(dir.join("haltere.toml"), config).unwrap();
    let mut command = Command::new("sh");
    command.args(["-c", "exec \"$@\"", "sh"]).arg(program());
    command.args(["companion", "fly"]).current_dir(dir).stdin(Stdio::null());
    command
}

fn signal(child: &Child, name: &str) {
    let sent = Command::new("kill").args([name, &child.id().to_string()]).status().unwrap();
    assert!(sent.success());
}

/// It says READY=1 by systemd's socket when it flies.
fn systemd(dir: &Path, command: &mut Command) -> UnixDatagram {
    let path = dir.join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
    command.env("NOTIFY_SOCKET", &path).env("WATCHDOG_USEC", "1000000");
    socket
}

fn hears(socket: &UnixDatagram, words: &str) {
    let mut buffer = [0; 256];
    loop {
        let n = socket.recv(&mut buffer).expect("in time");
        if std::str::from_utf8(&buffer[..n]).is_ok_and(|said| said.contains(words)) {
            return;
        }
    }
}

#[test]
fn regress_every_signal_ends_a_companion_at_rest_with_its_log_closed() {
    for name in ["-HUP", "-INT", "-QUIT", "-TERM", "-USR1", "-ALRM"] {
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path();
        let mut command = idle(dir);
        let socket = systemd(dir, &mut command);
        let file = std::fs::File::create(dir.join("said.txt")).unwrap();
        let mut child = command.stdout(file.try_clone().unwrap()).stderr(file).spawn().unwrap();
        hears(&socket, "READY=1");
        hears(&socket, "WATCHDOG=1\nSTATUS=disarmed");
        signal(&child, name);
        let code = wait(&mut child, LIMIT);
        let said = std::fs::read_to_string(dir.join("said.txt")).unwrap();
        assert_eq!(code, Some(0), "{name}: {said}");
        hears(&socket, "STOPPING=1");
        let log = said.lines().find_map(|line| line.strip_prefix("log: ")).expect("a log");
        let listed = run(dir, &["log", "info", log]);
        assert_eq!(listed.code, Some(0), "{listed:?}");
    }
}

/// What it prints meets a full pipe: the watchdog is fed, and signals are heard.
#[test]
fn regress_output_that_nobody_reads_holds_nothing_up() {
    for closed in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path();
        let mut command = idle(dir);
        let socket = systemd(dir, &mut command);
        let (reader, writer) = std::io::pipe().unwrap();
        let filler = writer.try_clone().unwrap();
        let mut child = command.stdout(writer.try_clone().unwrap()).stderr(writer).spawn().unwrap();
        // The command keeps its own copies of the pipe's end.
        drop(command);
        hears(&socket, "READY=1");
        let reader = if closed {
            drop((reader, filler));
            None
        } else {
            // Until nothing fits in; the thread stays behind until the reader is gone.
            std::thread::spawn(move || while (&filler).write(&[b'\n'; 512]).is_ok() {});
            std::thread::sleep(Duration::from_millis(300));
            Some(reader)
        };
        for _ in 0..4 {
            hears(&socket, "WATCHDOG=1");
        }
        signal(&child, "-TERM");
        let code = wait(&mut child, Duration::from_secs(15));
        assert_eq!(code, Some(0), "closed: {closed}");
        drop(reader);
    }
}

/// SIGXFSZ would end it: the log that grows too long is a full disk, and nothing else happens.
#[test]
fn regress_a_limit_on_file_sizes_ends_no_companion() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let mut command = idle(dir);
    let socket = systemd(dir, &mut command);
    // In blocks of 512 bytes: a little more than a log begins with.
    let limited: Vec<_> = command.get_args().skip(2).map(ToOwned::to_owned).collect();
    let mut command = Command::new("sh");
    command.args(["-c", "ulimit -f 1000; exec \"$@\""]).args(limited).current_dir(dir);
    command.env("NOTIFY_SOCKET", dir.join("notify")).env("WATCHDOG_USEC", "1000000");
    let mut child =
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    hears(&socket, "READY=1");
    // Long enough for a log to grow beyond that.
    for _ in 0..20 {
        hears(&socket, "WATCHDOG=1");
    }
    signal(&child, "-TERM");
    // The log was cut: that is said with the end.
    assert_eq!(wait(&mut child, LIMIT), Some(1));
}

/// The package is not taken away under a vehicle that flies.
#[test]
fn prop_the_package_is_refused_while_the_vehicle_is_armed() {
    let folder = tempfile::tempdir().unwrap();
    let systemctl = folder.path().join("systemctl");
    let script = root().join("packaging/debian/prerm");
    for (status, action, code) in [
        ("armed", "upgrade", 1),
        ("armed", "remove", 1),
        ("armed", "failed-upgrade", 1),
        ("disarmed", "upgrade", 0),
        ("", "upgrade", 0),
    ] {
        std::fs::write(&systemctl, format!("#!/bin/sh\n[ \"$1\" = show ] && echo '{status}'\n"))
            .unwrap();
        std::fs::set_permissions(&systemctl, std::fs::Permissions::from_mode(0o755)).unwrap();
        let path = format!("{}:{}", folder.path().display(), std::env::var("PATH").unwrap());
        let ended =
            Command::new("sh").arg(&script).args([action, "9.9"]).env("PATH", path).output();
        let ended = ended.unwrap();
        assert_eq!(ended.status.code(), Some(code), "{status} {action}: {ended:?}");
    }
}
