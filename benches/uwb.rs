//! Speed of the TDOA engine from bytes to measurements, best of several runs:
//! `cargo bench -p haltere --bench uwb`.

use std::hint::black_box;
use std::time::Instant;

use haltere_core::drops::Drops;
use haltere_core::frames::Vec3;
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_dialect::lps::sniffer::{SnifferFrame, encode};
use haltere_dialect::lps::tdoa2::Tdoa2Packet;
use haltere_pilot::uwb::{TdoaEngine, UwbConfig};

const RUNS: usize = 15;
const PACKETS: usize = 40_000;
const SLOT_TICKS: u64 = 1 << 27;

fn main() {
    let anchors: Vec<_> = (0..8u8)
        .map(|i| {
            let at = |bit: u8| if i & bit != 0 { 8.0 } else { 0.0 };
            (AnchorId(i), Vec3::new(at(1), at(2), -at(4)))
        })
        .collect();
    let survey = Survey::new(&anchors).expect("a cube is a good survey");
    // All clocks alike, the tag in the middle: the engine does the same work as with any other.
    let frames: Vec<Vec<u8>> = (0..PACKETS as u64)
        .map(|i| {
            let source = (i % 8) as usize;
            let mut packet = Tdoa2Packet::default();
            for r in 0..8u64 {
                let ago = (i + 8 - r) % 8;
                let sent = i.saturating_sub(ago) * SLOT_TICKS;
                packet.counters[r as usize] = (i.saturating_sub(ago) / 8) as u8;
                packet.times[r as usize] = (sent + if ago == 0 { 0 } else { 33_000 }) as u32;
                packet.tofs[r as usize] = 33_000;
            }
            let mut payload = Vec::new();
            packet.encode(&mut payload);
            let mut bytes = Vec::new();
            let rx_ticks = (i * SLOT_TICKS + 33_000) % (1 << 40);
            encode(
                &mut bytes,
                &SnifferFrame {
                    rx_ticks,
                    source: source as u8,
                    destination: 0xFF,
                    payload: &payload,
                },
            );
            bytes
        })
        .collect();
    for pairs_per_packet in [1, 7] {
        let mut best_ns = f64::INFINITY;
        let mut out = Vec::with_capacity(8 * PACKETS);
        for _ in 0..RUNS {
            let config = UwbConfig { pairs_per_packet, ..Default::default() };
            let mut engine = TdoaEngine::new(config, &survey);
            let mut drops = Drops::default();
            out.clear();
            let start = Instant::now();
            for (i, bytes) in frames.iter().enumerate() {
                let at = HostTime::from_us(1_000_000 + (i as f64 * 2100.5) as u64);
                engine.tag_bytes(at, bytes, &mut out, &mut drops);
            }
            best_ns = best_ns.min(start.elapsed().as_nanos() as f64 / PACKETS as f64);
            assert!(black_box(&out).len() > (PACKETS - 100) * usize::from(pairs_per_packet));
        }
        println!("tdoa engine, TDoA2, {pairs_per_packet} pairs: {best_ns:6.1} ns/packet");
    }
}
