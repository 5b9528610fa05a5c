//! Record, read back, cut, damage, overflow.

use std::io::{self, Seek, Write};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};

use super::channels::Decoded;
use super::writer::LogWriter;
use super::*;
use haltere_core::drops::{DropReason, Drops};
use haltere_core::estimate::{Estimate, Health};
use haltere_core::frames::{B, E, Rot, Vec3};
use haltere_core::measure::{
    AnchorId, BaroSample, BatterySample, BoardAttitude, ImuSample, MagSample, OtherBattery,
    ReferencePose, ServoOutput, Tdoa,
};
use haltere_core::survey::Survey;
use haltere_core::time::HostTime;
use haltere_core::topics::{
    ControlRecord, HealthRecord, ModeRecord, Saturation, ShadowRecord, TextRecord, Topic, UwbRecord,
};
use haltere_pilot::{LinkId, Recording};

pub(crate) fn session() -> Session {
    let anchors: Vec<_> = (0..8u8)
        .map(|i| {
            let at = |bit: u8, far: f64| if i & bit != 0 { far } else { 0.1 };
            (AnchorId(i), Vec3::new(at(1, 7.7), at(2, 9.3), -at(4, 3.1)))
        })
        .collect();
    Session {
        build: BuildIdentity::current(),
        started_unix_us: 1_795_269_763_000_000,
        pilot_started_at: HostTime::from_us(5_000_000),
        config_toml: "[tag]\nport = \"auto\"\n".into(),
        survey: Survey::new(&anchors).unwrap(),
    }
}

fn topics(at: HostTime) -> Vec<Topic> {
    let v = |x| Vec3::<E>::new(x, -x, 0.5 * x);
    let w = |x| Vec3::<B>::new(x, 2.0 * x, -x);
    let R = Rot::<E, B>::from_euler_rad(0.1, -0.2, 1.5);
    let mut drops = Drops::default();
    drops.add(DropReason::TagBadLength, 7);
    vec![
        Topic::Imu(ImuSample {
            valid_at: at.offset_us(-900),
            received_at: at,
            acc_B_mps2: w(9.8),
            rate_B_radps: w(0.3),
        }),
        Topic::Uwb(UwbRecord {
            tdoa: Tdoa {
                valid_at: at.offset_us(-400),
                received_at: at,
                anchor_a: AnchorId(3),
                anchor_b: AnchorId(200),
                distance_diff_m: 1.25,
                std_m: Some(0.1),
            },
            innovation_m: -0.07,
            var_innovation_m2: 0.02,
            test_ratio: 0.4,
            fused: true,
        }),
        Topic::Estimate(Estimate {
            at,
            pos_E_m: v(1.0),
            vel_B_mps: w(0.5),
            R_EB: R,
            rate_B_radps: w(0.1),
            std_pos_E_m: v(0.1),
            std_vel_B_mps: w(0.2),
            std_att_B_rad: w(0.01),
            uwb_noise_factor: 0.5,
            health: Health::Degraded,
        }),
        Topic::Control(ControlRecord {
            at,
            pos_setpoint_E_m: [Some(1.0), None, Some(-1.2)],
            vel_setpoint_E_mps: v(0.3),
            thrust_frac: 0.6,
            saturation: Saturation { tilt: true, ..Saturation::default() },
            ..ControlRecord::default()
        }),
        Topic::Shadow(ShadowRecord {
            at,
            place_E_m: v(2.0),
            attitude: R,
            thrust_frac: 0.55,
            theirs: Some((R, 0.6)),
        }),
        Topic::Battery(BatterySample {
            received_at: at,
            supply_v: 7.9,
            current_a: None,
            remaining_frac: Some(0.8),
        }),
        Topic::OtherBattery(OtherBattery {
            id: 3,
            function: 4,
            sample: BatterySample {
                received_at: at,
                supply_v: 8.3,
                current_a: Some(0.1),
                remaining_frac: None,
            },
        }),
        Topic::Servos(ServoOutput::new(at, 1, [1500.0, 1100.0, 1900.0])),
        Topic::BoardAttitude(BoardAttitude { valid_at: at, received_at: at, attitude: R }),
        Topic::Baro(BaroSample { valid_at: at, received_at: at, pressure_pa: 101_325.0 }),
        Topic::Mag(MagSample {
            valid_at: at,
            received_at: at,
            field_B_tesla: Vec3::new(2e-5, 1e-6, 4e-5),
        }),
        Topic::Reference(ReferencePose {
            valid_at: at,
            received_at: at,
            pos_E_m: v(2.0),
            attitude: Some(R),
        }),
        Topic::Mode(ModeRecord { at, mode: "hold", armed: true, cause: "ground".into() }),
        Topic::Text(TextRecord { at, severity: 4, text: "UWB lost".into() }),
        Topic::Health(HealthRecord {
            at,
            drops: vec![(0, drops)].into(),
            deadline_misses: 1,
            control_steps: 100,
            uwb_age_s: None,
            imu_age_s: Some(0.002),
            std_board_clock_s: Some(1e-4),
            left_out: 0b100,
        }),
    ]
}

/// Records a bit of everything and returns what a reader must yield.
fn script(recorder: &mut Recorder, cycles: u64) -> Vec<Entry> {
    let mut expected = Vec::new();
    let mut sequence = 0;
    let mut next = || {
        sequence += 1;
        sequence
    };
    for cycle in 0..cycles {
        let at = HostTime::from_us(5_000_000 + cycle * 10_000);
        let inputs = [
            RawInput::LinkUp { link: LinkId::Tag },
            RawInput::Peer {
                link: LinkId::Board,
                address: std::net::SocketAddr::from(([10, 0, 0, 7], 14_550)),
            },
            RawInput::Bytes { link: LinkId::Tag, bytes: vec![cycle as u8; 33] },
            RawInput::Bytes { link: LinkId::Board, bytes: vec![0xfd, 0, cycle as u8] },
            RawInput::Bytes { link: LinkId::Ground(3), bytes: vec![] },
            RawInput::Backlog { link: LinkId::Ground(3), is_full: cycle % 2 == 0 },
            RawInput::LinkDown { link: LinkId::Ground(3) },
            RawInput::Lost { link: LinkId::Board, reason: DropReason::InputQueueFull, count: 3 },
            RawInput::Calendar { unix_us: 1_795_000_000_000_000 },
            RawInput::EndAsked,
            RawInput::Recording { state: Recording::Waits, why: "0.9 GB free".into() },
            RawInput::File { ticket: 7, fault: None, bytes: vec![1, 2, 3] },
            RawInput::File {
                ticket: 8,
                fault: Some(haltere_pilot::services::FileFault::NotFound),
                bytes: vec![],
            },
            RawInput::Wake,
        ];
        for (i, input) in inputs.into_iter().enumerate() {
            let at = at.offset_us(i as i64);
            recorder.input(at, input.as_input());
            expected.push(Entry::Input { sequence: next(), at, input });
        }
        for link in [LinkId::Board, LinkId::Ground(0), LinkId::Tag] {
            let bytes = vec![0x55; 5 + cycle as usize % 50];
            recorder.output(at, link, &bytes);
            expected.push(Entry::Output { sequence: next(), at, link, bytes });
        }
        for topic in topics(at) {
            expected.push(Entry::Decoded(Decoded::from_topic(&topic)));
            recorder.topic(at, topic);
        }
        recorder.commit(at);
    }
    expected
}

pub(super) fn read(bytes: &[u8]) -> Result<(Vec<Entry>, LogEnd), LogError> {
    let log = LogReader::from_bytes("test.mcap".into(), bytes.to_vec())?;
    let mut entries = log.entries();
    let all = entries.by_ref().collect();
    Ok((all, entries.end()))
}

/// A medium in memory.
#[derive(Clone, Default)]
pub(super) struct Memory(Arc<Mutex<io::Cursor<Vec<u8>>>>);

impl Memory {
    pub(super) fn bytes(&self) -> Vec<u8> {
        self.0.lock().unwrap().get_ref().clone()
    }
}

impl Write for Memory {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.lock().unwrap().write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Memory {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        self.0.lock().unwrap().seek(to)
    }
}

pub(super) fn in_memory() -> (Memory, LogWriter<Memory>) {
    let memory = Memory::default();
    let sync = Box::new(|| Ok(()));
    let log = LogWriter::on(PathBuf::from("memory"), memory.clone(), sync, &session()).unwrap();
    (memory, log)
}

#[test]
fn prop_what_is_recorded_is_read_back() {
    let directory = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::start(directory.path(), &session()).unwrap();
    let expected = script(&mut recorder, 200);
    let summary = recorder.finish();
    assert!(summary.error.is_none());
    assert_eq!(summary.lost_entries, 0);
    let log = LogReader::open(summary.path.unwrap()).unwrap();
    assert_eq!(log.session(), &session());
    let mut entries = log.entries();
    let mut got: Vec<_> = entries.by_ref().collect();
    assert_eq!(entries.end(), LogEnd::Complete);
    let Some(Entry::Closing(closing)) = got.pop() else { panic!("closing missing") };
    assert_eq!(closing.last_sequence, 200 * 17);
    assert_eq!(closing.lost_entries, 0);
    assert!(got == expected);
}

#[test]
fn prop_every_topic_has_a_channel() {
    let at = HostTime::from_us(77);
    for topic in topics(at) {
        let decoded = Decoded::from_topic(&topic);
        assert_eq!(decoded.at(), at);
        let mut bytes = Vec::new();
        decoded.encode(&mut bytes);
        assert_eq!(Decoded::decode(decoded.channel(), &bytes), Some(Ok(decoded.clone())));
    }
    assert_eq!(Decoded::CHANNELS.len(), topics(at).len() + 1, "the topics and /glue");
}

#[test]
fn prop_a_cut_log_is_a_prefix() {
    // Chunks of some batches, so that cuts fall between, inside and at the end of chunks.
    let (memory, mut log) = in_memory();
    log.chunk_bytes = 900;
    let topics = topics(HostTime::from_us(1));
    let mut expected = Vec::new();
    for sequence in 1..=30 {
        let at = HostTime::from_us(sequence * 10);
        let bytes = vec![sequence as u8; 40];
        log.raw(false, LinkId::Tag, at, sequence, &bytes).unwrap();
        let input = RawInput::Bytes { link: LinkId::Tag, bytes };
        expected.push(Entry::Input { sequence, at, input });
        let decoded = Decoded::from_topic(&topics[sequence as usize % topics.len()]);
        log.decoded(&decoded).unwrap();
        expected.push(Entry::Decoded(decoded));
        if sequence % 3 == 0 {
            log.persist().unwrap();
        }
    }
    let open = memory.bytes();
    log.finish().unwrap();
    let closed = memory.bytes();
    assert_eq!(read(&closed).unwrap(), (expected.clone(), LogEnd::Complete));
    // Power loss right after a sync costs nothing.
    assert_eq!(read(&open).unwrap(), (expected.clone(), LogEnd::Cut { offset: open.len() as u64 }));

    let head = {
        let (memory, _log) = in_memory();
        memory.bytes().len()
    };
    assert_eq!(read(&open[..head]).unwrap().0, [], "the head alone is a log");
    let mut longest = 0;
    // A stride that is prime to the record sizes visits every kind of place.
    let end = open.len() - 300;
    for cut in (0..end).step_by(7).chain(end..=open.len()) {
        match read(&open[..cut]) {
            Ok((got, LogEnd::Cut { offset })) => {
                assert!(offset <= cut as u64);
                assert!(expected.starts_with(&got), "cut at {cut}");
                assert!(got.len() >= longest, "cut at {cut} reads less than an earlier one");
                longest = got.len();
            }
            Ok((_, other)) => panic!("cut at {cut}: {other}"),
            Err(LogError::NoHead { .. }) => assert!(cut < head, "cut at {cut}"),
            Err(other) => panic!("cut at {cut}: {other}"),
        }
    }
    assert_eq!(longest, expected.len(), "nothing is lost in the open chunk");
}

#[test]
fn prop_a_chunk_tells_its_length_only_when_all_of_it_is_permanent() {
    // What a power cut leaves: the medium as it was at the last sync.
    let memory = Memory::default();
    let safe = Arc::new(Mutex::new(Vec::new()));
    let (medium, saved) = (memory.clone(), safe.clone());
    let sync = Box::new(move || {
        *saved.lock().unwrap() = medium.bytes();
        Ok(())
    });
    let mut log = LogWriter::on("memory".into(), memory.clone(), sync, &session()).unwrap();
    log.chunk_bytes = 2000;
    for sequence in 1..=200 {
        let at = HostTime::from_us(sequence * 10);
        log.raw(false, LinkId::Tag, at, sequence, &[7; 90]).unwrap();
        if sequence % 4 == 0 {
            log.persist().unwrap();
        }
        let kept = safe.lock().unwrap().clone();
        let (got, _) = read(&kept).unwrap();
        assert!(got.len() as u64 >= sequence / 4 * 4, "{} of {sequence}", got.len());
        // The head of a chunk, but not what was in it, came to the disk: nothing claims to be whole.
        let now = memory.bytes();
        let mut torn = now[..kept.len().min(now.len())].to_vec();
        torn.resize(now.len(), 0);
        let (got, _) = read(&torn).unwrap();
        assert!(got.len() as u64 >= sequence / 4 * 4, "torn: {} of {sequence}", got.len());
    }
    log.finish().unwrap();
    assert_eq!(read(&memory.bytes()).unwrap().1, LogEnd::Complete);
    let summary = mcap::Summary::read(&memory.bytes()).unwrap().unwrap();
    // 200 messages of some 133 bytes, 16 to a chunk, and two of the head.
    assert!((14..=16).contains(&summary.chunk_indexes.len()), "{}", summary.chunk_indexes.len());
}

#[test]
fn prop_damage_costs_what_is_damaged_and_never_panics() {
    let (memory, mut log) = in_memory();
    log.chunk_bytes = 300;
    for sequence in 1..=20 {
        let at = HostTime::from_us(sequence * 10);
        log.raw(true, LinkId::Board, at, sequence, &[sequence as u8; 25]).unwrap();
        if sequence % 5 == 0 {
            log.persist().unwrap();
        }
    }
    log.finish().unwrap();
    let bytes = memory.bytes();
    let (whole, _) = read(&bytes).unwrap();
    for at in (0..bytes.len()).step_by(11) {
        for flip in [0x01, 0x80, 0xff] {
            let mut damaged = bytes.clone();
            damaged[at] ^= flip;
            // Checksums cover the chunks: what is read is what was written, in its order.
            if let Ok((got, _)) = read(&damaged) {
                let mut rest = whole.iter();
                assert!(got.iter().all(|entry| rest.any(|w| w == entry)), "byte {at}");
            }
        }
    }
    // Blocks that the file system allocated but never wrote are zeros.
    let mut torn = bytes[..bytes.len() / 2].to_vec();
    torn.extend([0; 4096]);
    let (got, end) = read(&torn).unwrap();
    assert!(whole.starts_with(&got));
    assert!(matches!(end, LogEnd::Damaged { .. }), "{end}");
}

#[test]
fn prop_other_files_are_refused_with_place_and_way_out() {
    let check = |bytes: &[u8], says: &str| {
        let error = read(bytes).unwrap_err().to_string();
        assert!(error.contains(says), "{error}");
        assert!(error.starts_with("test.mcap: byte "), "{error}");
    };
    check(b"time,x,y,z\n", "not an MCAP file; a flight log is named");
    check(b"", "byte 0: the file ends before the head");
    check(&mcap::MAGIC[..5], "byte 5: the file ends");
    check(mcap::MAGIC, "byte 8: the file ends");
    let mut garbage = mcap::MAGIC.to_vec();
    garbage.extend([0x77; 64]);
    check(&garbage, "byte 8: no record has this length");
    let mut foreign =
        mcap::WriteOptions::new().compression(None).create(io::Cursor::new(Vec::new())).unwrap();
    let channel = foreign.add_channel(0, "/chatter", "ros1", &Default::default()).unwrap();
    let header = mcap::records::MessageHeader {
        channel_id: channel,
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    foreign.write_to_known_channel(&header, b"hello").unwrap();
    foreign.finish().unwrap();
    let bytes = foreign.into_inner().into_inner();
    check(&bytes, "the first message is on channel /chatter, not on /config");
}

#[test]
fn prop_the_log_of_a_newer_build_is_refused_with_the_way_out() {
    let newest = haltere_core::checks::schema::Schema::LOG.newest();
    let of_version = |schema_version: u32| {
        let head = pb::Session { schema_version, ..session().message() };
        let mut log = mcap::WriteOptions::new()
            .compression(None)
            .create(io::Cursor::new(Vec::new()))
            .unwrap();
        let channel = log.add_channel(0, "/config", "protobuf", &Default::default()).unwrap();
        let header = mcap::records::MessageHeader {
            channel_id: channel,
            sequence: 0,
            log_time: 0,
            publish_time: 0,
        };
        log.write_to_known_channel(&header, &prost::Message::encode_to_vec(&head)).unwrap();
        log.finish().unwrap();
        log.into_inner().into_inner()
    };
    assert_eq!(session().message().schema_version, newest);
    // 0 is what a log says that was written before there were versions.
    for known in [0, 1, newest] {
        read(&of_version(known)).unwrap();
    }
    let error = read(&of_version(newest + 1)).unwrap_err().to_string();
    let says = format!("test.mcap: schema version {} of the log, this build (", newest + 1);
    assert!(error.starts_with(&says), "{error}");
    assert!(
        error.contains("install that one, or read it with the build that wrote it (haltere "),
        "{error}"
    );
}

#[test]
fn prop_recovery_completes_a_cut_log() {
    let directory = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::start(directory.path(), &session()).unwrap();
    script(&mut recorder, 50);
    let path = recorder.finish().path.unwrap();
    let bytes = std::fs::read(&path).unwrap();
    // The index at the end is lost, and with it the proper end.
    let whole = read(&bytes).unwrap().0;
    let cut = directory.path().join("cut.mcap");
    std::fs::write(&cut, &bytes[..bytes.len() - 20_000]).unwrap();
    let to = recovered_name(&cut);
    let (saved, end) = recover(&cut, &to).unwrap();
    assert!(matches!(end, LogEnd::Cut { .. } | LogEnd::Complete), "{end}");
    let (got, end) = read(&std::fs::read(&to).unwrap()).unwrap();
    assert_eq!(end, LogEnd::Complete);
    assert_eq!(got.len() as u64 + 2, saved, "and the head, twice");
    assert!(whole.starts_with(&got));
    // The crate's own reader accepts it without leniency.
    let bytes = std::fs::read(&to).unwrap();
    let messages: Result<Vec<_>, _> = mcap::MessageStream::new(&bytes).unwrap().collect();
    assert_eq!(messages.unwrap().len() as u64, saved);
    assert!(recover(&cut, &to).is_err(), "nothing is overwritten");
}

/// A medium whose writes wait for permission.
struct Gate {
    inner: Memory,
    waiting: SyncSender<()>,
    open: Receiver<()>,
    /// Of the head: its two chunks, and what makes it permanent.
    free_flushes: u8,
}

impl Seek for Gate {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }
}

impl Write for Gate {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.inner.write(bytes)
    }
    fn flush(&mut self) -> io::Result<()> {
        match self.free_flushes.checked_sub(1) {
            Some(left) => self.free_flushes = left,
            None => {
                let _ = self.waiting.try_send(());
                let _ = self.open.recv();
            }
        }
        Ok(())
    }
}

#[test]
fn prop_an_overflow_is_a_hole_in_the_log() {
    let memory = Memory::default();
    let (waiting, stalled) = sync_channel(1);
    let (let_go, open) = sync_channel(100);
    let gate = Gate { inner: memory.clone(), waiting, open, free_flushes: 3 };
    let sync = Box::new(|| Ok(()));
    let log = LogWriter::on("gate".into(), gate, sync, &session()).unwrap();
    let mut recorder = Recorder::spawn(log, 2).unwrap();
    let wake = |recorder: &mut Recorder, from: u64, to: u64| {
        for i in from..to {
            let at = HostTime::from_us(5_000_000 + i * 10_000);
            recorder.input(at, haltere_pilot::Input::Wake);
            recorder.commit(at);
        }
    };
    wake(&mut recorder, 0, 1);
    stalled.recv().unwrap(); // the disk stalls in its first periodic flush
    // The caller never waits: the disk is let go only below.
    wake(&mut recorder, 1, 4000);
    let lost = recorder.lost();
    assert!(lost > 3000, "{lost}");
    for _ in 0..100 {
        let _ = let_go.try_send(());
    }
    drop(let_go);
    let summary = recorder.finish();
    assert_eq!(summary.lost_entries, lost);

    let bytes = memory.bytes();
    let (entries, end) = read(&bytes).unwrap();
    assert_eq!(end, LogEnd::Complete);
    let mut expected = 1;
    let mut holes = 0;
    for entry in &entries {
        match entry {
            Entry::Input { sequence, .. } => {
                assert_eq!(*sequence, expected);
                expected += 1;
            }
            Entry::Hole(hole) => {
                assert_eq!(hole.first_sequence, expected);
                assert_eq!(hole.lost_raw, hole.last_sequence - hole.first_sequence + 1);
                assert!(hole.from_us < hole.to_us);
                expected = hole.last_sequence + 1;
                holes += 1;
            }
            Entry::Closing(closing) => assert_eq!(closing.lost_entries, lost),
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(expected, 4001, "every wake-up is there or in a hole");
    assert!(holes >= 1);
}

#[test]
fn prop_what_waits_for_a_stalled_disk_is_bounded_in_bytes_too() {
    let (waiting, stalled) = sync_channel(1);
    let (let_go, open) = sync_channel(100);
    let gate = Gate { inner: Memory::default(), waiting, open, free_flushes: 3 };
    let log = LogWriter::on("gate".into(), gate, Box::new(|| Ok(())), &session()).unwrap();
    // Room for more batches than memory could hold.
    let mut recorder = Recorder::spawn(log, 100_000).unwrap();
    let at = |i: u64| HostTime::from_us(5_000_000 + i * 30_000);
    recorder.input(at(0), haltere_pilot::Input::Wake);
    recorder.commit(at(0));
    stalled.recv().unwrap();
    let flood = vec![7; 1 << 20];
    for i in 1..200 {
        let link = haltere_pilot::LinkId::Ground(0);
        recorder.input(at(i), haltere_pilot::Input::Bytes { link, bytes: &flood });
        recorder.commit(at(i));
        recorder.commit(at(i + 1));
    }
    // 64 MiB wait, the rest is a hole.
    let lost = recorder.lost();
    assert!((130..=140).contains(&lost), "{lost}");
    for _ in 0..100 {
        let _ = let_go.try_send(());
    }
    drop(let_go);
    assert_eq!(recorder.finish().lost_entries, lost);
}

/// A medium that is full after some bytes.
struct Full {
    inner: Memory,
    room: usize,
}

impl Seek for Full {
    fn seek(&mut self, to: io::SeekFrom) -> io::Result<u64> {
        self.inner.seek(to)
    }
}

impl Write for Full {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self.room.checked_sub(bytes.len()) {
            Some(left) => {
                self.room = left;
                self.inner.write(bytes)
            }
            None => Err(io::Error::from(io::ErrorKind::StorageFull)),
        }
    }
    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// Wherever the disk becomes full, between a chunk and its head too, what was written is read.
#[test]
fn prop_a_disk_that_is_full_at_any_byte_leaves_a_log() {
    let mut most = 0;
    // Head, schema of the channel, and one message.
    let begun = {
        let (memory, mut log) = in_memory();
        log.raw(false, LinkId::Tag, HostTime::from_us(10), 1, &[7; 90]).unwrap();
        log.persist().unwrap();
        memory.bytes().len()
    };
    for room in begun..begun + 6000 {
        let inner = Memory::default();
        let full = Full { inner: inner.clone(), room };
        let begun = LogWriter::on("memory".into(), full, Box::new(|| Ok(())), &session());
        let Ok(mut log) = begun else { continue };
        log.chunk_bytes = 700;
        let mut written = 0;
        for sequence in 1..=40 {
            let at = HostTime::from_us(sequence * 10);
            log.raw(false, LinkId::Tag, at, sequence, &[7; 90]).unwrap();
            if log.fault().is_some() {
                break;
            }
            written = sequence as usize;
        }
        drop(log);
        match read(&inner.bytes()) {
            Ok((entries, LogEnd::Cut { .. } | LogEnd::Complete)) => {
                assert!(entries.len() + 1 >= written, "{room}: {} of {written}", entries.len());
                most = most.max(entries.len());
            }
            Ok((_, end)) => panic!("full after {room} bytes: {end}"),
            // The head itself found no room.
            Err(LogError::NoHead { .. }) => assert_eq!(written, 0, "{room}"),
            Err(other) => panic!("full after {room} bytes: {other}"),
        }
    }
    assert!(most > 20, "{most}");
}

#[test]
fn prop_a_full_disk_ends_the_recording_not_the_flight() {
    let sync = Box::new(|| Ok(()));
    let inner = Memory::default();
    let full = Full { inner: inner.clone(), room: 2_000_000 };
    let log = LogWriter::on("/logs/a.mcap".into(), full, sync, &session()).unwrap();
    let mut recorder = Recorder::spawn(log, 4096).unwrap();
    script(&mut recorder, 3000);
    let summary = recorder.finish();
    let error = summary.error.unwrap().to_string();
    assert!(error.starts_with("/logs/a.mcap: recording stopped: no storage space"), "{error}");
    assert!(summary.lost_entries > 0);
    // What was written stays readable, though its chunk was never closed.
    let (entries, end) = read(&inner.bytes()).unwrap();
    assert!(matches!(end, LogEnd::Cut { .. }), "{end}");
    assert!(entries.len() > 100, "{}", entries.len());
}

#[test]
fn prop_a_directory_that_cannot_be_made_is_named() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let error = Recorder::start(&file.path().join("logs"), &session()).unwrap_err().to_string();
    assert!(error.starts_with("record.directory = /"), "{error}");
    assert!(error.ends_with("name a directory that can be written"), "{error}");
}
