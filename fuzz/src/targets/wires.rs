//! The codecs: sniffer stream, packets on the air, packets of a Crazyflie, MAVLink frames, signatures and doors.

use haltere_core::drops::Drops;
use haltere_core::time::HostTime;
use haltere_dialect::crtp::packet::{MAX_PACKET, Packet};
use haltere_dialect::crtp::value::Kind;
use haltere_dialect::crtp::{FromBoard, ToBoard, loco};
use haltere_dialect::lps::sniffer::{SnifferDecoder, encode};
use haltere_dialect::lps::tdoa2::Tdoa2Packet;
use haltere_dialect::lps::tdoa3::Tdoa3Packet;
use haltere_dialect::lps::text::TextDecoder;
use haltere_dialect::lps::{self};
use haltere_dialect::mav_stream::{self, MavSplitter};
use haltere_dialect::signing::{self as sign, SigningKey};
use haltere_pilot::guard::{Door, DoorConfig, KeyRing, KeySetup, RateLimit, Signing};

/// Both forms of the sniffer's stream: the same in any chunking, and what is a frame encodes to itself.
pub fn sniffer(data: &[u8]) {
    let Some((chunk, stream)) = data.split_first() else { return };
    let through = |chunk: usize| {
        let mut decoder = SnifferDecoder::new();
        let mut frames = Vec::new();
        for bytes in stream.chunks(chunk.max(1)) {
            decoder.push(bytes);
            while let Some(next) = decoder.next() {
                if let Ok(frame) = next {
                    let mut bytes = Vec::new();
                    encode(&mut bytes, &frame);
                    let _ = lps::check(bytes.get(6).copied().unwrap_or(0), frame.payload);
                    frames.push(bytes);
                }
            }
            assert!(decoder.pending() <= bytes.len() + 65_536);
        }
        frames
    };
    let whole = through(stream.len());
    assert_eq!(whole, through(usize::from(*chunk)));
    for frame in &whole {
        let mut decoder = SnifferDecoder::new();
        decoder.push(frame);
        assert!(matches!(decoder.next(), Some(Ok(_))), "a frame that does not read its own form");
    }
    let mut text = TextDecoder::new();
    for bytes in stream.chunks(usize::from(*chunk).max(1)) {
        text.push(bytes);
        while text.next().is_some() {}
    }
}

/// What decodes encodes to the same packet.
pub fn tdoa2(data: &[u8]) {
    if let Ok(packet) = Tdoa2Packet::decode(data) {
        let mut bytes = Vec::new();
        packet.encode(&mut bytes);
        let again = Tdoa2Packet::decode(&bytes).expect("what we encode decodes");
        assert_eq!(format!("{packet:?}"), format!("{again:?}"));
    }
}

/// The same for TDoA3.
pub fn tdoa3(data: &[u8]) {
    if let Ok(packet) = Tdoa3Packet::decode(data) {
        let mut bytes = Vec::new();
        packet.encode(&mut bytes);
        let again = Tdoa3Packet::decode(&bytes).expect("what we encode decodes");
        assert_eq!(format!("{packet:?}"), format!("{again:?}"));
    }
}

/// A packet read as either end would: what is a message is the same one after it was sent again.
pub fn crtp(data: &[u8]) {
    let _ = loco::anchors(data);
    let _ = loco::AnchorPosition::read(data);
    let Ok(packet) = Packet::read(data) else {
        assert!(data.is_empty() || data.len() > MAX_PACKET, "a packet that is not read");
        return;
    };
    if let Ok(message) = ToBoard::decode(&packet) {
        let sent = message.encode().expect("what fitted once fits again");
        let again = ToBoard::decode(&sent).expect("what we encode decodes");
        assert_eq!(format!("{message:?}"), format!("{again:?}"));
    }
    let Ok(message) = FromBoard::decode(&packet) else { return };
    let sent = message.encode().expect("what fitted once fits again");
    let again = FromBoard::decode(&sent).expect("what we encode decodes");
    assert_eq!(format!("{message:?}"), format!("{again:?}"));
    if let FromBoard::Row(row) = message {
        let kinds: Vec<_> = row.bytes.iter().filter_map(|code| Kind::of_log(*code)).collect();
        assert!(row.values(&kinds).is_none_or(|values| values.count() == kinds.len()));
    }
}

/// A stream of frames, damaged or not, and frames whose checksum is right around any payload.
pub fn mavlink(data: &[u8]) {
    let mut splitter = MavSplitter::new();
    let (mut passed, mut garbage) = (0, 0);
    splitter.push(data);
    let mut flushed = false;
    loop {
        match splitter.next() {
            Some(Ok(frame)) => {
                passed += frame.raw.len();
                let _ = mav_stream::heartbeat_of(&frame);
                let _ = frame.signature();
                if let Ok(message) = frame.decode() {
                    let _ = mav_stream::target(&message);
                }
            }
            Some(Err(mav_stream::MavLoss::GarbageBytes(n))) => garbage += n,
            Some(Err(_)) => {}
            None if !flushed => {
                flushed = true;
                splitter.flush();
            }
            None => break,
        }
    }
    assert_eq!(passed + garbage, data.len(), "every byte is accounted for");
    // Any id around any payload: what decodes encodes to what decodes the same.
    let Some((id, payload)) = data.split_first_chunk::<2>() else { return };
    let id = u32::from(u16::from_le_bytes(*id));
    let Some(message) = mav_stream::parse_payload(id, payload) else { return };
    let mut bytes = Vec::new();
    mav_stream::encode(&mut bytes, 1, 1, 0, &message);
    let mut splitter = MavSplitter::new();
    splitter.push(&bytes);
    let Some(Ok(frame)) = splitter.next() else {
        panic!("our own frame does not read: {message:?}")
    };
    let again = frame.decode().expect("our own frame decodes");
    assert_eq!(format!("{message:?}"), format!("{again:?}"));
}

/// Doors of every policy: nothing unsigned passes a demanding one, and only whole frames pass any.
pub fn signing(data: &[u8]) {
    let Some(([choice, chunk, seed], stream)) = data.split_first_chunk::<3>() else { return };
    let policies = [Signing::Off, Signing::Accept, Signing::Require];
    let policy = policies[usize::from(choice % 3)];
    let setups = [KeySetup::Never, KeySetup::Signed, KeySetup::Anybody];
    let config = DoorConfig {
        signing: policy,
        setup: setups[usize::from(choice / 3 % 3)],
        commanders: (choice & 0x40 != 0).then(|| [255].into()),
        unsigned: [109].into(),
        rate: (choice & 0x80 != 0).then_some(RateLimit { frames_per_s: 50.0, bytes_per_s: 5000.0 }),
        own: (Some(1), 1),
    };
    let key = SigningKey::new([1; 32]);
    let mut ring = KeyRing::new(key.clone(), 0);
    let mut door = Door::new(config);
    let (mut passed, mut drops) = (Vec::new(), Drops::default());
    // Between pieces of the stream stand frames that are signed as they should be.
    for (n, bytes) in stream.chunks(usize::from(*chunk).max(1)).enumerate() {
        let unix_us = 1_795_327_200_000_000 + n as i64 * 1000;
        let mut frame = Vec::new();
        mav_stream::encode_payload(&mut frame, *seed, 190, n as u8, u32::from(*seed), bytes);
        let stamp = sign::timestamp(unix_us) + u64::from(*seed) * 10_000;
        let signed = key.as_ref().and_then(|key| sign::sign(&frame, key, *seed, stamp));
        let at = HostTime::from_us(n as u64 * 1000);
        for bytes in [Some(bytes), signed.as_deref()].into_iter().flatten() {
            let _ = door.would_open(&ring, unix_us, bytes);
            door.admit(&mut ring, at, unix_us, bytes, &mut passed, &mut drops);
            door.seal(&mut ring, 2, unix_us, &mut bytes.to_vec());
        }
    }
    let mut splitter = MavSplitter::new();
    splitter.push(passed.get(..passed.len().min(60_000)).unwrap_or_default());
    while let Some(next) = splitter.next() {
        match next {
            Ok(frame) => {
                assert_ne!(frame.header.msg_id, 256, "a key went through");
                let fine = frame.signed || frame.header.msg_id == 109;
                assert!(policy != Signing::Require || fine);
            }
            // Signed frames of unknown ids are whole too; anything else is a hole in the door.
            Err(loss) => assert!(passed.len() > 60_000, "{loss:?}"),
        }
    }
}
