//! Reader of the logs of ArduPilot (DataFlash, `.bin`).
//!
//! Messages: `A3 95`, the number of their kind, so many bytes. Kind 128, `FMT`, tells of a kind its length, name, the types of its fields as
//! letters, and their names. Where no message begins, bytes are read over to the next that does.

use std::collections::BTreeMap;

use super::events::{Event, Kind, Left, text};

const HEAD: [u8; 2] = [0xA3, 0x95];
/// The kind of message that tells of the others, and its length with the head.
const FMT: u8 = 128;
const FMT_BYTES: usize = 89;
/// Filler behind the last message of a file that was made at its full length.
const FILLER: [u8; 2] = [0, 0xFF];

/// A log, message by message.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DataFlash {
    /// The messages that were asked for; text in them is left out.
    pub events: Vec<Event>,
    /// Parameters of the board (`PARM`), the last value of each.
    pub parameters: BTreeMap<String, f64>,
    /// Names of all messages of which there is one.
    pub messages: Vec<String>,
    /// Bytes that could not be read, but for a last message that is cut off.
    pub unread_bytes: usize,
}

/// What a kind of message looks like.
struct Layout {
    bytes: usize,
    fields: Vec<Field>,
    /// Whether it is asked for.
    is_wanted: bool,
    is_there: bool,
    event: Event,
}

enum Field {
    Number(Kind, f64),
    Text(usize),
}

/// Reads the messages that are asked for; `None` where not even one message is.
pub fn parse(bytes: &[u8], wanted: &[&str]) -> Option<DataFlash> {
    let end = bytes.iter().rposition(|byte| !FILLER.contains(byte)).map_or(0, |last| last + 1);
    let mut left = Left::of(bytes);
    let mut log = DataFlash::default();
    let mut layouts: BTreeMap<u8, Layout> = BTreeMap::new();
    while left.at < end {
        let from = left;
        let known = match (left.take(), left.take()) {
            (Some(HEAD), Some([FMT])) => Some((FMT, FMT_BYTES)),
            (Some(HEAD), Some([id])) => layouts.get(&id).map(|layout| (id, layout.bytes)),
            _ => None,
        };
        let Some((id, length)) = known else {
            log.unread_bytes += 1;
            left.at = from.at + 1;
            continue;
        };
        let Some(body) = left.bytes(length - 3) else { break };
        match layouts.get_mut(&id) {
            _ if id == FMT => {
                if let Some((id, layout)) = layout(body, wanted) {
                    layouts.entry(id).or_insert(layout);
                }
            }
            Some(layout) => layout.read(body, &mut log),
            None => {}
        }
    }
    let there = || layouts.values().filter(|layout| layout.is_there);
    log.messages = there().map(|layout| layout.event.name.clone()).collect();
    log.events =
        layouts.into_values().filter(|l| l.is_wanted && l.is_there).map(|l| l.event).collect();
    (!log.messages.is_empty()).then_some(log)
}

/// What a message of kind `FMT` tells; `None` where it contradicts itself.
fn layout(body: &[u8], wanted: &[&str]) -> Option<(u8, Layout)> {
    let mut left = Left::of(body);
    let [id, bytes] = left.take()?;
    let [name, letters, columns] =
        [text(left.bytes(4)?), text(left.bytes(16)?), text(left.bytes(64)?)];
    let fields: Vec<Field> = letters.bytes().map(field).collect::<Option<_>>()?;
    let size = |field: &Field| match field {
        Field::Number(kind, _) => kind.bytes(),
        Field::Text(bytes) => *bytes,
    };
    let variables: Vec<String> = columns.split(',').map(str::to_owned).collect();
    let is_whole = variables.len() == fields.len()
        && 3 + fields.iter().map(size).sum::<usize>() == usize::from(bytes);
    let numbers =
        variables.into_iter().zip(&fields).filter(|(_, field)| matches!(field, Field::Number(..)));
    let variables = numbers.map(|(name, _)| name).collect();
    let is_wanted = is_whole && wanted.contains(&name.as_str());
    let event = Event { name, variables, ..Event::default() };
    // Of one that contradicts itself the length still says where the next message begins.
    let fields = if is_whole { fields } else { Vec::new() };
    (bytes > 3)
        .then_some((id, Layout { bytes: bytes.into(), fields, is_wanted, is_there: false, event }))
}

/// The letters of the format, with what makes the unit of a scaled one.
fn field(letter: u8) -> Option<Field> {
    Some(match letter {
        b'b' => Field::Number(Kind::I8, 1.0),
        b'B' | b'M' => Field::Number(Kind::U8, 1.0),
        b'h' => Field::Number(Kind::I16, 1.0),
        b'H' => Field::Number(Kind::U16, 1.0),
        b'i' => Field::Number(Kind::I32, 1.0),
        b'I' => Field::Number(Kind::U32, 1.0),
        b'q' => Field::Number(Kind::I64, 1.0),
        b'Q' => Field::Number(Kind::U64, 1.0),
        b'f' => Field::Number(Kind::F32, 1.0),
        b'd' => Field::Number(Kind::F64, 1.0),
        b'c' => Field::Number(Kind::I16, 0.01),
        b'C' => Field::Number(Kind::U16, 0.01),
        b'e' => Field::Number(Kind::I32, 0.01),
        b'E' => Field::Number(Kind::U32, 0.01),
        b'L' => Field::Number(Kind::I32, 1e-7),
        // Numbers of half the usual width, which nothing that is read here has.
        b'g' => Field::Text(2),
        b'n' => Field::Text(4),
        b'N' => Field::Text(16),
        b'Z' | b'a' => Field::Text(64),
        _ => return None,
    })
}

impl Layout {
    fn read(&mut self, body: &[u8], log: &mut DataFlash) {
        self.is_there = true;
        let is_parameter = self.event.name == "PARM";
        if !self.is_wanted && !is_parameter {
            return;
        }
        let mut left = Left::of(body);
        let (mut values, mut words) = (Vec::new(), Vec::new());
        for field in &self.fields {
            match field {
                Field::Number(kind, scale) => {
                    values.extend(left.value(*kind).map(|value| scale * value))
                }
                Field::Text(bytes) => words.extend(left.bytes(*bytes).map(text)),
            }
        }
        let place = |name: &str| self.event.variables.iter().position(|variable| variable == name);
        let of = |name: &str| place(name).and_then(|at| values.get(at)).copied();
        if let Some((name, value)) = words.first().zip(of("Value")).filter(|_| is_parameter) {
            log.parameters.insert(name.clone(), value);
        }
        let time_s = of("TimeUS").map(|us| us * 1e-6).or_else(|| of("TimeMS").map(|ms| ms * 1e-3));
        if let Some(time_s) = time_s.filter(|_| self.is_wanted) {
            self.event.time_s.push(time_s);
            self.event.values.extend(values);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn format(id: u8, bytes: u8, name: &str, letters: &str, columns: &str) -> Vec<u8> {
        let padded = |text: &str, to: usize| [text.as_bytes(), &vec![0; to - text.len()]].concat();
        [&HEAD[..], &[FMT, id, bytes], &padded(name, 4), &padded(letters, 16), &padded(columns, 64)]
            .concat()
    }

    fn battery(time_us: u64, centivolt: i16) -> Vec<u8> {
        [&HEAD[..], &[9], &time_us.to_le_bytes(), &centivolt.to_le_bytes()].concat()
    }

    /// A log as the page of the format describes it.
    fn log() -> Vec<u8> {
        let parameter =
            [&HEAD[..], &[8], &1u64.to_le_bytes(), b"SERVO1_FUNCTION\0", &33f32.to_le_bytes()]
                .concat();
        let strange = [&HEAD[..], &[10, 1, 2]].concat();
        [
            format(FMT, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
            format(8, 31, "PARM", "QNf", "TimeUS,Name,Value"),
            format(9, 13, "BAT", "Qc", "TimeUS,Volt"),
            format(10, 5, "ODD", "Q", "A,B"),
            parameter,
            battery(1_000_000, 1180),
            strange,
            battery(2_000_000, 1170),
        ]
        .concat()
    }

    #[test]
    fn val_messages_are_read_as_the_page_of_the_format_says() {
        let read = parse(&log(), &["BAT", "ODD"]).unwrap();
        assert_eq!((read.unread_bytes, read.messages.len()), (0, 3));
        assert_eq!(read.parameters["SERVO1_FUNCTION"], 33.0);
        let [battery] = &read.events[..] else { panic!("{:?}", read.events) };
        assert_eq!((battery.name.as_str(), &battery.time_s[..]), ("BAT", &[1.0, 2.0][..]));
        let volt: Vec<f64> = battery.column("Volt").unwrap().collect();
        assert!((volt[0] - 11.8).abs() < 1e-9 && (volt[1] - 11.7).abs() < 1e-9, "{volt:?}");
    }

    #[test]
    fn prop_what_is_lost_is_counted_and_what_follows_is_read() {
        let whole = log();
        let mut damaged = whole.clone();
        damaged.splice(whole.len() - 13..whole.len() - 13, [1, 0xA3, 0x95, 77, 5]);
        damaged.extend([0xFF; 40]);
        let read = parse(&damaged, &["BAT"]).unwrap();
        assert_eq!((read.unread_bytes, read.events[0].time_s.len()), (5, 2));
        let cut = parse(&whole[..whole.len() - 3], &["BAT"]).unwrap();
        assert_eq!((cut.unread_bytes, cut.events[0].time_s.len()), (0, 1));
        assert!(parse(b"not a log", &[]).is_none() && parse(&[], &[]).is_none());
    }

    proptest! {
        #[test]
        fn prop_no_bytes_panic(bytes in proptest::collection::vec(any::<u8>(), 0..300), at in 0usize..600) {
            let _ = parse(&bytes, &["BAT"]);
            let mut near = log();
            let at = at % near.len();
            near.splice(at..at, bytes);
            let read = parse(&near, &["BAT", "ODD"]);
            prop_assert!(read.is_none_or(|log| log.unread_bytes <= near.len()));
        }
    }
}
