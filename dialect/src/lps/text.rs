//! Text lines of a sniffer before its command `b`: `From SS to DD @HHLLLLLLLL: PPPP…` CR LF, hex,
//! time most significant byte first.

use super::sniffer::{MAX_PAYLOAD, SnifferFrame, SnifferLoss};
use super::{RX_BITS, check};
use crate::scanner::{Found, Scanner, Verdict};

/// Characters before the payload, `From SS to DD @HHLLLLLLLL: `.
const HEAD: usize = 27;
const LONGEST_LINE: usize = HEAD + 2 * MAX_PAYLOAD + 2;

/// Finds packets in the text output.
#[derive(Debug, Clone)]
pub struct TextDecoder {
    scanner: Scanner,
    payload: [u8; MAX_PAYLOAD],
}

impl Default for TextDecoder {
    fn default() -> Self {
        Self { scanner: Scanner::default(), payload: [0; MAX_PAYLOAD] }
    }
}

impl TextDecoder {
    /// With an empty buffer.
    pub fn new() -> Self {
        Self::default()
    }

    /// Appends bytes, in any chunking. Read with [`next`](Self::next) until it gives `None`.
    pub fn push(&mut self, bytes: &[u8]) {
        self.scanner.push(bytes);
    }

    /// Bytes neither delivered nor reported yet.
    pub fn pending(&self) -> usize {
        self.scanner.pending()
    }

    /// The next packet or loss; `None` when more bytes are needed.
    #[allow(clippy::should_implement_trait)] // lends from the buffer, which `Iterator` cannot
    pub fn next(&mut self) -> Option<Result<SnifferFrame<'_>, SnifferLoss>> {
        Some(match self.scanner.next(|b| b == b'F', judge)? {
            Found::Garbage(n) => Err(SnifferLoss::GarbageBytes(n)),
            Found::Failed(loss) => Err(loss),
            Found::Frame(_, line) => {
                self.payload = line.payload;
                Ok(SnifferFrame {
                    rx_ticks: line.rx_ticks,
                    source: line.source,
                    destination: line.destination,
                    payload: self.payload.get(..line.len).unwrap_or_default(),
                })
            }
        })
    }
}

struct Line {
    rx_ticks: u64,
    source: u8,
    destination: u8,
    payload: [u8; MAX_PAYLOAD],
    len: usize,
}

fn judge(bytes: &[u8]) -> Verdict<Line, SnifferLoss> {
    let line = bytes.get(..LONGEST_LINE).unwrap_or(bytes);
    let Some(end) = line.iter().position(|b| *b == b'\n') else {
        return match line.len() {
            LONGEST_LINE => Verdict::Failed(SnifferLoss::BadLength),
            _ => Verdict::Incomplete,
        };
    };
    let Some(parsed) = line.get(..end).and_then(parse) else {
        return Verdict::Failed(SnifferLoss::BadLength);
    };
    match check(parsed.source, parsed.payload.get(..parsed.len).unwrap_or_default()) {
        Ok(()) => Verdict::Frame(end + 1, parsed),
        Err(error) => Verdict::Failed(error.into()),
    }
}

fn parse(line: &[u8]) -> Option<Line> {
    let line = line.strip_suffix(b"\r").unwrap_or(line);
    let (source, line) = hex(line.strip_prefix(b"From ")?, 2)?;
    let (destination, line) = hex(line.strip_prefix(b" to ")?, 2)?;
    let (rx_ticks, line) = hex(line.strip_prefix(b" @")?, (RX_BITS / 4) as usize)?;
    let mut rest = line.strip_prefix(b":")?;
    rest = rest.strip_prefix(b" ").unwrap_or(rest);
    let mut payload = [0; MAX_PAYLOAD];
    let mut len = 0;
    while !rest.is_empty() {
        let (byte, tail) = hex(rest, 2)?;
        *payload.get_mut(len)? = byte as u8; // two digits
        len += 1;
        rest = tail;
    }
    Some(Line { rx_ticks, source: source as u8, destination: destination as u8, payload, len })
}

/// Value of the first `digits` characters, and what follows them.
fn hex(text: &[u8], digits: usize) -> Option<(u64, &[u8])> {
    let (head, tail) = text.split_at_checked(digits)?;
    let mut value = 0;
    for digit in head {
        value = value << 4 | u64::from(char::from(*digit).to_digit(16)?);
    }
    Some((value, tail))
}

/// Appends a line.
pub fn encode(out: &mut Vec<u8>, frame: &SnifferFrame<'_>) {
    let rx_ticks = frame.rx_ticks & ((1 << RX_BITS) - 1);
    let (source, destination) = (frame.source, frame.destination);
    let line = format!("From {source:02x} to {destination:02x} @{rx_ticks:010x}: ");
    out.extend_from_slice(line.as_bytes());
    for byte in frame.payload.iter().take(MAX_PAYLOAD) {
        out.extend_from_slice(format!("{byte:02x}").as_bytes());
    }
    out.extend_from_slice(b"\r\n");
}

#[cfg(test)]
mod tests {
    use super::super::tdoa3::Tdoa3Packet;
    use super::*;

    #[test]
    fn golden_line_after_the_format_in_the_interface_description() {
        let line = b"boot: LPS node\r\nFrom 0a to ff @010203040A: 300500000080 00\r\n\
            From 0a to ff @010203040a: 30050000008000\r\n";
        let mut decoder = TextDecoder::new();
        let mut frames = 0;
        let mut garbage = 0;
        for chunk in line.chunks(5) {
            decoder.push(chunk);
            while let Some(found) = decoder.next() {
                match found {
                    Ok(frame) => {
                        frames += 1;
                        assert_eq!(frame.rx_ticks, 0x01_0203_040A);
                        assert_eq!((frame.source, frame.destination), (10, 0xFF));
                        let packet = Tdoa3Packet::decode(frame.payload).unwrap();
                        assert_eq!((packet.counter, packet.tx), (5, 0x8000_0000));
                        let mut again = Vec::new();
                        encode(&mut again, &frame);
                        assert!(line.ends_with(&again[again.len() - 20..]));
                    }
                    Err(SnifferLoss::GarbageBytes(n)) => garbage += n,
                    Err(_) => {}
                }
            }
        }
        assert_eq!((frames, garbage, decoder.pending()), (1, line.len() - 43, 0));
    }
}
