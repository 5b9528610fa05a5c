//! The glue on real sockets and a pseudo-terminal: bytes that go in are in the log, in order.

use std::io::{Read, Write};
use std::net::{TcpStream, UdpSocket};
use std::time::{Duration, Instant};

use serialport::{SerialPort, TTYPort};

use super::*;
use crate::config::{Config, Loaded};
use crate::record::{Entry, LogEnd, LogReader, RawInput};

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
    let survey = crate::config::read_anchors(anchors.as_ref()).unwrap();
    Loaded { config, survey, files: Vec::new(), notes: Vec::new() }
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
    client.write_all(b"client bytes").unwrap();
    accepted.write_all(b"server bytes").unwrap();
    std::thread::sleep(Duration::from_millis(300));
    // The server goes and comes back.
    drop(accepted);
    let (mut again, _) = server.accept().unwrap();
    again.write_all(b"once more").unwrap();
    std::thread::sleep(Duration::from_millis(200));
    stop.stop();
    let summary = running.join().unwrap().unwrap();
    assert_eq!(summary.log.as_deref(), Some(log.as_path()));
    assert_eq!(summary.recording_error, None);
    assert!(summary.wake_ups > 20);

    let log = LogReader::open(log).unwrap();
    let mut bytes: std::collections::BTreeMap<LinkId, Vec<u8>> = Default::default();
    let (mut ups, mut downs, mut last) = (0, 0, 0);
    let mut entries = log.entries();
    for entry in entries.by_ref() {
        if let Entry::Input { sequence, input, .. } = entry {
            assert!(sequence > last);
            last = sequence;
            match input {
                RawInput::Bytes { link, bytes: new } => bytes.entry(link).or_default().extend(new),
                RawInput::LinkUp { .. } => ups += 1,
                RawInput::LinkDown { .. } => downs += 1,
                RawInput::Lost { .. } | RawInput::File { .. } | RawInput::Wake => {}
            }
        }
    }
    assert_eq!(entries.end(), LogEnd::Complete);
    assert_eq!(bytes[&LinkId::Tag], b"tag bytes");
    assert_eq!(bytes[&LinkId::Board], b"board bytes");
    assert_eq!(bytes[&LinkId::Ground(0)], b"client bytes");
    // The server of the first endpoint has eight places.
    assert_eq!(bytes[&LinkId::Ground(8)], b"server bytesonce more");
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
