//! Logs with bad sectors, torn ends, or others' records in them.

use std::io;

use super::tests::{in_memory, read, session};
use super::*;
use haltere_core::time::HostTime;
use haltere_pilot::LinkId;

/// A log of raw bytes and wake-ups in small chunks, closed.
fn recorded() -> Vec<u8> {
    let (memory, mut log) = in_memory();
    log.chunk_bytes = 4000;
    for sequence in 1..=600 {
        let at = HostTime::from_us(5_000_000 + sequence * 10_000);
        if sequence % 2 == 0 {
            let wake = pb::Wake { sequence, host_time_us: at.as_us() };
            log.put(super::channels::WAKE, at, sequence, &wake).unwrap();
        } else {
            log.raw(false, LinkId::Tag, at, sequence, &[sequence as u8; 60]).unwrap();
        }
    }
    let at = HostTime::from_us(11_000_000);
    let closing = pb::Closing { host_time_us: at.as_us(), last_sequence: 600, lost_entries: 0 };
    log.put(super::channels::CLOSING, at, 0, &closing).unwrap();
    log.finish().unwrap();
    memory.bytes()
}

/// How many inputs are there, and how many of their numbers are missing up to the last of them, or to the recorder's
/// last word.
fn numbers(entries: &[Entry]) -> (u64, u64) {
    let there = entries.iter().filter(|e| matches!(e, Entry::Input { .. })).count() as u64;
    let last = entries.iter().map(|entry| match entry {
        Entry::Input { sequence, .. } => *sequence,
        Entry::Closing(closing) => closing.last_sequence,
        _ => 0,
    });
    (there, last.max().unwrap_or_default() - there)
}

#[test]
fn regress_one_bad_sector_costs_a_chunk() {
    let bytes = recorded();
    let whole: Vec<Entry> = read(&bytes).unwrap().0;
    let mut worst = 0;
    for at in (0..bytes.len() - 16).step_by(97) {
        let mut hurt = bytes.clone();
        hurt[at..at + 16].iter_mut().for_each(|b| *b ^= 0xff);
        // The closing magic alone says of a file without its first bytes what it is.
        let (got, end) = read(&hurt).unwrap_or_else(|error| panic!("byte {at}: {error}"));
        let lost = 600 - numbers(&got).0;
        worst = worst.max(lost);
        // What is read is what was written.
        let mut rest = whole.iter();
        assert!(got.iter().all(|entry| rest.any(|w| w == entry)), "byte {at}");
        assert!(lost == 0 || matches!(end, LogEnd::Damaged { .. }), "byte {at}: {end}");
    }
    assert!((10..60).contains(&worst), "{worst} of 600 for 16 bytes");
}

#[test]
fn regress_a_cut_log_with_a_bad_chunk_keeps_the_rest() {
    let bytes = recorded();
    let cut = bytes.len() * 2 / 3;
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    // The head, then the chunk in which both channels have their records.
    let offsets: Vec<_> =
        summary.chunk_indexes.iter().map(|c| c.chunk_start_offset as usize).collect();
    for chunk in [0, 1, 2, 4] {
        let mut hurt = bytes[..cut].to_vec();
        hurt[offsets[chunk] + 400] ^= 0xff;
        let (got, end) = read(&hurt).unwrap_or_else(|error| panic!("chunk {chunk}: {error}"));
        let (there, lost) = numbers(&got);
        assert!(there > 250 && lost < 60, "chunk {chunk}: {there} there, {lost} lost: {end}");
        assert_eq!(lost == 0, chunk < 2, "chunk {chunk}: {end}");
        assert!(matches!(end, LogEnd::Damaged { cut: Some(_), .. }), "{end}");
    }
}

#[test]
fn regress_the_recovered_copy_of_a_damaged_log_keeps_its_numbers() {
    let directory = tempfile::tempdir().unwrap();
    let mut bytes = recorded();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    let path = directory.path().join("hurt.mcap");
    std::fs::write(&path, &bytes).unwrap();
    let to = recovered_name(&path);
    let (_, end) = recover(&path, &to).unwrap();
    assert!(matches!(end, LogEnd::Damaged { .. }), "{end}");
    let (before, (after, end)) =
        (read(&bytes).unwrap().0, read(&std::fs::read(&to).unwrap()).unwrap());
    assert_eq!((numbers(&after), end), (numbers(&before), LogEnd::Complete));
    assert!(numbers(&after).1 > 0);
}

/// The same bytes at the official reader: nothing of what is new stops it.
#[test]
fn prop_the_head_stands_twice_and_the_official_reader_reads_all() {
    let bytes = recorded();
    let messages: Result<Vec<_>, _> = mcap::MessageStream::new(&bytes).unwrap().collect();
    let messages = messages.unwrap();
    let heads: Vec<_> = messages.iter().filter(|m| m.channel.topic == "/config").collect();
    assert_eq!((heads.len(), messages.len()), (2, 603));
    assert_eq!(heads[0].data, heads[1].data);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let [a, b] = [0, 1].map(|n| summary.chunk_indexes[n].chunk_start_offset);
    assert!(b - a > 16_000, "one sector holds both");
}

fn put_together(sessions: &[(Session, u64)], woven: bool) -> Vec<u8> {
    let mut out =
        mcap::WriteOptions::new().compression(None).create(io::Cursor::new(Vec::new())).unwrap();
    let mut all = Vec::new();
    for (n, (session, first_us)) in sessions.iter().enumerate() {
        let mut ids = std::collections::BTreeMap::new();
        let mut id = |out: &mut mcap::Writer<_>, topic: &str| {
            *ids.entry(topic.to_owned()).or_insert_with(|| {
                let about = [("from".to_owned(), n.to_string())].into();
                out.add_channel(0, topic, "protobuf", &about).unwrap()
            })
        };
        let head = prost::Message::encode_to_vec(&session.message());
        all.push((*first_us, id(&mut out, "/config"), 0, head));
        for sequence in 1..=50u64 {
            let host_time_us = first_us + sequence * 10_000;
            let (topic, data) = if sequence % 3 == 0 {
                let raw = pb::RawBytes { sequence, host_time_us, data: vec![n as u8; 5] };
                ("/in/tag", prost::Message::encode_to_vec(&raw))
            } else {
                let wake = pb::Wake { sequence, host_time_us };
                ("/wake", prost::Message::encode_to_vec(&wake))
            };
            all.push((host_time_us, id(&mut out, topic), sequence as u32, data));
        }
    }
    if woven {
        all.sort_by_key(|(at, ..)| *at);
    }
    for (at, channel_id, sequence, data) in all {
        let log_time = at * 1000;
        let header =
            mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        out.write_to_known_channel(&header, &data).unwrap();
    }
    out.finish().unwrap();
    out.into_inner().into_inner()
}

#[test]
fn regress_logs_that_were_put_into_one_file_are_refused() {
    let later = Session { started_unix_us: 1_795_270_000_000_000, ..session() };
    let two = [(session(), 5_000_000), (later, 5_003_000)];
    for woven in [true, false] {
        let error = read(&put_together(&two, woven)).unwrap_err().to_string();
        assert!(error.contains("a second session begins here, recorded from "), "{error}");
        assert!(error.ends_with("; take the logs themselves"), "{error}");
    }
}

/// One behind the other, in order of their time on channels of their own, and so on the same channels: it passed for a
/// flight in which everything happens twice.
#[test]
fn regress_a_log_that_was_put_into_a_file_twice_is_refused() {
    let alone = recorded();
    let messages: Vec<_> = mcap::MessageStream::new(&alone).unwrap().map(Result::unwrap).collect();
    let woven = |own_channels: bool| {
        let cursor = io::Cursor::new(Vec::new());
        let mut out = mcap::WriteOptions::new().compression(None).create(cursor).unwrap();
        let mut twice: Vec<_> =
            [0, 1].iter().flat_map(|n| messages.iter().map(move |m| (n, m))).collect();
        twice.sort_by_key(|(_, message)| message.log_time);
        for (n, mcap::Message { channel, sequence, log_time, publish_time, data }) in twice {
            let mut about = channel.metadata.clone();
            if own_channels {
                about.insert("from".into(), n.to_string());
            }
            let channel_id = out.add_channel(0, &channel.topic, "protobuf", &about).unwrap();
            let header = mcap::records::MessageHeader {
                channel_id,
                sequence: *sequence,
                log_time: *log_time,
                publish_time: *publish_time,
            };
            out.write_to_known_channel(&header, data).unwrap();
        }
        out.finish().unwrap();
        out.into_inner().into_inner()
    };
    for bytes in [[&alone[..], &alone].concat(), woven(true), woven(false)] {
        let error = read(&bytes).unwrap_err();
        assert!(matches!(error, LogError::Twice { .. }), "{error}");
        assert!(error.to_string().contains("one log that was put into a file twice"), "{error}");
    }
}

#[test]
fn regress_one_log_behind_another_is_refused_too() {
    let first = recorded();
    let other = {
        let later = Session { started_unix_us: 1_795_270_000_000_000, ..session() };
        put_together(&[(later, 5_000_000)], false)
    };
    let error = read(&[first, other].concat()).unwrap_err();
    assert!(matches!(error, LogError::Merged { .. }), "{error}");
}

#[test]
fn prop_what_is_no_file_is_refused_and_not_read() {
    let directory = tempfile::tempdir().unwrap();
    for path in [directory.path(), std::path::Path::new("/dev/zero")] {
        let error = LogReader::open(path).unwrap_err().to_string();
        assert!(error.contains("not a file; name the log itself"), "{error}");
    }
}

/// A log of a build before the head stood twice, cut: its first chunk holds the head and all records of channels.
#[test]
fn regress_an_old_cut_log_with_a_bad_first_chunk_keeps_the_rest() {
    let mut out = mcap::WriteOptions::new()
        .compression(None)
        .chunk_size(None)
        .create(io::Cursor::new(Vec::new()))
        .unwrap();
    let head = session().message();
    let about = [
        ("config_toml", head.config_toml.clone()),
        ("source_hash", head.source_hash.clone()),
        ("started_unix_us", head.started_unix_us.to_string()),
        ("pilot_started_us", head.pilot_started_us.to_string()),
    ];
    let metadata = about.map(|(name, value)| (name.to_owned(), value)).into();
    let name = "haltere.session".to_owned();
    out.write_metadata(&mcap::records::Metadata { name, metadata }).unwrap();
    let [config, wake] = ["/config", "/wake"]
        .map(|topic| out.add_channel(0, topic, "protobuf", &Default::default()).unwrap());
    let mut put = |channel_id, sequence: u64, data: Vec<u8>| {
        let log_time = (5_000_000 + sequence * 10_000) * 1000;
        let sequence = sequence as u32;
        let header =
            mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        out.write_to_known_channel(&header, &data).unwrap();
        if sequence == 100 {
            out.flush().unwrap();
        }
    };
    put(config, 0, prost::Message::encode_to_vec(&head));
    for sequence in 1..=200 {
        let wake_up = pb::Wake { sequence, host_time_us: 5_000_000 + sequence * 10_000 };
        put(wake, sequence, prost::Message::encode_to_vec(&wake_up));
    }
    out.finish().unwrap();
    let bytes = out.into_inner().into_inner();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let [first, second] = [0, 1].map(|n| &summary.chunk_indexes[n]);
    let cut = (second.chunk_start_offset + second.chunk_length) as usize - 100;
    let mut hurt = bytes[..cut].to_vec();
    let at = (first.chunk_start_offset + first.chunk_length) as usize - 300;
    hurt[at..at + 16].iter_mut().for_each(|b| *b ^= 0xff);
    let log = LogReader::from_bytes("test.mcap".into(), hurt).unwrap();
    assert_eq!(log.session(), &session());
    let mut entries = log.entries();
    let (there, lost) = numbers(&entries.by_ref().collect::<Vec<_>>());
    assert!(there > 90 && lost == 100, "{there} there, {lost} lost: {}", entries.end());
}

/// Found by the fuzzer: it was copied as it is, so that the copy was damaged again.
#[test]
fn regress_a_message_that_cannot_be_understood_is_no_part_of_a_copy() {
    let (memory, mut log) = in_memory();
    for sequence in 1..=9 {
        let at = HostTime::from_us(5_000_000 + sequence * 10_000);
        let wake = pb::Wake { sequence, host_time_us: at.as_us() };
        // Its raw bytes on a channel of numbers are none.
        let channel = if sequence == 5 { super::channels::CALENDAR } else { super::channels::WAKE };
        if sequence == 5 {
            let nonsense = pb::Drop { link: 1, reason: "ab".into(), count: 1 };
            log.put(channel, at, sequence, &nonsense).unwrap();
        } else {
            log.put(channel, at, sequence, &wake).unwrap();
        }
    }
    log.finish().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (path, to) = (folder.path().join("a.mcap"), folder.path().join("b.mcap"));
    std::fs::write(&path, memory.bytes()).unwrap();
    let (_, end) = recover(&path, &to).unwrap();
    assert!(matches!(end, LogEnd::Damaged { .. }), "{end}");
    let log = LogReader::open(&to).unwrap();
    let mut entries = log.entries();
    let (there, lost) = numbers(&entries.by_ref().collect::<Vec<_>>());
    assert_eq!((there, lost, entries.end()), (8, 1, LogEnd::Complete));
}

/// What head and tail tell is what a reader of the whole finds.
#[test]
fn prop_an_outline_tells_what_the_whole_log_holds() {
    let log = LogReader::from_bytes("a.mcap".into(), recorded()).unwrap();
    let outline = log.outline().unwrap();
    let entries: Vec<Entry> = log.entries().collect();
    let at = |entry: &Entry| match entry {
        Entry::Input { at, .. } => Some(*at),
        _ => None,
    };
    let first = entries.iter().find_map(at);
    let last = entries.iter().rev().find_map(at);
    assert_eq!(outline.span.map(|[from, to]| (Some(from), Some(to))), Some((first, last)));
    let is_wake = |e: &&Entry| matches!(e, Entry::Input { input: RawInput::Wake, .. });
    let wakes: Vec<Entry> = entries.iter().filter(is_wake).cloned().collect();
    assert_eq!(outline.counts().get("/wake"), Some(&(wakes.len() as u64)));
    assert_eq!(outline.entries("/wake"), Some(wakes));
    assert_eq!(outline.entries("/closing").map(|closing| closing.len()), Some(1));
    // Cut, it has no tail; and a tail that does not fit tells nothing.
    let mut bytes = recorded();
    bytes.truncate(bytes.len() / 2);
    assert!(LogReader::from_bytes("a.mcap".into(), bytes).unwrap().outline().is_none());
}

/// Of a log whose first copy of the head is bad the tail said that it is complete.
#[test]
fn regress_a_log_with_a_bad_head_is_not_told_by_its_tail() {
    let mut bytes = recorded();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    bytes[summary.chunk_indexes[0].chunk_start_offset as usize + 400] ^= 0xff;
    let log = LogReader::from_bytes("a.mcap".into(), bytes).unwrap();
    assert!(log.outline().is_none());
    let mut entries = log.entries();
    entries.by_ref().for_each(drop);
    assert!(matches!(entries.end(), LogEnd::Damaged { .. }));
}

/// A copy that ended half-way, as on a full disk, was left behind and stood in the way of the next.
#[test]
fn regress_a_copy_of_a_log_is_there_whole_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mcap");
    std::fs::write(&path, recorded()).unwrap();
    let log = LogReader::open(&path).unwrap();
    let taken = folder.path().join("notes");
    std::fs::write(&taken, "notes").unwrap();
    for to in [&path, &taken] {
        let says = format!(
            "{}: exists already, and no log is written over a file; name another one",
            to.display()
        );
        assert_eq!(recover(&path, to).unwrap_err().to_string(), says);
        assert_eq!(trim(&log, to, 0.0, 1.0).unwrap_err().to_string(), says);
    }
    assert_eq!(
        (std::fs::read(&path).unwrap(), std::fs::read(&taken).unwrap()),
        (recorded(), b"notes".to_vec())
    );
    let mut names: Vec<_> =
        std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["a.mcap", "notes"]);
}
