//! Shards of one campaign become the whole.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use super::row::Row;
use super::store::{self, Identity};

/// Merges the shards in these folders, in any order, into a new folder `out`. How many flights came to what.
pub fn merge(shards: &[PathBuf], out: &Path) -> Result<String> {
    let (identity, rows) = gather(shards)?;
    store::write_all(out, &identity, &rows)?;
    let again = format!("haltere-sim campaign FILE # {}", identity.name);
    let rows: Vec<&Row> = rows.values().collect();
    super::write_results(out, &identity, &rows, &again)?;
    Ok(super::outcomes(&rows))
}

fn gather(folders: &[PathBuf]) -> Result<(Identity, BTreeMap<u64, Row>)> {
    let mut shards: BTreeMap<u64, PathBuf> = BTreeMap::new();
    let mut all = BTreeMap::new();
    let mut first: Option<Identity> = None;
    for folder in folders {
        let name = folder.display();
        let identity = store::identity(folder)?;
        if identity.sample {
            bail!("{name}: a sample is flown in one piece; there is nothing to merge");
        }
        let whole = first.get_or_insert_with(|| identity.clone());
        if let Some(why) = whole.differs(&identity) {
            bail!("{name} does not belong to {}: {why}", folders[0].display());
        }
        let [shard, of] = identity.shard;
        if of != whole.shard[1] {
            bail!(
                "{name}: shard {shard} of {of}, and {} is one of {}",
                folders[0].display(),
                whole.shard[1]
            );
        }
        if let Some(other) = shards.insert(shard, folder.clone()) {
            bail!("shard {shard} is there twice: {} and {name}", other.display());
        }
        let found = store::rows(folder)?;
        let wanted: Vec<u64> = super::selection(identity.flights, identity.shard, None).collect();
        let missing = wanted.iter().filter(|i| !found.rows.contains_key(i)).count();
        if missing > 0 {
            bail!(
                "{name}: {missing} of {} flights are not flown yet{}; run its command again",
                wanted.len(),
                if found.torn > 0 {
                    format!(", {} rows are torn", found.torn)
                } else {
                    String::new()
                }
            );
        }
        all.extend(found.rows);
    }
    let mut identity = first.context("no shard was named")?;
    let of = identity.shard[1];
    let missing: Vec<String> =
        (1..=of).filter(|i| !shards.contains_key(i)).map(|i| i.to_string()).collect();
    if !missing.is_empty() {
        bail!("shards {} of {of} are missing", missing.join(", "));
    }
    identity.shard = [1, 1];
    Ok((identity, all))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulated::campaign::store::{Program, Store};

    fn shard(
        root: &std::path::Path,
        name: &str,
        digest: &str,
        shard: [u64; 2],
        rows: &[u64],
    ) -> PathBuf {
        let identity = Identity {
            name: "x".into(),
            digest: digest.into(),
            flights: 6,
            shard,
            sample: false,
            program: Program::current(),
        };
        let path = root.join(name);
        let (mut store, _) = Store::open(&path, &identity).unwrap();
        rows.iter().for_each(|i| store.add(&Row::blank(*i, 0, BTreeMap::new())).unwrap());
        path
    }

    #[test]
    fn prop_shards_become_the_whole_or_are_refused_by_name() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str, d: &str, s, rows: &[u64]| shard(dir.path(), name, d, s, rows);
        let a = at("a", "d", [1, 3], &[0, 3]);
        let b = at("b", "d", [2, 3], &[1, 4]);
        let c = at("c", "d", [3, 3], &[2, 5]);
        let (identity, rows) = gather(&[c.clone(), a.clone(), b.clone()]).unwrap();
        assert_eq!(identity.shard, [1, 1]);
        assert_eq!(rows.keys().copied().collect::<Vec<_>>(), [0, 1, 2, 3, 4, 5]);
        let says = |folders: &[&PathBuf], needed: &str| {
            let folders: Vec<PathBuf> = folders.iter().map(|p| (*p).clone()).collect();
            let error = format!("{:#}", gather(&folders).unwrap_err());
            assert!(error.contains(needed), "{error}");
        };
        says(&[&a, &c], "shards 2 of 3 are missing");
        says(&[&a, &b, &c, &a], "shard 1 is there twice");
        says(&[&a, &at("other", "e", [2, 3], &[1, 4]), &c], "another campaign");
        says(&[&a, &at("short", "d", [2, 3], &[1]), &c], "1 of 2 flights are not flown yet");
        says(&[&a, &at("of2", "d", [2, 2], &[1, 3, 5])], "shard 2 of 2");
        says(&[&dir.path().join("nowhere")], "no campaign has been flown");
    }
}
