//! `haltere gap`: one variant, one line in `run` and one file beside this one per subcommand.

use std::process::ExitCode;

use clap::Subcommand;

use super::{gap_balance, gap_sight};

/// Diagnosis of the gap between flights and the nominal model.
#[derive(Debug, Subcommand)]
pub(super) enum Gap {
    /// Force balance of recorded flights with motion capture.
    Balance(gap_balance::Balance),
    /// Blocked lines of sight in recorded UWB flights with motion capture.
    Sight(gap_sight::Sight),
}

impl Gap {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        match self {
            Gap::Balance(balance) => balance.run(),
            Gap::Sight(sight) => sight.run(),
        }
    }
}
