//! The Loco Positioning System: the sniffer's stream and the packets on the air.

pub mod sniffer;
pub mod tdoa2;
pub mod tdoa3;
pub mod text;

/// Ticks of the DW1000's time stamps per second: 128 times its 499.2 MHz chip rate
/// (DW1000 User Manual, section 4.1.6).
pub const TICK_HZ: f64 = 499.2e6 * 128.0;

/// Speed of light, m/s (exact, SI).
pub const LIGHT_MPS: f64 = 299_792_458.0;

/// Way of light in one tick, m.
pub const TICK_M: f64 = LIGHT_MPS / TICK_HZ;

/// Time stamps of the tag have this many bits: they wrap after 17.2 s.
pub const RX_BITS: u32 = 40;

/// Why a payload is no packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PayloadError {
    /// Its type is none we know.
    UnknownType,
    /// Its length or inner structure is not that of its type.
    BadPayload,
    /// Its sender cannot exist in its protocol.
    BadSource,
}

/// Checks the meaning of a payload: known type, exact length, possible sender.
#[inline]
pub fn check(source: u8, payload: &[u8]) -> Result<(), PayloadError> {
    match payload.first() {
        None => Err(PayloadError::BadPayload),
        Some(&tdoa2::TYPE) if !tdoa2::fits(payload) => Err(PayloadError::BadPayload),
        Some(&tdoa2::TYPE) if usize::from(source) >= tdoa2::ANCHORS => Err(PayloadError::BadSource),
        Some(&tdoa3::TYPE) if !tdoa3::fits(payload) => Err(PayloadError::BadPayload),
        Some(&(tdoa2::TYPE | tdoa3::TYPE)) => Ok(()),
        Some(_) => Err(PayloadError::UnknownType),
    }
}

/// Optional tail of a packet: position of its sender.
const POSITION_LEN: usize = 14;
/// Header of a short LPP packet, then its type, anchor position.
const POSITION_MARK: [u8; 2] = [0xF0, 0x01];

/// Whether `tail` is empty or a position.
#[inline]
fn tail_fits(tail: &[u8]) -> bool {
    tail.is_empty() || (tail.len() == POSITION_LEN && tail.starts_with(&POSITION_MARK))
}

fn decode_position(tail: &[u8]) -> Option<[f32; 3]> {
    let (words, _) = tail.strip_prefix(&POSITION_MARK)?.as_chunks::<4>();
    let [x, y, z] = words.try_into().ok()?;
    Some([f32::from_le_bytes(x), f32::from_le_bytes(y), f32::from_le_bytes(z)])
}

fn encode_position(out: &mut Vec<u8>, position: Option<[f32; 3]>) {
    if let Some(position) = position {
        out.extend_from_slice(&POSITION_MARK);
        out.extend(position.into_iter().flat_map(f32::to_le_bytes));
    }
}
