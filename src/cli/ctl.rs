//! `haltere ctl`: a small ground station for scripts.

use std::io::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::output::print;
use crate::ctl::{self, Action, Place, Target, Wanted};
use crate::sources::read_key;

/// Talks to a running companion as any ground station does.
#[derive(Debug, Args)]
pub(super) struct Ctl {
    /// Where the companion's ground endpoint leads: udpin:HOST:PORT, udpout:HOST:PORT or
    /// tcpout:HOST:PORT. Default: udpin:127.0.0.1:14550.
    #[arg(long, value_name = "ADDR")]
    to: Option<String>,
    /// Of several vehicles there the one with this system id.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=254))]
    system: Option<u8>,
    /// Of several vehicles there the one that speaks from this address, as the error about them names it.
    #[arg(long, value_name = "IP[:PORT]")]
    from: Option<Place>,
    /// Signs with the key in this file, which must be private (mode 600).
    #[arg(long, value_name = "FILE")]
    signing_key: Option<PathBuf>,
    #[command(subcommand)]
    action: Action,
}

impl Ctl {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let prints = matches!(self.action, Action::Status { .. } | Action::Items { .. });
        let key = self.signing_key.as_deref().map(read_key).transpose()?;
        let wanted = Wanted { system: self.system, from: self.from };
        let note = |line: &str| {
            let _ = writeln!(std::io::stderr(), "{line}");
        };
        let mut printed = Ok(());
        let say = |line: &str| match prints {
            true if printed.is_ok() => printed = print(&format!("{line}\n")),
            true => {}
            false => note(line),
        };
        let target = Target { to: self.to, wanted, key };
        ctl::run(target, &self.action, say, note)?;
        printed.map(|()| ExitCode::SUCCESS)
    }
}
