//! The bytes of a log, a window at a time: what is read of a file is never more than a record and a window.

use std::fs::File;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// What is read at once, bytes.
const WINDOW_BYTES: u64 = 1 << 18;
/// What a disk gives or does not give as one, bytes.
const SECTOR_BYTES: usize = 4096;

/// A log on disk or in memory.
#[derive(Debug)]
pub(super) struct Source {
    medium: Medium,
    length: u64,
}

#[derive(Debug)]
enum Medium {
    Memory(Vec<u8>),
    File(Mutex<File>),
}

impl Source {
    /// A file. What is no file (a folder, a pipe, a device) has no end, and is refused.
    pub fn file(path: &Path) -> io::Result<Self> {
        let about = std::fs::metadata(path)?;
        if !about.is_file() {
            let kind = if about.is_dir() {
                io::ErrorKind::IsADirectory
            } else {
                io::ErrorKind::InvalidInput
            };
            return Err(io::Error::new(kind, "not a file; name the log itself"));
        }
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        Ok(Self { medium: Medium::File(Mutex::new(file)), length })
    }

    pub fn memory(bytes: Vec<u8>) -> Self {
        Self { length: bytes.len() as u64, medium: Medium::Memory(bytes) }
    }

    pub fn length(&self) -> u64 {
        self.length
    }

    /// Whether the bytes at a place are these.
    pub fn has(&self, at: u64, bytes: &[u8]) -> bool {
        Window::new(self).get(at, bytes.len()) == Some(bytes)
    }

    /// Fills `into`. What the disk does not give is zeros: the checksums find it, like any other damage.
    fn read(file: &Mutex<File>, at: u64, into: &mut [u8]) {
        let mut file = file.lock().unwrap_or_else(PoisonError::into_inner);
        if file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(into)).is_ok() {
            return;
        }
        let mut at = at;
        for sector in into.chunks_mut(SECTOR_BYTES) {
            if file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(sector)).is_err() {
                sector.fill(0);
            }
            at += sector.len() as u64;
        }
    }
}

/// A view of a log that moves along.
#[derive(Debug)]
pub(super) struct Window<'a> {
    source: &'a Source,
    start: u64,
    bytes: Vec<u8>,
    /// What is read at once, bytes.
    reach: u64,
}

impl<'a> Window<'a> {
    pub fn new(source: &'a Source) -> Self {
        Self::reaching(source, WINDOW_BYTES)
    }

    /// For who reads a little in many places.
    pub fn reaching(source: &'a Source, reach: u64) -> Self {
        Self { source, start: 0, bytes: Vec::new(), reach }
    }

    pub fn end(&self) -> u64 {
        self.source.length
    }

    /// `None`: not so many bytes are there.
    pub fn get(&mut self, at: u64, length: usize) -> Option<&[u8]> {
        let end = at.checked_add(length as u64).filter(|end| *end <= self.source.length)?;
        let file = match &self.source.medium {
            Medium::Memory(bytes) => {
                return bytes.get(usize::try_from(at).ok()?..usize::try_from(end).ok()?);
            }
            Medium::File(file) => file,
        };
        if at < self.start || end > self.start + self.bytes.len() as u64 {
            let wanted = (length as u64).max(self.reach).min(self.source.length - at);
            self.bytes.resize(usize::try_from(wanted).ok()?, 0);
            // What was asked for once and was long is not kept.
            self.bytes.shrink_to(4 * self.bytes.len());
            self.start = at;
            Source::read(file, at, &mut self.bytes);
        }
        let from = usize::try_from(at - self.start).ok()?;
        self.bytes.get(from..from + length)
    }

    /// As many bytes as there are, `most` of them at most.
    pub fn some(&mut self, at: u64, most: u64) -> &[u8] {
        let there = self.source.length.saturating_sub(at).min(most);
        usize::try_from(there).ok().and_then(|there| self.get(at, there)).unwrap_or_default()
    }

    pub fn u64_at(&mut self, at: u64) -> Option<u64> {
        self.get(at, 8)?.first_chunk::<8>().map(|b| u64::from_le_bytes(*b))
    }

    pub fn u32_at(&mut self, at: u64) -> Option<u32> {
        self.get(at, 4)?.first_chunk::<4>().map(|b| u32::from_le_bytes(*b))
    }

    /// Checksum of a stretch, read a window at a time.
    pub fn crc32(&mut self, from: u64, to: u64) -> Option<u32> {
        let mut crc = flate2::Crc::new();
        let mut at = from;
        while at < to {
            let piece = self.get(at, usize::try_from((to - at).min(WINDOW_BYTES)).ok()?)?;
            crc.update(piece);
            at += piece.len() as u64;
        }
        Some(crc.sum())
    }
}
