//! Reader of the logs of PX4 (`.ulg`, version 0 and 1 of the format).
//!
//! Sixteen bytes of head, then messages: size (`u16`), a letter, so many bytes. `F` tells the fields of a topic as text, `A` gives a topic
//! the number under which `D` holds its records. Records that were lost in writing are whole messages, so the next one is found; where
//! bytes are damaged, behind the next synchronisation (`S`).

use std::collections::BTreeMap;

use super::events::{Event, Kind, Left, text};

const MAGIC: [u8; 7] = *b"ULog\x01\x12\x35";
/// A whole message of synchronisation.
const SYNC: [u8; 11] = [8, 0, b'S', 0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12];
/// Every letter that a message may have.
const LETTERS: &[u8] = b"BFIMPQARDLCSO";
/// Most topics, and fields of one, that are read: more than any that is asked for has.
const MOST_TOPICS: usize = 64;
const MOST_FIELDS: usize = 512;
/// Place of the flags that a reader must know in `B`, and those that change nothing: records may stand behind the end.
const MUST_KNOW: std::ops::Range<usize> = 8..16;
const APPENDED: u8 = 1;

/// A log, topic by topic.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ULog {
    /// The topics that were asked for. A second one of a topic is called as `actuator_outputs.1`, fields of an array as `output[0]`.
    pub events: Vec<Event>,
    /// Every topic that was logged.
    pub topics: Vec<String>,
    /// Bytes that could not be read, but for a last message that is cut off.
    pub unread_bytes: usize,
}

/// Why bytes are no such log.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NoLog {
    /// Other first bytes.
    #[error("does not begin as a log of PX4 (.ulg)")]
    Magic,
    /// A flag that says that this reader would read it wrongly.
    #[error("a log of PX4 with the flags {0:02x?}, which are newer than this reader")]
    Flags(Vec<u8>),
}

/// A topic with what is needed to read its records.
struct Layout {
    /// Type of each field, `None` for so many bytes that are read over.
    fields: Vec<Result<Kind, usize>>,
    time_at: usize,
    event: Event,
}

/// Reads the topics that are asked for.
pub fn parse(bytes: &[u8], wanted: &[&str]) -> Result<ULog, NoLog> {
    let mut left = Left::of(bytes);
    if left.take() != Some(MAGIC) {
        return Err(NoLog::Magic);
    }
    // Version and time of the beginning.
    left.bytes(9);
    let mut formats: BTreeMap<String, String> = BTreeMap::new();
    let mut layouts: BTreeMap<u16, Layout> = BTreeMap::new();
    let mut log = ULog::default();
    loop {
        let from = left;
        let Some((letter, body)) = message(&mut left) else {
            let is_last = from.rest().get(2).is_none_or(|letter| LETTERS.contains(letter));
            let found = from.rest().windows(SYNC.len()).position(|window| window == SYNC);
            log.unread_bytes += found.unwrap_or(if is_last { 0 } else { from.rest().len() });
            let Some(found) = found else { break };
            left.at = from.at + found;
            continue;
        };
        match letter {
            b'B' => {
                let flags = body.get(MUST_KNOW).unwrap_or_default();
                let unknown = flags
                    .iter()
                    .enumerate()
                    .any(|(k, flag)| flag & !(APPENDED * u8::from(k == 0)) != 0);
                if unknown {
                    return Err(NoLog::Flags(flags.to_vec()));
                }
            }
            b'F' => {
                if let Some((name, fields)) = text(body).split_once(':') {
                    formats.insert(name.into(), fields.into());
                }
            }
            b'A' => log.add(body, wanted, &formats, &mut layouts),
            b'D' => log.unread_bytes += record(body, &mut layouts),
            _ => {}
        }
    }
    log.events = layouts.into_values().map(|layout| layout.event).collect();
    log.events.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(log)
}

/// Letter and body of the next message; `None` where none is.
fn message<'a>(left: &mut Left<'a>) -> Option<(u8, &'a [u8])> {
    let mut ahead = *left;
    let size = ahead.u16()?;
    let [letter] = ahead.take()?;
    let body = ahead.bytes(size.into()).filter(|_| LETTERS.contains(&letter))?;
    *left = ahead;
    Some((letter, body))
}

impl ULog {
    /// Takes note of a topic, with a layout where it is wanted.
    fn add(
        &mut self,
        body: &[u8],
        wanted: &[&str],
        formats: &BTreeMap<String, String>,
        layouts: &mut BTreeMap<u16, Layout>,
    ) {
        let mut left = Left::of(body);
        let Some(([instance], id)) = left.take().zip(left.u16()) else { return };
        let topic = text(left.rest());
        let name = if instance == 0 { topic.clone() } else { format!("{topic}.{instance}") };
        let format = formats
            .get(&topic)
            .filter(|_| wanted.contains(&topic.as_str()) && layouts.len() < MOST_TOPICS);
        if let Some(layout) = format.and_then(|format| layout(&name, format)) {
            layouts.entry(id).or_insert(layout);
        }
        self.topics.push(name);
    }
}

/// From `uint64_t timestamp;float[4] q;…`. What stands behind a field of a type of its own is not read.
fn layout(name: &str, format: &str) -> Option<Layout> {
    let mut fields = Vec::new();
    let mut variables = Vec::new();
    for field in format.split(';') {
        let Some((of, field)) = field.trim().split_once(' ') else { break };
        let (of, count) = match of.strip_suffix(']').and_then(|of| of.split_once('[')) {
            Some((of, count)) => (of, Some(count.parse::<u8>().ok()?)),
            None => (of, None),
        };
        let kind = match of {
            "uint8_t" | "bool" | "char" => Kind::U8,
            "int8_t" => Kind::I8,
            "uint16_t" => Kind::U16,
            "int16_t" => Kind::I16,
            "uint32_t" => Kind::U32,
            "int32_t" => Kind::I32,
            "uint64_t" => Kind::U64,
            "int64_t" => Kind::I64,
            "float" => Kind::F32,
            "double" => Kind::F64,
            _ => break,
        };
        if field.starts_with("_padding") {
            fields.push(Err(count.unwrap_or(1).into()));
            continue;
        }
        if variables.len() > MOST_FIELDS {
            return None;
        }
        for k in 0..count.unwrap_or(1) {
            fields.push(Ok(kind));
            variables.push(count.map_or(field.into(), |_| format!("{field}[{k}]")));
        }
    }
    let time_at = variables.iter().position(|name| name == "timestamp")?;
    let event = Event { name: name.into(), variables, ..Event::default() };
    Some(Layout { fields, time_at, event })
}

/// One record; how many bytes of it are lost.
fn record(body: &[u8], layouts: &mut BTreeMap<u16, Layout>) -> usize {
    let mut left = Left::of(body);
    let Some(id) = left.u16() else { return body.len() };
    let Some(layout) = layouts.get_mut(&id) else { return 0 };
    let mut values = Vec::with_capacity(layout.event.variables.len());
    for field in &layout.fields {
        match field {
            Ok(kind) => {
                let Some(value) = left.value(*kind) else { return body.len() };
                values.push(value);
            }
            // At the end it is not written.
            Err(padding) => left.at += padding,
        }
    }
    layout.event.time_s.push(values[layout.time_at] * 1e-6);
    layout.event.values.extend(values);
    0
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn message(letter: u8, body: &[u8]) -> Vec<u8> {
        let size = (body.len() as u16).to_le_bytes();
        [&size[..], &[letter], body].concat()
    }

    /// A log as the page of the format describes it: a topic of which there are two, and one that nobody asks for.
    fn log() -> Vec<u8> {
        let outputs = |id: u16, time_us: u64, output: f32| {
            let body =
                [&id.to_le_bytes()[..], &time_us.to_le_bytes(), &4u32.to_le_bytes()].concat();
            message(b'D', &[body, output.to_le_bytes().repeat(2)].concat())
        };
        let topic = |instance: u8, id: u16, name: &str| {
            message(b'A', &[&[instance][..], &id.to_le_bytes(), name.as_bytes()].concat())
        };
        [
            [&MAGIC[..], &[1], &7u64.to_le_bytes()].concat(),
            message(b'B', &[0; 40]),
            message(b'F', b"outputs:uint64_t timestamp;uint32_t noutputs;float[2] output;uint8_t[4] _padding0;"),
            message(b'F', b"other:uint64_t timestamp;inner[2] inner;"),
            message(b'P', b"\x0bint32_t ABC\x01\0\0\0"),
            topic(0, 3, "outputs"),
            topic(1, 4, "outputs"),
            topic(0, 5, "other"),
            outputs(3, 1_000_000, 1500.0),
            message(b'D', &[5, 0, 9]),
            outputs(4, 1_500_000, 900.0),
            message(b'O', &[30, 0]),
            SYNC.to_vec(),
            outputs(3, 2_000_000, 1600.0),
        ]
        .concat()
    }

    #[test]
    fn val_topics_are_read_as_the_page_of_the_format_says() {
        let read = parse(&log(), &["outputs"]).unwrap();
        assert_eq!((read.unread_bytes, read.events.len()), (0, 2));
        assert_eq!(read.topics, ["outputs", "outputs.1", "other"]);
        let first = &read.events[0];
        assert_eq!((first.name.as_str(), &first.time_s[..]), ("outputs", &[1.0, 2.0][..]));
        assert_eq!(first.column("output[1]").unwrap().collect::<Vec<_>>(), [1500.0, 1600.0]);
        assert_eq!(read.events[1].column("noutputs").unwrap().collect::<Vec<_>>(), [4.0]);
    }

    #[test]
    fn prop_behind_damage_it_goes_on_at_the_next_synchronisation() {
        let whole = log();
        let sync = whole.windows(11).position(|window| window == SYNC).unwrap();
        let mut damaged = whole.clone();
        damaged.splice(sync - 5..sync, [0xFF; 9]);
        let read = parse(&damaged, &["outputs"]).unwrap();
        assert_eq!((read.unread_bytes, &read.events[0].time_s[..]), (9, &[1.0, 2.0][..]));
        // Power was taken away while it was written: what is there counts.
        let cut = parse(&whole[..whole.len() - 3], &["outputs"]).unwrap();
        assert_eq!((cut.unread_bytes, cut.events[0].time_s.len()), (0, 1));
    }

    #[test]
    fn prop_what_is_no_log_is_said() {
        assert_eq!(parse(b"ULog", &[]).unwrap_err(), NoLog::Magic);
        let mut newer = log();
        newer[16 + 3 + 8] = 2;
        assert!(matches!(parse(&newer, &[]).unwrap_err(), NoLog::Flags(_)));
    }

    proptest! {
        #[test]
        fn prop_no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300), at in 0usize..400) {
            let _ = parse(&bytes, &["outputs"]);
            let mut near = log();
            let at = at % near.len();
            near.splice(at..at, bytes);
            let read = parse(&near, &["outputs", "other"]);
            prop_assert!(read.map_or(true, |log| log.unread_bytes <= near.len()));
        }
    }
}
