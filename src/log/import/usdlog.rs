//! Reader of the logs that a Crazyflie writes to its memory card (`usdlog`, versions 1 and 2).
//!
//! `0xBC`, version and number of events (`u16`), then of each event its number, its name, and the names of its variables with a
//! letter for the type, as in `motor.m1(I)`; names end with a zero. Then records to the last four bytes, which hold the CRC-32
//! of all before: number of the event, time (version 1: `u32` of ms, version 2: `u64` of µs), the variables. Little-endian
//! throughout.

use flate2::Crc;

use super::events::{Event, Kind, Left, text};

/// First byte of a log.
const MAGIC: u8 = 0xBC;

/// A log, event by event.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct UsdLog {
    /// What was logged.
    pub events: Vec<Event>,
    /// Whether the checksum at the end is that of the rest: of a log that was cut off it is not.
    pub is_whole: bool,
    /// Bytes behind the last record that could be read.
    pub unread_bytes: usize,
}

/// Why bytes are no such log.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NoLog {
    /// Another first byte.
    #[error("does not begin with 0xBC: no log of a Crazyflie's memory card")]
    Magic,
    /// Another version.
    #[error("a usdlog of version {0}, known are 1 and 2")]
    Version(u16),
    /// The head is cut off, or holds what no firmware writes.
    #[error("the head is damaged at byte {0}")]
    Head(usize),
}

/// Reads the bytes of a log.
pub fn parse(bytes: &[u8]) -> Result<UsdLog, NoLog> {
    let (body, is_whole) = checked(bytes);
    let mut left = Left::of(body);
    if left.take::<1>() != Some([MAGIC]) {
        return Err(NoLog::Magic);
    }
    let damaged = |left: &Left<'_>| NoLog::Head(left.at);
    let version = left.u16().ok_or_else(|| damaged(&left))?;
    if !(1..=2).contains(&version) {
        return Err(NoLog::Version(version));
    }
    let count = left.u16().ok_or_else(|| damaged(&left))?;
    let mut layouts = Vec::new();
    for _ in 0..count {
        layouts.push(left.layout().ok_or_else(|| damaged(&left))?);
    }
    let mut read_to = left.at;
    while left.record(version, &mut layouts).is_some() {
        read_to = left.at;
    }
    let events = layouts.into_iter().map(|layout| layout.event).collect();
    Ok(UsdLog { events, is_whole, unread_bytes: body.len() - read_to })
}

/// The bytes before the checksum, and whether it is theirs.
fn checked(bytes: &[u8]) -> (&[u8], bool) {
    let Some((body, sum)) = bytes.split_last_chunk::<4>() else { return (bytes, false) };
    let mut crc = Crc::new();
    crc.update(body);
    (body, crc.sum() == u32::from_le_bytes(*sum))
}

/// An event with what is needed to read its records.
struct Layout {
    id: u16,
    kinds: Vec<Kind>,
    event: Event,
}

/// Types of variables, by the letters of Python's `struct`.
fn kind(letter: u8) -> Option<Kind> {
    Some(match letter {
        b'B' => Kind::U8,
        b'b' => Kind::I8,
        b'H' => Kind::U16,
        b'h' => Kind::I16,
        b'I' => Kind::U32,
        b'i' => Kind::I32,
        b'f' => Kind::F32,
        _ => return None,
    })
}

impl Left<'_> {
    /// Bytes up to a zero.
    fn name(&mut self) -> Option<&[u8]> {
        let rest = self.rest();
        let length = rest.iter().position(|byte| *byte == 0)?;
        self.at += length + 1;
        Some(&rest[..length])
    }

    fn layout(&mut self) -> Option<Layout> {
        let id = self.u16()?;
        let mut event = Event { name: text(self.name()?), ..Event::default() };
        let mut kinds = Vec::new();
        for _ in 0..self.u16()? {
            let [name @ .., b'(', letter, b')'] = self.name()? else { return None };
            kinds.push(kind(*letter)?);
            event.variables.push(text(name));
        }
        Some(Layout { id, kinds, event })
    }

    /// One record more; `None` at the end, and where the number of an event is of none.
    fn record(&mut self, version: u16, layouts: &mut [Layout]) -> Option<()> {
        let id = self.u16()?;
        let time_s = match version {
            1 => f64::from(u32::from_le_bytes(self.take()?)) * 1e-3,
            _ => u64::from_le_bytes(self.take()?) as f64 * 1e-6,
        };
        let Layout { kinds, event, .. } = layouts.iter_mut().find(|layout| layout.id == id)?;
        let before = event.values.len();
        for kind in kinds {
            let Some(value) = self.value(*kind) else {
                event.values.truncate(before);
                return None;
            };
            event.values.push(value);
        }
        event.time_s.push(time_s);
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A log as the firmware writes it: two events, of which one never came.
    fn log(version: u16, records: &[(u64, u32, f32)]) -> Vec<u8> {
        let mut bytes = vec![MAGIC];
        for number in [version, 2, 0xFFFF] {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend(b"fixedFrequency\0\x02\0motor.m1(I)\0gyro.x(f)\0");
        bytes.extend(b"\x0c\0activeMarkerModeChanged\0\x01\0mode(B)\0");
        for (time, motor, rate) in records {
            bytes.extend([0xFF, 0xFF]);
            match version {
                1 => bytes.extend((*time as u32).to_le_bytes()),
                _ => bytes.extend(time.to_le_bytes()),
            }
            bytes.extend(motor.to_le_bytes());
            bytes.extend(rate.to_le_bytes());
        }
        let mut crc = Crc::new();
        crc.update(&bytes);
        bytes.extend(crc.sum().to_le_bytes());
        bytes
    }

    #[test]
    fn prop_both_versions_are_read_with_their_clocks() {
        for (version, times) in [(1, [1500, 1510]), (2, [1_500_000, 1_510_000])] {
            let bytes = log(version, &[(times[0], 40_000, 0.5), (times[1], 41_000, -0.5)]);
            let read = parse(&bytes).unwrap();
            assert!(read.is_whole && read.unread_bytes == 0);
            let event = &read.events[0];
            assert_eq!(
                (event.name.as_str(), &event.time_s[..]),
                ("fixedFrequency", &[1.5, 1.51][..])
            );
            assert_eq!(event.column("motor.m1").unwrap().collect::<Vec<_>>(), [40_000.0, 41_000.0]);
            assert_eq!(event.column("gyro.x").unwrap().collect::<Vec<_>>(), [0.5, -0.5]);
            assert!(event.column("gyro.y").is_none() && read.events[1].values.is_empty());
        }
    }

    #[test]
    fn prop_what_is_lost_is_counted_and_what_is_changed_is_seen() {
        let whole = log(2, &[(10_000, 1, 0.0), (20_000, 2, 0.0)]);
        let cut = parse(&whole[..whole.len() - 10]).unwrap();
        assert!(!cut.is_whole);
        assert_eq!((cut.events[0].time_s.len(), cut.unread_bytes), (1, 8));
        let mut changed = whole.clone();
        changed[whole.len() - 6] ^= 1;
        assert!(!parse(&changed).unwrap().is_whole);
        // The number of an event that was never told of: nothing behind it can be read.
        let mut strange = whole;
        let records = strange.len() - 2 * 18 - 4;
        strange[records] = 7;
        assert_eq!(parse(&strange).unwrap().unread_bytes, 36);
    }

    #[test]
    fn prop_what_is_no_log_is_said() {
        assert_eq!(parse(b"").unwrap_err(), NoLog::Magic);
        assert_eq!(parse(&log(3, &[])).unwrap_err(), NoLog::Version(3));
        assert_eq!(parse(&log(2, &[])[..30]).unwrap_err(), NoLog::Head(24));
    }

    proptest! {
        #[test]
        fn prop_no_bytes_panic(
            bytes in proptest::collection::vec(any::<u8>(), 0..400), at in 0usize..400, with: u8
        ) {
            let _ = parse(&bytes);
            let mut near = log(2, &[(10_000, 1, 0.0); 8]);
            let at = at % near.len();
            near[at] = with;
            near.splice(at..at, bytes);
            let read = parse(&near);
            prop_assert!(read.map_or(true, |log| log.unread_bytes <= near.len()));
        }
    }
}
