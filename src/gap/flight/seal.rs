//! The seal of a suite: keys are committed by their SHA-256 (FIPS 180-4) before anything is flown.

use std::io::{self, Read};

use sha2::{Digest, Sha256};

/// The digest of `data`, in hexadecimal.
pub fn digest(data: &[u8]) -> String {
    hex(&Sha256::digest(data))
}

/// The same of everything that a reader gives, a piece at a time.
pub fn digest_of(mut data: impl Read) -> io::Result<String> {
    let mut hash = Sha256::new();
    io::copy(&mut data, &mut hash)?;
    Ok(hex(&hash.finalize()))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn val_the_digest_is_that_of_the_standard() {
        // FIPS 180-4, example of one block.
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(digest(b"abc"), expected);
        assert_eq!(digest_of(&b"abc"[..]).unwrap(), expected);
    }
}
