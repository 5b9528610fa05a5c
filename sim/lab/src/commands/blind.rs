//! `haltere-lab blind`: scores a sealed suite.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use haltere::cli::gap::{BankOptions, SceneOptions};
use haltere::cli::{print, print_json};
use haltere_gap::attribute::Settings;
use haltere_gap::scene::{Scene, Told};

use crate::blind::{BlindResult, Choice, run};
use crate::score::Score;

/// Scores a sealed suite of flights (`haltere-lab cases`) against its key, which is opened only when
/// every case has been answered.
#[derive(Debug, Args)]
pub struct Blind {
    /// Folder of the suite.
    dir: PathBuf,
    /// Only the fixed stratified tenth.
    #[arg(long)]
    tenth: bool,
    /// The lockbox too: at releases only.
    #[arg(long)]
    lockbox: bool,
    /// Only so many accepted flights, and none kept for limits alone: what a user has. By default all of the suite.
    #[arg(long, value_name = "N")]
    references: Option<usize>,
    /// Flies held-out missions with what was named, and measures the shrink.
    #[arg(long)]
    shrink: bool,
    /// Scores the answers of another method, one JSON object a line, in place of our own.
    #[arg(long, value_name = "FILE")]
    answers: Option<PathBuf>,
    /// Takes every effect out of the library in turn and diagnoses its flights without it.
    #[arg(long, conflicts_with_all = ["answers", "shrink", "references"])]
    withhold_each: bool,
    /// Fails when a score is surely lower: `top_1=0.4` asks that the upper 95 % limit of top-1 is at
    /// least 0.4, `false_alarm=0.1` that the lower limit of false alarms is at most 0.1.
    #[arg(long, value_name = "SCORE=SHARE", value_parser = demand)]
    demand: Vec<(String, f64)>,
    #[command(flatten)]
    told: SceneOptions,
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
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let lab = Scene::lab().map_err(anyhow::Error::new)?;
        let told = self.told.told()?;
        let told = Told { room: told.room.or(Some(lab.room)), ..told };
        let mut settings = Settings::for_flights();
        if !self.set.is_empty() {
            settings = toml::from_str::<Settings>(&self.set.join("\n"))?.beside_flights();
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
            references: self.references,
            shrink: self.shrink,
            withheld: self.options.without.clone(),
            size: self.options.size(),
            settings,
            outside: self.answers.clone(),
        };
        let tell = |line: String| eprintln!("{line}");
        if self.withhold_each {
            let folder = self.options.folder();
            let result = crate::withheld::run(&self.dir, &folder, &told, &choice, &tell)?;
            if self.json {
                print_json(&result)?;
            } else {
                print(&result.table())?;
            }
            return Ok(ExitCode::SUCCESS);
        }
        let result = run(&self.dir, &self.options.folder(), &told, &choice, &tell)?;
        if self.json {
            print_json(&result)?;
        } else {
            print(&text(&result))?;
        }
        let missed = missed(&result.score, &self.demand);
        for line in &missed {
            eprintln!("{line}");
        }
        Ok(if missed.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
    }
}

/// Scores that can be demanded, and whether more is better.
const DEMANDED: [(&str, bool); 6] = [
    ("top_1", true),
    ("top_3", true),
    ("subsystem", true),
    ("covered", true),
    ("false_alarm", false),
    ("known_rejected", false),
];

fn demand(text: &str) -> Result<(String, f64), String> {
    let known = || DEMANDED.map(|(name, _)| name).join(", ");
    let (name, share) = text.split_once('=').ok_or("expected SCORE=SHARE")?;
    if !DEMANDED.iter().any(|(known, _)| *known == name) {
        return Err(format!("no score {name:?}, there are {}", known()));
    }
    let share: f64 = share.parse().map_err(|e| format!("{share:?}: {e}"))?;
    if !(0.0..=1.0).contains(&share) {
        return Err(format!("{share}: a share lies between 0 and 1"));
    }
    Ok((name.to_owned(), share))
}

/// Demands that the limits of a score exclude.
fn missed(score: &Score, demands: &[(String, f64)]) -> Vec<String> {
    demands
        .iter()
        .filter_map(|(name, share)| {
            let found = match name.as_str() {
                "top_1" => score.top_1,
                "top_3" => score.top_3,
                "subsystem" => score.subsystem,
                "covered" => score.covered,
                "false_alarm" => score.false_alarm,
                _ => score.known_rejected,
            };
            let (_, more) = DEMANDED.iter().find(|(known, _)| known == name)?;
            let met = if *more { found.high >= *share } else { found.low <= *share };
            let limits = format!("95 % limits {:.3} to {:.3}", found.low, found.high);
            (!met).then(|| {
                format!("{name}: {} of {}, {limits}, {share} demanded", found.hits, found.of)
            })
        })
        .collect()
}

fn text(r: &BlindResult) -> String {
    use std::fmt::Write;
    let mut out = r.score.table();
    let _ = writeln!(out, "right anchor            {} of {}", r.anchor_hits, r.anchor_of);
    for (name, shrink) in [
        ("shrink, as named", &r.shrink),
        ("shrink, true effect", &r.attainable),
        ("shrink, retuned", &r.retuned),
    ] {
        let Some(s) = shrink else { continue };
        let value = s.value.map_or("nothing to shrink".to_owned(), |v| format!("{v:.3}"));
        let interval = s.interval.map_or(String::new(), |[a, b]| format!(" ({a:.3} to {b:.3})"));
        let _ = writeln!(
            out,
            "{name:<24}{value}{interval}: {:.2} to {:.2}, floor {:.2}",
            s.before, s.after, s.floor
        );
    }
    if r.shrink.is_some() {
        let _ = writeln!(out, "distance of held-out flights: before, as named, true, retuned");
        for (truth, said, [before, named, right, retuned]) in &r.shrink_flights {
            let _ = writeln!(
                out,
                "  {truth:<4} named {said:<4} {before:8.2} {named:8.2} {right:8.2} {retuned:8.2}"
            );
        }
        let _ = writeln!(out, "named effects that help at no size when flown: {}", r.unhelpful);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::score::Share;

    #[test]
    fn val_demands_are_held_against_the_limits() {
        let score =
            Score { top_1: Share::new(12, 25), false_alarm: Share::new(2, 12), ..Score::default() };
        let of = |text: &str| missed(&score, &[demand(text).unwrap()]).len();
        assert_eq!((of("top_1=0.6"), of("top_1=0.9")), (0, 1));
        assert_eq!((of("false_alarm=0.1"), of("false_alarm=0.01")), (0, 1));
        assert!(demand("top_2=0.5").is_err() && demand("top_1=2").is_err());
    }
}
