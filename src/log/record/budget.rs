//! What logs may take together. Only where the user has set a budget anything is removed, and then only logs that this
//! recorder wrote and closed, that hold neither a flight nor a program, and that are older than a day.

use std::fs::{self, File};
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use super::names::is_log_name;

/// Name of the metadata record at the end of a log in which nobody armed, and no station sent a mission or a program.
/// A log of an older build, one that was cut, recovered or trimmed has none, and stays.
pub(super) const UNEVENTFUL: &str = "haltere.uneventful";

/// Somebody may want to look at yesterday's.
const LEAST_AGE: Duration = Duration::from_secs(86_400);
/// End of a file: opcode and length of the footer, its data, magic.
const FOOTER_BYTES: u64 = 9 + 20 + 8;
/// Opcodes, as the MCAP specification numbers them.
const FOOTER: u8 = 0x02;
const METADATA_INDEX: u8 = 0x0d;
/// A longer index is of no log of ours: 500 bytes for each megabyte.
const MOST_INDEX_BYTES: u64 = 64 << 20;

/// What was removed, and what could not be.
#[derive(Debug, Default)]
pub(super) struct Tidied {
    pub removed: Vec<PathBuf>,
    pub removed_B: u64,
    pub failed: Option<(PathBuf, io::Error)>,
    /// What is left is more than the budget, bytes.
    pub over_B: u64,
}

/// Removes the oldest until all logs of the folder together are within the budget. `own` is being written; `go_on` is
/// asked before each file.
pub(super) fn tidy(
    folder: &Path,
    budget_B: u64,
    own: Option<&Path>,
    now: SystemTime,
    go_on: impl Fn() -> bool,
) -> io::Result<Tidied> {
    let mut logs = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        // A link is none of ours.
        let Ok(meta) = fs::symlink_metadata(&path) else { continue };
        if meta.is_file() && path.extension().is_some_and(|ending| ending == "mcap") {
            logs.push((path, meta));
        }
    }
    // By name: by the time of their beginning.
    logs.sort_by(|a, b| a.0.cmp(&b.0));
    let mut all_B: u64 = logs.iter().map(|(_, meta)| meta.len()).sum();
    let mut tidied = Tidied::default();
    let own = own.and_then(Path::file_name);
    for (path, meta) in logs {
        if all_B <= budget_B || !go_on() {
            break;
        }
        let name = path.file_name();
        let is_ours = name.and_then(|name| name.to_str()).is_some_and(is_log_name) && name != own;
        let age = meta.modified().ok().and_then(|t| now.duration_since(t).ok());
        if !is_ours || age.is_none_or(|age| age <= LEAST_AGE) || !is_uneventful(&path) {
            continue;
        }
        match fs::remove_file(&path) {
            Ok(()) => {
                all_B = all_B.saturating_sub(meta.len());
                tidied.removed_B += meta.len();
                tidied.removed.push(path);
            }
            Err(error) => tidied.failed = Some((path, error)),
        }
    }
    tidied.over_B = all_B.saturating_sub(budget_B);
    Ok(tidied)
}

/// Whether a log was closed, and says of itself that nothing happened in it. Whatever cannot be read says nothing.
pub(super) fn is_uneventful(path: &Path) -> bool {
    index_of(path).is_ok_and(|index| names(&index).any(|name| name == UNEVENTFUL))
}

/// The summary section.
fn index_of(path: &Path) -> io::Result<Vec<u8>> {
    let nonsense = || io::Error::from(io::ErrorKind::InvalidData);
    let mut file = File::open(path)?;
    let size = file.metadata()?.len();
    let ends = size.checked_sub(FOOTER_BYTES).ok_or_else(nonsense)?;
    let mut footer = [0; FOOTER_BYTES as usize];
    file.seek(SeekFrom::Start(ends))?;
    file.read_exact(&mut footer)?;
    let whole = footer.first() == Some(&FOOTER) && footer.ends_with(mcap::MAGIC);
    let start = footer.get(9..17).and_then(|bytes| bytes.try_into().ok()).map(u64::from_le_bytes);
    let start = start.filter(|start| whole && *start > 0).ok_or_else(nonsense)?;
    let length = ends.checked_sub(start).filter(|n| *n <= MOST_INDEX_BYTES).ok_or_else(nonsense)?;
    file.seek(SeekFrom::Start(start))?;
    let mut index = Vec::new();
    file.take(length).read_to_end(&mut index)?;
    Ok(index)
}

/// Names of the metadata records that an index lists.
fn names(mut index: &[u8]) -> impl Iterator<Item = String> + '_ {
    std::iter::from_fn(move || {
        loop {
            let (code, rest) = index.split_first()?;
            let length = u64::from_le_bytes(rest.get(..8)?.try_into().ok()?);
            let body = rest.get(8..)?;
            let length = usize::try_from(length).ok().filter(|n| *n <= body.len())?;
            let (record, rest) = body.split_at(length);
            index = rest;
            if *code == METADATA_INDEX
                && let Ok(mcap::records::Record::MetadataIndex(found)) =
                    mcap::parse_record(*code, record)
            {
                return Some(found.name);
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::session;
    use super::super::{Limits, Recorder, recover};
    use super::*;
    use haltere_core::time::HostTime;
    use haltere_pilot::Input;

    fn log(folder: &Path, eventful: bool) -> PathBuf {
        let mut recorder = Recorder::within(Limits::default(), folder, &session()).unwrap();
        recorder.input(HostTime::from_us(5_000_000), Input::Wake);
        if eventful {
            recorder.set_eventful();
        }
        recorder.finish().path.unwrap()
    }

    fn age(path: &Path, hours: u64) {
        let then = SystemTime::now() - Duration::from_secs(3600 * hours);
        File::options().append(true).open(path).unwrap().set_modified(then).unwrap();
    }

    fn removed(folder: &Path, budget_B: u64, own: Option<&Path>) -> Vec<PathBuf> {
        tidy(folder, budget_B, own, SystemTime::now(), || true).unwrap().removed
    }

    #[test]
    fn regress_only_old_closed_logs_of_ours_without_a_flight_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let [first, flown, second, young, own] =
            [false, true, false, false, false].map(|eventful| log(folder, eventful));
        let cut = log(folder, false);
        let bytes = std::fs::read(&cut).unwrap();
        std::fs::write(&cut, &bytes[..bytes.len() - 10]).unwrap();
        // What somebody else put there, under a name of his own, or a link.
        let renamed = folder.join("bench.mcap");
        std::fs::copy(&first, &renamed).unwrap();
        let linked = folder.join("20200101-000000-00.mcap");
        std::os::unix::fs::symlink(&flown, &linked).unwrap();
        let recovered = folder.join("20200101-000000-01.mcap");
        recover(&first, &recovered).unwrap();
        for path in [&first, &flown, &second, &own, &cut, &renamed, &recovered] {
            age(path, 25);
        }
        age(&young, 23);
        // Within the budget nothing goes.
        assert!(removed(folder, 1 << 30, Some(&own)).is_empty());
        // The oldest first, and no more than it takes.
        let all: u64 = std::fs::read_dir(folder)
            .unwrap()
            .map(|entry| std::fs::symlink_metadata(entry.unwrap().path()).unwrap())
            .filter(|meta| meta.is_file())
            .map(|meta| meta.len())
            .sum();
        assert_eq!(removed(folder, all - 1, Some(&own)), [first]);
        assert_eq!(removed(folder, 0, Some(&own)), [second]);
        for kept in [flown, young, own, cut, renamed, linked, recovered] {
            assert!(kept.exists(), "{}", kept.display());
        }
    }

    #[test]
    fn prop_no_damage_makes_a_flight_uneventful_or_panics() {
        let folder = tempfile::tempdir().unwrap();
        let path = log(folder.path(), true);
        assert!(!is_uneventful(&path));
        let bytes = std::fs::read(&path).unwrap();
        let damaged = folder.path().join("damaged.mcap");
        // The index lies at the end.
        let index = bytes.len().saturating_sub(1000);
        for at in (0..index).step_by(997).chain((index..bytes.len()).step_by(7)) {
            let mut other = bytes.clone();
            other[at] ^= 0xff;
            std::fs::write(&damaged, &other).unwrap();
            assert!(!is_uneventful(&damaged), "byte {at}");
            std::fs::write(&damaged, &bytes[..at]).unwrap();
            assert!(!is_uneventful(&damaged), "cut at {at}");
        }
    }
}
