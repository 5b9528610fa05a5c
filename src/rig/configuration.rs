//! The companion's configuration, for an endpoint that runs.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use haltere_model::Vehicle;

use crate::simulated::scenario::Scenario;

/// What the companion has to be told.
#[derive(Debug)]
pub struct Wiring<'a> {
    /// The tag's device.
    pub tag: &'a str,
    /// What the tag speaks.
    pub tag_protocol: &'a str,
    /// The board's address.
    pub board: &'a str,
    /// Endpoints for stations.
    pub endpoints: &'a [String],
    /// Folder for logs.
    pub logs: &'a Path,
}

impl Wiring<'_> {
    /// Writes configuration and anchors into `folder`; the path of the former.
    pub fn write(&self, folder: &Path, scenario: &Scenario, by: &str) -> Result<PathBuf> {
        let gear_m = Vehicle::default().body.gear_m;
        let profile = scenario.companion_board();
        let profile =
            profile.map(|[name, _]| format!("profile = \"{name}\"\n")).unwrap_or_default();
        let mut config = String::new();
        let _ = write!(
            config,
            "# Written by `{by}`.\n\
             [tag]\nport = \"{}\"\nprotocol = \"{}\"\n\n\
             [board]\naddress = \"{}\"\n{profile}north_offset_deg = {:?}\n\n\
             [ground]\nendpoints = {:?}\n\n\
             [anchors]\nfile = \"anchors.toml\"\n\n\
             # The vehicle stands on the floor at the height of its gear: near the floor ranging\n\
             # alone tells height badly.\n\
             [flight]\ngear_height_m = {gear_m:?}\n\n\
             [estimator]\nrest_height_m = {gear_m:?}\n\n\
             [record]\ndirectory = \"{}\"\n\n\
             # Nothing of an earlier flight.\n\
             [store]\ndirectory = \"\"\n",
            self.tag,
            self.tag_protocol,
            self.board,
            scenario.told.north_offset_deg(scenario.board.north_offset_deg.unwrap_or(0.0)),
            self.endpoints,
            self.logs.display(),
        );
        let file = folder.join("haltere.toml");
        write_file(&file, &config)?;
        write_file(&folder.join("anchors.toml"), &scenario.anchors_toml())?;
        Ok(file)
    }
}

fn write_file(path: &Path, text: &str) -> Result<()> {
    Ok(haltere_log::written::write::<&Path>(path, text, &[])?)
}
