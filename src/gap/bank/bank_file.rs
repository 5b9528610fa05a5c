//! A bank on disk ([`crate::bank::kept_file`]).
//!
//! NaN has no place in JSON: statistics that are unknown are `null` there.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::bank::axis::Axis;
use crate::bank::kept_file::{self, KeptFileError, Kind};
use crate::bank::{Bank, BankError, Draw, EffectDraws};

const KIND: Kind = Kind { what: "bank", magic: b"HALTBANK", version: 4 };

/// What can be wrong with a bank file.
#[derive(Debug, thiserror::Error)]
pub enum BankFileError {
    /// The file.
    #[error(transparent)]
    File(#[from] KeptFileError),
    /// Contents contradict themselves.
    #[error("{}: no bank to learn from; delete it, and it is flown anew", path.display())]
    Bank {
        /// File.
        path: PathBuf,
        /// What.
        source: BankError,
    },
}

/// A row of statistics on disk; `null`: unknown.
pub type Row = Vec<Option<f64>>;

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
    axes: Vec<Axis>,
    draws: Vec<DrawOnDisk>,
}

/// θ, seed, twin, statistics.
pub(super) type DrawOnDisk = (Vec<f64>, u64, usize, Row);

pub(super) fn draw_to_disk(draw: &Draw) -> DrawOnDisk {
    (draw.theta.clone(), draw.seed, draw.twin, to_disk(&draw.statistics))
}

pub(super) fn draw_from_disk((theta, seed, twin, row): DrawOnDisk) -> Draw {
    Draw { theta, seed, twin, statistics: from_disk(row) }
}

/// A row in JSON, which knows no NaN.
pub fn to_disk(rows: &[f64]) -> Row {
    rows.iter().map(|v| v.is_finite().then_some(*v)).collect()
}

/// A row as the diagnosis takes it.
pub fn from_disk(row: Row) -> Vec<f64> {
    row.into_iter().map(|v| v.unwrap_or(f64::NAN)).collect()
}

fn contents(bank: &Bank) -> OnDisk {
    let rows = |rows: &[Vec<f64>]| rows.iter().map(|r| to_disk(r)).collect();
    let effects = bank.effects.iter().map(|e| EffectOnDisk {
        id: e.id.clone(),
        axes: e.axes.clone(),
        draws: e.draws.iter().map(draw_to_disk).collect(),
    });
    OnDisk {
        names: bank.names.clone(),
        seeds: rows(&bank.seeds),
        jitter: rows(&bank.jitter),
        effects: effects.collect(),
    }
}

/// Hash of a bank's contents, as reports and file names print it.
pub fn hash(bank: &Bank) -> Result<u64, serde_json::Error> {
    kept_file::hash(&contents(bank))
}

/// Writes a bank, whole or not at all. Returns the hash.
pub fn write(path: &Path, bank: &Bank) -> Result<u64, BankFileError> {
    bank.check().map_err(|source| BankFileError::Bank { path: path.to_path_buf(), source })?;
    Ok(kept_file::write(KIND, path, &contents(bank))?)
}

/// Reads a bank with its hash.
pub fn read(path: &Path) -> Result<(Bank, u64), BankFileError> {
    let (disk, found): (OnDisk, u64) = kept_file::read(KIND, path)?;
    let effects = disk.effects.into_iter().map(|e| EffectDraws {
        id: e.id,
        axes: e.axes,
        draws: e.draws.into_iter().map(draw_from_disk).collect(),
    });
    let bank = Bank {
        names: disk.names,
        seeds: disk.seeds.into_iter().map(from_disk).collect(),
        jitter: disk.jitter.into_iter().map(from_disk).collect(),
        effects: effects.collect(),
    };
    bank.check().map_err(|source| BankFileError::Bank { path: path.to_path_buf(), source })?;
    Ok((bank, found))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bank() -> Bank {
        let draw = Draw {
            theta: vec![0.1 + 0.2],
            seed: u64::MAX,
            twin: 3,
            statistics: vec![1e-300, f64::NAN],
        };
        Bank {
            names: vec!["a".into(), "b".into()],
            seeds: vec![vec![1.0 / 3.0, -0.0]; 12],
            jitter: vec![vec![f64::NAN, 2.0]; 12],
            effects: vec![EffectDraws {
                id: "A1".into(),
                axes: vec![Axis::over([0.0, 1.0].into_iter())],
                draws: vec![draw; 6],
            }],
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
}
