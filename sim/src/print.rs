//! `haltere-sim print`: scenarios, campaigns and vehicles that come with the program.

use anyhow::{Context as _, Result};
use haltere::simulated::built_in::{self, Kind};

/// `haltere-sim print`
#[derive(Debug, clap::Args)]
pub struct Print {
    /// What.
    #[arg(value_enum)]
    kind: Kind,
    /// Which; without it their names are printed.
    name: Option<String>,
}

impl Print {
    /// Prints it to standard output.
    pub fn run(&self) -> Result<()> {
        let text = match &self.name {
            Some(name) => built_in::text(self.kind, name).context("print")?,
            None => self.kind.names().iter().map(|name| format!("{name}\n")).collect(),
        };
        haltere::cli::print(&text)?;
        Ok(())
    }
}
