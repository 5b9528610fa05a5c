//! The CRC-32 of MAVLink's services: parameter hash, file checksums, component metadata.
//!
//! Polynomial 0x04C11DB7, reflected (0xEDB88320), start 0 and **no** final inversion: that is what
//! the guide's MAVLink FTP page ("CalcFileCRC32") and PX4's `_HASH_CHECK` use. It is not the CRC-32
//! of zip, which starts at and ends with all ones.

/// Reflected polynomial.
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// Goes on with a checksum; begin with 0.
pub fn crc32(bytes: &[u8], start: u32) -> u32 {
    bytes.iter().fold(start, |crc, byte| {
        let mut crc = crc ^ u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { (crc >> 1) ^ POLYNOMIAL } else { crc >> 1 };
        }
        crc
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The check value of zip's CRC-32 of "123456789" is 0xCBF43926 (ISO 3309): the same register
    /// with all ones before and after.
    #[test]
    fn val_the_register_is_that_of_crc32() {
        assert_eq!(!crc32(b"123456789", !0), 0xCBF4_3926);
    }

    /// Python: `zlib.crc32(b"123456789", 0xFFFFFFFF) ^ 0xFFFFFFFF`, its inversions taken back.
    #[test]
    fn val_the_start_is_zero() {
        assert_eq!(crc32(b"123456789", 0), 0x2DFD_2D88);
        assert_eq!(crc32(b"", 0), 0);
    }

    #[test]
    fn prop_pieces_add_up() {
        assert_eq!(crc32(b"56789", crc32(b"1234", 0)), crc32(b"123456789", 0));
    }
}
