//! `haltere fly`.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Error, anyhow};
use clap::Args;

use super::output::FAILED;
use super::programs::BuiltIn;
use crate::live::console::{self, Console};
use crate::live::signals::{ENDED_ARMED, Signals};
use crate::live::{self, RunSummary, realtime};
use crate::sources::{Loaded, Sources};
use haltere_core::checks::Problems;
use haltere_core::drops::DropReason;
use haltere_core::survey::Survey;

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
        self.read().map_err(refused)
    }

    /// The same; where nothing is told, in this room.
    pub(super) fn load_or_in(self, room: Survey) -> anyhow::Result<Loaded> {
        Loaded::load_or_in(&Sources::new(self.config, self.set), room).map_err(refused)
    }

    /// The same, with all that is wrong one by one.
    pub(super) fn read(self) -> Result<Loaded, Problems> {
        Loaded::load(&Sources::new(self.config, self.set))
    }
}

fn refused(problems: Problems) -> anyhow::Error {
    anyhow!("the configuration is refused (`haltere check` examines it):\n{problems}")
}

/// Flies.
#[derive(Debug, Args)]
pub(super) struct Fly {
    #[command(flatten)]
    configuration: Configuration,
    /// Watch beside somebody else who flies: estimate, record what would be sent, send nothing that arms or
    /// moves (flight.shadow = true).
    #[arg(long)]
    shadow: bool,
    /// Print the summary at the end as JSON.
    #[arg(long)]
    json: bool,
}

impl Fly {
    pub(super) fn run(mut self, nice: Option<i32>) -> ExitCode {
        if self.shadow {
            // The last word counts, whatever files and other values say.
            self.configuration.set.push("flight.shadow=true".to_owned());
        }
        // Before any other thread begins: all of them are to leave signals alone, and the stacks of those that
        // come later are not read in whole.
        let held = Signals::hold();
        let loaded = self.configuration.load();
        let locked = loaded
            .as_ref()
            .is_ok_and(|loaded| loaded.config.timing.lock_memory)
            .then(realtime::lock_memory);
        let console = Console::start();
        super::output::be_nice(nice);
        match locked {
            Some(Ok(())) => tracing::info!("memory locked"),
            Some(Err(why)) => tracing::warn!("{why}"),
            None => {}
        }
        let ended = held.map_err(Error::from).and_then(|signals| fly(signals, loaded?, self.json));
        let code = ended.unwrap_or_else(|error| {
            console::say_last(std::io::stderr(), format!("haltere: {error:#}\n"));
            ExitCode::from(FAILED)
        });
        drop(console);
        code
    }
}

fn fly(signals: Signals, loaded: Loaded, as_json: bool) -> anyhow::Result<ExitCode> {
    let stop = live::Stop::default();
    signals.serve(stop.clone())?;
    for file in &loaded.files {
        tracing::info!("read {}", file.display());
    }
    for note in &loaded.notes {
        tracing::warn!("{note}");
    }
    for endpoint in &loaded.config.ground.endpoints {
        tracing::info!("stations: {}", endpoint.address.for_client());
    }
    let programs = Box::new(BuiltIn::new(&loaded)?);
    let summary = live::run_with(&loaded, &stop, programs)?;
    let told =
        if as_json { serde_json::to_string_pretty(&summary)? + "\n" } else { in_words(&summary) };
    console::say_last(std::io::stdout(), told);
    if summary.ended_armed {
        tracing::error!("ended while armed: the board's own failsafe is in charge");
        return Ok(ExitCode::from(ENDED_ARMED));
    }
    match summary.recording_error {
        Some(error) => Err(anyhow!(error)),
        None => Ok(ExitCode::SUCCESS),
    }
}

fn in_words(summary: &RunSummary) -> String {
    let log = summary.log.as_ref().map(|path| path.display().to_string());
    let earlier = summary.earlier_logs.iter().map(|path| format!("log: {}\n", path.display()));
    let mut words = earlier.collect::<String>();
    let _ = write!(
        words,
        "log: {}\nwake-ups: {}, late by more than 5 ms: {}, worst {:.1} ms\n",
        log.as_deref().unwrap_or("none"),
        summary.wake_ups,
        summary.late_wake_ups,
        summary.worst_lateness_s * 1e3
    );
    for (link, reason, count) in &summary.drops {
        let _ =
            writeln!(words, "{}", DropReason::in_words(reason, *count, &format!("link {link}")));
    }
    words
}
