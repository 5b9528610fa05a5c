//! The folder of a campaign: what it is, and a row for each flight that is done.
//!
//! ```text
//! DIR/campaign.json   which campaign, which program, which shard
//! DIR/rows.jsonl      one line a flight: the row as JSON, its first key `sha256` the first 16 digits of the
//!                     SHA-256 of the row without that key
//! ```
//! A line that a kill or a full disk tore does not fit its digest: it is counted, taken out, and the
//! flight is flown again.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use haltere_log::record::BuildIdentity;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::file::Campaign;
use super::row::Row;

/// `campaign.json`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identity {
    /// Name of the campaign, for people.
    pub name: String,
    /// Digest over everything that determines its flights.
    pub digest: String,
    /// How many flights the whole campaign has.
    pub flights: u64,
    /// Which share of them: this one of so many.
    pub shard: [u64; 2],
    /// Whether only the fixed sample is flown.
    pub sample: bool,
    /// Version and source of the program.
    pub program: Program,
}

/// The program that flies.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Program {
    /// Its version.
    pub version: String,
    /// For people.
    pub commit: String,
    /// Hash of the source of the companion and of simulated flights.
    pub source: String,
}

impl Program {
    /// This one.
    pub fn current() -> Self {
        let build = BuildIdentity::current();
        Self {
            version: build.program_version,
            commit: build.git_commit,
            source: format!("{}-{}", haltere_gap::BANK_HASH, env!("HALTERE_SIMULATED_HASH")),
        }
    }
}

impl Identity {
    /// Of a share of a campaign, flown by this program.
    pub fn new(campaign: &Campaign, shard: [u64; 2], sample: bool) -> Self {
        Self {
            name: campaign.file.name.clone(),
            digest: campaign.digest.clone(),
            flights: campaign.flights,
            shard,
            sample,
            program: Program::current(),
        }
    }

    /// Why rows of `other` cannot stand beside rows of this; `None`: they can.
    pub fn differs(&self, other: &Self) -> Option<String> {
        if self.digest != other.digest {
            return Some(format!(
                "it holds flights of another campaign (`{}`, digest {:.12}; this is `{}`, {:.12}): the file, \
                 the seed or a file that it names has changed",
                other.name, other.digest, self.name, self.digest
            ));
        }
        if self.flights != other.flights || self.sample != other.sample {
            return Some("it holds another selection of this campaign's flights".to_owned());
        }
        if self.program.source != other.program.source {
            return Some(format!(
                "its flights were flown by another program (commit {}, source {}; here {}, {})",
                other.program.commit,
                other.program.source,
                self.program.commit,
                self.program.source
            ));
        }
        None
    }
}

/// Rows that were found.
#[derive(Debug, Default)]
pub struct Found {
    /// By number.
    pub rows: BTreeMap<u64, Row>,
    /// Lines that were torn or damaged.
    pub torn: u64,
}

/// A folder in use; another process that wants it is refused.
#[derive(Debug)]
pub struct Store {
    path: PathBuf,
    file: File,
    _lock: File,
}

/// Which campaign.
pub const IDENTITY: &str = "campaign.json";
/// Its rows.
pub const ROWS: &str = "rows.jsonl";
const LOCK: &str = "lock";
/// What stands before the digest of a line, and between it and the row.
const BEFORE: &str = "{\"sha256\":\"";
const BEHIND: &str = "\",";
/// Digits of a line's digest.
const DIGITS: usize = 16;

fn digest(text: &str) -> String {
    Sha256::digest(text).iter().take(DIGITS / 2).map(|byte| format!("{byte:02x}")).collect()
}

fn line(row: &Row) -> Result<String> {
    let json = serde_json::to_string(row)?;
    let rest = json.trim_start_matches('{');
    Ok(format!("{BEFORE}{}{BEHIND}{rest}\n", digest(&json)))
}

fn parse(text: &str) -> Option<Row> {
    let (sum, rest) = text.strip_prefix(BEFORE)?.split_once(BEHIND)?;
    let json = format!("{{{rest}");
    (sum == digest(&json)).then(|| serde_json::from_str(&json).ok())?
}

/// Whole or not at all.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    Ok(haltere_log::written::write::<&Path>(path, bytes, &[])?)
}

/// Which campaign a folder holds.
pub fn identity(directory: &Path) -> Result<Identity> {
    let path = directory.join(IDENTITY);
    let text = std::fs::read_to_string(&path).with_context(|| {
        format!("{}: no campaign has been flown into this folder", path.display())
    })?;
    serde_json::from_str(&text).with_context(|| {
        format!("{}: damaged; the rows beside it cannot be told apart", path.display())
    })
}

/// Rows of a folder.
pub fn rows(directory: &Path) -> Result<Found> {
    let path = directory.join(ROWS);
    let bytes = match std::fs::read(&path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Found::default()),
        Err(error) => return Err(error).with_context(|| path.display().to_string()),
    };
    let mut found = Found::default();
    let text = String::from_utf8_lossy(&bytes);
    for piece in text.split_inclusive('\n') {
        // Without its end a line may be short of digits of a number and still look whole.
        match piece.strip_suffix('\n').and_then(parse) {
            Some(row) => {
                found.rows.insert(row.index, row);
            }
            None => found.torn += 1,
        }
    }
    Ok(found)
}

impl Store {
    /// Opens a folder for this campaign, or makes it. Gives what was flown before.
    pub fn open(directory: &Path, identity: &Identity) -> Result<(Self, Found)> {
        let name = directory.display();
        std::fs::create_dir_all(directory).with_context(|| name.to_string())?;
        let lock = File::create(directory.join(LOCK)).with_context(|| name.to_string())?;
        if lock.try_lock().is_err() {
            bail!("{name}: another process flies a campaign into this folder");
        }
        if directory.join(IDENTITY).exists() {
            let before = self::identity(directory)?;
            if let Some(why) = identity.differs(&before) {
                bail!("{name}: {why}. Name another folder with --out, or delete this one");
            }
            if before.shard != identity.shard {
                let [a, of_a] = before.shard;
                let [b, of_b] = identity.shard;
                bail!(
                    "{name}: it holds shard {a}/{of_a} and not {b}/{of_b}: a folder for each shard"
                );
            }
        } else {
            let text = serde_json::to_string_pretty(identity)? + "\n";
            write_whole(&directory.join(IDENTITY), text.as_bytes())?;
        }
        let found = rows(directory)?;
        let path = directory.join(ROWS);
        if found.torn > 0 {
            write_rows(directory, found.rows.values())?;
        }
        let file = OpenOptions::new()
            .create(true)
            .append(true)
            .open(&path)
            .with_context(|| path.display().to_string())?;
        Ok((Self { path, file, _lock: lock }, found))
    }

    /// Keeps a row.
    pub fn add(&mut self, row: &Row) -> Result<()> {
        let text = line(row)?;
        self.file.write_all(text.as_bytes()).with_context(|| {
            format!("{} cannot be written; fly on with the same command", self.path.display())
        })
    }
}

/// Writes rows anew, in the order given.
pub fn write_rows<'a>(directory: &Path, rows: impl Iterator<Item = &'a Row>) -> Result<()> {
    let text: String = rows.map(line).collect::<Result<_>>()?;
    write_whole(&directory.join(ROWS), text.as_bytes())
}

/// Makes a folder that holds these rows, whole.
pub fn write_all(directory: &Path, identity: &Identity, rows: &BTreeMap<u64, Row>) -> Result<()> {
    let (store, found) = Store::open(directory, identity)?;
    if !found.rows.is_empty() {
        bail!("{}: there are rows already; name an empty folder with --out", directory.display());
    }
    drop(store);
    write_rows(directory, rows.values())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn identity() -> Identity {
        Identity {
            name: "x".into(),
            digest: "d".into(),
            flights: 3,
            shard: [1, 1],
            sample: false,
            program: Program::current(),
        }
    }

    fn row(index: u64) -> Row {
        let drawn = BTreeMap::from([("a.b".to_owned(), serde_json::json!(0.1 + 0.2))]);
        Row { estimate_mean_m: Some(0.123_457), ..Row::blank(index, 7, drawn) }
    }

    #[test]
    fn prop_rows_come_back_and_torn_ones_are_told() {
        let dir = tempfile::tempdir().unwrap();
        let (mut store, found) = Store::open(dir.path(), &identity()).unwrap();
        assert!(found.rows.is_empty() && found.torn == 0);
        (0..3).for_each(|i| store.add(&row(i)).unwrap());
        assert!(Store::open(dir.path(), &identity()).is_err(), "two processes in one folder");
        drop(store);
        let path = dir.path().join(ROWS);
        let whole = std::fs::read(&path).unwrap();
        // JSON lines, as anybody reads them.
        for (line, index) in String::from_utf8(whole.clone()).unwrap().lines().zip(0..) {
            let read: serde_json::Value = serde_json::from_str(line).unwrap();
            assert_eq!(
                (&read["index"], &read["outcome"]),
                (&json!(index), &json!("not-taken-off"))
            );
        }
        // Cut at every byte: what is whole comes back as it was, the rest is told.
        let starts: Vec<usize> = std::iter::once(0)
            .chain(whole.iter().enumerate().filter(|(_, b)| **b == b'\n').map(|(i, _)| i + 1))
            .collect();
        for cut in 0..=whole.len() {
            std::fs::write(&path, &whole[..cut]).unwrap();
            let found = rows(dir.path()).unwrap();
            let lines = starts.iter().filter(|s| **s <= cut).count() - 1;
            assert_eq!(found.rows.len(), lines, "cut at {cut}");
            assert_eq!(found.torn, u64::from(!starts.contains(&cut)), "cut at {cut}");
            assert!(found.rows.values().all(|r| *r == row(r.index)));
        }
        // Damage in the middle costs that row alone.
        let mut damaged = whole.clone();
        damaged[starts[1] + 40] ^= 1;
        std::fs::write(&path, &damaged).unwrap();
        let (_, found) = Store::open(dir.path(), &identity()).unwrap();
        assert_eq!((found.rows.len(), found.torn), (2, 1));
        assert_eq!(rows(dir.path()).unwrap().torn, 0, "what was torn is gone");
    }

    #[test]
    fn prop_other_campaigns_shards_and_programs_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        drop(Store::open(dir.path(), &identity()).unwrap());
        let says = |other: Identity, needed: &str| {
            let error = format!("{:#}", Store::open(dir.path(), &other).unwrap_err());
            assert!(error.contains(needed), "{error}");
        };
        says(Identity { digest: "e".into(), ..identity() }, "another campaign");
        says(Identity { shard: [2, 3], ..identity() }, "holds shard 1/1 and not 2/3");
        says(Identity { sample: true, ..identity() }, "another selection");
        let program = Program { source: "other".into(), ..Program::current() };
        says(Identity { program, ..identity() }, "another program");
        std::fs::write(dir.path().join(IDENTITY), "{").unwrap();
        says(identity(), "damaged");
    }
}
