//! TDoA3 on the air: any number of anchors at random times, each packet lists up to eight others.
//!
//! | offset | size | field |
//! |---|---|---|
//! | 0 | 1 | 0x30 |
//! | 1 | 1 | counter, 0 to 127 |
//! | 2 | 4 | time of sending, low 32 bits |
//! | 6 | 1 | number of entries, at most 8 |
//! | 7 | 6 or 8 each | id; bit 7: has distance, bits 0-6: counter heard; receive time u32; time of flight u16 |
//! | end | 14 | optional position of the sender |

use super::{PayloadError, decode_position, encode_position, tail_fits};

/// First byte of the payload.
pub const TYPE: u8 = 0x30;
/// Most entries in one packet.
pub const MAX_REMOTES: usize = 8;

const HEAD: usize = 7;
const HAS_DISTANCE: u8 = 0x80;
const ENTRY: usize = 6;
const ENTRY_WITH_DISTANCE: usize = 8;

/// What the sender heard of one other anchor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Remote {
    /// The other anchor.
    pub id: u8,
    /// Number of the last packet heard from it, 7 bits.
    pub counter: u8,
    /// When that packet was received, sender's clock, low 32 bits.
    pub rx: u32,
    /// Time of flight to it, ticks, antenna delays included.
    pub tof: Option<u16>,
}

/// The entries of a packet, without allocation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Remotes {
    entries: [Remote; MAX_REMOTES],
    len: usize,
}

impl Remotes {
    /// No entry.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds an entry; `false` when the packet is full.
    pub fn push(&mut self, remote: Remote) -> bool {
        let Some(slot) = self.entries.get_mut(self.len) else { return false };
        *slot = remote;
        self.len += 1;
        true
    }

    /// The entries in the order of the packet.
    #[inline]
    pub fn as_slice(&self) -> &[Remote] {
        self.entries.get(..self.len).unwrap_or_default()
    }
}

/// One packet.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tdoa3Packet {
    /// Number of this packet, 7 bits.
    pub counter: u8,
    /// Time of sending, sender's clock, low 32 bits.
    pub tx: u32,
    /// What the sender heard of others.
    pub remotes: Remotes,
    /// Position of the sender, m, as its operator wrote it.
    pub position: Option<[f32; 3]>,
}

/// Length of the entry that begins with these bytes.
#[inline]
fn entry_len(entry: &[u8]) -> Option<usize> {
    let with_distance = entry.get(1)? & HAS_DISTANCE != 0;
    Some(if with_distance { ENTRY_WITH_DISTANCE } else { ENTRY })
}

/// Whether type, number of entries and length are right.
#[inline]
pub(super) fn fits(payload: &[u8]) -> bool {
    let Some((&[TYPE, counter, _, _, _, _, count], mut rest)) = payload.split_first_chunk::<HEAD>()
    else {
        return false;
    };
    if usize::from(count) > MAX_REMOTES || counter & HAS_DISTANCE != 0 {
        return false;
    }
    for _ in 0..count {
        let Some(tail) = entry_len(rest).and_then(|len| rest.get(len..)) else { return false };
        rest = tail;
    }
    tail_fits(rest)
}

impl Tdoa3Packet {
    /// Reads a payload.
    #[inline]
    pub fn decode(payload: &[u8]) -> Result<Self, PayloadError> {
        if payload.first() != Some(&TYPE) {
            return Err(PayloadError::UnknownType);
        }
        let (head, mut rest) = match payload.split_first_chunk::<HEAD>() {
            Some(split) if fits(payload) => split,
            _ => return Err(PayloadError::BadPayload),
        };
        let [_, counter, t0, t1, t2, t3, count] = *head;
        let mut remotes = Remotes::new();
        for _ in 0..count {
            let Some((&[id, flags, r0, r1, r2, r3], tail)) = rest.split_first_chunk::<ENTRY>()
            else {
                return Err(PayloadError::BadPayload);
            };
            let mut remote = Remote {
                id,
                counter: flags & !HAS_DISTANCE,
                rx: u32::from_le_bytes([r0, r1, r2, r3]),
                tof: None,
            };
            rest = tail;
            if flags & HAS_DISTANCE != 0 {
                let Some((tof, tail)) = rest.split_first_chunk::<2>() else {
                    return Err(PayloadError::BadPayload);
                };
                remote.tof = Some(u16::from_le_bytes(*tof));
                rest = tail;
            }
            remotes.push(remote);
        }
        Ok(Self {
            counter,
            tx: u32::from_le_bytes([t0, t1, t2, t3]),
            remotes,
            position: decode_position(rest),
        })
    }

    /// Appends the payload.
    pub fn encode(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&[TYPE, self.counter & !HAS_DISTANCE]);
        out.extend_from_slice(&self.tx.to_le_bytes());
        let remotes = self.remotes.as_slice();
        out.push(remotes.len() as u8); // at most 8
        for remote in remotes {
            let flag = if remote.tof.is_some() { HAS_DISTANCE } else { 0 };
            out.extend_from_slice(&[remote.id, (remote.counter & !HAS_DISTANCE) | flag]);
            out.extend_from_slice(&remote.rx.to_le_bytes());
            out.extend(remote.tof.into_iter().flat_map(u16::to_le_bytes));
        }
        encode_position(out, self.position);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn remote() -> impl Strategy<Value = Remote> {
        (any::<u8>(), 0..128u8, any::<u32>(), any::<Option<u16>>())
            .prop_map(|(id, counter, rx, tof)| Remote { id, counter, rx, tof })
    }

    proptest! {
        #[test]
        fn prop_encode_then_decode_is_identity(
            counter in 0..128u8, tx: u32, remotes in prop::collection::vec(remote(), 0..=8),
            position in prop::option::of(prop::array::uniform3(-100.0f32..100.0)),
        ) {
            let mut packet = Tdoa3Packet { counter, tx, position, ..Default::default() };
            for r in &remotes {
                prop_assert!(packet.remotes.push(*r));
            }
            let mut payload = Vec::new();
            packet.encode(&mut payload);
            prop_assert_eq!(Tdoa3Packet::decode(&payload), Ok(packet));
            prop_assert!(payload.len() <= super::super::sniffer::MAX_PAYLOAD);
            payload.push(0);
            prop_assert_eq!(Tdoa3Packet::decode(&payload), Err(PayloadError::BadPayload));
        }

        #[test]
        fn prop_garbage_never_panics(mut bytes in prop::collection::vec(any::<u8>(), 0..140)) {
            if let Some(first) = bytes.first_mut() {
                *first = TYPE;
            }
            prop_assert_eq!(Tdoa3Packet::decode(&bytes).is_ok(), fits(&bytes));
        }
    }
}
