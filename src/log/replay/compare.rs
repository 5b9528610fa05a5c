//! Compares bytes as messages: the numbers in their written-out form, one by one.

use haltere_dialect::mav_stream::MavSplitter;

/// How far decoded numbers of two builds may be apart; relative where they exceed 1.
pub const TOLERANCE: f64 = 1e-6;

/// Link id, time and signature at the end of a signed MAVLink frame.
const SIGNATURE_BYTES: usize = 13;

/// How two outputs compare that are not the same bytes.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Agreement {
    /// The same messages, but for numbers.
    Numbers {
        /// Largest difference.
        worst: f64,
        /// Whole numbers that differ by one.
        rounding_flips: u64,
        /// Both messages where the difference is largest.
        what: String,
    },
    /// Different messages.
    None(String),
}

/// `bytes` with the signatures of whole MAVLink frames left out.
pub(super) fn without_signatures(bytes: &[u8]) -> Vec<u8> {
    let mut frames = MavSplitter::new();
    frames.push(bytes);
    let mut out = Vec::with_capacity(bytes.len());
    let mut clean = true;
    while let Some(found) = frames.next() {
        match found {
            Ok(frame) if frame.signed => {
                let end = frame.raw.len().saturating_sub(SIGNATURE_BYTES);
                out.extend_from_slice(frame.raw.get(..end).unwrap_or_default());
            }
            Ok(frame) => out.extend_from_slice(frame.raw),
            Err(_) => clean = false,
        }
    }
    // Only whole frames of ours are expected; anything else is compared as it is.
    if clean && frames.pending() == 0 { out } else { bytes.to_vec() }
}

/// Compares two outputs of the same link.
pub(super) fn compare(recorded: &[u8], replayed: &[u8]) -> Agreement {
    compare_texts(recorded, replayed, true)
}

/// The same for two builds: their sequence numbers differ for good where one has sent a message more.
pub(super) fn compare_messages(recorded: &[u8], replayed: &[u8]) -> Agreement {
    compare_texts(recorded, replayed, false)
}

fn compare_texts(recorded: &[u8], replayed: &[u8], numbered: bool) -> Agreement {
    let texts = |bytes| texts(bytes, numbered);
    let (Some(recorded_texts), Some(replayed_texts)) = (texts(recorded), texts(replayed)) else {
        return Agreement::None(format!(
            "recorded {recorded:02x?}, replayed {replayed:02x?}, which are no MAVLink messages"
        ));
    };
    if recorded_texts.len() != replayed_texts.len() {
        return Agreement::None(format!(
            "recorded {} messages, replayed {}",
            recorded_texts.len(),
            replayed_texts.len()
        ));
    }
    let (mut worst, mut rounding_flips, mut what) = (0.0, 0, String::new());
    for (a, b) in recorded_texts.iter().zip(&replayed_texts) {
        let Some((difference, flips)) = distance(a, b) else {
            return Agreement::None(format!("recorded {a}, replayed {b}"));
        };
        rounding_flips += flips;
        if difference > worst || what.is_empty() {
            worst = difference;
            what = format!("recorded {a}, replayed {b}");
        }
    }
    Agreement::Numbers { worst, rounding_flips, what }
}

/// Every message written out, `numbered` with its sequence number; `None` when something else is among them.
fn texts(bytes: &[u8], numbered: bool) -> Option<Vec<String>> {
    let mut frames = MavSplitter::new();
    frames.push(bytes);
    let mut texts = Vec::new();
    while let Some(found) = frames.next() {
        let frame = found.ok()?;
        let message = frame.decode().ok()?;
        let header = frame.header;
        let number = if numbered { header.sequence } else { 0 };
        texts.push(format!("{}/{} #{number} {message:?}", header.system_id, header.component_id));
    }
    (frames.pending() == 0 && !texts.is_empty()).then_some(texts)
}

/// Largest difference of two numbers at the same place, and how many whole numbers differ by one.
/// `None`: the texts differ in more than numbers.
fn distance(a: &str, b: &str) -> Option<(f64, u64)> {
    let (mut worst, mut flips) = (0.0_f64, 0);
    let (mut a, mut b) = (Pieces(a), Pieces(b));
    loop {
        match (a.next(), b.next()) {
            (None, None) => return Some((worst, flips)),
            (Some(x), Some(y)) if x == y => {}
            (Some(x), Some(y)) => {
                let whole = |s: &str| s.parse::<i64>().ok();
                if let (Some(i), Some(j)) = (whole(x), whole(y)) {
                    if i.abs_diff(j) != 1 {
                        return None;
                    }
                    flips += 1;
                } else {
                    let (x, y) = (number(x)?, number(y)?);
                    worst = worst.max((x - y).abs() / x.abs().max(y.abs()).max(1.0));
                }
            }
            _ => return None,
        }
    }
}

fn number(text: &str) -> Option<f64> {
    let starts = text.starts_with(|c: char| c.is_ascii_digit() || c == '-');
    text.parse().ok().filter(|x: &f64| starts && x.is_finite())
}

/// Splits a text into numbers and what lies between them.
struct Pieces<'a>(&'a str);

impl<'a> Iterator for Pieces<'a> {
    type Item = &'a str;

    fn next(&mut self) -> Option<&'a str> {
        let bytes = self.0.as_bytes();
        let first = *bytes.first()?;
        let digit = |i: usize| bytes.get(i).is_some_and(u8::is_ascii_digit);
        let end = if first.is_ascii_digit() || (first == b'-' && digit(1)) {
            let mut i = 1;
            while let Some(byte) = bytes.get(i) {
                let part = match byte {
                    b'0'..=b'9' => true,
                    b'.' => digit(i + 1),
                    b'e' => digit(i + 1) || (bytes.get(i + 1) == Some(&b'-') && digit(i + 2)),
                    b'-' => bytes.get(i - 1) == Some(&b'e'),
                    _ => false,
                };
                if !part {
                    break;
                }
                i += 1;
            }
            i
        } else if first.is_ascii_alphabetic() || first == b'_' {
            // A name with its digits.
            let name = |b: &u8| b.is_ascii_alphanumeric() || *b == b'_';
            bytes.iter().position(|b| !name(b)).unwrap_or(bytes.len())
        } else {
            let plain = |b: &u8| !b.is_ascii_alphanumeric() && !matches!(b, b'_' | b'-');
            bytes.iter().skip(1).position(|b| !plain(b)).map_or(bytes.len(), |i| i + 1)
        };
        let (piece, rest) = self.0.split_at_checked(end).unwrap_or((self.0, ""));
        self.0 = rest;
        Some(piece)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_numbers_are_compared_and_names_are_not() {
        let check = |a: &str, b: &str, expected: Option<(f64, u64)>| {
            assert_eq!(distance(a, b), expected, "{a} | {b}");
            assert_eq!(Pieces(a).collect::<String>(), a);
        };
        check("A { x1: 1.5, n: 3 }", "A { x1: 1.5, n: 3 }", Some((0.0, 0)));
        check("A { x1: 1.5 }", "A { x2: 1.5 }", None);
        check("x: 0.25,", "x: 0.5,", Some((0.25, 0)));
        check("x: -2e-7,", "x: 2e-7,", Some((4e-7, 0)));
        check("x: 1000.0", "x: 1000.5", Some((0.5 / 1000.5, 0)));
        check("z: -1200", "z: -1201", Some((0.0, 1)));
        check("z: 1200", "z: 1202", None);
        check("x: NaN", "x: 1.0", None);
        check("x: NaN", "x: NaN", Some((0.0, 0)));
        check("MODE_A", "MODE_B", None);
        check("a: 1, b: 2", "a: 1", None);
        check("größer ° 1.0", "größer ° 1.0", Some((0.0, 0)));
    }

    #[test]
    fn prop_bytes_that_are_no_messages_do_not_agree() {
        assert!(matches!(compare(b"b", b"c"), Agreement::None(_)));
        assert_eq!(without_signatures(b"b"), b"b");
        assert_eq!(without_signatures(&[0xfd, 9, 0]), [0xfd, 9, 0]);
    }
}
