//! A log that has become long is followed by another one on the floor, with the real programs over real wires.

use std::collections::BTreeMap;
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use haltere::ctl::GroundStation;
use haltere_dialect::mav::haltere::{MavCmd, MavMessage};
use haltere_log::record::{Decoded, Entry, LogEnd, LogReader};
use haltere_model::Vehicle;

use super::support::{Running, companion, hall, in_real_time, program, serve, wait};

const LIMIT: Duration = Duration::from_secs(120);
/// Stations hear a heartbeat a second; the pause between two cores must stay below another one.
const LONGEST_PAUSE: Duration = Duration::from_secs(2);

fn configure(dir: &Path, told: &serde_json::Value, port: u16) -> PathBuf {
    let gear_m = Vehicle::default().body.gear_m;
    let file = dir.join("haltere.toml");
    std::fs::write(dir.join("anchors.toml"), hall()).unwrap();
    let config = format!(
        "[tag]\nport = {}\nprotocol = {}\n[board]\naddress = {}\n[ground]\nendpoints = [\"udpout:127.0.0.1:{port}\"]\n\
         [anchors]\nfile = \"anchors.toml\"\n[flight]\ngear_height_m = {gear_m:?}\n[estimator]\nrest_height_m = {gear_m:?}\n\
         [record]\ndirectory = \"{dir}/log\"\nrotate_mb = 1.5\n[store]\ndirectory = \"{dir}/state\"\n",
        // JSON's strings are TOML's too.
        told["tag"],
        told["tag_protocol"],
        told["board"],
        dir = dir.display()
    );
    std::fs::write(&file, config).unwrap();
    file
}

/// Listens, and remembers the longest time without a heartbeat.
struct Listener {
    station: GroundStation,
    beat_at: Instant,
    longest: Duration,
    texts: Vec<String>,
}

impl Listener {
    fn listen(&mut self, time: Duration) {
        let until = Instant::now() + time;
        while Instant::now() < until {
            if let Some(MavMessage::HEARTBEAT(_)) = self.station.next_message(until).unwrap() {
                self.longest = self.longest.max(self.beat_at.elapsed());
                self.beat_at = Instant::now();
            }
        }
        self.texts.extend(self.station.take_texts());
    }

    fn until(&mut self, what: &str, mut is_it: impl FnMut(&mut GroundStation) -> bool) {
        let deadline = Instant::now() + LIMIT;
        while !is_it(&mut self.station) {
            assert!(Instant::now() < deadline, "{what} does not come: {:?}", self.texts);
            self.listen(Duration::from_millis(200));
        }
        // What an order waits for is no pause of the vehicle.
        self.beat_at = Instant::now();
    }
}

fn logs(dir: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(dir.join("log")).into_iter().flatten();
    let mut logs: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    logs.sort();
    logs
}

/// Modes of a log that are flight, by their name.
fn flown(log: &Path) -> (BTreeMap<String, usize>, LogEnd) {
    let reader = LogReader::open(log).unwrap();
    let mut modes = BTreeMap::new();
    let mut entries = reader.entries();
    for entry in entries.by_ref() {
        if let Entry::Decoded(Decoded::Mode(mode)) = entry
            && mode.armed
        {
            *modes.entry(mode.mode).or_default() += 1;
        }
    }
    (modes, entries.end())
}

#[test]
#[ignore = "a minute of real time, by .ci/nightly"]
fn regress_a_long_log_is_followed_by_another_on_the_floor_and_a_flight_is_never_cut() {
    in_real_time("rotation", rotation);
}

fn rotation() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path();
    let (_endpoint, told) = serve(dir, &["--seed", "3"]);
    let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let config = configure(dir, &told, port);
    let said = std::fs::File::create(dir.join("said.txt")).unwrap();
    let mut fly = Command::new(program());
    fly.args(["companion", "fly", "--config"]).arg(&config).current_dir(dir);
    fly.stdin(Stdio::null()).stdout(said.try_clone().unwrap()).stderr(said);
    let mut fly = Running(fly.spawn().unwrap());
    let station = GroundStation::connect(&format!("udpin:127.0.0.1:{port}")).unwrap();
    let beat_at = Instant::now();
    let mut to = Listener { station, beat_at, longest: Duration::ZERO, texts: Vec::new() };

    // What a station sets, and the store keeps, is in force in the next core.
    // Who arms before the next core has taken over flies on into the first log.
    to.until(
        "another log on the floor",
        |_| matches!(&logs(dir)[..], [first, _, ..] if flown(first).1 == LogEnd::Complete),
    );
    to.until("arming", |station| station.arm().is_ok());
    let before = logs(dir);
    let nan = f32::NAN;
    let params = [nan, nan, nan, nan, nan, nan, 1.0];
    to.station.command(MavCmd::MAV_CMD_NAV_TAKEOFF, params).unwrap();
    to.beat_at = Instant::now();
    to.listen(Duration::from_secs(25));
    assert_eq!(logs(dir), before, "a flight is never cut");
    assert!(std::fs::metadata(before.last().unwrap()).unwrap().len() > 3_000_000, "it is long");
    to.station.land().unwrap();
    to.beat_at = Instant::now();
    to.until("another log after the flight", |_| logs(dir).len() > before.len());
    to.listen(Duration::from_secs(3));
    assert!(to.longest < LONGEST_PAUSE, "{:?} without a heartbeat", to.longest);

    let ended = Command::new("kill").args(["-TERM", &fly.0.id().to_string()]).status().unwrap();
    assert!(ended.success());
    assert_eq!(wait(&mut fly.0, LIMIT), Some(0));
    let said = std::fs::read_to_string(dir.join("said.txt")).unwrap();
    let all = logs(dir);
    assert!(all.len() >= 3, "{said}");
    let named = said.lines().filter(|line| line.starts_with("log: ")).count();
    assert_eq!(named, all.len(), "each is named at the end: {said}");
    let mut flights = 0;
    for log in &all {
        let (modes, end) = flown(log);
        assert_eq!(end, LogEnd::Complete, "{}", log.display());
        if !modes.is_empty() {
            flights += 1;
            for mode in ["takeoff", "land"] {
                assert!(modes.keys().any(|name| name.contains(mode)), "{mode}: {modes:?}");
            }
        }
        let replayed = companion(&["replay", &log.display().to_string()], dir, LIMIT);
        assert_eq!(replayed.code, Some(0), "{}", replayed.text);
        assert!(replayed.text.contains("reproduced bit for bit"), "{}", replayed.text);
    }
    assert_eq!(flights, 1, "the flight is in one log");
}
