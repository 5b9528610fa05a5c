//! Laws and golden bytes of the sniffer stream.

use proptest::prelude::*;

use super::super::tdoa2::{self, Tdoa2Packet};
use super::super::tdoa3::{Remote, Tdoa3Packet};
use super::*;

/// Built by hand from the tables of the interface description: anchor 2 broadcasts packet 0x85 at
/// 0x11223344; it last heard packet 7 of anchor 0 at 0xA0B0C0D0, 32951 (0x80B7) ticks away, and
/// nobody else. The tag heard it at 0xFEDCBA9876.
const GOLDEN: [u8; 69] = [
    0xBC, //
    0x76, 0x98, 0xBA, 0xDC, 0xFE, // receive time
    0x02, 0xFF, // source, destination
    57, 0x00, // L
    0x22, // type
    0x07, 0x00, 0x85, 0x00, 0x00, 0x00, 0x00, 0x00, // counters
    0xD0, 0xC0, 0xB0, 0xA0, // time of anchor 0
    0x00, 0x00, 0x00, 0x00, //
    0x44, 0x33, 0x22, 0x11, // own time
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, //
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, //
    0xB7, 0x80, // time of flight to anchor 0
    0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, //
    57, 0x00, // L again
];

#[derive(Debug, Clone, PartialEq)]
struct Owned {
    rx_ticks: u64,
    source: u8,
    destination: u8,
    payload: Vec<u8>,
}

impl Owned {
    fn encode(&self, out: &mut Vec<u8>) {
        let Owned { rx_ticks, source, destination, ref payload } = *self;
        encode(out, &SnifferFrame { rx_ticks, source, destination, payload });
    }
}

#[derive(Debug, Default, PartialEq)]
struct Heard {
    frames: Vec<Owned>,
    garbage: usize,
    pending: usize,
    other: Vec<SnifferLoss>,
}

fn hear(bytes: &[u8], chunks: impl Iterator<Item = usize>) -> Heard {
    let mut heard = Heard::default();
    let mut decoder = SnifferDecoder::new();
    let mut rest = bytes;
    let mut take = |decoder: &mut SnifferDecoder| {
        while let Some(found) = decoder.next() {
            match found {
                Ok(frame) => heard.frames.push(Owned {
                    rx_ticks: frame.rx_ticks,
                    source: frame.source,
                    destination: frame.destination,
                    payload: frame.payload.to_vec(),
                }),
                Err(SnifferLoss::GarbageBytes(n)) => heard.garbage += n,
                Err(loss) => heard.other.push(loss),
            }
        }
    };
    for chunk in chunks {
        let (now, later) = rest.split_at(chunk.min(rest.len()));
        decoder.push(now);
        rest = later;
        take(&mut decoder);
    }
    decoder.push(rest);
    take(&mut decoder);
    heard.pending = decoder.pending();
    let sum = heard.frames.iter().map(|f| f.payload.len() + OVERHEAD).sum::<usize>();
    assert_eq!(sum + heard.garbage + heard.pending, bytes.len(), "bytes are conserved");
    heard
}

fn at_once(bytes: &[u8]) -> Heard {
    hear(bytes, std::iter::empty())
}

prop_compose! {
    fn tdoa2_frame()(
        rx_ticks in 0..1u64 << 40, source in 0..8u8, counters: [u8; 8], times: [u32; 8],
        tofs: [u16; 8], position in prop::option::of(prop::array::uniform3(-9.0f32..9.0)),
    ) -> Owned {
        let mut payload = Vec::new();
        Tdoa2Packet { counters, times, tofs, position }.encode(&mut payload);
        Owned { rx_ticks, source, destination: 0xFF, payload }
    }
}

prop_compose! {
    fn tdoa3_frame()(
        rx_ticks in 0..1u64 << 40, source: u8, counter in 0..128u8, tx: u32,
        remotes in prop::collection::vec((any::<u8>(), 0..128u8, any::<u32>(), any::<Option<u16>>()), 0..=8),
    ) -> Owned {
        let mut packet = Tdoa3Packet { counter, tx, ..Default::default() };
        for (id, counter, rx, tof) in remotes {
            packet.remotes.push(Remote { id, counter, rx, tof });
        }
        let mut payload = Vec::new();
        packet.encode(&mut payload);
        Owned { rx_ticks, source, destination: 0xFF, payload }
    }
}

fn frame() -> impl Strategy<Value = Owned> {
    // Half of the frames full of 0xBC: the sync byte is not escaped.
    prop_oneof![
        tdoa2_frame(),
        tdoa3_frame(),
        tdoa2_frame().prop_map(|mut f| {
            for b in f.payload.iter_mut().take(tdoa2::LEN).skip(9).step_by(3) {
                *b = SYNC;
            }
            f
        })
    ]
}

/// What the device may say between frames.
const BOOT_TEXT: &[u8] =
    b"\r\n====================\r\nSYSTEM\t: CPU-ID: 0123\r\nCONFIG: Mode Sniffer\r\n";

#[derive(Debug, Clone)]
enum Damage {
    Change(u8),
    Delete,
    Insert(u8),
}

proptest! {
    #[test]
    fn prop_any_chunking_gives_the_same(
        frames in prop::collection::vec(frame(), 1..8),
        noise in prop::collection::vec(any::<u8>(), 0..60),
        at in 0..60usize,
        chunks in prop::collection::vec(0..40usize, 0..60),
    ) {
        let mut stream = Vec::new();
        frames.iter().for_each(|f| f.encode(&mut stream));
        let at = at.min(stream.len());
        stream.splice(at..at, noise);
        prop_assert_eq!(at_once(&stream), hear(&stream, chunks.into_iter()));
    }

    #[test]
    fn prop_encode_then_decode_is_identity(frames in prop::collection::vec(frame(), 1..8)) {
        let mut stream = Vec::new();
        frames.iter().for_each(|f| f.encode(&mut stream));
        let heard = at_once(&stream);
        prop_assert_eq!(heard, Heard { frames, ..Default::default() });
    }

    /// All other frames come out. A false frame would need some 43 chance bits.
    #[test]
    fn prop_a_damaged_byte_costs_its_frame_only(
        frames in prop::collection::vec(frame(), 2..8),
        hit: prop::sample::Index,
        at: prop::sample::Index,
        damage in prop_oneof![
            any::<u8>().prop_map(Damage::Change),
            Just(Damage::Delete),
            any::<u8>().prop_map(Damage::Insert),
            Just(Damage::Insert(SYNC)),
        ],
    ) {
        let hit = hit.index(frames.len());
        let mut stream = Vec::new();
        for (i, f) in frames.iter().enumerate() {
            let mut bytes = Vec::new();
            f.encode(&mut bytes);
            if i == hit {
                let at = at.index(bytes.len());
                match damage {
                    Damage::Change(b) => bytes[at] = b,
                    Damage::Delete => drop(bytes.remove(at)),
                    Damage::Insert(b) => bytes.insert(at, b),
                }
            }
            stream.extend_from_slice(&bytes);
        }
        // Room for a false candidate at the end to complete and fail.
        stream.extend_from_slice(&[0; MAX_PAYLOAD + OVERHEAD]);
        let heard = at_once(&stream);
        let mut got = heard.frames.iter().peekable();
        for (i, f) in frames.iter().enumerate() {
            if i != hit {
                // The damaged frame itself may come out, with a changed value.
                while got.peek().is_some_and(|g| *g != f) {
                    got.next();
                }
                prop_assert!(got.next().is_some(), "frame {} of {} is lost", i, frames.len());
            }
        }
        prop_assert!(heard.frames.len() <= frames.len());
    }

    #[test]
    fn prop_garbage_is_conserved_and_never_panics(
        mut bytes in prop::collection::vec(any::<u8>(), 0..2000),
        marks in prop::collection::vec(0..2000usize, 0..100),
    ) {
        for at in marks {
            if let Some(b) = bytes.get_mut(at) {
                *b = SYNC;
            }
        }
        prop_assert_eq!(at_once(&bytes).frames, []);
    }

    #[test]
    fn prop_boot_text_between_frames_is_garbage(
        frames in prop::collection::vec(frame(), 1..8), cut: prop::sample::Index,
    ) {
        let cut = cut.index(frames.len());
        let mut stream = Vec::new();
        for (i, f) in frames.iter().enumerate() {
            if i == cut {
                stream.extend_from_slice(BOOT_TEXT);
            }
            f.encode(&mut stream);
        }
        let heard = at_once(&stream);
        prop_assert_eq!(heard.frames, frames);
        prop_assert_eq!(heard.garbage, BOOT_TEXT.len());
    }
}

#[test]
fn golden_frame_built_by_hand_decodes() {
    let heard = at_once(&GOLDEN);
    assert_eq!(heard.frames.len(), 1);
    let frame = &heard.frames[0];
    assert_eq!((frame.rx_ticks, frame.source, frame.destination), (0xFE_DCBA_9876, 2, 0xFF));
    let packet = Tdoa2Packet::decode(&frame.payload).unwrap();
    assert_eq!(packet.counters, [7, 0, 0x85, 0, 0, 0, 0, 0]);
    assert_eq!(packet.times, [0xA0B0_C0D0, 0, 0x1122_3344, 0, 0, 0, 0, 0]);
    assert_eq!(packet.tofs, [32951, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(packet.position, None);
    let mut again = Vec::new();
    frame.encode(&mut again);
    assert_eq!(again, GOLDEN);
}

/// Every single lost byte in a frame of nothing but sync bytes, between two good ones.
#[test]
fn prop_each_lost_byte_of_a_frame_is_survived() {
    let payload_full_of_sync = {
        let mut p = vec![SYNC; tdoa2::LEN];
        p[0] = tdoa2::TYPE;
        p
    };
    let middle = Owned { rx_ticks: 5, source: 3, destination: 0xFF, payload: payload_full_of_sync };
    let mut bytes = Vec::new();
    middle.encode(&mut bytes);
    for lost in 0..bytes.len() {
        let mut stream = GOLDEN.to_vec();
        let mut damaged = bytes.clone();
        damaged.remove(lost);
        stream.extend_from_slice(&damaged);
        stream.extend_from_slice(&GOLDEN);
        let heard = at_once(&stream);
        assert_eq!(heard.frames.len(), 2, "byte {lost}");
        assert_eq!(heard.garbage, bytes.len() - 1);
    }
}

#[test]
fn prop_meaning_is_checked_and_the_reason_told() {
    let check = |payload: &[u8], source: u8, reason: SnifferLoss| {
        let mut stream = Vec::new();
        encode(&mut stream, &SnifferFrame { rx_ticks: 1, source, destination: 0xFF, payload });
        let heard = at_once(&stream);
        assert_eq!((heard.frames.len(), heard.garbage), (0, stream.len()));
        assert_eq!(heard.other, [reason]);
    };
    let mut good = vec![0; tdoa2::LEN];
    good[0] = tdoa2::TYPE;
    check(&good, 8, SnifferLoss::BadSource);
    check(&good[..56], 0, SnifferLoss::BadPayload);
    check(&[0x21, 0, 0], 0, SnifferLoss::UnknownType);
    check(&[], 0, SnifferLoss::BadPayload);
    check(&[0x30, 0, 0, 0, 0, 0, 9], 0, SnifferLoss::BadPayload);
    let mut too_long = GOLDEN.to_vec();
    too_long[8] = 129;
    assert_eq!(at_once(&too_long).other, [SnifferLoss::BadLength]);
}
