//! A reader that ends in an error when it has given more than can be meant.
//!
//! A compressed file says nothing of its size: some kilobytes unpack to more than any memory holds.

use std::io::{self, Read};

/// Most bytes that are taken from one recorded flight, unpacked: some hundred times the largest that is known.
pub const MOST_BYTES: u64 = 1 << 30;

/// Passes on what another reader gives, up to a limit.
#[derive(Debug)]
pub struct Bounded<R> {
    from: R,
    most: u64,
    left: u64,
}

impl<R: Read> Bounded<R> {
    /// With the limit for recorded flights.
    pub fn new(from: R) -> Self {
        Self::of(from, MOST_BYTES)
    }

    /// With a limit of its own.
    pub fn of(from: R, most: u64) -> Self {
        Self { from, most, left: most }
    }
}

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let read = self.from.read(out)?;
        self.left = self.left.checked_sub(read as u64).ok_or_else(|| {
            let what = format!(
                "more than {} bytes (unpacked), which no recorded flight has; cut it into parts",
                self.most
            );
            io::Error::new(io::ErrorKind::FileTooLarge, what)
        })?;
        Ok(read)
    }
}

#[cfg(test)]
mod tests {
    use std::io::BufRead as _;

    use super::*;

    #[test]
    fn regress_a_stream_without_an_end_is_an_error_and_not_all_memory() {
        let endless = io::BufReader::new(Bounded::of(io::repeat(b'x'), 100_000));
        let error = endless.lines().next().expect("something").expect_err("too long");
        assert!(error.to_string().starts_with("more than 100000 bytes"), "{error}");
        let mut whole = Vec::new();
        Bounded::of(&b"abc"[..], 3).read_to_end(&mut whole).expect("as many as allowed");
        assert_eq!(whole, b"abc");
    }
}
