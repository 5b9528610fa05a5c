//! A bank on disk: magic, version, length and hash of the contents, then JSON, deflated.
//!
//! NaN has no place in JSON: statistics that are unknown are `null` there. The hash (FNV-1a, 64
//! bit) is over the JSON and finds damage and mix-ups; it is no protection against intent.

use std::fs::File;
use std::io::{BufReader, Read, Write};
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use serde::{Deserialize, Serialize};

use super::bank::{Bank, BankError, Draw, EffectDraws};

/// First bytes of a bank file.
const MAGIC: &[u8; 8] = b"HALTBANK";
/// Version of the layout.
const VERSION: u32 = 1;
/// Largest contents that are read, bytes: some twenty times the bank of 53 effects.
const MOST_BYTES: u64 = 1 << 30;

/// What can be wrong with a bank file.
#[derive(Debug, thiserror::Error)]
pub enum BankFileError {
    /// The system.
    #[error("{path}: {source}")]
    Io {
        /// File.
        path: PathBuf,
        /// What it says.
        source: std::io::Error,
    },
    /// Not a bank.
    #[error("{path}: not a bank file")]
    NotABank {
        /// File.
        path: PathBuf,
    },
    /// Written by another version.
    #[error("{path}: layout {found}, this program reads {VERSION}")]
    Version {
        /// File.
        path: PathBuf,
        /// Layout found.
        found: u32,
    },
    /// Larger than any bank.
    #[error("{path}: {found} bytes, at most {MOST_BYTES} are read")]
    TooLarge {
        /// File.
        path: PathBuf,
        /// Bytes that the header promises.
        found: u64,
    },
    /// Contents do not match their hash or length.
    #[error("{path}: damaged: hash {found:016x} of {length} bytes, header says {expected:016x}")]
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
    /// Contents are not a bank.
    #[error("{path}: {source}")]
    Json {
        /// File.
        path: PathBuf,
        /// Where and why.
        source: serde_json::Error,
    },
    /// Contents contradict themselves.
    #[error("{path}: {source}")]
    Bank {
        /// File.
        path: PathBuf,
        /// What.
        source: BankError,
    },
}

type Row = Vec<Option<f64>>;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct OnDisk {
    names: Vec<String>,
    seeds: Vec<Row>,
    jitter: Vec<Row>,
    effects: Vec<EffectOnDisk>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct EffectOnDisk {
    id: String,
    /// θ, seed, statistics.
    draws: Vec<(Vec<f64>, u64, Row)>,
}

fn to_disk(rows: &[f64]) -> Row {
    rows.iter().map(|v| v.is_finite().then_some(*v)).collect()
}

fn from_disk(row: Row) -> Vec<f64> {
    row.into_iter().map(|v| v.unwrap_or(f64::NAN)).collect()
}

fn contents(bank: &Bank) -> Result<Vec<u8>, serde_json::Error> {
    let rows = |rows: &[Vec<f64>]| rows.iter().map(|r| to_disk(r)).collect();
    let effects = bank.effects.iter().map(|e| EffectOnDisk {
        id: e.id.clone(),
        draws: e.draws.iter().map(|d| (d.theta.clone(), d.seed, to_disk(&d.statistics))).collect(),
    });
    serde_json::to_vec(&OnDisk {
        names: bank.names.clone(),
        seeds: rows(&bank.seeds),
        jitter: rows(&bank.jitter),
        effects: effects.collect(),
    })
}

pub(super) fn fnv(bytes: &[u8]) -> u64 {
    // FNV-1a, 64 bit (draft-eastlake-fnv).
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
        (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3)
    })
}

/// Hash of a bank's contents, as reports and file names print it.
pub fn hash(bank: &Bank) -> Result<u64, serde_json::Error> {
    Ok(fnv(&contents(bank)?))
}

/// Writes a bank, whole or not at all. Returns the hash.
pub fn write(path: &Path, bank: &Bank) -> Result<u64, BankFileError> {
    let io = |source| BankFileError::Io { path: path.to_path_buf(), source };
    bank.check().map_err(|source| BankFileError::Bank { path: path.to_path_buf(), source })?;
    let json = contents(bank)
        .map_err(|source| BankFileError::Json { path: path.to_path_buf(), source })?;
    let hash = fnv(&json);
    let mut bytes = Vec::new();
    bytes.extend_from_slice(MAGIC);
    bytes.extend_from_slice(&VERSION.to_le_bytes());
    bytes.extend_from_slice(&(json.len() as u64).to_le_bytes());
    bytes.extend_from_slice(&hash.to_le_bytes());
    let mut deflated = ZlibEncoder::new(bytes, Compression::fast());
    deflated.write_all(&json).map_err(io)?;
    let bytes = deflated.finish().map_err(io)?;
    let mut name = path.as_os_str().to_os_string();
    name.push(".part");
    let part = PathBuf::from(name);
    let mut file = File::create(&part).map_err(io)?;
    file.write_all(&bytes).and_then(|()| file.sync_all()).map_err(io)?;
    std::fs::rename(&part, path).map_err(io)?;
    Ok(hash)
}

/// Reads a bank with its hash.
pub fn read(path: &Path) -> Result<(Bank, u64), BankFileError> {
    let path = path.to_path_buf();
    let io = |source| BankFileError::Io { path: path.clone(), source };
    let mut file = BufReader::new(File::open(&path).map_err(io)?);
    let mut head = [0u8; 28];
    file.read_exact(&mut head).map_err(|_| BankFileError::NotABank { path: path.clone() })?;
    let (magic, rest) = head.split_at(8);
    let (version, rest) = rest.split_at(4);
    let (length, expected) = rest.split_at(8);
    let number = |bytes: &[u8]| bytes.iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
    if magic != MAGIC {
        return Err(BankFileError::NotABank { path });
    }
    let found = number(version) as u32;
    if found != VERSION {
        return Err(BankFileError::Version { path, found });
    }
    let (length, expected) = (number(length), number(expected));
    if length > MOST_BYTES {
        return Err(BankFileError::TooLarge { path, found: length });
    }
    let mut json = Vec::new();
    // A cut or changed stream fails to inflate or to hash: both are damage.
    let inflated = ZlibDecoder::new(file).take(length + 1).read_to_end(&mut json);
    let found = fnv(&json);
    if inflated.is_err() || json.len() as u64 != length || found != expected {
        return Err(BankFileError::Damaged { path, length: json.len(), found, expected });
    }
    let disk: OnDisk = serde_json::from_slice(&json)
        .map_err(|source| BankFileError::Json { path: path.clone(), source })?;
    let effects = disk.effects.into_iter().map(|e| EffectDraws {
        id: e.id,
        draws: e
            .draws
            .into_iter()
            .map(|(theta, seed, row)| Draw { theta, seed, statistics: from_disk(row) })
            .collect(),
    });
    let bank = Bank {
        names: disk.names,
        seeds: disk.seeds.into_iter().map(from_disk).collect(),
        jitter: disk.jitter.into_iter().map(from_disk).collect(),
        effects: effects.collect(),
    };
    bank.check().map_err(|source| BankFileError::Bank { path, source })?;
    Ok((bank, found))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bank() -> Bank {
        let draw =
            Draw { theta: vec![0.1 + 0.2], seed: u64::MAX, statistics: vec![1e-300, f64::NAN] };
        Bank {
            names: vec!["a".into(), "b".into()],
            seeds: vec![vec![1.0 / 3.0, -0.0]; 12],
            jitter: vec![vec![f64::NAN, 2.0]; 12],
            effects: vec![EffectDraws { id: "A1".into(), draws: vec![draw; 6] }],
        }
    }

    #[test]
    fn prop_a_bank_survives_the_disk_to_the_last_bit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one.bank");
        let written = write(&path, &bank()).unwrap();
        let (back, found) = read(&path).unwrap();
        assert_eq!(written, found);
        assert_eq!(found, hash(&bank()).unwrap());
        // NaN differs from itself: compare as text.
        assert_eq!(format!("{back:?}"), format!("{:?}", bank()));
        let mut other = bank();
        other.seeds[3][0] += 1e-12;
        assert_ne!(hash(&other).unwrap(), found);
    }

    #[test]
    fn prop_every_damaged_byte_and_every_cut_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one.bank");
        write(&path, &bank()).unwrap();
        let good = std::fs::read(&path).unwrap();
        for at in 0..good.len() {
            let mut bad = good.clone();
            bad[at] ^= 0x10;
            std::fs::write(&path, &bad).unwrap();
            // Unused bits of the deflate header may change without harm to the contents.
            if let Ok((back, _)) = read(&path) {
                assert_eq!(format!("{back:?}"), format!("{:?}", bank()), "byte {at}");
            }
        }
        for length in 0..good.len() - 4 {
            std::fs::write(&path, &good[..length]).unwrap();
            if let Ok((back, _)) = read(&path) {
                assert_eq!(format!("{back:?}"), format!("{:?}", bank()), "cut at {length}");
            }
        }
        std::fs::write(&path, b"HALTBANK").unwrap();
        assert!(matches!(read(&path), Err(BankFileError::NotABank { .. })));
    }
}
