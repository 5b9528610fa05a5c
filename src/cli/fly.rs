//! `haltere fly`.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::anyhow;
use clap::Args;

use super::programs::BuiltIn;
use super::{print, print_json};
use crate::checks::Problems;
use crate::config::{Loaded, Sources};
use crate::live;

/// Where the configuration comes from.
#[derive(Debug, Args)]
pub(super) struct Configuration {
    /// Configuration file; several may be given, later ones win. Default: haltere.toml in the
    /// working directory, if there is one.
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// One value, for example control.version=raw. Wins over files and environment.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl Configuration {
    pub(super) fn load(self) -> anyhow::Result<Loaded> {
        self.read().map_err(|problems| {
            anyhow!("the configuration is refused (`haltere check` examines it):\n{problems}")
        })
    }

    /// The same, with all that is wrong one by one.
    pub(super) fn read(self) -> Result<Loaded, Problems> {
        Loaded::load(&Sources::new(self.config, self.set))
    }
}

/// Flies.
#[derive(Debug, Args)]
pub(super) struct Fly {
    #[command(flatten)]
    configuration: Configuration,
    /// Print the summary at the end as JSON.
    #[arg(long)]
    json: bool,
}

impl Fly {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let loaded = self.configuration.load()?;
        for file in &loaded.files {
            tracing::info!("read {}", file.display());
        }
        for note in &loaded.notes {
            tracing::warn!("{note}");
        }
        let programs = Box::new(BuiltIn::new(&loaded)?);
        let summary = live::run_with(&loaded, &live::Stop::default(), programs)?;
        if self.json {
            print_json(&summary)?;
        } else {
            let log = summary.log.as_ref().map(|path| path.display().to_string());
            print(&format!("log: {}\n", log.as_deref().unwrap_or("none")));
            print(&format!(
                "wake-ups: {}, late by more than 5 ms: {}, worst {:.1} ms\n",
                summary.wake_ups,
                summary.late_wake_ups,
                summary.worst_lateness_s * 1e3
            ));
            for (link, reason, count) in &summary.drops {
                print(&format!("lost on link {link}: {reason} {count}\n"));
            }
        }
        match summary.recording_error {
            Some(error) => Err(anyhow!(error)),
            None => Ok(ExitCode::SUCCESS),
        }
    }
}
