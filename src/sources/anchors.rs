//! The anchor file on the disk.

use std::path::Path;

use haltere_core::checks::Problems;
use haltere_core::survey::Survey;
use haltere_pilot::settings::parse_anchors;

/// Reads and checks an anchor file.
pub fn read_anchors(path: &Path) -> Result<Survey, Problems> {
    let name = path.display();
    let text = haltere_log::intake::text(path, super::layers::MOST_BYTES).map_err(|error| {
        Problems::one(format!(
            "{name}: the anchor survey cannot be read: {error}; write one as in \
             config/anchors.toml, or let `haltere init` do it, and name it in anchors.file"
        ))
    })?;
    parse_anchors(&name.to_string(), &text)
}
