//! What passes the doors and what does not, counted by reason.

use haltere_dialect::mav::haltere::{
    HEARTBEAT_DATA, MavMessage, RADIO_STATUS_DATA, SETUP_SIGNING_DATA,
};
use haltere_dialect::mav_stream::{self, MavSplitter};
use haltere_dialect::signing::{self, SigningKey};

use super::ring::MOST_STREAMS;
use super::*;
use haltere_core::drops::{DropReason, Drops};
use haltere_core::time::HostTime;

/// 2026-11-22 06:00 UTC, µs since 1970.
const NOW: i64 = 1_795_327_200_000_000;
const RADIO_STATUS_ID: u32 = 109;

fn key(seed: u8) -> SigningKey {
    SigningKey::new([seed; 32]).unwrap()
}

fn config(signing: Signing, setup: KeySetup) -> DoorConfig {
    let unsigned = [RADIO_STATUS_ID].into();
    DoorConfig { signing, setup, commanders: None, unsigned, rate: None, own: (Some(1), 1) }
}

fn plain(system: u8, message: &MavMessage) -> Vec<u8> {
    let mut bytes = Vec::new();
    mav_stream::encode(&mut bytes, system, 190, 0, message);
    bytes
}

fn beat() -> Vec<u8> {
    plain(255, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()))
}

/// A heartbeat, signed so many seconds after `NOW`.
fn signed(key: &SigningKey, link: u8, after_s: f64) -> Vec<u8> {
    let at = signing::timestamp(NOW).saturating_add_signed((after_s * 1e5) as i64);
    signing::sign(&beat(), key, link, at).unwrap()
}

/// A door, the ring behind it, and what it counted.
struct Rig {
    door: Door,
    ring: KeyRing,
    drops: Drops,
    /// What our clock says, µs since 1970.
    now: i64,
}

impl Rig {
    fn new(config: DoorConfig, key: Option<SigningKey>) -> Self {
        let ring = KeyRing::new(key, 0);
        Self { door: Door::new(config), ring, drops: Drops::default(), now: NOW }
    }

    fn push(&mut self, bytes: &[u8]) -> (Vec<u8>, Option<KeyOffer>) {
        let mut passed = Vec::new();
        let at = HostTime::from_us(1_000_000);
        let Self { door, ring, drops, now } = self;
        let offer = door.admit(ring, at, *now, bytes, &mut passed, drops);
        (passed, offer)
    }

    fn passes(&mut self, bytes: &[u8]) -> bool {
        let (passed, _) = self.push(bytes);
        assert!(passed.is_empty() || passed == bytes);
        !passed.is_empty()
    }

    fn lost(&self) -> Vec<(DropReason, u64)> {
        self.drops.iter().collect()
    }
}

#[test]
fn prop_each_policy_lets_in_what_it_says() {
    let wrong = signed(&key(9), 0, 0.0);
    let right = |n: f64| signed(&key(1), 0, n);
    let radio = plain(51, &MavMessage::RADIO_STATUS(RADIO_STATUS_DATA::default()));
    let v1 = [0xFE, 9, 0, 255, 190, 0, 0, 0, 0, 0, 0, 0, 0, 0, 3];
    let mut off = Rig::new(config(Signing::Off, KeySetup::Never), Some(key(1)));
    assert!(off.passes(&beat()) && off.passes(&wrong) && off.passes(&right(0.0)));
    assert!(off.passes(&radio));
    let mut accept = Rig::new(config(Signing::Accept, KeySetup::Never), Some(key(1)));
    assert!(accept.passes(&beat()) && accept.passes(&right(0.0)) && accept.passes(&radio));
    assert!(!accept.passes(&wrong));
    assert_eq!(accept.lost(), [(DropReason::MavBadSignature, 1)]);
    let mut require = Rig::new(config(Signing::Require, KeySetup::Never), Some(key(1)));
    assert!(!require.passes(&beat()) && !require.passes(&wrong));
    assert!(require.passes(&right(0.0)) && require.passes(&radio));
    let crc = crc_v1(&v1);
    assert!(!require.passes(&[&v1[..], &crc].concat()), "version 1 cannot be signed");
    let wanted = [(DropReason::MavUnsigned, 2), (DropReason::MavBadSignature, 1)];
    assert_eq!(require.lost(), wanted);
    // Without a key nothing can be checked: an accepting door is open, a demanding one shut.
    let mut accept = Rig::new(config(Signing::Accept, KeySetup::Never), None);
    assert!(accept.passes(&wrong) && accept.passes(&beat()));
    let mut require = Rig::new(config(Signing::Require, KeySetup::Never), None);
    assert!(!require.passes(&right(0.0)) && !require.passes(&beat()));
}

/// Checksum of a version 1 HEARTBEAT, X.25 over all behind the marker and CRC_EXTRA 50.
fn crc_v1(frame: &[u8]) -> [u8; 2] {
    let mut crc = 0xFFFF_u16;
    for byte in frame[1..].iter().chain(&[50]) {
        let mut x = *byte ^ (crc & 0xFF) as u8;
        x ^= x << 4;
        crc = (crc >> 8) ^ (u16::from(x) << 8) ^ (u16::from(x) << 3) ^ (u16::from(x) >> 4);
    }
    crc.to_le_bytes()
}

#[test]
fn prop_nothing_comes_in_twice_and_nothing_old_begins_a_stream() {
    let mut rig = Rig::new(config(Signing::Require, KeySetup::Never), Some(key(1)));
    let first = signed(&key(1), 0, 0.0);
    assert!(rig.passes(&first));
    assert!(!rig.passes(&first), "replayed");
    assert!(!rig.passes(&signed(&key(1), 0, -0.1)), "older");
    assert!(rig.passes(&signed(&key(1), 0, 0.1)));
    assert_eq!(rig.lost(), [(DropReason::MavReplayed, 2)]);
    // Another link id is another stream: it may be behind, by a minute.
    assert!(rig.passes(&signed(&key(1), 1, -59.0)));
    assert!(!rig.passes(&signed(&key(1), 2, -61.0)));
    assert_eq!(rig.drops.count(DropReason::MavStaleTime), 1);
    // A stream that is known may be as old as it likes, as long as it grows.
    assert!(rig.passes(&signed(&key(1), 3, -50.0)));
    assert!(rig.passes(&signed(&key(1), 0, 3600.0)), "a station whose clock is ahead");
    assert!(rig.passes(&signed(&key(1), 3, -49.0)));
    assert!(rig.passes(&signed(&key(1), 4, 0.0)), "and no other is held to its time");
    // The same stream over another door: still a replay.
    let mut other = Door::new(config(Signing::Require, KeySetup::Never));
    let (mut passed, mut drops) = (Vec::new(), Drops::default());
    let again = signed(&key(1), 0, 0.1);
    other.admit(&mut rig.ring, HostTime::from_us(0), NOW, &again, &mut passed, &mut drops);
    assert_eq!(
        (passed.len(), drops.iter().collect::<Vec<_>>()),
        (0, vec![(DropReason::MavReplayed, 1)])
    );
}

#[test]
fn prop_a_restart_does_not_go_back() {
    let mut ring = KeyRing::new(Some(key(1)), 0);
    let due = ring.due_to_keep(NOW).expect("nothing is kept yet");
    ring.was_kept(due);
    assert_eq!(ring.due_to_keep(NOW), None);
    assert_eq!(ring.due_to_keep(NOW + 7_000_000), None);
    assert!(ring.due_to_keep(NOW + 9_000_000).is_some(), "before it is reached");
    let sent = ring.sign(&beat(), 0, NOW + 5_000_000).unwrap();
    // The power goes, and the clock begins in 1970.
    let mut again = KeyRing::new(Some(key(1)), due);
    let later = again.sign(&beat(), 0, 0).unwrap();
    let time = |bytes: &[u8]| {
        let mut splitter = MavSplitter::new();
        splitter.push(bytes);
        splitter.next().unwrap().unwrap().signature().unwrap().1
    };
    assert!(time(&later) > time(&sent));
    // What was recorded more than a minute before is not taken for new either.
    let mut rig = Rig::new(config(Signing::Require, KeySetup::Never), None);
    rig.ring = KeyRing::new(Some(key(1)), due);
    assert!(!rig.passes(&signed(&key(1), 0, -61.0)));
}

#[test]
fn prop_with_another_key_streams_begin_again_and_with_a_former_one_they_go_on() {
    let mut rig = Rig::new(config(Signing::Require, KeySetup::Never), Some(key(1)));
    let old = signed(&key(1), 0, -1.0);
    assert!(rig.passes(&old));
    assert!(rig.passes(&signed(&key(1), 0, 9.0)), "ahead of its clock, as we were");
    rig.ring.change(key(2), signing::timestamp(NOW), (255, 190), NOW);
    assert!(rig.passes(&signed(&key(2), 0, 0.0)), "by its clock again");
    assert!(!rig.passes(&signed(&key(2), 0, 0.0)), "once");
    assert!(!rig.passes(&old));
    rig.ring.change(key(2), signing::timestamp(NOW), (255, 190), NOW);
    assert!(!rig.passes(&signed(&key(2), 0, 0.0)), "the same key is no other one");
    rig.ring.change(key(1), signing::timestamp(NOW), (255, 190), NOW);
    assert!(!rig.passes(&old), "what was signed with it before stays old");
    assert!(rig.passes(&signed(&key(1), 0, 9.1)));
}

#[test]
fn prop_streams_are_bounded_and_none_is_forgotten_that_could_be_replayed() {
    let mut rig = Rig::new(config(Signing::Require, KeySetup::Never), Some(key(1)));
    let old = signed(&key(1), 0, -30.0);
    assert!(rig.passes(&old));
    let sign = |system: u8, component: u8, after_s: f64| {
        let mut bytes = Vec::new();
        let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        mav_stream::encode(&mut bytes, system, component, 0, &beat);
        let at = signing::timestamp(NOW).saturating_add_signed((after_s * 1e5) as i64);
        signing::sign(&bytes, &key(1), 0, at).unwrap()
    };
    for n in 0..1000_u16 {
        let _ = rig.passes(&sign(n as u8, (n >> 8) as u8, 0.0));
    }
    assert_eq!(rig.ring.streams(), MOST_STREAMS);
    assert!(!rig.passes(&old));
    // A minute later the oldest may go: what was recorded of it is too old for a new stream.
    rig.now = NOW + 61_000_000;
    assert!(rig.passes(&sign(0, 0, 61.0)));
    assert!(rig.passes(&sign(200, 200, 61.0)));
    assert_eq!(rig.ring.streams(), MOST_STREAMS);
    assert!(!rig.passes(&old));
}

#[test]
fn prop_a_key_comes_only_from_whom_it_may_and_goes_no_further() {
    let message = |bytes: [u8; 32], target: u8| {
        plain(
            255,
            &MavMessage::SETUP_SIGNING(SETUP_SIGNING_DATA {
                initial_timestamp: signing::timestamp(NOW) + 5,
                target_system: target,
                target_component: 0,
                secret_key: bytes,
            }),
        )
    };
    let offer = message([7; 32], 1);
    let signed_offer =
        |n: u64| signing::sign(&offer, &key(1), 0, signing::timestamp(NOW) + n).unwrap();
    for signing in [Signing::Off, Signing::Accept, Signing::Require] {
        let mut rig = Rig::new(config(signing, KeySetup::Never), Some(key(1)));
        assert_eq!(rig.push(&offer), (vec![], None));
        assert_eq!(rig.push(&signed_offer(0)), (vec![], None));
        assert!(rig.ring.is_key(&key(1)));
        let mut rig = Rig::new(config(signing, KeySetup::Signed), Some(key(1)));
        assert_eq!(rig.push(&offer), (vec![], None));
        let (passed, got) = rig.push(&signed_offer(0));
        assert!(passed.is_empty());
        // Where signatures are not looked at, none can allow anything.
        assert_eq!(got.is_some(), signing != Signing::Off, "{signing:?}");
        assert_eq!(rig.ring.is_key(&key(7)), signing != Signing::Off);
        let mut rig = Rig::new(config(signing, KeySetup::Anybody), None);
        assert_eq!(rig.push(&message([7; 32], 9)), (vec![], None), "for another vehicle");
        assert_eq!(rig.push(&message([0; 32], 1)), (vec![], None), "to sign no more");
        assert_eq!(rig.push(&offer), (vec![], Some(KeyOffer { key: key(7) })));
        assert_eq!(rig.push(&offer), (vec![], None), "the same again");
        assert_eq!(rig.drops.count(DropReason::SigningSetup), 3);
    }
}

#[test]
fn prop_bytes_that_were_kept_out_never_grow_together() {
    // The halves of an unsigned frame around a signed one, which passes alone.
    let mut rig = Rig::new(config(Signing::Require, KeySetup::Never), Some(key(1)));
    let frame = beat();
    let mut passed = Vec::new();
    for (n, cut) in (1..frame.len()).enumerate() {
        let good = signed(&key(1), 0, n as f64);
        passed.extend(rig.push(&[&frame[..cut], &good[..], &frame[cut..]].concat()).0);
        // Whatever is still waited for is given up.
        rig.door.reopen();
    }
    let mut splitter = MavSplitter::new();
    splitter.push(&passed);
    while let Some(next) = splitter.next() {
        assert!(next.expect("frames only").signed);
    }
}

#[test]
fn prop_in_any_chunking_the_same_passes() {
    let stream: Vec<u8> = (0..20)
        .flat_map(|n| [signed(&key(1), 0, f64::from(n)), beat(), vec![1, 0xFD, 2]].concat())
        .collect();
    let through = |chunk: usize| {
        let mut rig = Rig::new(config(Signing::Require, KeySetup::Never), Some(key(1)));
        let passed: Vec<u8> = stream.chunks(chunk).flat_map(|bytes| rig.push(bytes).0).collect();
        (passed, rig.drops.count(DropReason::MavUnsigned))
    };
    let whole = through(stream.len());
    assert!(whole.1 > 5 && !whole.0.is_empty());
    for chunk in [1, 2, 7, 64] {
        assert_eq!(through(chunk), whole);
    }
}

#[test]
fn prop_a_flood_is_cut_to_its_rate_and_counted() {
    let rate = Some(RateLimit { frames_per_s: 50.0, bytes_per_s: 1e6 });
    let mut rig =
        Rig::new(DoorConfig { rate, ..config(Signing::Off, KeySetup::Never) }, Some(key(1)));
    let passed = (0..500).filter(|_| rig.passes(&beat())).count();
    assert_eq!(passed, 50);
    assert_eq!(rig.lost(), [(DropReason::RateLimited, 450)]);
    // Garbage costs as much.
    let rate = Some(RateLimit { frames_per_s: 1e6, bytes_per_s: 10_000.0 });
    let mut rig =
        Rig::new(DoorConfig { rate, ..config(Signing::Off, KeySetup::Never) }, Some(key(1)));
    for _ in 0..100 {
        rig.push(&[0; 1000]);
    }
    let wanted = [(DropReason::MavGarbageByte, 10_000), (DropReason::RateLimited, 90)];
    assert_eq!(rig.lost(), wanted);
}

/// As a frame goes out.
fn sealed(door: &Door, ring: &mut KeyRing, frame: &[u8]) -> Vec<u8> {
    let mut frame = frame.to_vec();
    door.seal(ring, 4, NOW, &mut frame);
    frame
}

#[test]
fn prop_only_frames_of_our_own_are_signed() {
    let door = Door::new(config(Signing::Accept, KeySetup::Never));
    let mut ring = KeyRing::new(Some(key(1)), 0);
    let own = {
        let mut bytes = Vec::new();
        let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        mav_stream::encode(&mut bytes, 1, 1, 0, &beat);
        bytes
    };
    let times: Vec<_> = (0..3)
        .map(|_| {
            let sealed = sealed(&door, &mut ring, &own);
            let mut splitter = MavSplitter::new();
            splitter.push(&sealed);
            let frame = splitter.next().unwrap().unwrap();
            assert!(signing::verify(&frame, &key(1)));
            let (link, time) = frame.signature().unwrap();
            assert_eq!(link, 4);
            time
        })
        .collect();
    assert!(times.is_sorted_by(|a, b| a < b), "no timestamp twice: {times:?}");
    // Of others: as it came.
    assert_eq!(sealed(&door, &mut ring, &beat()), beat());
    let off = Door::new(config(Signing::Off, KeySetup::Never));
    assert_eq!(sealed(&off, &mut ring, &own), own);
    assert_eq!(sealed(&door, &mut ring, &[1, 2]), [1, 2]);
    assert_eq!(sealed(&door, &mut KeyRing::default(), &own), own);
}

#[test]
fn prop_strangers_must_show_a_signature_where_one_is_demanded() {
    let ring = KeyRing::new(Some(key(1)), 0);
    let demanding = Door::new(config(Signing::Require, KeySetup::Never));
    let refused = |bytes: &[u8]| demanding.would_open(&ring, NOW, bytes).unwrap_err();
    assert_eq!(refused(&beat()), DropReason::MavUnsigned);
    assert_eq!(refused(&[]), DropReason::MavUnsigned);
    assert_eq!(refused(&signed(&key(2), 0, 0.0)), DropReason::MavBadSignature);
    assert_eq!(refused(&signed(&key(1), 0, -100.0)), DropReason::MavStaleTime);
    let both = [beat(), signed(&key(1), 0, 0.0)].concat();
    assert_eq!(demanding.would_open(&ring, NOW, &both), Ok(()));
    let open = Door::new(config(Signing::Accept, KeySetup::Never));
    assert_eq!(open.would_open(&ring, NOW, &beat()), Ok(()));
}

/// A heartbeat of this link with any timestamp.
fn stamped(link: u8, timestamp: u64) -> Vec<u8> {
    signing::sign(&beat(), &key(1), link, timestamp).unwrap()
}

fn time_of(bytes: &[u8]) -> u64 {
    let mut splitter = MavSplitter::new();
    splitter.push(bytes);
    splitter.next().unwrap().unwrap().signature().unwrap().1
}

#[test]
fn regress_one_holder_at_the_end_of_time_shuts_out_nobody_and_no_restart() {
    let mut rig = Rig::new(config(Signing::Require, KeySetup::Never), Some(key(1)));
    for (link, timestamp) in [(1, (1 << 48) - 2), (2, signing::LAST_TIMESTAMP)] {
        assert!(rig.passes(&stamped(link, timestamp)), "however far ahead, once");
        assert!(!rig.passes(&stamped(link, timestamp)), "once");
    }
    let told = rig.ring.take_news();
    assert!(matches!(told, Some(TimeNews::Ahead { from: (255, 190), .. })), "{told:?}");
    assert_eq!(rig.ring.take_news(), None, "told once");
    // Right clocks, and those that are a minute behind ours, come in as before; older ones do not.
    for (link, after_s) in [(3, 0.0), (4, -0.5), (5, -59.0)] {
        assert!(rig.passes(&signed(&key(1), link, after_s)), "{after_s}");
    }
    assert!(!rig.passes(&signed(&key(1), 6, -61.0)));
    // What we sign stays near our clock: stations follow it.
    let minute = signing::timestamp(NOW) + MINUTE;
    for _ in 0..3 {
        let ours = time_of(&rig.ring.sign(&beat(), 0, NOW).unwrap());
        assert!(ours <= minute + 3, "{ours}");
    }
    // A restart believes what is kept, and hears the same.
    let kept = rig.ring.due_to_keep(NOW).unwrap();
    for kept in [kept, rig.ring.newest(NOW)] {
        assert!(kept <= minute + 11 * 100_000);
        let mut again = Rig::new(config(Signing::Require, KeySetup::Never), None);
        again.ring = KeyRing::new(Some(key(1)), kept);
        assert!(again.passes(&signed(&key(1), 3, 11.0)));
        assert_eq!(again.ring.take_news(), None);
    }
    // The file of an older build that was led astray.
    let mut again = Rig::new(config(Signing::Require, KeySetup::Never), None);
    again.ring = KeyRing::new(Some(key(1)), signing::LAST_TIMESTAMP);
    assert!(again.passes(&signed(&key(1), 3, 0.0)));
    assert!(matches!(again.ring.take_news(), Some(TimeNews::KeptUnused { .. })));
    assert!(time_of(&again.ring.sign(&beat(), 0, NOW).unwrap()) <= minute);
    assert!(again.ring.due_to_keep(NOW).unwrap() <= minute, "and it is written anew");
}

#[test]
fn regress_a_clock_that_begins_in_1970_takes_the_first_signed_time_and_tells() {
    let mut rig = Rig::new(config(Signing::Require, KeySetup::Never), Some(key(1)));
    rig.now = 5_000_000;
    // No time that can be: in for itself, and our time is not moved.
    assert!(rig.passes(&stamped(1, (1 << 48) - 2)));
    assert_eq!(rig.ring.take_news(), None);
    assert!(rig.passes(&signed(&key(1), 2, 0.0)));
    assert_eq!(rig.ring.take_news(), Some(TimeNews::Taken { from: (255, 190), unix_us: NOW }));
    // From here on it is a clock like any other, which goes on.
    rig.now += 30_000_000;
    assert!(rig.passes(&signed(&key(1), 3, -29.0)));
    assert!(!rig.passes(&signed(&key(1), 4, -31.0)), "a minute behind");
    assert!(rig.passes(&signed(&key(1), 5, 86_400.0)));
    assert!(rig.passes(&signed(&key(1), 6, 30.0)));
    let ours = time_of(&rig.ring.sign(&beat(), 0, rig.now).unwrap());
    let wanted = signing::timestamp(NOW + 30_000_000);
    assert!((wanted..=wanted + MINUTE + 1).contains(&ours), "{ours}");
    // The network sets it in flight: that counts.
    rig.now = NOW + 40_000_000;
    assert!(rig.passes(&signed(&key(1), 7, 40.0)) && rig.passes(&signed(&key(1), 3, 40.1)));
    assert!(!rig.passes(&signed(&key(1), 8, -21.0)));
    // What was kept over a restart is not gone behind.
    let mut rig = Rig::new(config(Signing::Require, KeySetup::Never), None);
    rig.ring = KeyRing::new(Some(key(1)), signing::timestamp(NOW));
    rig.now = 5_000_000;
    assert!(!rig.passes(&signed(&key(1), 1, -61.0)));
    assert!(rig.passes(&signed(&key(1), 1, 3600.0)));
    assert!(matches!(rig.ring.take_news(), Some(TimeNews::Taken { .. })));
}

#[test]
fn regress_a_clock_that_is_set_in_flight_shuts_nobody_out() {
    for step_s in [-3600.0, -5.0, 5.0, 3600.0, -10.0 * 86_400.0] {
        let mut rig = Rig::new(config(Signing::Require, KeySetup::Never), Some(key(1)));
        let due = rig.ring.due_to_keep(NOW).unwrap();
        rig.ring.was_kept(due);
        // Ours is wrong by the step, theirs is right.
        let wrong_by_s = step_s;
        assert_eq!(rig.passes(&signed(&key(1), 1, wrong_by_s)), wrong_by_s > -60.0, "{step_s}");
        let before = time_of(&rig.ring.sign(&beat(), 0, NOW).unwrap());
        rig.now = NOW + (step_s * 1e6) as i64;
        for (link, after_s) in [(1, 0.1), (2, -0.5), (3, 0.0)] {
            assert!(rig.passes(&signed(&key(1), link, step_s + after_s)), "{step_s} {link}");
        }
        assert!(!rig.passes(&signed(&key(1), 4, step_s - 61.0)), "{step_s}");
        let after = time_of(&rig.ring.sign(&beat(), 0, rig.now).unwrap());
        assert!(after > before, "no timestamp twice");
        // And a restart after it hears the same.
        if let Some(due) = rig.ring.due_to_keep(rig.now) {
            rig.ring.was_kept(due);
        }
        let mut again = Rig::new(config(Signing::Require, KeySetup::Never), None);
        again.ring = KeyRing::new(Some(key(1)), rig.ring.newest(rig.now));
        again.now = rig.now + 1_000_000;
        assert!(again.passes(&signed(&key(1), 2, step_s + 61.0)), "{step_s}");
    }
}

#[test]
fn regress_a_key_is_taken_from_commanders_alone() {
    let offer = |system: u8| {
        plain(
            system,
            &MavMessage::SETUP_SIGNING(SETUP_SIGNING_DATA {
                initial_timestamp: (1 << 48) - 2,
                target_system: 1,
                target_component: 1,
                secret_key: [7; 32],
            }),
        )
    };
    for setup in [KeySetup::Signed, KeySetup::Anybody] {
        let commanders = Some([255].into());
        let config = DoorConfig { commanders, ..config(Signing::Require, setup) };
        let mut rig = Rig::new(config, Some(key(1)));
        let now = signing::timestamp(NOW);
        let others = signing::sign(&offer(7), &key(1), 0, now).unwrap();
        assert_eq!(rig.push(&others), (vec![], None));
        assert_eq!(rig.drops.count(DropReason::SigningSetup), 1);
        assert!(rig.ring.is_key(&key(1)));
        let theirs = signing::sign(&offer(255), &key(1), 0, now).unwrap();
        assert!(rig.push(&theirs).1.is_some());
        // The time that comes with a key moves ours no further than a signature.
        assert!(time_of(&rig.ring.sign(&beat(), 0, NOW).unwrap()) <= now + MINUTE);
        let right = signing::sign(&beat(), &key(7), 3, now).unwrap();
        assert!(rig.passes(&right));
    }
}
