//! Where the recorded flights of others lie that tests run on: they are no part of the repository.

use std::path::{Path, PathBuf};

/// The recordings in the UTIL layout.
pub fn util() -> Option<PathBuf> {
    holds("util", "anchors.csv")
}

/// Recordings of the vehicle, with command and voltage.
pub fn flapper() -> Option<PathBuf> {
    holds("flapper_swarm3d", "")
}

/// Real flights with known causes.
pub fn crazypad() -> Option<PathBuf> {
    holds("crazypad", "motor_data")
}

/// The folder of this name, if it has this file: beside the checkout or beside the folder of checkouts.
fn holds(folder: &str, file: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    ["../shared/data", "../../shared/data"]
        .iter()
        .map(|up| root.join(up).join(folder))
        .find(|dir| dir.join(file).exists())
}

/// Where a crate moves and its paths do not, no recording is found, and every test on them passes.
#[test]
fn prop_recordings_are_looked_for_from_the_root() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    assert!(root.join("ARCHITECTURE.md").exists(), "{}", root.display());
}
