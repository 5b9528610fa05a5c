//! Laws of the TDOA engine, against traffic of exact geometry.

use rand::RngExt as _;

use super::air;
use super::air::{Air, Heard};
use super::*;
use haltere_core::checks::Problems;
use haltere_core::drops::{DropReason, Drops};
use haltere_core::frames::{E, Vec3};
use haltere_core::measure::{AnchorId, Tdoa};
use haltere_core::time::HostTime;

/// No error at all is left but the rounding of four stamps, ±2 ticks, and what rounding does to K.
const EXACT_M: f64 = 0.012;
/// "A wrong value".
const WRONG_M: f64 = 0.3;

struct Run {
    engine: TdoaEngine,
    out: Vec<Tdoa>,
    drops: Drops,
    packets: usize,
}

impl Run {
    fn new() -> Self {
        // One pair a packet: packets and measurements can then be counted against each other.
        Self::with(UwbConfig { pairs_per_packet: 1, ..UwbConfig::default() })
    }

    fn with(config: UwbConfig) -> Self {
        let engine = TdoaEngine::new(config, &air::survey());
        Self { engine, out: Vec::new(), drops: Drops::default(), packets: 0 }
    }

    fn hear(&mut self, packets: &[Heard]) -> &mut Self {
        for packet in packets {
            self.engine.tag_bytes(
                packet.received_at(),
                &packet.bytes,
                &mut self.out,
                &mut self.drops,
            );
            self.packets += 1;
        }
        self
    }

    /// Largest error against the true position at `valid_at`, which the read delay puts late.
    fn worst_m(&self, air: &Air) -> f64 {
        self.out.iter().map(|tdoa| error_m(tdoa, &*air.tag_pos).abs()).fold(0.0, f64::max)
    }

    fn std_m(&self, air: &Air) -> f64 {
        let sum: f64 = self.out.iter().map(|tdoa| error_m(tdoa, &*air.tag_pos).powi(2)).sum();
        (sum / self.out.len() as f64).sqrt()
    }

    /// Share of packets that gave a measurement.
    fn yield_frac(&self) -> f64 {
        self.out.len() as f64 / self.packets as f64
    }
}

fn error_m(tdoa: &Tdoa, tag_pos: &dyn Fn(f64) -> Vec3<E>) -> f64 {
    let t_s = tdoa.valid_at.seconds_since(HostTime::from_us(7_000_000)) - air::READ_DELAY_S;
    let distance_m = |id: AnchorId| {
        let (_, pos) = air::anchors()[usize::from(id.0)];
        (tag_pos(t_s) - pos).norm()
    };
    tdoa.distance_diff_m - (distance_m(tdoa.anchor_b) - distance_m(tdoa.anchor_a))
}

/// 1.5 m circle at 3 m/s.
fn circle(t_s: f64) -> Vec3<E> {
    let (sin, cos) = (2.0 * t_s).sin_cos();
    Vec3::new(4.0 + 1.5 * sin, 4.0 + 1.5 * cos, -1.5)
}

#[test]
fn prop_exact_stamps_give_exact_differences() {
    for tdoa3 in [false, true] {
        for skew in [0.0, 5e-6, 50e-6, 100e-6] {
            let mut air = Air { tdoa3, ..Air::new(skew, 11) };
            let heard = air.run(0.0..20.0); // across both wraps
            let mut run = Run::new();
            run.hear(&heard);
            let worst_m = run.worst_m(&air);
            println!(
                "tdoa3 {tdoa3} skew {:4.0} ppm: worst {:.1} mm, std {:.1} mm, yield {:.4}",
                skew * 1e6,
                worst_m * 1e3,
                run.std_m(&air) * 1e3,
                run.yield_frac()
            );
            assert!(worst_m < EXACT_M, "{worst_m}");
            assert!(run.yield_frac() > if tdoa3 { 0.9 } else { 0.99 }, "{:?}", run.drops);
            let told = run.engine.anchors_heard().map(|a| a.clock_skew_ppm.unwrap());
            for (ppm, clock) in told.zip(&air.anchors) {
                let truth = ((1.0 + air.tag.skew) / (1.0 + clock.skew) - 1.0) * 1e6;
                assert!((ppm - truth).abs() < 0.005, "{ppm} {truth}");
            }
        }
    }
}

#[test]
fn prop_each_packet_is_measured_or_counted() {
    let mut air = Air { loss_frac: 0.1, ..Air::new(30e-6, 2) };
    let mut run = Run::new();
    run.hear(&air.run(0.0..5.0));
    let lost: u64 = run.drops.iter().map(|(_, n)| n).sum();
    assert_eq!(run.out.len() + lost as usize, run.packets);
}

#[test]
fn prop_a_moving_tag_is_measured_where_it_was() {
    for tdoa3 in [false, true] {
        for pairs_per_packet in [1, 7] {
            let mut air = Air { tdoa3, tag_pos: Box::new(circle), ..Air::new(20e-6, 5) };
            let mut run = Run::with(UwbConfig { pairs_per_packet, ..Default::default() });
            run.hear(&air.run(0.0..10.0));
            let (worst_m, std_m) = (run.worst_m(&air), run.std_m(&air));
            println!("tdoa3 {tdoa3} pairs {pairs_per_packet}: worst {worst_m:.4} std {std_m:.4}");
            // The lag of K behind 6 m/s², over a pair's age of 2 ms or 15 to 34 ms.
            assert!(worst_m < if pairs_per_packet == 1 && !tdoa3 { 0.015 } else { 0.05 });
            assert!(std_m < if pairs_per_packet == 1 { 0.006 } else { 0.012 });
        }
    }
}

#[test]
fn prop_warming_crystals_are_followed() {
    let mut air = Air::new(20e-6, 18);
    for (i, clock) in air.anchors.iter_mut().enumerate() {
        clock.drift_per_s = if i % 2 == 0 { 1e-7 } else { -1e-7 };
    }
    let mut run = Run::new();
    run.hear(&air.run(0.0..20.0));
    println!("0.1 ppm/s: worst {:.4} m, std {:.4}", run.worst_m(&air), run.std_m(&air));
    assert!(run.worst_m(&air) < 0.02, "{}", run.worst_m(&air));
    assert!(run.yield_frac() > 0.99);
}

#[test]
fn prop_noise_is_that_of_the_stamps() {
    for (pairs_per_packet, bound_m) in [(1, 0.092), (7, 0.097)] {
        let mut air = Air { std_arrival_m: 0.05, ..Air::new(20e-6, 6) };
        let mut run = Run::with(UwbConfig { pairs_per_packet, ..Default::default() });
        run.hear(&air.run(0.0..20.0));
        let std_m = run.std_m(&air);
        println!("pairs {pairs_per_packet}: std {std_m:.4} m, {:?}", run.drops);
        // Three arrivals of 5 cm: 8.66 cm. The rest is K.
        assert!(std_m > 0.08 && std_m < bound_m, "{std_m}");
        assert!(run.yield_frac() > 0.98 * f64::from(pairs_per_packet));
    }
}

#[test]
fn prop_loss_costs_packets_not_accuracy() {
    for tdoa3 in [false, true] {
        for loss_frac in [0.1, 0.5, 0.8] {
            let mut air = Air { tdoa3, loss_frac, ..Air::new(50e-6, 7) };
            let mut run = Run::with(UwbConfig { pairs_per_packet: 7, ..Default::default() });
            run.hear(&air.run(0.0..30.0));
            println!(
                "tdoa3 {tdoa3} loss {loss_frac}: worst {:.4} m, {} of {}, {:?}",
                run.worst_m(&air),
                run.out.len(),
                run.packets,
                run.drops.iter().collect::<Vec<_>>()
            );
            assert!(run.worst_m(&air) < 0.03, "{}", run.worst_m(&air));
            assert!(run.drops.count(DropReason::UwbClockJump) == 0);
        }
    }
}

/// Both clocks of the tag's life: the first part ends, the tag reboots, the second begins.
#[test]
fn prop_a_tag_reboot_costs_a_moment_and_no_wrong_value() {
    for offset_ticks in [0, 1 << 33, 1 << 39, (1 << 40) - (1 << 35), 123 << 32] {
        let mut air = Air::new(40e-6, 8);
        let mut run = Run::new();
        run.hear(&air.run(0.0..5.0));
        air.tag.offset_ticks = offset_ticks;
        let before = run.out.len();
        let second = air.run(5.5..8.0);
        let (moment, rest) = second.split_at(16 * 8);
        run.hear(moment);
        let settled = run.out.len();
        run.hear(rest);
        assert!(run.worst_m(&air) < WRONG_M, "{}", run.worst_m(&air));
        assert_eq!(run.out.len() - settled, rest.len(), "offset {offset_ticks} {before}");
        let last = run.out.last().unwrap();
        assert!(last.valid_at <= last.received_at && error_m(last, &*air.tag_pos).abs() < EXACT_M);
        let age_s = last.received_at.seconds_since(last.valid_at);
        assert!(age_s < 0.02, "offset {offset_ticks}: {age_s} s");
    }
}

#[test]
fn prop_an_anchor_reboot_costs_that_anchor_a_moment() {
    let mut air = Air::new(40e-6, 9);
    let mut run = Run::new();
    run.hear(&air.run(0.0..2.0));
    let before = run.out.len();
    air.anchors[4].offset_ticks += 0x1234_5678_9ABC;
    let second = air.run(2.0..4.0);
    run.hear(&second);
    assert!(run.worst_m(&air) < EXACT_M);
    // It is lost, and the next pairs with the one before it, for some six frames.
    assert!(run.out.len() - before > second.len() - 20, "{:?}", run.drops);
}

#[test]
fn prop_pauses_of_any_length_are_survived() {
    for pause_s in [0.5, 0.9, 1.5, 10.0, 17.2074, 17.5, 40.0] {
        let mut air = Air::new(40e-6, 10);
        let mut run = Run::new();
        run.hear(&air.run(0.0..5.0));
        let before = run.out.len();
        let second = air.run(5.0 + pause_s..7.0 + pause_s);
        run.hear(&second);
        assert!(run.worst_m(&air) < EXACT_M, "pause {pause_s}: {}", run.worst_m(&air));
        assert!(run.out.len() - before > second.len() - 60, "{pause_s}");
        let last = run.out.last().unwrap();
        assert!(last.received_at.seconds_since(last.valid_at) < 0.02, "{pause_s}");
    }
}

/// A program that is started again, or stood still, reads what waited for it at once, and misses what had no room.
#[test]
fn regress_what_waited_and_what_is_missing_hold_nothing_up() {
    for begins_anew in [false, true] {
        for missing_s in [1.0, 4.0, 8.0, 10.0, 16.0, 20.0] {
            let mut air = Air::new(40e-6, 21);
            let heard = air.run(0.0..3.0);
            let mut run = Run::new();
            if !begins_anew {
                run.hear(&heard);
            }
            let live_s = 5.0 + missing_s;
            let waited = air.run(3.0..5.0);
            let read: Vec<_> = waited.iter().map(|h| h.played_again(live_s - h.t_s, 0.0)).collect();
            run.hear(&read);
            let before = run.out.len();
            run.hear(&air.run(live_s..live_s + 3.0));
            let fused = run.out.len() - before;
            assert!(fused > 500, "anew {begins_anew}, {missing_s} s missing: {fused}");
        }
    }
}

/// Bytes of the last seconds played again and again, as they were and with receive times that go on.
#[test]
fn regress_a_stream_that_is_played_again_gives_nothing() {
    for tdoa3 in [false, true] {
        for (window_s, times_grow) in
            [(1.0, false), (3.0, false), (8.0, false), (1.0, true), (3.0, true), (8.0, true)]
        {
            let mut air = Air { tdoa3, ..Air::new(40e-6, 18) };
            let heard = air.run(0.0..10.0);
            let mut run = Run::new();
            run.hear(&heard);
            let first = heard.iter().position(|h| h.t_s > 10.0 - window_s).unwrap();
            let before = run.out.len();
            for lap in 1..4 {
                for packet in &heard[first..] {
                    let by_s = window_s * f64::from(lap);
                    let grow_s = if times_grow { by_s } else { 0.0 };
                    run.hear(&[packet.played_again(by_s, grow_s)]);
                }
            }
            let fused = run.out.len() - before;
            assert_eq!(fused, 0, "tdoa3 {tdoa3} window {window_s} s, times grow {times_grow}");
            assert!(run.engine.is_played_again());
            // What is live again is heard again.
            let passed_s = 10.0 + 3.0 * window_s;
            run.hear(&air.run(passed_s..passed_s + 1.0));
            assert!(run.out.len() > before + 100 && !run.engine.is_played_again());
        }
    }
}

#[test]
fn prop_a_lost_byte_costs_its_packet() {
    let mut air = Air::new(40e-6, 12);
    let mut heard = air.run(0.0..3.0);
    let mut damaged = 0;
    for packet in heard.iter_mut().skip(100).step_by(10) {
        let at = air.rng.random_range(0..packet.bytes.len());
        packet.bytes.remove(at);
        damaged += 1;
    }
    let mut run = Run::new();
    run.hear(&heard);
    assert!(run.worst_m(&air) < EXACT_M, "{}", run.worst_m(&air));
    assert_eq!(run.drops.count(DropReason::TagGarbageByte), damaged * 68);
    // The next packet pairs with the one before.
    assert!(run.out.len() + damaged as usize > heard.len() - 40, "{:?}", run.drops);
}

/// No checksum protects the stamps: any one byte may be changed.
#[test]
fn prop_a_changed_byte_spoils_at_most_what_the_filter_can_gate() {
    let mut air = Air::new(40e-6, 13);
    let mut heard = air.run(0.0..20.0);
    let total = heard.len();
    let mut damaged = 0;
    for packet in heard.iter_mut().skip(100).step_by(10) {
        let at = air.rng.random_range(0..packet.bytes.len());
        packet.bytes[at] ^= 1 << air.rng.random_range(0..8);
        damaged += 1;
    }
    let mut run = Run::new();
    run.hear(&heard);
    let wrong = run.out.iter().filter(|t| error_m(t, &*air.tag_pos).abs() > WRONG_M).count();
    println!("{damaged} of {total} changed: {wrong} wrong, {:?}", run.drops);
    // What stays unseen is a change of metres inside the gates, and it spoils one value, not two.
    assert!(wrong * 20 < damaged);
    assert!(run.worst_m(&air) < 17.0);
    assert!(run.out.len() > total - 40 - damaged * 2);
}

#[test]
fn prop_stale_reports_do_not_alias() {
    // The tag hears everything; the anchors hear little, so their reports are old. Counters of
    // 7 bits and stamps of 32 bits come round many times.
    for tdoa3 in [false, true] {
        let mut air = Air { tdoa3, loss_frac: 0.9, ..Air::new(100e-6, 14) };
        let mut run = Run::with(UwbConfig { pairs_per_packet: 7, ..Default::default() });
        run.hear(&air.run(0.0..120.0));
        println!("tdoa3 {tdoa3}: {} measured, {:?}", run.out.len(), run.drops);
        assert!(run.worst_m(&air) < WRONG_M, "{}", run.worst_m(&air));
    }
}

#[test]
fn prop_repeated_and_foreign_packets_are_told_apart() {
    let mut air = Air::new(10e-6, 15);
    let heard = air.run(0.0..1.0);
    let mut run = Run::new();
    run.hear(&heard).hear(&heard[heard.len() - 1..]);
    assert_eq!(run.drops.count(DropReason::UwbDuplicate), 1);
    // Anchor 0 of the survey is number 100 there.
    let mut anchors = air::anchors();
    anchors[0].0 = AnchorId(100);
    let survey = haltere_core::survey::Survey::new(&anchors).unwrap();
    let mut foreign = Run::new();
    foreign.engine = TdoaEngine::new(UwbConfig::default(), &survey);
    foreign.hear(&heard);
    let of_0 = heard.iter().filter(|h| h.source == 0).count();
    assert_eq!(foreign.drops.count(DropReason::UwbUnknownAnchor), of_0 as u64);
    assert!(foreign.out.iter().all(|t| t.anchor_a != AnchorId(0) && t.anchor_b != AnchorId(0)));
    assert!(foreign.out.len() > heard.len() * 8 / 10);
}

#[test]
fn prop_chunking_does_not_matter() {
    let mut air = Air { loss_frac: 0.1, ..Air::new(10e-6, 16) };
    let heard = air.run(0.0..2.0);
    let at = HostTime::from_us(5);
    let bytes: Vec<u8> = heard.iter().flat_map(|h| h.bytes.clone()).collect();
    let through = |chunk: usize| {
        let mut run = Run::new();
        for part in bytes.chunks(chunk) {
            run.engine.tag_bytes(at, part, &mut run.out, &mut run.drops);
        }
        (run.out, run.drops)
    };
    assert_eq!(through(bytes.len()), through(13));
}

#[test]
fn prop_garbage_never_panics() {
    let mut air = Air::new(10e-6, 17);
    let mut heard = air.run(0.0..2.0);
    for packet in &mut heard {
        for _ in 0..4 {
            let at = air.rng.random_range(0..packet.bytes.len());
            packet.bytes[at] = air.rng.random();
        }
    }
    Run::new().hear(&heard);
}

#[test]
fn prop_configuration_is_checked() {
    let mut problems = Problems::new();
    let config = UwbConfig { pairs_per_packet: 8, clock_gate_m: f64::NAN, ..Default::default() };
    config.check("uwb", &mut problems);
    assert_eq!(problems.lines().len(), 2);
    assert!(problems.lines()[0].starts_with("uwb.pairs_per_packet = 8, allowed 1 to 7"));
    assert!(toml::from_str::<UwbConfig>("pairs_per_packet = 2\n").is_ok());
    assert!(toml::from_str::<UwbConfig>("pairs = 2\n").is_err());
}
