//! Live: what tag and board really send. The companion itself runs for some seconds, without stations,
//! into a log that is thrown away; what arrived is counted there.
//!
//! The board is asked for its streams and for its time, as before a flight. It is never armed.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::time::Duration;

use haltere_dialect::lps::sniffer::SnifferDecoder;
use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream::MavSplitter;

use super::{Finding, crazyflie};
use crate::live::{self, Stop};
use crate::sources::Loaded;
use haltere_core::time::HostTime;
use haltere_log::record::{Decoded, Entry, LogReader, RawInput};
use haltere_pilot::settings::StoreConfig;
use haltere_pilot::{BoardProfile, Lines, LinkId, Look, Quantity, TagProtocol};

/// Time in which links open and streams begin, s; it is not counted.
const SETTLE_S: f64 = 2.0;
/// The same where a board is asked hundreds of names first, one after the other, s.
const SETTLE_CRAZYFLIE_S: f64 = 10.0;
/// Packets of one anchor, 1/s, below which positions suffer: half of TDoA 2 with eight anchors sends 60.
const LEAST_ANCHOR_HZ: f64 = 10.0;
/// Rates that the board must reach, Hz (INTERFACES section 2): inertial, attitude, battery.
const LEAST_IMU_HZ: f64 = 100.0;
const LEAST_ATTITUDE_HZ: f64 = 50.0;
const LEAST_BATTERY_HZ: f64 = 2.0;
/// Of a Crazyflie's rows at 100 Hz, of which a radio may lose some.
const CRAZYFLIE_IMU_HZ: f64 = 80.0;
/// Severity up to which a text warns (MAVLink).
const WARNING: u32 = 4;
/// The board's clock is good enough when known to this, s: a fifth of a control period.
const CLOCK_S: f64 = 0.002;

/// What was heard in the time that counts.
#[derive(Debug, Default)]
struct Heard {
    span_s: f64,
    tag_bytes: u64,
    board_bytes: u64,
    anchors: BTreeMap<u8, u64>,
    /// Time differences with this anchor in them.
    differences: BTreeMap<u8, u64>,
    imu: u64,
    attitude: u64,
    battery: u64,
    heartbeats: u64,
    std_board_clock_s: Option<f64>,
    late: Option<(u64, u64)>,
    /// Round trips of a Crazyflie's echoes, s.
    trips_s: Vec<f64>,
    /// What was warned of a Crazyflie.
    warnings: BTreeSet<String>,
    /// Whoever speaks, with which reader ever.
    lines: Lines,
    /// The table of what is known at rest, at the end.
    at_rest: Vec<(&'static Quantity, Look)>,
}

/// Listens for `seconds`.
pub fn examine(loaded: &Loaded, seconds: f64) -> Vec<Finding> {
    let directory = std::env::temp_dir().join(format!("haltere-check-{}", std::process::id()));
    let found = listen(loaded, seconds, directory.clone());
    // What is left of it is in the way of nobody.
    let _ = std::fs::remove_dir_all(&directory);
    match found {
        Ok(heard) => judge(loaded, &heard),
        Err(why) => vec![Finding::problem("live", why, "put the ports right first, as told above")],
    }
}

fn listen(loaded: &Loaded, seconds: f64, directory: PathBuf) -> Result<Heard, String> {
    let mut quiet = loaded.clone();
    quiet.config.ground.endpoints.clear();
    quiet.config.store = StoreConfig { directory: PathBuf::new() };
    quiet.config.record.enabled = true;
    quiet.config.record.directory = directory;
    let stop = Stop::default();
    let timer = {
        let stop = stop.clone();
        let wait = Duration::from_secs_f64(settle_s(quiet.config.tag.protocol) + seconds);
        std::thread::spawn(move || {
            std::thread::sleep(wait);
            stop.stop();
        })
    };
    let summary = live::run(&quiet, &stop).map_err(|error| error.to_string())?;
    let _ = timer.join();
    let path = summary.log.ok_or("no log was written")?;
    let log = LogReader::open(path).map_err(|error| error.to_string())?;
    let mut heard = count(&log, quiet.config.tag.protocol);
    if quiet.config.tag.protocol == TagProtocol::Crazyflie {
        heard.anchors = std::mem::take(&mut heard.differences);
    }
    heard.late = Some((summary.late_wake_ups, summary.wake_ups));
    heard.at_rest = summary.at_rest;
    Ok(heard)
}

fn settle_s(protocol: TagProtocol) -> f64 {
    if protocol == TagProtocol::Crazyflie { SETTLE_CRAZYFLIE_S } else { SETTLE_S }
}

fn count(log: &LogReader, protocol: TagProtocol) -> Heard {
    let begin = log.session().pilot_started_at.offset_us((settle_s(protocol) * 1e6) as i64);
    let mut heard = Heard::default();
    let mut last = begin;
    let mut sniffer = SnifferDecoder::new();
    let [mut tag, mut board] = [MavSplitter::new(), MavSplitter::new()];
    for entry in log.entries() {
        match entry {
            Entry::Input { at, input, .. } => {
                last = last.max(at);
                let RawInput::Bytes { link, bytes } = input else { continue };
                let counts = at >= begin;
                match link {
                    LinkId::Tag => {
                        heard.tag_bytes += if counts { bytes.len() as u64 } else { 0 };
                        heard.lines.tag.hear(&bytes);
                        let mut add = |anchor: u8| {
                            *heard.anchors.entry(anchor).or_default() += u64::from(counts);
                        };
                        match protocol {
                            TagProtocol::LpsSniffer => {
                                sniffer.push(&bytes);
                                while let Some(next) = sniffer.next() {
                                    if let Ok(frame) = next {
                                        add(frame.source);
                                    }
                                }
                            }
                            TagProtocol::Mavlink => each_message(&mut tag, &bytes, |message| {
                                if let MavMessage::UWB_TDOA(m) = message {
                                    add(m.anchor_a);
                                    add(m.anchor_b);
                                }
                            }),
                            TagProtocol::Crazyflie => {}
                        }
                    }
                    LinkId::Board => {
                        heard.board_bytes += if counts { bytes.len() as u64 } else { 0 };
                        heard.lines.board.hear(&bytes);
                        if protocol == TagProtocol::Crazyflie && counts {
                            heard.trips_s.extend(crazyflie::trips_s(at, &bytes));
                        }
                        each_message(&mut board, &bytes, |message| {
                            if counts && matches!(message, MavMessage::HEARTBEAT(_)) {
                                heard.heartbeats += 1;
                            }
                        });
                    }
                    LinkId::Ground(_) => {}
                }
            }
            Entry::Decoded(decoded) => decoded_one(&mut heard, &decoded, begin),
            _ => {}
        }
    }
    heard.span_s = last.seconds_since(begin).max(1e-3);
    heard
}

fn each_message(splitter: &mut MavSplitter, bytes: &[u8], mut take: impl FnMut(&MavMessage)) {
    splitter.push(bytes);
    while let Some(next) = splitter.next() {
        if let Ok(message) = next.and_then(|frame| frame.decode()) {
            take(&message);
        }
    }
}

fn decoded_one(heard: &mut Heard, decoded: &Decoded, begin: HostTime) {
    if let Decoded::Health(health) = decoded {
        heard.std_board_clock_s = health.std_board_clock_s;
    }
    if decoded.at() < begin {
        return;
    }
    match decoded {
        Decoded::Imu(_) => heard.imu += 1,
        Decoded::BoardAttitude(_) => heard.attitude += 1,
        Decoded::Battery(_) => heard.battery += 1,
        Decoded::Text(text) if text.severity <= WARNING => {
            heard.warnings.insert(text.text.clone());
        }
        Decoded::Uwb(uwb) => {
            let ids = [uwb.anchor_a, uwb.anchor_b].map(|id| u8::try_from(id).unwrap_or(u8::MAX));
            ids.iter().for_each(|id| *heard.differences.entry(*id).or_default() += 1);
        }
        _ => {}
    }
}

fn judge(loaded: &Loaded, heard: &Heard) -> Vec<Finding> {
    let has_anchors = heard.anchors.values().any(|n| *n > 0);
    let misplaced = heard.lines.misplaced(loaded.config.tag.protocol);
    // Of a line on which somebody else speaks no more is to be said.
    let misplaced = misplaced.filter(|_| !has_anchors || heard.heartbeats == 0);
    let mut findings = Vec::new();
    findings.extend(
        misplaced.map(|[what, way_out]| Finding::problem("tag.port, board.address", what, way_out)),
    );
    if misplaced.is_none() || has_anchors {
        findings.extend(tag(loaded, heard));
    }
    if loaded.config.board.profile == BoardProfile::Crazyflie {
        findings.extend(of_crazyflie(heard));
    } else if misplaced.is_none() || heard.heartbeats > 0 {
        findings.extend(board(heard));
    }
    findings.extend(heard.at_rest.iter().filter_map(|(row, look)| at_rest(row, look)));
    if let Some((late, of)) = heard.late {
        let text = format!("{late} of {of} wake-ups came more than 5 ms late");
        let way_out = "end what loads this computer, and see timing.realtime";
        // One comes late while everything starts; one in a thousand is the noise of a busy desktop.
        findings.push(if late > 1 + of / 1000 {
            Finding::warning("control loop", text, way_out)
        } else {
            Finding::ok("control loop", text)
        });
    }
    findings
}

/// What is measured in the vehicle, as whoever arms would hear it.
fn at_rest(row: &Quantity, look: &Look) -> Option<Finding> {
    let what = format!("at rest: {}", row.name);
    let way_out =
        if row.way_out.is_empty() { "docs/SAFETY.md, What is known at rest" } else { row.way_out };
    match look {
        _ if !row.is_measured => None,
        Look::Fits(found) if found.is_empty() => None,
        Look::Fits(found) => Some(Finding::ok(what, found)),
        Look::Told(found) => Some(Finding::warning(what, found, way_out)),
        Look::Refused(found) => Some(Finding::problem(what, found, way_out)),
    }
}

fn tag(loaded: &Loaded, heard: &Heard) -> Vec<Finding> {
    let surveyed = loaded.survey.ids();
    if heard.anchors.values().all(|n| *n == 0) {
        let (found, way_out) = if heard.tag_bytes == 0 {
            (
                "silent",
                "plug it in again; a node must be in sniffer mode (command `s`, then replug)",
            )
        } else {
            (
                "sends bytes, and no packet of an anchor among them",
                "check tag.protocol, and that anchors are on",
            )
        };
        return vec![Finding::problem(
            "tag",
            format!("{found} for {:.1} s", heard.span_s),
            way_out,
        )];
    }
    let hz = |id: u8| heard.anchors.get(&id).copied().unwrap_or(0) as f64 / heard.span_s;
    let all: f64 = heard.anchors.keys().map(|id| hz(*id)).sum();
    let mut findings = vec![Finding::ok("tag", format!("{all:.0} packets/s"))];
    for id in surveyed {
        let text = format!("{:.1} packets/s, at least {LEAST_ANCHOR_HZ} expected", hz(id.0));
        findings.push(if hz(id.0) <= 0.0 {
            Finding::problem(
                format!("anchor {id}"),
                "not heard",
                format!("switch anchor {id} on, or take it out of the anchor file"),
            )
        } else if hz(id.0) < LEAST_ANCHOR_HZ {
            Finding::warning(
                format!("anchor {id}"),
                text,
                format!("see what stands between the tag and anchor {id}, and its power"),
            )
        } else {
            Finding::ok(format!("anchor {id}"), text)
        });
    }
    for id in heard.anchors.keys().filter(|id| !surveyed.iter().any(|s| s.0 == **id)) {
        findings.push(Finding::warning(
            format!("anchor {id}"),
            format!("{:.1} packets/s, and it is not in the anchor file: not used", hz(*id)),
            "measure its place and add it to the anchor file",
        ));
    }
    findings
}

/// What the link to it would let nobody arm with, and its rates.
fn of_crazyflie(heard: &Heard) -> Vec<Finding> {
    let row = heard.at_rest.iter().find(|(row, _)| row.name == "board");
    let mut findings = vec![match row {
        Some((_, Look::Refused(why))) => {
            Finding::problem("board", why, "docs/CRAZYFLIE.md, Set-up")
        }
        _ => Finding::ok("board", "a Crazyflie that can be armed"),
    }];
    for (what, n, least_hz) in [
        ("inertial", heard.imu, CRAZYFLIE_IMU_HZ),
        ("attitude", heard.attitude, CRAZYFLIE_IMU_HZ),
        ("battery", heard.battery, LEAST_BATTERY_HZ),
    ] {
        let (what, hz) = (format!("board: {what}"), n as f64 / heard.span_s);
        let text = format!("{hz:.0} Hz, at least {least_hz:.0} needed");
        findings.push(if hz < least_hz {
            let way_out = "go nearer with the dongle, take another channel, or 2M";
            Finding::problem(what, text, way_out)
        } else {
            Finding::ok(what, text)
        });
    }
    findings.push(crazyflie::echo(&heard.trips_s));
    let warned = heard.warnings.iter();
    findings.extend(warned.map(|text| Finding::warning("board", text, "docs/CRAZYFLIE.md")));
    findings
}

fn board(heard: &Heard) -> Vec<Finding> {
    if heard.heartbeats == 0 {
        let (found, way_out) = if heard.board_bytes == 0 {
            ("silent", "check power, wires (TX to RX) and board.address")
        } else {
            (
                "sends bytes, and no HEARTBEAT among them",
                "check the speed in board.address, and that the port speaks MAVLink",
            )
        };
        return vec![Finding::problem(
            "board",
            format!("{found} for {:.1} s", heard.span_s),
            way_out,
        )];
    }
    let rate = |what: &str, n: u64, least: f64, message: &str| {
        let hz = n as f64 / heard.span_s;
        let text = format!("{hz:.0} Hz, at least {least:.0} needed");
        // One sample of tolerance at either end of the time that counts.
        if hz + 2.0 / heard.span_s < least {
            Finding::problem(
                format!("board: {what}"),
                text,
                format!("let the board send {message} faster; a slow serial line may be full"),
            )
        } else {
            Finding::ok(format!("board: {what}"), text)
        }
    };
    let mut findings = vec![
        rate("inertial", heard.imu, LEAST_IMU_HZ, "HIGHRES_IMU"),
        rate("attitude", heard.attitude, LEAST_ATTITUDE_HZ, "ATTITUDE_QUATERNION"),
        rate("battery", heard.battery, LEAST_BATTERY_HZ, "BATTERY_STATUS"),
    ];
    findings.push(match heard.std_board_clock_s {
        Some(std_s) if std_s <= CLOCK_S => {
            Finding::ok("board: clock", format!("known to {:.2} ms", std_s * 1e3))
        }
        Some(std_s) => Finding::warning(
            "board: clock",
            format!("known to {:.1} ms only, {:.0} ms expected", std_s * 1e3, CLOCK_S * 1e3),
            "measure longer with --live 10; a slow or busy line delays TIMESYNC",
        ),
        None => Finding::problem(
            "board: clock",
            "not known: the board does not answer TIMESYNC",
            "let the board answer TIMESYNC on this port",
        ),
    });
    findings
}

#[cfg(test)]
mod tests {
    use haltere_dialect::mav::haltere::{HEARTBEAT_DATA, MavAutopilot};
    use haltere_dialect::mav_stream;

    use super::super::tests::loaded;
    use super::*;

    /// The advice was to check anchors and speed.
    #[test]
    fn regress_a_line_on_which_somebody_else_speaks_is_what_is_told() {
        let loaded = loaded("");
        let mut board = Vec::new();
        let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC as u8,
            ..Default::default()
        });
        mav_stream::encode(&mut board, 1, 1, 0, &beat);
        let tag = b"From 0a to ff @010203040a: 30050000008000\r\n";
        let all = |heard: &Heard| {
            let lines = judge(&loaded, heard);
            lines
                .iter()
                .map(|f| format!("{}: {}; {}", f.what, f.found, f.way_out))
                .collect::<Vec<_>>()
        };
        let mut heard = Heard { span_s: 5.0, tag_bytes: 9, board_bytes: 9, ..Heard::default() };
        assert_eq!(all(&heard).len(), 2, "nobody was recognised: {:?}", all(&heard));
        heard.lines.tag.hear(&board);
        heard.lines.board.hear(tag);
        let told = all(&heard);
        assert!(told.len() == 1 && told[0].contains("tag and board are exchanged"), "{told:?}");
        // One alone: of the other one it is said how it is.
        let mut heard = Heard { span_s: 5.0, tag_bytes: 9, heartbeats: 5, ..Heard::default() };
        heard.lines.tag.hear(&board);
        heard.lines.board.hear(&board);
        let told = all(&heard);
        assert!(told[0].contains("a board speaks MAVLink on the tag's line"), "{told:?}");
        assert!(told.iter().any(|t| t.starts_with("board: inertial")), "{told:?}");
        assert!(!told.iter().any(|t| t.contains("anchors are on")), "{told:?}");
    }
}
