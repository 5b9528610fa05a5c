//! What is found in good and in bad surroundings.

use std::path::Path;

use super::*;
use crate::sources::{Loaded, Sources};
use haltere_pilot::settings::{Address, Config, TagPort};

const SAMPLE_ANCHORS: &str = include_str!("../../config/anchors.toml");

pub(super) fn loaded(text: &str) -> Loaded {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.toml"), text).unwrap();
    std::fs::write(folder.path().join("anchors.toml"), SAMPLE_ANCHORS).unwrap();
    let files = vec![folder.path().join("a.toml")];
    Loaded::load(&Sources { files, ..Sources::default() }).unwrap()
}

fn one<'f>(findings: &'f [Finding], what: &str) -> &'f Finding {
    findings.iter().find(|f| f.what == what).unwrap_or_else(|| panic!("{what}: {findings:#?}"))
}

#[test]
fn prop_whatever_is_not_right_has_a_way_out() {
    let mut config = Config::default();
    config.tag.port = TagPort::Device("/dev/null".into());
    config.board.address = "serial:/nowhere/tty:115200".parse().unwrap();
    config.record.directory = "/proc/logs".into();
    let mut findings = ports::examine(&config);
    findings.extend(disk::examine(&config));
    assert!(one(&findings, "tag.port").found.contains("/dev/null: is no serial device"));
    let board = one(&findings, "board.address");
    assert!(board.found.starts_with("/nowhere/tty: there is no such device"), "{board:?}");
    let record = one(&findings, "record.directory");
    assert!(record.found.contains("cannot be written"), "{record:?}");
    assert_eq!(worst(&findings), Status::Problem);
    for finding in findings.iter().filter(|f| f.status > Status::Ok) {
        assert!(!finding.way_out.is_empty(), "{finding:?}");
    }
}

#[test]
fn prop_a_port_in_use_is_told_and_a_free_one_is_not() {
    let socket = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let port = socket.local_addr().unwrap().port();
    let mut config = Config::default();
    config.board.address = format!("udpin:127.0.0.1:{port}").parse::<Address>().unwrap();
    let findings = ports::examine(&config);
    let board = one(&findings, "board.address");
    assert_eq!(board.status, Status::Problem);
    assert!(board.way_out.contains("ss -lnp"), "{board:?}");
    drop(socket);
    assert_eq!(one(&ports::examine(&config), "board.address").status, Status::Ok);
}

#[test]
fn prop_a_watch_page_for_others_without_a_token_is_a_problem() {
    let watch = |host: &str| {
        let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        drop(listener);
        let text = format!("[watch]\naddress = \"tcpin:{host}:{port}\"\n");
        ports::examine(&Config::from_toml("test", &text).unwrap())
    };
    assert_eq!(one(&watch("127.0.0.1"), "watch.address").status, Status::Ok);
    assert!(watch("127.0.0.1").iter().all(|f| f.what != "watch.token_file"));
    let open = watch("0.0.0.0");
    assert_eq!(one(&open, "watch.token_file").status, Status::Problem);
}

#[test]
fn prop_a_volume_outside_of_the_anchors_is_warned_of() {
    let inside = survey::examine(&loaded("[limits]\nheight_m = 2.0\n"));
    assert!(inside.iter().all(|f| !f.what.starts_with("limits")), "{inside:#?}");
    let outside = survey::examine(&loaded("[limits]\nnorth_m = [-8.0, 14.0]\n"));
    let finding = one(&outside, "limits.north_m");
    assert_eq!(finding.status, Status::Warning);
    assert!(finding.found.contains("-8.0 to 14.0 m, the anchors span 0.0 to 6.0 m"), "{finding:?}");
    assert_eq!(one(&outside, "dilution of precision").status, Status::Warning);
}

#[test]
fn prop_what_cannot_be_looked_at_is_neither_right_nor_wrong() {
    let none = [Finding::not_checked("a", "b", "")];
    assert_eq!(worst(&none), Status::Ok);
    let some = [Finding::warning("a", "b", "c"), Finding::not_checked("a", "b", "")];
    assert_eq!(worst(&some), Status::Warning);
}

#[test]
fn prop_a_board_is_heard_over_udp_and_silence_is_no_board() {
    let mut beat = Vec::new();
    let payload = [0, 0, 0, 0, 2, 12, 81, 3, 3];
    haltere_dialect::mav_stream::encode_payload(&mut beat, 7, 1, 0, 0, &payload);
    let board = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
    let to: Address =
        format!("udpout:127.0.0.1:{}", board.local_addr().unwrap().port()).parse().unwrap();
    assert_eq!(probe::at(&to).unwrap(), None);
    let answering = std::thread::spawn(move || {
        let mut buffer = [0; 512];
        // What the first, unanswered look left behind, then the second.
        for _ in 0..8 {
            let (_, from) = board.recv_from(&mut buffer).unwrap();
            let _ = board.send_to(&beat, from);
        }
    });
    let heard = probe::at(&to).unwrap().unwrap();
    assert_eq!((heard.system_id, heard.to_string()), (7, "PX4, system 7".to_owned()));
    drop(answering);
}

#[test]
fn prop_a_first_configuration_is_accepted_and_replaces_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let answers = first::Answers {
        tag: TagPort::Auto,
        board: "udpin:0.0.0.0:14551".parse().unwrap(),
        ground: vec!["udpout:127.0.0.1:14550".parse::<Address>().unwrap().into()],
        anchors: SAMPLE_ANCHORS.to_owned(),
        ..first::Answers::default()
    };
    let files = first::write(&answers, folder.path(), false).unwrap();
    let text = std::fs::read_to_string(&files[0]).unwrap();
    assert!(text.contains("# Device of the UWB tag"), "{text}");
    let loaded = Loaded::load(&Sources { files: vec![files[0].clone()], ..Sources::default() });
    let config = loaded.unwrap().config;
    assert_eq!(config.board.address.to_string(), "udpin:0.0.0.0:14551");
    let refused = first::write(&answers, folder.path(), false).unwrap_err();
    assert!(refused.contains("exists already") && refused.contains("--force"), "{refused}");
    assert_eq!(std::fs::read_to_string(&files[0]).unwrap(), text);
    first::write(&answers, folder.path(), true).unwrap();

    let bad = first::Answers { anchors: "frame = \"enu\"\n".to_owned(), ..answers };
    let elsewhere = folder.path().join("new");
    let refused = first::write(&bad, &elsewhere, false).unwrap_err();
    assert!(refused.contains("0 anchors, at least 5"), "{refused}");
    assert!(!Path::exists(&elsewhere), "nothing is written before all is right");
}

#[test]
fn prop_anchors_come_as_lines_too() {
    let text = "# id east north up\n0 0 0 0.2\n1, 6, 0, 2.8\n2;6;6;0.2\n3\t0\t6\t2.8\n4 0 0 2.8\n";
    let file = first::anchor_file(text, "enu").unwrap();
    assert!(file.contains("id = 1\nposition_m = [6.0, 0.0, 2.8]"), "{file}");
    assert_eq!(first::anchor_file(SAMPLE_ANCHORS, "enu").unwrap(), SAMPLE_ANCHORS);
    let wrong = first::anchor_file("0 0 0\n", "enu").unwrap_err();
    assert!(wrong.contains("line 1"), "{wrong}");
}
