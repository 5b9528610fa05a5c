//! Two simulators and two companions on one computer: none flies the other's vehicle.

use std::fs::File;
use std::net::UdpSocket;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use haltere_dialect::mav::haltere::{HEARTBEAT_DATA, MavMessage, MavType};
use haltere_dialect::mav_stream;

use super::support::{Ended, Running, companion, hall, in_real_time, program, serve};

const LIMIT: Duration = Duration::from_secs(90);

/// The companion of a simulator; `more` is added to its configuration. What it says goes to `said.txt`.
fn fly(dir: &Path, sim: &serde_json::Value, more: &str) -> Running {
    std::fs::write(dir.join("anchors.toml"), hall()).unwrap();
    let config = format!(
        "[tag]\nport = {}\n[board]\naddress = {}\n[anchors]\nfile = \"anchors.toml\"\n\
         [flight]\ngear_height_m = 0.12\n[estimator]\nrest_height_m = 0.12\n[store]\ndirectory = \"\"\n{more}\n",
        sim["tag"], sim["board"]
    );
    std::fs::write(dir.join("haltere.toml"), config).unwrap();
    let said = File::create(dir.join("said.txt")).unwrap();
    let mut command = Command::new(program());
    command.args(["companion", "fly"]).current_dir(dir).stdin(Stdio::null());
    Running(command.stdout(said.try_clone().unwrap()).stderr(said).spawn().unwrap())
}

/// What stands behind these words in a file, up to the end of the line; waits for it.
fn said(file: &Path, words: &str) -> String {
    let began = Instant::now();
    loop {
        let text = std::fs::read_to_string(file).unwrap_or_default();
        let found = text.lines().find_map(|line| Some(line.split_once(words)?.1.to_owned()));
        if let Some(rest) = found {
            return rest;
        }
        assert!(began.elapsed() < LIMIT, "`{words}` was not said: {text}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

fn ctl(dir: &Path, args: &[&str]) -> Ended {
    let folder = dir.join("ctl");
    std::fs::create_dir_all(&folder).unwrap();
    companion(&[&["ctl"], args].concat(), &folder, LIMIT)
}

#[test]
fn prop_two_vehicles_fly_beside_each_other() {
    in_real_time("beside", two_vehicles);
}

fn two_vehicles() {
    let starts = [[3.0, 3.0], [7.0, 6.0]];
    let folders = [(); 2].map(|()| tempfile::tempdir().unwrap());
    // The simulators first: nobody listens where they speak to.
    let simulators = [0, 1].map(|n: usize| {
        let dir = folders[n].path();
        let [north_m, east_m] = starts[n];
        let start = format!("[start]\nposition_m = [{north_m:?}, {east_m:?}]\n");
        std::fs::write(dir.join("s.toml"), start).unwrap();
        serve(dir, &["--scenario", "s.toml", "--truth", "truth.csv"])
    });
    assert_ne!(simulators[0].1["board"], simulators[1].1["board"]);
    let companions = [0, 1].map(|n: usize| {
        let dir = folders[n].path();
        let station = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let ground = format!("[ground]\nendpoints = [\"udpout:{station}\"]");
        let flies = fly(dir, &simulators[n].1, &ground);
        (flies, said(&dir.join("said.txt"), "stations: udpin:"))
    });
    let stations = [0, 1].map(|n: usize| format!("udpin:{}", companions[n].1));

    // Both at once.
    std::thread::scope(|scope| {
        for n in [0, 1] {
            let (dir, to) = (folders[n].path(), &*stations[n]);
            let [north_m, east_m] = starts[n];
            scope.spawn(move || {
                said(&dir.join("said.txt"), "estimator aligned");
                std::thread::sleep(Duration::from_secs(4));
                let status = ctl(dir, &["--to", to, "status", "--json"]);
                let told: serde_json::Value = serde_json::from_str(&status.text).expect("JSON");
                let near = |i: usize, at: f64| {
                    told["position_NED_m"][i].as_f64().is_some_and(|m| (m - at).abs() < 0.6)
                };
                assert!(near(0, north_m) && near(1, east_m), "{told:#}");
                for order in [&["takeoff", "1.0"][..], &["land"]] {
                    let flown = ctl(dir, &[&["--to", to], order].concat());
                    assert_eq!(flown.code, Some(0), "{flown:?}");
                    assert!(!flown.text.contains("another vehicle"), "{flown:?}");
                }
            });
        }
    });
    drop(companions);
    drop(simulators);
    for n in [0, 1] {
        let truth = std::fs::read_to_string(folders[n].path().join("truth.csv")).unwrap();
        let rows: Vec<Vec<f64>> = truth
            .lines()
            .skip(1)
            .map(|row| row.split(',').map(|v| v.parse().unwrap_or(f64::NAN)).collect())
            .collect();
        let highest_m = rows.iter().map(|row| -row[4]).fold(0.0, f64::max);
        let last = rows.last().unwrap();
        assert!((0.8..1.4).contains(&highest_m), "vehicle {n}: {highest_m} m");
        assert!(-last[4] < 0.3, "vehicle {n} has landed: {last:?}");
        // Each over its own place.
        let [north_m, east_m] = starts[n];
        assert!((last[2] - north_m).hypot(last[3] - east_m) < 1.0, "vehicle {n}: {last:?}");
        let said = std::fs::read_to_string(folders[n].path().join("sim.txt")).unwrap();
        assert!(!said.contains("a second companion"), "{said}");
    }
}

#[test]
fn prop_nobody_shares_a_device_or_a_board() {
    in_real_time("in the way", in_the_way);
}

fn in_the_way() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let free = || UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let (board, station) = (free(), free());
    let (_sim, greeting) = serve(dir, &["--board", &format!("udpin:{board}")]);
    // The same port a second time.
    let again = super::support::sim(&["serve", "--board", &format!("udpin:{board}")], dir, LIMIT);
    again.refused(&["--board udpin:", "cannot listen there", "in use", "without --board"]);
    let ground = format!("[ground]\nendpoints = [\"udpout:{station}\"]");
    let _first = fly(dir, &greeting, &ground);
    said(&dir.join("said.txt"), "board found");

    // A second companion that wants the tag of the first.
    let other = tempfile::tempdir().unwrap();
    let mut tag_only = greeting.clone();
    tag_only["board"] = format!("udpin:{}", free()).into();
    let beside = fly(other.path(), &tag_only, "[ground]\nendpoints = []");
    said(&other.path().join("said.txt"), "that no other program has it");
    drop(beside);

    // Somebody on another way to the board: not heard, named, and nothing comes to him.
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    stranger.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
    stranger.send_to(&beat(1, 0), board).unwrap();
    let words = said(&dir.join("sim.txt"), "a second companion speaks to this board: ");
    assert!(words.contains(&stranger.local_addr().unwrap().to_string()), "{words}");
    assert!(stranger.recv(&mut [0; 64]).is_err(), "the board speaks to him");
}

/// A heartbeat of a vehicle.
fn beat(system: u8, sequence: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mavtype = MavType::MAV_TYPE_FLAPPING_WING;
    let message =
        MavMessage::HEARTBEAT(HEARTBEAT_DATA { mavtype: mavtype as u8, ..Default::default() });
    mav_stream::encode(&mut bytes, system, 1, sequence, &message);
    bytes
}

#[test]
fn prop_ctl_does_not_choose_between_two_vehicles() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let vehicles = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
    let at = [0, 1].map(|n: usize| vehicles[n].local_addr().unwrap().to_string());
    let heard = |vehicle: &UdpSocket| {
        vehicle.set_nonblocking(true).unwrap();
        std::iter::from_fn(|| vehicle.recv(&mut [0; 512]).ok()).count()
    };
    // Both speak to one address, with these numbers, while ctl runs.
    let with = |systems: [u8; 2], args: &[&str]| {
        let station = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        let ends = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            let speaks = scope.spawn(|| {
                for sequence in (0..=u8::MAX).cycle() {
                    if ends.load(std::sync::atomic::Ordering::Relaxed) {
                        break;
                    }
                    for (vehicle, system) in vehicles.iter().zip(systems) {
                        let _ = vehicle.send_to(&beat(system, sequence), station);
                    }
                    std::thread::sleep(Duration::from_millis(200));
                }
            });
            let to = format!("udpin:{station}");
            let ended = ctl(dir, &[&["--to", &to], args].concat());
            ends.store(true, std::sync::atomic::Ordering::Relaxed);
            speaks.join().unwrap();
            ended
        })
    };
    let two = with([1, 1], &["arm"]);
    two.refused(&["2 vehicles speak here", &at[0], &at[1], "--system N", "--from IP:PORT"]);
    assert_eq!([0, 1].map(|n: usize| heard(&vehicles[n])), [0, 0], "nothing was sent to either");

    // They do not answer, but one of them is spoken to, and the other is not.
    let chosen = with([1, 1], &["--from", &at[1], "disarm"]);
    chosen.refused(&["speaks to system 1", &at[1], "not answered"]);
    let [first, second] = [0, 1].map(|n: usize| heard(&vehicles[n]));
    assert!(first == 0 && second > 0, "{first} {second}");
    let chosen = with([1, 7], &["--system", "1", "disarm"]);
    chosen.refused(&["speaks to system 1", &at[0], "not answered"]);
    let [first, second] = [0, 1].map(|n: usize| heard(&vehicles[n]));
    assert!(first > 0 && second == 0, "{first} {second}");
    with([1, 7], &["--system", "3", "disarm"])
        .refused(&["with system id 3", "heard instead: system 1"]);
}
