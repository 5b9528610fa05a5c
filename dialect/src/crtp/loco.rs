//! The memory of the Loco Positioning deck: which anchors it hears, and where they say they are.
//!
//! Positions are what the anchors broadcast, kept for 2 s. Source: crazyflie-firmware 2a18fc29,
//! `src/deck/drivers/src/locodeck.c` and `src/modules/interface/mem.h`.

use super::wire::Reader;

/// Type of this memory, the second of its kind; the first, 0x11, is in no present firmware.
pub const TYPE: u8 = 0x13;
/// Address of the list of all anchors that were heard: a count, then their ids.
pub const HEARD: u32 = 0x0000;
/// Address of the list of those heard in the last 2 s, of the same form.
pub const ACTIVE: u32 = 0x1000;
/// Bytes of [`AnchorPosition`], which must be read at once.
pub const POSITION_LEN: u8 = 13;

const POSITIONS: u32 = 0x2000;
const POSITION_STEP: u32 = 0x0100;

/// Address of an anchor's position.
pub const fn position(anchor: u8) -> u32 {
    POSITIONS + POSITION_STEP * anchor as u32
}

/// The ids in a list, of which these are the first bytes: fewer than the count where that many were not read.
pub fn anchors(list: &[u8]) -> &[u8] {
    let Some((count, ids)) = list.split_first() else { return &[] };
    ids.get(..usize::from(*count)).unwrap_or(ids)
}

/// Where an anchor says it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnchorPosition {
    /// In the anchors' own world, z up, m.
    pub position_m: [f32; 3],
    /// It has said so in the last 2 s.
    pub valid: bool,
}

impl AnchorPosition {
    /// Of exactly [`POSITION_LEN`] bytes.
    pub fn read(bytes: &[u8]) -> Option<Self> {
        let mut reader = Reader(bytes);
        let (position_m, valid) = (reader.f32s().ok()?, reader.flag().ok()?);
        reader.end().ok()?;
        Some(Self { position_m, valid })
    }

    /// Its bytes.
    pub fn bytes(&self) -> [u8; POSITION_LEN as usize] {
        let mut bytes = [self.valid.into(); POSITION_LEN as usize];
        for (to, from) in
            bytes.iter_mut().zip(self.position_m.into_iter().flat_map(f32::to_le_bytes))
        {
            *to = from;
        }
        bytes
    }
}
