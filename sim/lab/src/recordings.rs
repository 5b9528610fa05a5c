//! Where the recorded flights of others lie that tests run on: they are no part of the repository.

use std::path::{Path, PathBuf};

/// The recordings in the UTIL layout, beside the checkout or beside the folder of checkouts.
pub fn util() -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    ["../shared/data/util", "../../shared/data/util"]
        .iter()
        .map(|up| root.join(up))
        .find(|dir| dir.join("anchors.csv").exists())
}

/// Where a crate moves and its paths do not, no recording is found, and every test on them passes.
#[test]
fn prop_recordings_are_looked_for_from_the_root() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    assert!(root.join("ARCHITECTURE.md").exists(), "{}", root.display());
}
