//! `haltere replay`: flight logs.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::output::{FAILED, print, print_json};
use haltere_log::replay;

/// Lives through flights again and says whether the same goes out.
///
/// The build that wrote a log must send every byte of it again. For a log of another build each message is looked
/// for among those of its link and kind, numbers within a tolerance, so that one message more does not move the
/// rest. Either way it is said whether the setpoints for the board differ, or only other traffic does: `gap
/// diagnose` rests on the setpoints alone, and judges those recorded where another build flew.
///
/// Exit codes: 0 reproduced; 1 a log cannot be replayed; 3 outputs differ; 4 the log has a hole
/// or no outputs, so that not all could be checked.
#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 reproduced; 1 a log cannot be replayed; 3 outputs differ; 4 not \
                        everything could be checked."
)]
pub(super) struct Replay {
    /// Flight logs.
    #[arg(required = true)]
    log: Vec<PathBuf>,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

impl Replay {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let mut worst = 0;
        let mut reports = Vec::new();
        for log in &self.log {
            match replay::replay(log) {
                Ok(report) => {
                    worst = worst.max(report.exit_code());
                    if !self.json {
                        print(&report.to_string())?;
                    }
                    reports.push(report);
                }
                Err(error) => {
                    tracing::error!("{error}");
                    worst = worst.max(FAILED);
                }
            }
        }
        if self.json {
            print_json(&reports)?;
        }
        Ok(ExitCode::from(worst))
    }
}
