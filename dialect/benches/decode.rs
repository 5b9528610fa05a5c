//! Speed of the codecs, best of several runs: `cargo bench -p haltere-dialect --bench decode`.

use std::hint::black_box;
use std::time::Instant;

use haltere_dialect::lps::sniffer::{self, SnifferDecoder, SnifferFrame};
use haltere_dialect::lps::tdoa2::Tdoa2Packet;
use haltere_dialect::lps::tdoa3::{Remote, Tdoa3Packet};
use haltere_dialect::mav::haltere::{
    HEARTBEAT_DATA, HIGHRES_IMU_DATA, MavMessage, SET_ATTITUDE_TARGET_DATA, UWB_TDOA_DATA,
};
use haltere_dialect::mav_stream::{MavSplitter, encode};

const RUNS: usize = 15;
const FRAMES: usize = 20_000;
/// As a serial port or a socket would hand them over.
const CHUNK: usize = 1024;

fn main() {
    let messages = [
        MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()),
        MavMessage::UWB_TDOA(UWB_TDOA_DATA { time_usec: 1 << 40, std: 0.15, ..Default::default() }),
        MavMessage::SET_ATTITUDE_TARGET(SET_ATTITUDE_TARGET_DATA {
            thrust: 0.5,
            ..Default::default()
        }),
        MavMessage::HIGHRES_IMU(HIGHRES_IMU_DATA { temperature: 20.0, ..Default::default() }),
    ];
    for message in &messages {
        let mut bytes = Vec::new();
        (0..FRAMES).for_each(|i| encode(&mut bytes, 1, 1, i as u8, message));
        let name = format!("{message:?}");
        let name = name.split('(').next().unwrap_or_default();
        let len = bytes.len() / FRAMES;
        report(&format!("mavlink split          {name} {len} B"), || split(&bytes, false));
        report(&format!("mavlink split + decode {name} {len} B"), || split(&bytes, true));
        let mut out = Vec::with_capacity(bytes.len());
        report(&format!("mavlink encode         {name} {len} B"), || {
            out.clear();
            (0..FRAMES).for_each(|i| encode(&mut out, 1, 1, i as u8, black_box(message)));
            FRAMES
        });
    }

    let mut tdoa2 = Vec::new();
    let mut tdoa3 = Vec::new();
    for i in 0..FRAMES {
        let source = (i % 8) as u8;
        let mut frame =
            SnifferFrame { rx_ticks: i as u64, source, destination: 0xFF, payload: &[] };
        let mut payload = Vec::new();
        Tdoa2Packet { times: [i as u32; 8], ..Default::default() }.encode(&mut payload);
        frame.payload = &payload;
        sniffer::encode(&mut tdoa2, &frame);
        let mut packet = Tdoa3Packet { tx: i as u32, ..Default::default() };
        (0..8).for_each(|id| {
            packet.remotes.push(Remote { id, counter: 1, rx: 2, tof: Some(32951) });
        });
        let mut payload = Vec::new();
        packet.encode(&mut payload);
        frame.payload = &payload;
        sniffer::encode(&mut tdoa3, &frame);
    }
    report("sniffer + TDoA2 decode 69 B", || sniff(&tdoa2));
    report("sniffer + TDoA3 decode 83 B", || sniff(&tdoa3));
}

fn split(bytes: &[u8], decode: bool) -> usize {
    let mut splitter = MavSplitter::new();
    let mut frames = 0;
    for chunk in bytes.chunks(CHUNK) {
        splitter.push(chunk);
        while let Some(found) = splitter.next() {
            if let Ok(frame) = found {
                if decode {
                    let _ = black_box(frame.decode());
                } else {
                    black_box(frame.raw);
                }
                frames += 1;
            }
        }
    }
    frames
}

fn sniff(bytes: &[u8]) -> usize {
    let mut decoder = SnifferDecoder::new();
    let mut frames = 0;
    for chunk in bytes.chunks(CHUNK) {
        decoder.push(chunk);
        while let Some(found) = decoder.next() {
            if let Ok(frame) = found {
                let _ = black_box(Tdoa2Packet::decode(frame.payload));
                let _ = black_box(Tdoa3Packet::decode(frame.payload));
                frames += 1;
            }
        }
    }
    frames
}

fn report(name: &str, mut run: impl FnMut() -> usize) {
    let mut best_ns = f64::INFINITY;
    for _ in 0..RUNS {
        let start = Instant::now();
        let n = black_box(run());
        assert_eq!(n, FRAMES, "{name}");
        best_ns = best_ns.min(start.elapsed().as_nanos() as f64 / n as f64);
    }
    println!("{name:52} {best_ns:7.1} ns/frame {:6.2} M/s", 1e3 / best_ns);
}
