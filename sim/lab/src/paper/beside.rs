//! The steps of table 3 in another world, as a program of the laboratory writes them for `--beside`.

use std::path::Path;

use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};

use super::table_3::{Flown, WINDOWS_S};

/// The steps as another world flew them; what is read was checked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Beside {
    /// What world it is.
    pub world: String,
    /// Windows of the errors, s: a file of other windows is refused.
    pub windows_s: Vec<usize>,
    /// By repetition.
    pub raw: Vec<Flown>,
    /// By repetition, on the same seeds.
    pub modified: Vec<Flown>,
}

impl Beside {
    /// Reads what the laboratory wrote.
    pub fn read(path: &Path) -> Result<Self> {
        let place = path.display();
        let text = std::fs::read_to_string(path).with_context(|| format!("{place}"))?;
        let found: Self = serde_json::from_str(&text).with_context(|| {
            format!("{place}: not what `haltere-lab beside` writes; write it anew")
        })?;
        let Self { windows_s, raw, modified, .. } = &found;
        if windows_s[..] != WINDOWS_S {
            bail!(
                "{place}: windows_s = {windows_s:?}, allowed {WINDOWS_S:?}; write it anew with this version's `haltere-lab beside`"
            );
        }
        if raw.is_empty() || raw.len() != modified.len() {
            bail!(
                "{place}: {} flights of raw and {} of modified, allowed as many of both, at least one",
                raw.len(),
                modified.len()
            );
        }
        if let Some(k) = raw.iter().chain(modified).position(|f| !f.is_whole()) {
            bail!("{place}: flight {k} lacks an error, or one is no number above 0; write it anew");
        }
        Ok(found)
    }
}
