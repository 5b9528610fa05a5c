//! The tag: its bytes decode to the geometry of the room.

use std::collections::BTreeMap;

use haltere_dialect::lps::sniffer::SnifferDecoder;
use haltere_dialect::lps::{RX_BITS, TICK_M, tdoa2, tdoa3};
use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream::MavSplitter;
use nalgebra::Vector3;

use crate::effects::{EffectSet, probe};
use crate::plant::rig::Rig;
use crate::tag::TagProtocol;

/// A packet in the tag's words: who, which, when sent, what it heard of whom, when the tag heard it.
struct Heard {
    source: u8,
    counter: u8,
    tx: u32,
    rx_tag: i64,
    remotes: Vec<(u8, u8, u32, u16)>,
}

fn packets(bytes: &[u8]) -> Vec<Heard> {
    let mut decoder = SnifferDecoder::new();
    let mut out = Vec::new();
    for chunk in bytes.chunks(4096) {
        decoder.push(chunk);
        collect(&mut decoder, &mut out);
    }
    out
}

fn collect(decoder: &mut SnifferDecoder, out: &mut Vec<Heard>) {
    while let Some(found) = decoder.next() {
        let Ok(frame) = found else { continue };
        let rx_tag = frame.rx_ticks.cast_signed();
        let source = frame.source;
        if frame.payload[0] == tdoa2::TYPE {
            let p = tdoa2::Tdoa2Packet::decode(frame.payload).unwrap();
            let own = usize::from(source);
            let remotes = (0..8u8)
                .map(|i| {
                    (i, p.counters[usize::from(i)], p.times[usize::from(i)], p.tofs[usize::from(i)])
                })
                .filter(|(i, _, time, _)| *i != source && *time != 0)
                .collect();
            out.push(Heard {
                source,
                counter: p.counters[own] & 0x7f,
                tx: p.times[own],
                rx_tag,
                remotes,
            });
        } else {
            let p = tdoa3::Tdoa3Packet::decode(frame.payload).unwrap();
            let remotes = p
                .remotes
                .as_slice()
                .iter()
                .map(|r| (r.id, r.counter, r.rx, r.tof.unwrap()))
                .collect();
            out.push(Heard { source, counter: p.counter, tx: p.tx, rx_tag, remotes });
        }
    }
}

/// Mean and worst difference (m) between TDOA by the formula of INTERFACES.md and geometry, and how many.
fn errors(bytes: &[u8], tag_E_m: Vector3<f64>) -> (f64, f64, usize) {
    let sites = probe::sites();
    let range = |id: u8| (tag_E_m - sites[usize::from(id)]).norm();
    // Newest packet of each anchor: counter, tag time, sending time.
    let mut last: BTreeMap<u8, (u8, i64, u32)> = BTreeMap::new();
    let (mut sum, mut worst, mut n): (f64, f64, usize) = (0.0, 0.0, 0);
    let wrap = |ticks: i64| ticks.rem_euclid(1 << RX_BITS);
    for p in packets(bytes) {
        if let Some((_, t_before, x_before)) = last.get(&p.source) {
            let k = wrap(p.rx_tag - t_before) as f64 / f64::from(p.tx.wrapping_sub(*x_before));
            for (r, counter, rx, tof) in &p.remotes {
                let Some((c, t_r, _)) = last.get(r) else { continue };
                if c & 0x7f != counter & 0x7f {
                    continue;
                }
                let own = f64::from(*tof) + f64::from(p.tx.wrapping_sub(*rx));
                let d = (wrap(p.rx_tag - t_r) as f64 - k * own) * TICK_M;
                let error = (d - (range(p.source) - range(*r))).abs();
                sum += error;
                worst = worst.max(error);
                n += 1;
            }
        }
        last.insert(p.source, (p.counter, p.rx_tag, p.tx));
    }
    (sum / n as f64, worst, n)
}

fn traffic(protocol: TagProtocol, effects: EffectSet) -> (Vec<u8>, Vector3<f64>) {
    let mut rig = Rig::with(effects, |c| c.protocol = protocol);
    rig.plant.tag_input(b"b");
    rig.run(20.0); // across a wrap of the 40-bit clock
    let place = rig.plant.truth().pos_E_m.raw();
    (std::mem::take(rig.plant.tag_output()), place)
}

/// Clocks with skew and drift, nothing else.
fn exact() -> EffectSet {
    EffectSet::none().with("N14", &[]).unwrap()
}

#[test]
fn val_tdoa2_traffic_gives_geometry_within_5_mm() {
    let (bytes, place) = traffic(TagProtocol::Tdoa2, exact());
    let (mean, worst, n) = errors(&bytes, place);
    println!("mean {mean:.4} m, worst {worst:.4} m of {n}");
    // One tick is 4.7 mm and four roundings enter: a single difference may be off by two ticks.
    assert!(n > 50_000, "{n}");
    assert!(mean < 0.005 && worst < 2.5 * TICK_M, "{mean} {worst}");
}

#[test]
fn val_tdoa3_traffic_gives_geometry_within_ticks() {
    let (bytes, place) = traffic(TagProtocol::Tdoa3, exact());
    let (mean, worst, n) = errors(&bytes, place);
    println!("mean {mean:.4} m, worst {worst:.4} m of {n}");
    assert!(n > 5_000, "{n}");
    assert!(mean < 0.005 && worst < 3.5 * TICK_M, "{mean} {worst}");
}

#[test]
fn val_frame_rate_is_that_of_the_devices() {
    let (bytes, _) = traffic(TagProtocol::Tdoa2, EffectSet::none());
    let rate = packets(&bytes).len() as f64 / 20.0;
    assert!((rate - 476.0).abs() < 1.0, "{rate}"); // INTERFACES.md: about 476 frames/s
    let frame = tdoa2::LEN + 12;
    assert!((bytes.len() as f64 / 20.0 / (frame as f64 * 476.0) - 1.0).abs() < 0.02);
}

#[test]
fn prop_boot_text_then_lines_then_frames() {
    let mut rig = Rig::new(EffectSet::none());
    rig.run(0.1);
    let text = String::from_utf8(std::mem::take(rig.plant.tag_output())).unwrap();
    assert!(text.contains("Sniffer") && text.contains("From 0"), "{text}");
    assert!(packets(text.as_bytes()).is_empty());
    rig.plant.tag_input(b"b");
    rig.run(0.1);
    assert!(packets(rig.plant.tag_output()).len() > 40);
    rig.plant.tag_input(b"d");
    rig.run(0.01);
    rig.plant.tag_output().clear();
    rig.run(0.1);
    assert!(packets(rig.plant.tag_output()).is_empty(), "text again after a reset");
}

#[test]
fn prop_mavlink_tag_sends_distance_differences() {
    let (bytes, place) = traffic(TagProtocol::Mavlink, EffectSet::none());
    let mut splitter = MavSplitter::new();
    let sites = probe::sites();
    let mut n = 0;
    for chunk in bytes.chunks(4096) {
        splitter.push(chunk);
        while let Some(frame) = splitter.next() {
            let Ok(MavMessage::UWB_TDOA(m)) = frame.unwrap().decode() else { panic!() };
            let range = |id: u8| (place - sites[usize::from(id)]).norm();
            let want = range(m.anchor_b) - range(m.anchor_a);
            assert!((f64::from(m.distance_diff) - want).abs() < 1e-5);
            n += 1;
        }
    }
    assert!(n > 9_000);
}
