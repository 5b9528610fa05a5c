//! Signatures of MAVLink 2 frames: who holds the key may speak.
//!
//! A signed frame flags it in its header and carries 13 more bytes behind its checksum:
//!
//! ```text
//! link id (1)   timestamp (6, little-endian, 10 µs since 2015-01-01 UTC)   signature (6)
//! signature = first 6 bytes of SHA-256(key (32) + frame from its marker to the timestamp)
//! ```
//!
//! Source: MAVLink developer guide, "Message Signing". This file knows bytes only: which frames are
//! demanded to be signed, and how old a timestamp may be, is policy and stands elsewhere.

use sha2::{Digest, Sha256};

use crate::crc;
use crate::mav_stream::{self, MavFrame};

/// Bytes of a key.
pub const KEY_BYTES: usize = 32;
/// Bytes that a signature adds to a frame.
pub const SIGNATURE_BYTES: usize = 13;
/// Of these, the signature proper, at the end.
const DIGEST_BYTES: usize = 6;
/// 2015-01-01 00:00 UTC, s since 1970.
const EPOCH_UNIX_S: i64 = 1_420_070_400;
/// Timestamps in a second.
pub const TIMESTAMPS_PER_S: u64 = 100_000;
/// The largest timestamp: 48 bits end in the year 2104.
pub const LAST_TIMESTAMP: u64 = (1 << 48) - 1;

/// A secret. Not printed, not compared in a time that depends on it.
#[derive(Clone)]
pub struct SigningKey([u8; KEY_BYTES]);

impl std::fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("SigningKey(…)")
    }
}

impl PartialEq for SigningKey {
    fn eq(&self, other: &Self) -> bool {
        same(&self.0, &other.0)
    }
}

impl Eq for SigningKey {}

impl SigningKey {
    /// Of these bytes. `None`: all zeros, which MAVLink uses to say "no key".
    pub fn new(bytes: [u8; KEY_BYTES]) -> Option<Self> {
        (bytes != [0; KEY_BYTES]).then_some(Self(bytes))
    }

    /// From the content of a key file: 32 bytes, or 64 hexadecimal digits with blanks around them.
    pub fn from_file(content: &[u8]) -> Option<Self> {
        if let Ok(bytes) = content.try_into() {
            return Self::new(bytes);
        }
        let text = std::str::from_utf8(content).ok()?.trim();
        if text.len() != 2 * KEY_BYTES || !text.bytes().all(|b| b.is_ascii_hexdigit()) {
            return None;
        }
        let mut bytes = [0; KEY_BYTES];
        for (n, byte) in bytes.iter_mut().enumerate() {
            *byte = u8::from_str_radix(text.get(2 * n..2 * n + 2)?, 16).ok()?;
        }
        Self::new(bytes)
    }

    /// As a key file holds it: 64 hexadecimal digits and the end of the line.
    pub fn to_file(&self) -> String {
        let digits: String = self.0.iter().map(|b| format!("{b:02x}")).collect();
        digits + "\n"
    }

    fn digest(&self, signed: &[u8]) -> [u8; DIGEST_BYTES] {
        let hash = Sha256::new().chain_update(self.0).chain_update(signed).finalize();
        let mut digest = [0; DIGEST_BYTES];
        for (to, from) in digest.iter_mut().zip(hash) {
            *to = from;
        }
        digest
    }
}

/// Without an early end, which would tell how much fits.
fn same(a: &[u8], b: &[u8]) -> bool {
    a.len() == b.len() && a.iter().zip(b).fold(0, |all, (x, y)| all | (x ^ y)) == 0
}

/// The timestamp of a moment, µs since 1970 UTC. Before 2015 it is 0.
pub fn timestamp(unix_us: i64) -> u64 {
    let since_us = unix_us.saturating_sub(EPOCH_UNIX_S.saturating_mul(1_000_000)).max(0);
    (since_us.unsigned_abs() / 10).min(LAST_TIMESTAMP)
}

/// The moment of a timestamp, µs since 1970 UTC.
pub fn unix_us(timestamp: u64) -> i64 {
    let since_us = timestamp.min(LAST_TIMESTAMP).saturating_mul(10).cast_signed();
    EPOCH_UNIX_S.saturating_mul(1_000_000).saturating_add(since_us)
}

/// Whether a frame is signed, with this key.
pub fn verify(frame: &MavFrame<'_>, key: &SigningKey) -> bool {
    let Some(signed) = frame.raw.len().checked_sub(DIGEST_BYTES).filter(|_| frame.signed) else {
        return false;
    };
    match frame.raw.split_at_checked(signed) {
        Some((bytes, signature)) => same(&key.digest(bytes), signature),
        None => false,
    }
}

/// The signed form of one whole unsigned MAVLink 2 frame. `None`: it is something else, or its id is
/// unknown, so that the checksum cannot be made anew.
pub fn sign(frame: &[u8], key: &SigningKey, link_id: u8, timestamp: u64) -> Option<Vec<u8>> {
    let &[mav_stream::MARKER_V2, len, 0, _, _, _, _, i0, i1, i2, ..] = frame else { return None };
    let body_end = mav_stream::HEADER_V2 + usize::from(len);
    if frame.len() != body_end + mav_stream::CHECKSUM {
        return None;
    }
    let extra = mav_stream::crc_extra(u32::from_le_bytes([i0, i1, i2, 0]))?;
    let mut out = Vec::with_capacity(frame.len() + SIGNATURE_BYTES);
    out.extend_from_slice(frame.get(..body_end)?);
    // The flag is covered by the checksum.
    *out.get_mut(2)? |= mav_stream::FLAG_SIGNED;
    let crc = crc::step(crc::checksum(out.get(1..)?), extra);
    out.extend_from_slice(&crc.to_le_bytes());
    out.push(link_id);
    out.extend_from_slice(timestamp.min(LAST_TIMESTAMP).to_le_bytes().get(..6)?);
    let digest = key.digest(&out);
    out.extend_from_slice(&digest);
    Some(out)
}

#[cfg(test)]
mod tests;
