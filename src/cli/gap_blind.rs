//! `haltere gap blind`: scores a sealed suite.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::gap::{BankOptions, RoomOptions};
use super::{print, print_json};
use crate::gap::attribute::Settings;
use crate::gap::blind::{BlindResult, Choice, run};
use crate::gap::scene::Scene;

/// Scores a sealed suite of flights (`haltere-sim cases`) against its key, which is opened only when
/// every case has been answered.
#[derive(Debug, Args)]
pub(super) struct Blind {
    /// Folder of the suite.
    dir: PathBuf,
    /// Only the fixed stratified tenth.
    #[arg(long)]
    tenth: bool,
    /// The lockbox too: at releases only.
    #[arg(long)]
    lockbox: bool,
    /// Without the reference flights of the airframe.
    #[arg(long)]
    without_references: bool,
    /// Flies held-out missions with what was named, and measures the shrink.
    #[arg(long)]
    shrink: bool,
    #[command(flatten)]
    room: RoomOptions,
    #[command(flatten)]
    options: BankOptions,
    /// Choices of the attribution, key=value in TOML, for experiments.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

impl Blind {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let lab = Scene::lab().map_err(anyhow::Error::new)?;
        let room = self.room.room()?.unwrap_or(lab.room);
        let mut settings = Settings { jittered: true, ..Settings::default() };
        if !self.set.is_empty() {
            settings = toml::from_str(&self.set.join("\n"))?;
            settings.jittered = true;
        }
        self.options.library()?;
        if !self.options.only.is_empty() {
            anyhow::bail!(
                "--only: a suite is scored with the whole library; use --without ID to withhold one"
            );
        }
        let choice = Choice {
            tenth: self.tenth,
            lockbox: self.lockbox,
            without_references: self.without_references,
            shrink: self.shrink,
            withheld: self.options.without.clone(),
            size: self.options.size(),
            settings,
        };
        let tell = |line: String| eprintln!("{line}");
        let result = run(&self.dir, &self.options.folder(), &room, &choice, &tell)?;
        if self.json {
            print_json(&result)?;
        } else {
            print(&text(&result));
        }
        Ok(ExitCode::SUCCESS)
    }
}

fn text(r: &BlindResult) -> String {
    use std::fmt::Write;
    let mut out = r.score.table();
    let _ = writeln!(out, "right anchor            {} of {}", r.anchor_hits, r.anchor_of);
    for (name, shrink) in [("shrink, as named", &r.shrink), ("shrink, true effect", &r.attainable)]
    {
        let Some(s) = shrink else { continue };
        let value = s.value.map_or("nothing to shrink".to_owned(), |v| format!("{v:.3}"));
        let interval = s.interval.map_or(String::new(), |[a, b]| format!(" ({a:.3} to {b:.3})"));
        let _ = writeln!(
            out,
            "{name:<24}{value}{interval}: {:.2} to {:.2}, floor {:.2}",
            s.before, s.after, s.floor
        );
    }
    if let Some(plain) = &r.plain {
        let _ = writeln!(out, "plain missions:\n{}", plain.table());
    }
    for fault in &r.faults {
        let _ = writeln!(out, "not judged: {fault}");
    }
    let _ = writeln!(
        out,
        "{} cases of {}, {} reference flights; {:.1} s a case, {:.0} s for banks and learning",
        r.cases, r.generator, r.references, r.seconds_per_case, r.seconds_learning
    );
    out
}
