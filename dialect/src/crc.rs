//! CRC-16/MCRF4XX, the checksum of MAVLink (its documents call it X.25): reflected polynomial
//! 0x8408, start 0xFFFF, no final inversion.
//!
//! Eight tables take eight bytes a step: the chain of dependent look-ups, not the arithmetic, is
//! what a byte-wise CRC costs.

const POLYNOMIAL: u16 = 0x8408;
const START: u16 = 0xFFFF;
const LANES: usize = 8;

/// `TABLES[k][b]`: effect of byte `b` followed by `k` zero bytes.
static TABLES: [[u16; 256]; LANES] = tables();

/// The only index whose entry in `TABLES[0]` has this high byte: the entries of a reflected table
/// differ in it, because the polynomial's top bit is set.
static BY_HIGH_BYTE: [u8; 256] = by_high_byte();

const fn tables() -> [[u16; 256]; LANES] {
    let mut tables = [[0u16; 256]; LANES];
    let mut byte = 0;
    while byte < 256 {
        let mut crc = byte as u16;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ POLYNOMIAL } else { crc >> 1 };
            bit += 1;
        }
        tables[0][byte] = crc;
        byte += 1;
    }
    let mut lane = 1;
    while lane < LANES {
        let mut byte = 0;
        while byte < 256 {
            let crc = tables[lane - 1][byte];
            tables[lane][byte] = (crc >> 8) ^ tables[0][(crc & 0xFF) as usize];
            byte += 1;
        }
        lane += 1;
    }
    tables
}

const fn by_high_byte() -> [u8; 256] {
    let tables = tables();
    let mut inverse = [0u8; 256];
    let mut byte = 0;
    while byte < 256 {
        inverse[(tables[0][byte] >> 8) as usize] = byte as u8;
        byte += 1;
    }
    inverse
}

/// Takes one more byte in.
#[inline]
pub fn step(crc: u16, byte: u8) -> u16 {
    (crc >> 8) ^ TABLES[0][usize::from(crc as u8 ^ byte)]
}

/// Checksum of `bytes`.
#[inline]
pub fn checksum(bytes: &[u8]) -> u16 {
    let (chunks, rest) = bytes.as_chunks::<LANES>();
    let mut crc = START;
    for b in chunks {
        let [low, high] = crc.to_le_bytes();
        crc = TABLES[7][usize::from(b[0] ^ low)]
            ^ TABLES[6][usize::from(b[1] ^ high)]
            ^ TABLES[5][usize::from(b[2])]
            ^ TABLES[4][usize::from(b[3])]
            ^ TABLES[3][usize::from(b[4])]
            ^ TABLES[2][usize::from(b[5])]
            ^ TABLES[1][usize::from(b[6])]
            ^ TABLES[0][usize::from(b[7])];
    }
    rest.iter().fold(crc, |crc, b| step(crc, *b))
}

/// Whether any one last byte takes `crc` to `goal`. Of all goals, one in 256 can be reached.
#[inline]
pub fn reachable(crc: u16, goal: u16) -> bool {
    let entry = goal ^ (crc >> 8);
    TABLES[0][usize::from(BY_HIGH_BYTE[usize::from(entry >> 8)])] == entry
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_check_value_of_the_catalogue() {
        // Catalogue of parametrised CRC algorithms, CRC-16/MCRF4XX: check 0x6f91 on "123456789".
        assert_eq!(checksum(b"123456789"), 0x6F91);
    }

    #[test]
    fn prop_eight_lanes_equal_byte_by_byte() {
        let bytes: Vec<u8> = (0..100u32).map(|i| (i * i * 31 + 7) as u8).collect();
        for len in 0..bytes.len() {
            let slow = bytes[..len].iter().fold(START, |crc, b| step(crc, *b));
            assert_eq!(checksum(&bytes[..len]), slow);
        }
    }

    #[test]
    fn prop_reachable_is_exact() {
        for crc in [0u16, 1, 0xFFFF, 0x1234, 0xBEEF] {
            let mut goals: Vec<u16> = (0..=255u8).map(|b| step(crc, b)).collect();
            goals.sort_unstable();
            for goal in 0..=u16::MAX {
                assert_eq!(reachable(crc, goal), goals.binary_search(&goal).is_ok());
            }
        }
    }
}
