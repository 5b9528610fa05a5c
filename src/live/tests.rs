//! The glue on real sockets and a pseudo-terminal: bytes that go in are in the log, in order.

use std::io::{Read, Write};
use std::net::{TcpStream, UdpSocket};
use std::time::{Duration, Instant};

use haltere_dialect::mav::haltere::{HEARTBEAT_DATA, MavMessage};
use haltere_dialect::mav_stream;
use serialport::{SerialPort, TTYPort};

use super::*;
use crate::sources::Loaded;
use haltere_core::drops::DropReason;
use haltere_log::record::{Entry, LogEnd, LogReader, RawInput};
use haltere_pilot::Recording;
use haltere_pilot::settings::Config;

fn free_port() -> u16 {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

fn loaded(folder: &std::path::Path, tag: String, board: String, ground: Vec<String>) -> Loaded {
    let mut config = Config::default();
    config.tag.port = tag.into();
    config.board.address = board.parse().unwrap();
    config.ground.endpoints = ground.iter().map(|g| g.parse::<Address>().unwrap().into()).collect();
    config.record.directory = folder.join("logs");
    config.store.directory = folder.join("state");
    config.timing.realtime = false;
    config.timing.lock_memory = false;
    let anchors = concat!(env!("CARGO_MANIFEST_DIR"), "/config/anchors.toml");
    let survey = crate::sources::read_anchors(anchors.as_ref()).unwrap();
    Loaded { config, survey, files: Vec::new(), notes: Vec::new(), lost: None }
}

/// A heartbeat of a station.
fn beat(sequence: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    mav_stream::encode(&mut bytes, 255, 190, sequence, &message);
    bytes
}

/// Tries until it works: threads start when they start.
fn eventually<T>(mut attempt: impl FnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(value) = attempt() {
            return value;
        }
        assert!(began.elapsed() < Duration::from_secs(20), "does not happen");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn prop_bytes_of_every_kind_of_link_reach_the_log() {
    let folder = tempfile::tempdir().unwrap();
    let (mut tag, slave) = TTYPort::pair().unwrap();
    let device = slave.name().unwrap();
    let (board_port, tcp_port) = (free_port(), free_port());
    let server = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let server_port = server.local_addr().unwrap().port();
    let station = UdpSocket::bind("127.0.0.1:0").unwrap();
    let loaded = loaded(
        folder.path(),
        device,
        format!("udpin:127.0.0.1:{board_port}"),
        vec![
            format!("tcpin:127.0.0.1:{tcp_port}"),
            format!("tcpout:127.0.0.1:{server_port}"),
            format!("udpout:{}", station.local_addr().unwrap()),
        ],
    );
    // The test holds the slave open; the companion opens it by name, exclusively.
    drop(slave);
    let stop = Stop::default();
    let running = std::thread::spawn({
        let stop = stop.clone();
        move || run(&loaded, &stop)
    });

    let log = eventually(|| std::fs::read_dir(folder.path().join("logs")).ok()?.next());
    let log = log.unwrap().path();
    let mut client = eventually(|| TcpStream::connect(("127.0.0.1", tcp_port)).ok());
    let (mut accepted, _) = server.accept().unwrap();
    // Written once the companion reads: a pseudo-terminal forgets what came before it was opened.
    std::thread::sleep(Duration::from_millis(300));
    tag.write_all(b"tag bytes").unwrap();
    let board = UdpSocket::bind("127.0.0.1:0").unwrap();
    board.send_to(b"board bytes", ("127.0.0.1", board_port)).unwrap();
    // Of stations only frames come in, in whatever pieces they are sent.
    let (first, second, third) = (beat(1), beat(2), beat(3));
    client.write_all(&first[..5]).unwrap();
    std::thread::sleep(Duration::from_millis(50));
    client.write_all(&first[5..]).unwrap();
    client.write_all(b"noise").unwrap();
    accepted.write_all(&second).unwrap();
    std::thread::sleep(Duration::from_millis(300));
    // The server goes and comes back.
    drop(accepted);
    let (mut again, _) = server.accept().unwrap();
    again.write_all(&third).unwrap();
    std::thread::sleep(Duration::from_millis(200));
    stop.stop();
    let summary = running.join().unwrap().unwrap();
    assert_eq!(summary.log.as_deref(), Some(log.as_path()));
    assert_eq!(summary.recording_error, None);
    assert!(summary.wake_ups > 20);

    let log = LogReader::open(log).unwrap();
    let mut bytes: std::collections::BTreeMap<LinkId, Vec<u8>> = Default::default();
    let (mut ups, mut downs, mut last, mut garbage, mut peers) = (0, 0, 0, 0, 0);
    let mut entries = log.entries();
    for entry in entries.by_ref() {
        if let Entry::Input { sequence, input, .. } = entry {
            assert!(sequence > last);
            last = sequence;
            match input {
                RawInput::Bytes { link, bytes: new } => bytes.entry(link).or_default().extend(new),
                RawInput::Peer { link, address } => {
                    assert_eq!((link, address), (LinkId::Board, board.local_addr().unwrap()));
                    peers += 1;
                }
                RawInput::LinkUp { .. } => ups += 1,
                RawInput::LinkDown { .. } => downs += 1,
                RawInput::Lost { link, reason, count } => {
                    assert_eq!((link, reason), (LinkId::Ground(0), DropReason::MavGarbageByte));
                    garbage += count;
                }
                RawInput::File { .. } | RawInput::Calendar { .. } | RawInput::Wake => {}
                RawInput::Backlog { .. } => {}
                RawInput::Recording { state, .. } => assert_eq!(state, Recording::Runs),
                RawInput::EndAsked => panic!("nobody asked"),
            }
        }
    }
    assert_eq!(entries.end(), LogEnd::Complete);
    assert_eq!(bytes[&LinkId::Tag], b"tag bytes");
    assert_eq!(bytes[&LinkId::Board], b"board bytes");
    assert_eq!(bytes[&LinkId::Ground(0)], first);
    assert_eq!(garbage, 5);
    assert_eq!(peers, 1, "who speaks to the board's port is in the log");
    // The server of the first endpoint has eight places.
    assert_eq!(bytes[&LinkId::Ground(8)], [second, third].concat());
    assert_eq!((ups, downs), (6, 1), "tag, board, three stations, and the server twice");
    let _ = tag.read(&mut [0; 16]);
}

#[test]
fn prop_a_port_that_is_taken_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let taken = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = format!("udpin:{}", taken.local_addr().unwrap());
    let loaded = loaded(folder.path(), "/dev/none".into(), address.clone(), vec![]);
    let error = run(&loaded, &Stop::default()).unwrap_err().to_string();
    assert!(error.starts_with(&format!("board.address = \"{address}\": cannot listen")), "{error}");
    assert!(!folder.path().join("logs").exists(), "no empty log is left behind");
}

#[test]
fn prop_a_missing_tag_does_not_end_the_companion() {
    let folder = tempfile::tempdir().unwrap();
    let board = format!("udpin:127.0.0.1:{}", free_port());
    let loaded = loaded(folder.path(), "/dev/there-is-no-tag".into(), board, vec![]);
    let stop = Stop::default();
    let running = std::thread::spawn({
        let stop = stop.clone();
        move || run(&loaded, &stop)
    });
    std::thread::sleep(Duration::from_millis(400));
    assert!(!running.is_finished());
    stop.stop();
    assert!(running.join().unwrap().unwrap().wake_ups > 10);
}

/// Where signatures are demanded, a place is held only by who shows one.
#[test]
fn prop_the_mute_are_cut_and_the_unsigned_get_no_place() {
    use haltere_dialect::signing::{self, SigningKey};
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let (tcp, udp) = (free_port(), free_port());
    let ground = vec![format!("tcpin:127.0.0.1:{tcp}"), format!("udpin:127.0.0.1:{udp}")];
    let board = format!("udpin:127.0.0.1:{}", free_port());
    let mut loaded = loaded(folder.path(), "/dev/there-is-no-tag".into(), board, ground);
    let key = SigningKey::new([3; 32]).unwrap();
    let file = folder.path().join("signing.key");
    std::fs::write(&file, key.to_file()).unwrap();
    loaded.config.signing.key_file = file.clone();
    loaded.config.ground.signing = haltere_pilot::guard::Signing::Require;
    // Others can read the key: it is not used.
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o644)).unwrap();
    let refused = run(&loaded, &Stop::default()).unwrap_err().to_string();
    assert!(refused.contains("its mode is 644"), "{refused}");
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o600)).unwrap();
    let stop = Stop::default();
    let running = std::thread::spawn({
        let stop = stop.clone();
        move || run(&loaded, &stop)
    });
    let signed = || {
        let at = signing::timestamp(super::clock::unix_us());
        signing::sign(&beat(1), &key, 5, at).unwrap()
    };
    let mut mute = eventually(|| TcpStream::connect(("127.0.0.1", tcp)).ok());
    let mut loud = TcpStream::connect(("127.0.0.1", tcp)).unwrap();
    loud.write_all(&signed()).unwrap();
    // From nine places, one more than there are: none is taken.
    for _ in 0..9 {
        let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
        stranger.send_to(&beat(2), ("127.0.0.1", udp)).unwrap();
    }
    let station = UdpSocket::bind("127.0.0.1:0").unwrap();
    std::thread::sleep(Duration::from_millis(100));
    station.send_to(&signed(), ("127.0.0.1", udp)).unwrap();
    station.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    let mut buffer = [0; 4096];
    assert!(station.recv(&mut buffer).is_ok_and(|n| n > 0), "it is answered with telemetry");
    // Telemetry first, then the end.
    mute.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    let ended = eventually(|| match mute.read(&mut buffer) {
        Ok(0) => Some(true),
        Ok(_) => None,
        Err(error) => panic!("{error}"),
    });
    assert!(ended);
    loud.write_all(&signed()).unwrap();
    loud.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    for _ in 0..20 {
        assert!(loud.read(&mut buffer).is_ok_and(|n| n > 0), "who signs stays");
    }
    stop.stop();
    let summary = running.join().unwrap().unwrap();
    let lost = |link, reason| {
        summary.drops.iter().find(|(l, r, _)| (*l, *r) == (link, reason)).map(|(.., n)| *n)
    };
    // The places of the second endpoint begin behind the eight of the first.
    assert_eq!(lost(10, "mav_unsigned"), Some(9));
    assert_eq!(lost(2, "mav_unsigned"), Some(1), "{:?}", summary.drops);
    assert_eq!(summary.drops.iter().find(|(_, r, _)| *r == "stations_full"), None);
    assert!(std::fs::metadata(crate::sources::time_file(&file)).is_ok(), "the time is kept");
}

/// A companion with this endpoint, for as long as `talk` lasts.
fn with_companion(endpoint: String, talk: impl FnOnce()) {
    let folder = tempfile::tempdir().unwrap();
    let tag = folder.path().join("no tag").to_string_lossy().into_owned();
    let board = format!("udpin:127.0.0.1:{}", free_port());
    let loaded = loaded(folder.path(), tag, board, vec![endpoint]);
    let stop = Stop::default();
    let running = std::thread::spawn({
        let stop = stop.clone();
        move || run(&loaded, &stop)
    });
    talk();
    stop.stop();
    running.join().unwrap().unwrap();
}

/// How many heartbeats of the companion are in these bytes.
fn beats_in(splitter: &mut mav_stream::MavSplitter, bytes: &[u8]) -> usize {
    splitter.push(bytes);
    let mut beats = 0;
    while let Some(next) = splitter.next() {
        beats += usize::from(next.is_ok_and(|f| f.header.msg_id == 0 && f.header.system_id == 1));
    }
    beats
}

#[test]
fn regress_idle_clients_shut_no_station_out() {
    let port = free_port();
    with_companion(format!("tcpin:127.0.0.1:{port}"), || {
        let connect = || eventually(|| TcpStream::connect(("127.0.0.1", port)).ok());
        // A browser among them.
        let mut idle = [(); MOST_IDLE].map(|()| connect());
        idle[3].write_all(b"GET / HTTP/1.1\r\n\r\n").unwrap();
        std::thread::sleep(Duration::from_millis(800));
        for _ in 0..2 {
            let mut station = connect();
            station.write_all(&beat(1)).unwrap();
            station.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
            let (mut splitter, mut buffer) = (mav_stream::MavSplitter::new(), [0; 4096]);
            eventually(|| {
                let length = station.read(&mut buffer).expect("bytes for the station");
                assert_ne!(length, 0, "the station was cut");
                (beats_in(&mut splitter, &buffer[..length]) > 0).then_some(())
            });
        }
    });
}

/// Places of an endpoint.
const MOST_IDLE: usize = 8;

#[test]
fn regress_a_station_and_fourteen_orders_of_its_identity_miss_no_heartbeat() {
    let port = free_port();
    with_companion(format!("udpin:127.0.0.1:{port}"), || {
        let bind = || {
            let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
            socket.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
            socket.connect(("127.0.0.1", port)).unwrap();
            socket
        };
        let hear = |socket: &UdpSocket, splitter: &mut mav_stream::MavSplitter| {
            let mut buffer = [0; 65_536];
            socket.recv(&mut buffer).map_or(0, |n| beats_in(splitter, &buffer[..n]))
        };
        let station = bind();
        let ended = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|scope| {
            let watch = scope.spawn(|| {
                let mut splitter = mav_stream::MavSplitter::new();
                let mut said = Instant::now() - Duration::from_secs(2);
                let (mut heard, mut longest_s) = (None::<Instant>, 0.0_f64);
                while !ended.load(std::sync::atomic::Ordering::Relaxed) {
                    if said.elapsed() >= Duration::from_secs(1) {
                        said = Instant::now();
                        let _ = station.send(&beat(0));
                    }
                    if hear(&station, &mut splitter) > 0 {
                        let gap_s = heard
                            .replace(Instant::now())
                            .map_or(0.0, |t| t.elapsed().as_secs_f64());
                        longest_s = longest_s.max(gap_s);
                    }
                }
                longest_s
            });
            for n in 0..14 {
                let order = bind();
                let (began, mut said, mut beats) = (Instant::now(), 0, 0);
                let mut splitter = mav_stream::MavSplitter::new();
                // As `haltere ctl` does it: a heartbeat each 0.2 s, the vehicle's own awaited, 1.5 s in all.
                while beats == 0 || began.elapsed() < Duration::from_millis(1500) {
                    if began.elapsed() >= Duration::from_millis(200) * said {
                        said += 1;
                        let _ = order.send(&beat(n));
                    }
                    beats += hear(&order, &mut splitter);
                    let waited = began.elapsed();
                    assert!(
                        waited < Duration::from_secs(4),
                        "order {n} is not answered in {waited:?}"
                    );
                }
            }
            ended.store(true, std::sync::atomic::Ordering::Relaxed);
            let longest_s = watch.join().unwrap();
            // One missed heartbeat would be two seconds.
            assert!(longest_s > 0.5 && longest_s < 1.9, "{longest_s} s between two heartbeats");
        });
    });
}
