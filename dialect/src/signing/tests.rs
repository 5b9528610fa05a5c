//! Signatures against pymavlink's, and against every kind of damage.

use proptest::prelude::*;

use super::*;
use crate::mav_stream::MavSplitter;

/// What pymavlink 2.4.50 signs with the key 1, 2, … 32, link 7, timestamps from 0x0102030405 on:
/// `MAVLink(None, 255, 190)` with `signing.secret_key`, `link_id`, `timestamp`, `sign_outgoing`, then
/// `pack` of HEARTBEAT(6, 8, 0, 0, 4, 3), COMMAND_LONG(1, 1, 400, 0, 1, 0, …) and
/// PING(123456789, 5, 0, 0).
const SIGNED: [(u64, &str); 3] = [
    (0x01_0203_0405, "fd09010000ffbe000000000000000608000403dab00705040302010097c89a7225af"),
    (
        0x01_0203_0406,
        "fd20010000ffbe4c00000000803f0000000000000000000000000000000000000000000000009001010149d0\
         07060403020100905c932f735a",
    ),
    (0x01_0203_0407, "fd09010000ffbe04000015cd5b0700000000050dc207070403020100730f49b35f65"),
];

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2).map(|n| u8::from_str_radix(&hex[2 * n..2 * n + 2], 16).unwrap()).collect()
}

fn key() -> SigningKey {
    SigningKey::new(std::array::from_fn(|n| n as u8 + 1)).unwrap()
}

/// The one frame in these bytes, handed to `look`.
fn with_frame<T>(bytes: &[u8], look: impl FnOnce(&MavFrame<'_>) -> T) -> Option<T> {
    let mut splitter = MavSplitter::new();
    splitter.push(bytes);
    match splitter.next()? {
        Ok(frame) => Some(look(&frame)),
        Err(_) => None,
    }
}

#[test]
fn val_frames_of_pymavlink_verify() {
    for (timestamp, hex) in SIGNED {
        let raw = bytes(hex);
        let (fits, signature) = with_frame(&raw, |f| (verify(f, &key()), f.signature())).unwrap();
        assert!(fits, "{hex}");
        assert_eq!(signature, Some((7, timestamp)));
        let other = SigningKey::new([9; KEY_BYTES]).unwrap();
        assert_eq!(with_frame(&raw, |f| verify(f, &other)), Some(false));
    }
}

#[test]
fn val_our_signatures_are_those_of_pymavlink() {
    for (timestamp, hex) in SIGNED {
        let signed = bytes(hex);
        let mut plain = Vec::new();
        with_frame(&signed, |f| {
            let h = f.header;
            let (system, component) = (h.system_id, h.component_id);
            mav_stream::encode_payload(
                &mut plain, system, component, h.sequence, h.msg_id, f.payload,
            );
        })
        .unwrap();
        assert_eq!(sign(&plain, &key(), 7, timestamp), Some(signed));
    }
}

#[test]
fn prop_no_changed_bit_verifies() {
    let signed = bytes(SIGNED[1].1);
    for at in 0..signed.len() {
        for bit in 0..8 {
            let mut damaged = signed.clone();
            damaged[at] ^= 1 << bit;
            assert_ne!(with_frame(&damaged, |f| verify(f, &key())), Some(true), "{at}.{bit}");
        }
    }
}

#[test]
fn prop_only_whole_unsigned_known_frames_are_signed() {
    let mut plain = Vec::new();
    mav_stream::encode_payload(&mut plain, 1, 1, 0, 0, &[0; 9]);
    assert!(sign(&plain, &key(), 0, 1).is_some());
    for end in 0..plain.len() {
        assert_eq!(sign(&plain[..end], &key(), 0, 1), None, "{end}");
    }
    let signed = sign(&plain, &key(), 0, 1).unwrap();
    assert_eq!(sign(&signed, &key(), 0, 2), None);
    let mut unknown = Vec::new();
    mav_stream::encode_payload(&mut unknown, 1, 1, 0, 31_337, &[1, 2]);
    assert_eq!(sign(&unknown, &key(), 0, 1), None);
}

#[test]
fn prop_keys_come_from_bytes_or_digits_and_are_not_printed() {
    let key = key();
    assert_eq!(SigningKey::from_file(&key.0), Some(key.clone()));
    assert_eq!(SigningKey::from_file(key.to_file().as_bytes()), Some(key.clone()));
    let upper = key.to_file().to_uppercase() + "\n  ";
    assert_eq!(SigningKey::from_file(upper.as_bytes()), Some(key.clone()));
    let zeros = "0".repeat(64);
    for bad in [&b""[..], &[0; 32], &[1; 31], &[1; 33], zeros.as_bytes(), &[b'g'; 64], &[b'+'; 64]]
    {
        assert_eq!(SigningKey::from_file(bad), None, "{bad:?}");
    }
    assert_eq!(format!("{key:?}"), "SigningKey(…)");
}

#[test]
fn val_the_epoch_is_that_of_the_guide() {
    assert_eq!(timestamp(i64::MIN), 0);
    assert_eq!(timestamp(EPOCH_UNIX_S * 1_000_000), 0);
    assert_eq!(timestamp(EPOCH_UNIX_S * 1_000_000 + 1_000_000), TIMESTAMPS_PER_S);
    assert_eq!(timestamp(i64::MAX), LAST_TIMESTAMP);
}

proptest! {
    #[test]
    fn prop_what_we_sign_verifies(
        payload in prop::collection::vec(any::<u8>(), 0..=255),
        link in any::<u8>(),
        at in any::<u64>(),
    ) {
        let mut plain = Vec::new();
        mav_stream::encode_payload(&mut plain, 3, 4, 5, 110, &payload);
        let signed = sign(&plain, &key(), link, at).unwrap();
        let seen = with_frame(&signed, |f| (verify(f, &key()), f.signature(), f.payload.to_vec()));
        prop_assert_eq!(seen, Some((true, Some((link, at.min(LAST_TIMESTAMP))), payload)));
    }

    #[test]
    fn prop_no_bytes_panic(raw in prop::collection::vec(any::<u8>(), 0..64)) {
        let _ = sign(&raw, &key(), 0, 0);
        let _ = with_frame(&raw, |f| verify(f, &key()));
    }
}
