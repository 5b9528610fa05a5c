//! TDoA2 on the air: anchors 0 to 7 send in turn, each packet tells what its sender heard.
//!
//! | offset | size | field |
//! |---|---|---|
//! | 0 | 1 | 0x22 |
//! | 1 | 8 × u8 | packet counters |
//! | 9 | 8 × u32 | times, sender's clock, low 32 bits |
//! | 41 | 8 × u16 | times of flight, ticks |
//! | 57 | 14 | optional position of the sender |

use super::{PayloadError, decode_position, encode_position, tail_fits};

/// First byte of the payload.
pub const TYPE: u8 = 0x22;
/// Anchors of the protocol.
pub const ANCHORS: usize = 8;
/// Length without the position.
pub const LEN: usize = 57;

const COUNTERS_AT: usize = 1;
const TIMES_AT: usize = 9;
const TOFS_AT: usize = 41;

/// One packet. The entry at the sender's own index means its own packet.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Tdoa2Packet {
    /// Own index: number of this packet. Else: of the last packet heard from that anchor.
    /// To be compared on 7 bits.
    pub counters: [u8; ANCHORS],
    /// Own index: time of sending. Else: time at which that packet was received. Ticks of the
    /// sender's clock, low 32 bits; 0: none.
    pub times: [u32; ANCHORS],
    /// Time of flight to that anchor, ticks, antenna delays included; 0: none.
    pub tofs: [u16; ANCHORS],
    /// Position of the sender, m, as its operator wrote it.
    pub position: Option<[f32; 3]>,
}

/// Whether type and length are right.
#[inline]
pub(super) fn fits(payload: &[u8]) -> bool {
    payload.first() == Some(&TYPE) && payload.get(LEN..).is_some_and(tail_fits)
}

impl Tdoa2Packet {
    /// Reads a payload.
    #[inline]
    pub fn decode(payload: &[u8]) -> Result<Self, PayloadError> {
        if payload.first() != Some(&TYPE) {
            return Err(PayloadError::UnknownType);
        }
        if !fits(payload) {
            return Err(PayloadError::BadPayload);
        }
        let bad = || PayloadError::BadPayload;
        let (times, _) = payload.get(TIMES_AT..TOFS_AT).ok_or_else(bad)?.as_chunks::<4>();
        let (tofs, _) = payload.get(TOFS_AT..LEN).ok_or_else(bad)?.as_chunks::<2>();
        let times: &[[u8; 4]; ANCHORS] = times.try_into().map_err(|_| bad())?;
        let tofs: &[[u8; 2]; ANCHORS] = tofs.try_into().map_err(|_| bad())?;
        let counters = payload.get(COUNTERS_AT..TIMES_AT).ok_or_else(bad)?;
        Ok(Self {
            counters: counters.try_into().map_err(|_| bad())?,
            times: times.map(u32::from_le_bytes),
            tofs: tofs.map(u16::from_le_bytes),
            position: payload.get(LEN..).and_then(decode_position),
        })
    }

    /// Appends the payload.
    pub fn encode(&self, out: &mut Vec<u8>) {
        out.push(TYPE);
        out.extend_from_slice(&self.counters);
        out.extend(self.times.into_iter().flat_map(u32::to_le_bytes));
        out.extend(self.tofs.into_iter().flat_map(u16::to_le_bytes));
        encode_position(out, self.position);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn prop_encode_then_decode_is_identity(
            counters: [u8; 8], times: [u32; 8], tofs: [u16; 8],
            position in prop::option::of(prop::array::uniform3(-100.0f32..100.0)),
        ) {
            let packet = Tdoa2Packet { counters, times, tofs, position };
            let mut payload = Vec::new();
            packet.encode(&mut payload);
            prop_assert_eq!(payload.len(), if position.is_some() { 71 } else { 57 });
            prop_assert_eq!(Tdoa2Packet::decode(&payload), Ok(packet));
            payload.pop();
            prop_assert_eq!(Tdoa2Packet::decode(&payload), Err(PayloadError::BadPayload));
        }
    }
}
