//! A medium that may be full for a while: what it does not take waits in memory, so that the file goes on exactly where
//! it stopped. The MCAP writer above never sees a failure, which would leave it in the middle of a record for good.

use std::collections::VecDeque;
use std::io::{self, Seek, SeekFrom, Write};

/// A medium, and what waits for it.
pub(super) struct Patient<W> {
    medium: W,
    /// With more waiting it is written.
    buffer_B: usize,
    /// Where, and what; in the order in which it was written.
    waiting: VecDeque<(u64, Vec<u8>)>,
    waiting_B: usize,
    /// Where the next byte goes, and where the file ends, for whoever writes.
    at: u64,
    end: u64,
    /// Where the medium stands; `None`: somewhere, after a failure.
    medium_at: Option<u64>,
    fault: Option<(io::ErrorKind, String)>,
}

impl<W: Write + Seek> Patient<W> {
    /// On a medium that is empty.
    pub(super) fn new(medium: W, buffer_B: usize) -> Self {
        Self {
            medium,
            buffer_B,
            waiting: VecDeque::new(),
            waiting_B: 0,
            at: 0,
            end: 0,
            medium_at: Some(0),
            fault: None,
        }
    }

    /// Why the medium does not take what waits.
    pub(super) fn fault(&self) -> Option<io::Error> {
        let (kind, why) = self.fault.as_ref()?;
        Some(io::Error::new(*kind, why.clone()))
    }

    /// Tries to write what waits; `and_then` makes it permanent. A failure is kept as [`Self::fault`] until this works.
    pub(super) fn settle(&mut self, and_then: impl FnOnce() -> io::Result<()>) {
        let settled = self.put_out().and_then(|()| self.medium.flush()).and_then(|()| and_then());
        self.fault = settled.err().map(|error| (error.kind(), error.to_string()));
    }

    /// Writes what waits if that is more than this, unless the medium has refused it before.
    pub(super) fn put_out_beyond(&mut self, most_B: usize) {
        if self.waiting_B > most_B && self.fault.is_none() {
            let put = self.put_out();
            self.fault = put.err().map(|error| (error.kind(), error.to_string()));
        }
    }

    fn put_out(&mut self) -> io::Result<()> {
        while let Some((to, bytes)) = self.waiting.front_mut() {
            if self.medium_at != Some(*to) {
                self.medium.seek(SeekFrom::Start(*to))?;
            }
            // Of what goes wrong now the place is not known.
            self.medium_at = None;
            let mut done = 0;
            let written = loop {
                match self.medium.write(bytes.get(done..).unwrap_or_default()) {
                    _ if done == bytes.len() => break Ok(()),
                    Ok(0) => break Err(io::Error::from(io::ErrorKind::WriteZero)),
                    Ok(n) => done = (done + n).min(bytes.len()),
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    Err(error) => break Err(error),
                }
            };
            *to += done as u64;
            self.waiting_B = self.waiting_B.saturating_sub(done);
            bytes.drain(..done);
            written?;
            self.medium_at = Some(*to);
            self.waiting.pop_front();
        }
        Ok(())
    }
}

impl<W: Write + Seek> Write for Patient<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self.waiting.back_mut() {
            Some((from, piece)) if *from + piece.len() as u64 == self.at => {
                piece.extend_from_slice(bytes);
            }
            _ => self.waiting.push_back((self.at, bytes.to_vec())),
        }
        self.waiting_B += bytes.len();
        self.at += bytes.len() as u64;
        self.end = self.end.max(self.at);
        self.put_out_beyond(self.buffer_B);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl<W> Seek for Patient<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
            SeekFrom::End(by) => self.end.checked_add_signed(by),
        };
        self.at = at.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Takes so many bytes more.
    struct Narrow {
        inner: io::Cursor<Vec<u8>>,
        room: usize,
    }

    impl Write for Narrow {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let n = bytes.len().min(self.room);
            if n == 0 && !bytes.is_empty() {
                return Err(io::ErrorKind::StorageFull.into());
            }
            self.room -= n;
            self.inner.write(&bytes[..n])
        }
        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for Narrow {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.inner.seek(to)
        }
    }

    /// What a file would hold holds the medium, wherever it was full and however often.
    #[test]
    fn prop_nothing_is_lost_or_misplaced_however_little_the_medium_takes() {
        for step in 1..40 {
            let mut plain = io::Cursor::new(Vec::new());
            let narrow = Narrow { inner: io::Cursor::new(Vec::new()), room: 3 };
            let mut patient = Patient::new(narrow, 7);
            let mut random = step as u64;
            for n in 0..200_u64 {
                random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(n);
                let piece = vec![n as u8; (random >> 33) as usize % 30];
                plain.write_all(&piece).unwrap();
                patient.write_all(&piece).unwrap();
                if n % 9 == 0 {
                    // As the MCAP writer does with the head of a chunk.
                    let back = (random >> 40) % plain.position().max(1);
                    for medium in [&mut plain as &mut dyn Rewrite, &mut patient] {
                        medium.rewrite(back);
                    }
                }
                patient.medium.room += step;
                if n % 5 == 0 {
                    patient.settle(|| Ok(()));
                }
            }
            patient.medium.room = usize::MAX;
            patient.settle(|| Ok(()));
            assert!(patient.fault().is_none());
            assert_eq!(patient.waiting_B, 0);
            assert!(patient.medium.inner.get_ref() == plain.get_ref(), "{step}");
        }
    }

    trait Rewrite {
        fn rewrite(&mut self, at: u64);
    }

    impl<T: Write + Seek> Rewrite for T {
        fn rewrite(&mut self, at: u64) {
            self.seek(SeekFrom::Start(at)).unwrap();
            self.write_all(b"h").unwrap();
            self.seek(SeekFrom::End(0)).unwrap();
        }
    }
}
