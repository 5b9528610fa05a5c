//! Binary frames of a Loco Positioning Node in sniffer mode, after its command `b`.
//!
//! | offset | bytes | field, little-endian |
//! |---|---|---|
//! | 0 | 1 | 0xBC, not escaped |
//! | 1 | 5 | receive time, ticks of the tag's clock |
//! | 6 | 1 | source anchor |
//! | 7 | 1 | destination, 0xFF broadcast |
//! | 8 | 2 | L, at most 128 |
//! | 10 | L | UWB payload |
//! | 10+L | 2 | L again, the only integrity check |
//!
//! The device drops single bytes in mid-frame when the host stalls and replays its boot text
//! between frames, so a frame counts only when both lengths agree *and* the payload is a packet
//! (see [`super::check`]). Together that is 43 bits or more of evidence, and the search resumes one
//! byte after a failed 0xBC: a lost byte costs its own frame only. What cannot be noticed is a byte
//! that was *changed* (not lost) in time, source or payload: there is no checksum.

use super::{PayloadError, check};
use crate::scanner::{Found, Scanner, Verdict};

/// First byte of a frame.
pub const SYNC: u8 = 0xBC;
/// Longest payload: what the DW1000 receives without its long-frame mode, rounded up.
pub const MAX_PAYLOAD: usize = 128;
/// Bytes before the payload.
pub const HEAD: usize = 10;
/// Bytes of a frame beside its payload.
pub const OVERHEAD: usize = HEAD + 2;

/// One packet as the sniffer heard it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SnifferFrame<'a> {
    /// When it was received, ticks of the tag's clock, 40 bits.
    pub rx_ticks: u64,
    /// Anchor that sent it.
    pub source: u8,
    /// Whom it was for; 0xFF everybody.
    pub destination: u8,
    /// The packet.
    pub payload: &'a [u8],
}

/// Something lost on the way from the sniffer. Failed candidates are counted each, so that one
/// damaged frame with 0xBC inside may count more than once; their bytes are all in `GarbageBytes`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SnifferLoss {
    /// Bytes that belong to no frame.
    GarbageBytes(usize),
    /// The two lengths differ or exceed the limit.
    BadLength,
    /// The payload is of no known type.
    UnknownType,
    /// The payload has not the length or structure of its type.
    BadPayload,
    /// The sender cannot exist in its protocol.
    BadSource,
}

impl From<PayloadError> for SnifferLoss {
    fn from(error: PayloadError) -> Self {
        match error {
            PayloadError::UnknownType => SnifferLoss::UnknownType,
            PayloadError::BadPayload => SnifferLoss::BadPayload,
            PayloadError::BadSource => SnifferLoss::BadSource,
        }
    }
}

/// Finds frames in the bytes of the serial port.
#[derive(Debug, Default, Clone)]
pub struct SnifferDecoder {
    scanner: Scanner,
}

impl SnifferDecoder {
    /// With an empty buffer.
    pub fn new() -> Self {
        Self::default()
    }

    /// Appends bytes, in any chunking. Read with [`next`](Self::next) until it gives `None`
    /// before the next push: of more than 64 KiB that wait, the oldest are dropped as garbage.
    pub fn push(&mut self, bytes: &[u8]) {
        self.scanner.push(bytes);
    }

    /// Gives up waiting for the rest of a frame: for a link that went quiet or was reopened.
    pub fn flush(&mut self) {
        self.scanner.flush();
    }

    /// Bytes neither delivered nor reported yet.
    pub fn pending(&self) -> usize {
        self.scanner.pending()
    }

    /// The next frame or loss; `None` when more bytes are needed.
    #[allow(clippy::should_implement_trait)] // lends from the buffer, which `Iterator` cannot
    #[inline]
    pub fn next(&mut self) -> Option<Result<SnifferFrame<'_>, SnifferLoss>> {
        Some(match self.scanner.next(|b| b == SYNC, judge)? {
            Found::Garbage(n) => Err(SnifferLoss::GarbageBytes(n)),
            Found::Failed(loss) => Err(loss),
            Found::Frame(range, Head { rx_ticks, source, destination, len }) => {
                let payload = self.scanner.at(range).get(HEAD..HEAD + len).unwrap_or_default();
                Ok(SnifferFrame { rx_ticks, source, destination, payload })
            }
        })
    }
}

struct Head {
    rx_ticks: u64,
    source: u8,
    destination: u8,
    len: usize,
}

#[inline]
fn judge(bytes: &[u8]) -> Verdict<Head, SnifferLoss> {
    let Some((&[_, t0, t1, t2, t3, t4, source, destination, l0, l1], rest)) =
        bytes.split_first_chunk::<HEAD>()
    else {
        return Verdict::Incomplete;
    };
    let len = usize::from(u16::from_le_bytes([l0, l1]));
    if len > MAX_PAYLOAD {
        return Verdict::Failed(SnifferLoss::BadLength);
    }
    let (Some(payload), Some(tail)) = (rest.get(..len), rest.get(len..len + 2)) else {
        return Verdict::Incomplete;
    };
    if tail != [l0, l1] {
        return Verdict::Failed(SnifferLoss::BadLength);
    }
    match check(source, payload) {
        Ok(()) => {
            let rx_ticks = u64::from_le_bytes([t0, t1, t2, t3, t4, 0, 0, 0]);
            Verdict::Frame(len + OVERHEAD, Head { rx_ticks, source, destination, len })
        }
        Err(error) => Verdict::Failed(error.into()),
    }
}

/// Appends a frame. Of the time only 40 bits are sent; a payload beyond [`MAX_PAYLOAD`] is cut.
pub fn encode(out: &mut Vec<u8>, frame: &SnifferFrame<'_>) {
    let payload = frame.payload.get(..MAX_PAYLOAD).unwrap_or(frame.payload);
    let len = (payload.len() as u16).to_le_bytes();
    let [t0, t1, t2, t3, t4, ..] = frame.rx_ticks.to_le_bytes();
    out.extend_from_slice(&[SYNC, t0, t1, t2, t3, t4, frame.source, frame.destination]);
    out.extend_from_slice(&len);
    out.extend_from_slice(payload);
    out.extend_from_slice(&len);
}

#[cfg(test)]
mod tests;
