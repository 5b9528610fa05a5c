//! A plan as a file: how mission, fence and rally points are kept over a restart.
//!
//! Eight bytes of name and version, the number of items, the items as MAVLink frames of
//! MISSION_ITEM_INT (any MAVLink tool reads them), and a CRC-32 over all of that.

use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavMessage};
use haltere_dialect::mav_stream::{self, MavSplitter};

use super::crc32::crc32;

/// Name and version.
const MAGIC: &[u8; 8] = b"HALPLAN1";

/// The file of these items.
pub fn encode(items: &[MISSION_ITEM_INT_DATA]) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend_from_slice(&(items.len() as u32).to_le_bytes());
    for (seq, item) in items.iter().enumerate() {
        let message = MavMessage::MISSION_ITEM_INT(item.clone());
        mav_stream::encode(&mut bytes, 1, 1, seq as u8, &message);
    }
    let crc = crc32(&bytes, !0);
    bytes.extend_from_slice(&crc.to_le_bytes());
    bytes
}

/// The items of a file; the error is for people.
pub fn decode(bytes: &[u8]) -> Result<Vec<MISSION_ITEM_INT_DATA>, String> {
    let damaged = |why: &str| Err(format!("plan file of {} bytes: {why}", bytes.len()));
    let Some((body, crc)) = bytes.split_last_chunk::<4>() else { return damaged("too short") };
    if crc32(body, !0) != u32::from_le_bytes(*crc) {
        return damaged("its checksum is wrong");
    }
    let Some((count, frames)) =
        body.strip_prefix(MAGIC).and_then(|rest| rest.split_first_chunk::<4>())
    else {
        return damaged("it is no plan");
    };
    let mut splitter = MavSplitter::new();
    let mut items = Vec::new();
    // Piece by piece: the splitter's buffer is bounded.
    for piece in frames.chunks(256) {
        splitter.push(piece);
        while let Some(next) = splitter.next() {
            match next.and_then(|frame| frame.decode()) {
                Ok(MavMessage::MISSION_ITEM_INT(item)) => items.push(item),
                _ => return damaged("it holds something else than items"),
            }
        }
    }
    if items.len() as u32 != u32::from_le_bytes(*count) {
        return damaged("items are missing");
    }
    Ok(items)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn items() -> Vec<MISSION_ITEM_INT_DATA> {
        (0..300)
            .map(|seq| MISSION_ITEM_INT_DATA {
                seq,
                x: i32::from(seq) * -1000,
                z: -1.5,
                param4: 0.25,
                ..Default::default()
            })
            .collect()
    }

    #[test]
    fn prop_there_and_back() {
        assert_eq!(decode(&encode(&items())), Ok(items()));
        assert_eq!(decode(&encode(&[])), Ok(vec![]));
    }

    #[test]
    fn prop_no_cut_and_no_flipped_bit_passes() {
        let bytes = encode(&items()[..5]);
        for end in 0..bytes.len() {
            assert!(decode(&bytes[..end]).is_err(), "cut at {end}");
        }
        for at in 0..bytes.len() {
            let mut bad = bytes.clone();
            bad[at] ^= 0x10;
            assert!(decode(&bad).is_err(), "flipped at {at}");
        }
    }
}
