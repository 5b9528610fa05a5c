//! A file of what was computed and is worth keeping: magic, version, length and hash of the contents, then
//! JSON, deflated.
//!
//! The hash (FNV-1a, 64 bit) is over the JSON and finds damage and mix-ups; it is no protection against
//! intent.

use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use haltere_log::written::{self, OutputError};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Largest contents that are read, bytes: some twenty times the bank of 53 effects.
const MOST_BYTES: u64 = 1 << 30;

/// What a file holds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kind {
    /// In words, for errors.
    pub what: &'static str,
    /// First bytes.
    pub magic: &'static [u8; 8],
    /// Version of the layout.
    pub version: u32,
}

/// What can be wrong with a kept file.
#[derive(Debug, thiserror::Error)]
pub enum KeptFileError {
    /// The system.
    #[error("{}: {source}", path.display())]
    Io {
        /// File.
        path: PathBuf,
        /// What it says.
        source: std::io::Error,
    },
    /// It may not be written, or cannot.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Something else.
    #[error("{}: not a {what} file", path.display())]
    NotThis {
        /// File.
        path: PathBuf,
        /// What was looked for.
        what: &'static str,
    },
    /// Written by another version.
    #[error("{}: layout {found}, this program reads {readable}", path.display())]
    Version {
        /// File.
        path: PathBuf,
        /// Layout found.
        found: u32,
        /// Layout of this program.
        readable: u32,
    },
    /// Larger than any.
    #[error("{}: {found} bytes, at most {MOST_BYTES} are read", path.display())]
    TooLarge {
        /// File.
        path: PathBuf,
        /// Bytes that the header promises.
        found: u64,
    },
    /// Contents do not match their hash or length.
    #[error("{}: damaged: hash {found:016x} of {length} bytes, header says {expected:016x}", path.display())]
    Damaged {
        /// File.
        path: PathBuf,
        /// Bytes read.
        length: usize,
        /// Hash of what is there.
        found: u64,
        /// Hash that was written.
        expected: u64,
    },
    /// Contents are of another shape.
    #[error("{}: {source}", path.display())]
    Json {
        /// File.
        path: PathBuf,
        /// Where and why.
        source: serde_json::Error,
    },
}

/// FNV-1a, 64 bit (draft-eastlake-fnv).
pub(crate) fn fnv(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// Hash of contents as a file of them would have.
pub(crate) fn hash(contents: &impl Serialize) -> Result<u64, serde_json::Error> {
    Ok(fnv(&serde_json::to_vec(contents)?))
}

/// Writes contents, whole or not at all. Returns their hash.
pub(crate) fn write(
    kind: Kind,
    path: &Path,
    contents: &impl Serialize,
) -> Result<u64, KeptFileError> {
    let io = |source| KeptFileError::Io { path: path.to_path_buf(), source };
    let json = serde_json::to_vec(contents)
        .map_err(|source| KeptFileError::Json { path: path.to_path_buf(), source })?;
    let hash = fnv(&json);
    let mut bytes = Vec::new();
    bytes.extend_from_slice(kind.magic);
    bytes.extend_from_slice(&kind.version.to_le_bytes());
    bytes.extend_from_slice(&(json.len() as u64).to_le_bytes());
    bytes.extend_from_slice(&hash.to_le_bytes());
    let mut deflated = ZlibEncoder::new(bytes, Compression::fast());
    deflated.write_all(&json).map_err(io)?;
    let bytes = deflated.finish().map_err(io)?;
    written::write::<&Path>(path, bytes, &[])?;
    Ok(hash)
}

/// Reads contents with their hash.
pub(crate) fn read<T: DeserializeOwned>(
    kind: Kind,
    path: &Path,
) -> Result<(T, u64), KeptFileError> {
    let path = path.to_path_buf();
    let io = |source| KeptFileError::Io { path: path.clone(), source };
    let other = || KeptFileError::NotThis { path: path.clone(), what: kind.what };
    let mut file = BufReader::new(haltere_log::intake::open(&path).map_err(io)?);
    let mut head = [0u8; 28];
    file.read_exact(&mut head).map_err(|_| other())?;
    let (magic, rest) = head.split_at(8);
    let (version, rest) = rest.split_at(4);
    let (length, expected) = rest.split_at(8);
    let number = |bytes: &[u8]| bytes.iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
    if magic != kind.magic {
        return Err(other());
    }
    let found = number(version) as u32;
    if found != kind.version {
        return Err(KeptFileError::Version { path, found, readable: kind.version });
    }
    let (length, expected) = (number(length), number(expected));
    if length > MOST_BYTES {
        return Err(KeptFileError::TooLarge { path, found: length });
    }
    let mut json = Vec::new();
    // A cut or changed stream fails to inflate or to hash: both are damage.
    let inflated = ZlibDecoder::new(file).take(length + 1).read_to_end(&mut json);
    let found = fnv(&json);
    if inflated.is_err() || json.len() as u64 != length || found != expected {
        return Err(KeptFileError::Damaged { path, length: json.len(), found, expected });
    }
    let contents =
        serde_json::from_slice(&json).map_err(|source| KeptFileError::Json { path, source })?;
    Ok((contents, found))
}

/// What a cache holds; a file that is not there is as none, and so is one that cannot be read, which is said.
pub(crate) fn recall<T: DeserializeOwned>(kind: Kind, path: &Path) -> Option<T> {
    if !path.exists() {
        return None;
    }
    let read = read(kind, path).inspect_err(|error| tracing::warn!("{error}; computed anew"));
    read.ok().map(|(contents, _)| contents)
}

/// Puts into a cache. What cannot be written costs time the next time and nothing now, and is said.
pub(crate) fn remember(kind: Kind, path: &Path, contents: &impl Serialize) {
    if let Some(folder) = path.parent() {
        // Where it cannot be made, writing says why.
        let _ = std::fs::create_dir_all(folder);
    }
    if let Err(error) = write(kind, path, contents) {
        tracing::warn!("{error}; this will be computed again next time");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KIND: Kind = Kind { what: "test", magic: b"HALTTEST", version: 3 };

    #[test]
    fn prop_every_damaged_byte_and_every_cut_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one.kept");
        let contents = vec![vec![1.0 / 3.0, 1e-300, -0.0]; 12];
        let written = write(KIND, &path, &contents).unwrap();
        assert_eq!(written, hash(&contents).unwrap());
        let read = || read::<Vec<Vec<f64>>>(KIND, &path);
        assert_eq!(read().unwrap(), (contents.clone(), written));
        let good = std::fs::read(&path).unwrap();
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 0x10;
            std::fs::write(&path, &bad).unwrap();
            // Unused bits of the deflate header may change without harm to the contents.
            if let Ok((back, _)) = read() {
                assert_eq!(back, contents, "byte {at}");
            }
        }
        for length in 0..good.len() - 4 {
            std::fs::write(&path, &good[..length]).unwrap();
            if let Ok((back, _)) = read() {
                assert_eq!(back, contents, "cut at {length}");
            }
        }
        std::fs::write(&path, b"HALTTEST").unwrap();
        assert!(matches!(read(), Err(KeptFileError::NotThis { what: "test", .. })));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left behind");
    }
}
