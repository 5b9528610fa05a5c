//! `haltere ctl`: a small ground station for scripts.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::print;
use crate::ctl::{self, Action};
use crate::sources::read_key;

/// Talks to a running companion as any ground station does.
#[derive(Debug, Args)]
pub(super) struct Ctl {
    /// Where the companion's ground endpoint leads: udpin:HOST:PORT, udpout:HOST:PORT or
    /// tcpout:HOST:PORT.
    #[arg(long, value_name = "ADDR", default_value = "udpin:127.0.0.1:14550")]
    to: String,
    /// Signs with the key in this file, which must be private (mode 600).
    #[arg(long, value_name = "FILE")]
    signing_key: Option<PathBuf>,
    #[command(subcommand)]
    action: Action,
}

impl Ctl {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let status = matches!(self.action, Action::Status { .. });
        let key = self.signing_key.as_deref().map(read_key).transpose()?;
        ctl::run(&self.to, key, &self.action, |line| {
            if status {
                print(&format!("{line}\n"));
            } else {
                let _ = writeln!(std::io::stderr(), "{line}");
            }
        })?;
        Ok(ExitCode::SUCCESS)
    }
}
